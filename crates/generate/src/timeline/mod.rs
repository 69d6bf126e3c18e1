//! A plan: clips on a timeline, from which one dance is made. docs/plans.md.
//!
//! The clips are laid into one file on the rig of one of them (`lay`, `compose`), and what none of them gives is made
//! anew, as in any edit of a clip. `draw` shows a plan as text.

mod compose;
mod draw;
mod lay;
mod told;

pub use draw::timeline;
pub use lay::{Placed, TimelineLayout};

use crate::request::timeline::over_s;
use crate::request::{At, Segment, Timeline, TimelineClip};
use crate::{Error, Result};
use kinelm_corpus::sidecar;
use kinelm_motion::format::{Unit, Up};
use kinelm_store::input;
use lay::Fault;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;

impl TimelineClip {
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

/// A plan with the places of its segments in the text.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TimelineFile {
    rig: Spanned<String>,
    #[serde(default = "over_s")]
    over: At,
    #[serde(default)]
    seconds: Option<At>,
    clips: BTreeMap<String, Spanned<TimelineClip>>,
    #[serde(default, rename = "segment")]
    segments: Vec<Spanned<Segment>>,
}

const HELP: &str = "docs/plans.md has examples with every key";

/// Bytes of a plan's file, at most: as parsed TOML they take some hundred times as many.
const MOST_BYTES: usize = 1 << 20;

impl Timeline {
    /// Reads a plan and lays it; files that it names without a root are looked for beside it.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] with line and column: no such TOML, unknown keys; a clip that isn't named, can't be read or is no BVH
    /// where its rig is written; times outside of a clip; joints that are none; two clips that give one joint at a time.
    pub fn load(path: &Path) -> Result<(Timeline, TimelineLayout)> {
        let text = input::text(path).map_err(Error::io(path))?;
        let wrong = |span, found: &str, expected: &str| Error::in_text((path, &text), span, found, expected, HELP);
        if text.len() > MOST_BYTES {
            let help = "make the dance in several";
            let expected = format!("a plan of at most {MOST_BYTES} bytes, some thousand segments");
            return Err(Error::file(path, format!("{} bytes", text.len()), expected, help));
        }
        let file: TimelineFile = toml::from_str(&text).map_err(|e| wrong(e.span(), e.message(), "a plan"))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let clip_spans: BTreeMap<String, Range<usize>> =
            file.clips.iter().map(|(k, c)| (k.clone(), c.span())).collect();
        let (rig_span, segment_spans) = (file.rig.span(), file.segments.iter().map(Spanned::span).collect::<Vec<_>>());
        let mut notes = Vec::new();
        let found = |(name, clip): (String, Spanned<TimelineClip>)| {
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
        let plan = Timeline {
            rig: file.rig.into_inner(),
            over: file.over,
            seconds: file.seconds,
            clips: file.clips.into_iter().map(found).collect(),
            segments: file.segments.into_iter().map(Spanned::into_inner).collect(),
        };
        let mut laid = TimelineLayout::of(&plan).map_err(|fault| match fault {
            Fault::Segment(n, what, expected) => wrong(segment_spans.get(n).cloned(), &what, &expected),
            Fault::Clip(name, what, expected) => wrong(clip_spans.get(&name).cloned(), &what, &expected),
            Fault::Rig(what, expected) => wrong(Some(rig_span.clone()), &what, &expected),
            Fault::Timeline(what, expected) => wrong(None, &what, &expected),
            Fault::Read(e) => e,
        })?;
        laid.notes.splice(0..0, notes);
        Ok((plan, laid))
    }

    /// The bytes of the dance, as far as clips give it.
    ///
    /// # Errors
    /// As [`Timeline::load`], without lines.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        TimelineLayout::of(self).map_err(Error::from)?.bytes()
    }
}
