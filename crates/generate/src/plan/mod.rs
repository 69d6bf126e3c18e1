//! A plan: clips on a timeline, from which one dance is made. docs/plans.md.
//!
//! The clips are laid into one file on the rig of one of them (`lay`, `compose`), and what none of them gives is made
//! anew, as in any edit of a clip. `draw` shows a plan as text.

mod compose;
mod draw;
mod lay;
mod told;

pub use draw::timeline;
pub use lay::{Laid, Placed};

use crate::{Error, Result};
use kinelm_corpus::sidecar;
use kinelm_motion::format::{ReadOptions, RestFrame, Unit, Up};
use kinelm_motion::moment::Moment;
use kinelm_store::input;
use lay::Fault;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// What a plan file says, its paths as they are found from here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// The clip on whose rig, at whose rate and on whose floor the dance is written.
    pub rig: String,
    /// How long what is made anew is where one clip goes over into another.
    #[serde(default = "over_s")]
    pub over: At,
    /// How long the dance is; up to the end of the last segment if not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<At>,
    /// The clips by the names that the plan has for them.
    pub clips: BTreeMap<String, PlanClip>,
    /// What is given when.
    #[serde(rename = "segment")]
    pub segments: Vec<Segment>,
}

fn over_s() -> At {
    At(Moment::Seconds(1.0))
}

/// A clip, and how it is read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanClip {
    /// The file.
    pub file: PathBuf,
    /// Its true rate, where it states it wrongly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fps_source: Option<f64>,
    /// Frames at its beginning that are left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skip: Option<usize>,
    /// Of a BVH.
    #[serde(default)]
    pub unit: Unit,
    /// Which axis is up.
    #[serde(default)]
    pub up: Up,
    /// Which joint is which: a map's name or file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<String>,
    /// Where its floor is, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<f64>,
}

impl PlanClip {
    /// How the file is read.
    pub fn options(&self) -> ReadOptions {
        let (fps_source, skip, unit, up) = (self.fps_source, self.skip.unwrap_or(0), self.unit, self.up);
        let (map, floor) = (self.map.clone(), self.floor);
        ReadOptions { fps_source, skip, unit, up, map, floor, rest: RestFrame::Drop, ..ReadOptions::default() }
    }

    /// What isn't said of it, of a dance as its sidecar says; and that in words.
    ///
    /// # Errors
    /// Those of [`sidecar::reading_of`].
    fn ask_sidecar(&mut self) -> Result<Option<String>> {
        let Some(told) = sidecar::reading_of(&self.file)? else { return Ok(None) };
        self.fps_source = self.fps_source.or(told.fps_source);
        self.skip = self.skip.or(Some(told.skip).filter(|skip| *skip > 0));
        self.unit = if self.unit == Unit::Auto { told.unit } else { self.unit };
        self.up = if self.up == Up::Auto { told.up } else { self.up };
        self.map = self.map.take().or(told.map.clone());
        self.floor = self.floor.or(told.floor);
        Ok(sidecar::in_words(&told, &self.options()))
    }
}

/// Joints of a clip over a time of the dance, what the model is told then, or both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// The clip's name in the plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clip: Option<String>,
    /// As [`kinelm_motion::joints::parse`] takes them, or as the clip's rig names its own.
    #[serde(default = "all_joints")]
    pub joints: String,
    /// From when on in the dance.
    pub from: At,
    /// Until when, half-open.
    pub to: At,
    /// Where in the clip it begins.
    #[serde(default)]
    pub at: At,
    /// What the model is told of this time, by fields.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub labels: BTreeMap<String, String>,
}

fn all_joints() -> String {
    "all".into()
}

/// A moment, as a number of seconds or a text such as `2.5s`, `40f`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct At(pub Moment);

impl Default for At {
    fn default() -> At {
        At(Moment::Seconds(0.0))
    }
}

impl Serialize for At {
    fn serialize<S: Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        to.collect_str(&self.0)
    }
}

impl<'de> Deserialize<'de> for At {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<At, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "a value that is no time (seconds, as 2.5 or \"2.5s\", or frames, as \"40f\")")]
        enum Either {
            Whole(i64),
            Number(f64),
            Text(String),
        }
        match Either::deserialize(from)? {
            Either::Whole(s) => Ok(At(Moment::Seconds(s as f64))),
            Either::Number(s) => Ok(At(Moment::Seconds(s))),
            Either::Text(text) => text.parse().map(At).map_err(serde::de::Error::custom),
        }
    }
}

/// The same with the places of its segments in the text.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanFile {
    rig: Spanned<String>,
    #[serde(default = "over_s")]
    over: At,
    #[serde(default)]
    seconds: Option<At>,
    clips: BTreeMap<String, Spanned<PlanClip>>,
    #[serde(default, rename = "segment")]
    segments: Vec<Spanned<Segment>>,
}

const HELP: &str = "docs/plans.md has examples with every key";

/// Bytes of a plan's file, at most: as parsed TOML they take some hundred times as many.
const MOST_BYTES: usize = 1 << 20;

impl Plan {
    /// Reads a plan and lays it; files that it names without a root are looked for beside it.
    ///
    /// # Errors
    /// [`Error::File`] with line and column: no such TOML, unknown keys; a clip that isn't named, can't be read or is no BVH
    /// where its rig is written; times outside of a clip; joints that are none; two clips that give one joint at a time.
    pub fn load(path: &Path) -> Result<(Plan, Laid)> {
        let text = input::text(path).map_err(Error::io(path))?;
        let wrong = |span, found: &str, expected: &str| Error::in_text((path, &text), span, found, expected, HELP);
        if text.len() > MOST_BYTES {
            let help = "make the dance in several";
            let expected = format!("a plan of at most {MOST_BYTES} bytes, some thousand segments");
            return Err(Error::file(path, format!("{} bytes", text.len()), expected, help));
        }
        let file: PlanFile = toml::from_str(&text).map_err(|e| wrong(e.span(), e.message(), "a plan"))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let clip_spans: BTreeMap<String, Range<usize>> =
            file.clips.iter().map(|(k, c)| (k.clone(), c.span())).collect();
        let (rig_span, segment_spans) = (file.rig.span(), file.segments.iter().map(Spanned::span).collect::<Vec<_>>());
        let mut notes = Vec::new();
        let found = |(name, clip): (String, Spanned<PlanClip>)| {
            let mut clip = clip.into_inner();
            clip.file = folder.join(&clip.file);
            match clip.ask_sidecar() {
                Ok(words) => {
                    let words = words.map(|words| (clip.file.display().to_string(), words));
                    notes.extend(sidecar::line(words.as_slice()));
                }
                Err(e) => notes.push(e.to_string()),
            }
            (name, clip)
        };
        let plan = Plan {
            rig: file.rig.into_inner(),
            over: file.over,
            seconds: file.seconds,
            clips: file.clips.into_iter().map(found).collect(),
            segments: file.segments.into_iter().map(Spanned::into_inner).collect(),
        };
        let mut laid = Laid::of(&plan).map_err(|fault| match fault {
            Fault::Segment(n, what, expected) => wrong(segment_spans.get(n).cloned(), &what, &expected),
            Fault::Clip(name, what, expected) => wrong(clip_spans.get(&name).cloned(), &what, &expected),
            Fault::Rig(what, expected) => wrong(Some(rig_span.clone()), &what, &expected),
            Fault::Plan(what, expected) => wrong(None, &what, &expected),
            Fault::Read(e) => e,
        })?;
        laid.notes.splice(0..0, notes);
        Ok((plan, laid))
    }

    /// The bytes of the dance, as far as clips give it.
    ///
    /// # Errors
    /// As [`Plan::load`], without lines.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        Laid::of(self).map_err(Error::from)?.bytes()
    }
}
