//! Timelines: several clips arranged in time, from which one dance is made. docs/timelines.md.
//!
//! The clips are laid out on the rig of one of them ([`TimelineLayout`]) and composed into one file; what none of them gives is
//! generated, as in any edit of a clip. [`chart`] shows a layout as text.

mod chart;
mod compose;
mod fault;
mod labels;
mod layout;
mod spans;
mod times;

pub use chart::chart;
pub use layout::{NO_SEGMENT, PlacedSegment, TimelineLayout};
pub use spans::{GivenSpan, GivenState};

use crate::request::timeline::default_transition;
use crate::request::{At, Segment, Timeline, TimelineClip};
use crate::{Error, Result};
use fault::Fault;
use kinelm_corpus::sidecar;
use kinelm_motion::format::{Unit, Up};
use kinelm_motion::rig::SkeletonMap;
use kinelm_store::input;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;

impl TimelineClip {
    /// Fills the options that the timeline leaves out from the sidecar of a dance. Returns them in words.
    ///
    /// # Errors
    /// Those of [`sidecar::read_options`].
    fn complete_from_sidecar(&mut self) -> Result<Option<String>> {
        let Some(read) = sidecar::read_options(&self.file)? else { return Ok(None) };
        self.fps_source = self.fps_source.or(read.fps_source);
        self.skip = self.skip.or(Some(read.skip).filter(|skip| *skip > 0));
        self.unit = if self.unit == Unit::Auto { read.unit } else { self.unit };
        self.up = if self.up == Up::Auto { read.up } else { self.up };
        self.map = self.map.take().or(read.map.clone());
        self.floor = self.floor.or(read.floor);
        self.root = self.root.take().or(read.root.clone());
        self.take = self.take.take().or(read.take.clone());
        self.mirror_axis = self.mirror_axis.or(read.mirror_axis);
        Ok(sidecar::describe(&read, &self.options()))
    }
}

/// A timeline with the positions of its segments in the text.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TimelineFile {
    rig: Spanned<String>,
    #[serde(default = "default_transition")]
    transition: At,
    #[serde(default)]
    seconds: Option<At>,
    clips: BTreeMap<String, Spanned<TimelineClip>>,
    #[serde(default, rename = "segment")]
    segments: Vec<Spanned<Segment>>,
}

const HELP: &str = "docs/timelines.md has examples with every key";

/// The most bytes of a timeline's file: parsed TOML takes some hundred times as many.
pub const MOST_BYTES: usize = 1 << 20;

impl Timeline {
    /// Reads a timeline and lays it out. Relative paths are relative to the timeline's folder.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] with line and column: wrong TOML, unknown keys; a clip that isn't named, can't be read or
    /// is no BVH where its rig is written; times outside a clip; unknown joints; two clips that give one joint at a time.
    pub fn load(path: &Path) -> Result<(Timeline, TimelineLayout)> {
        Timeline::parse(path, &input::text(path).map_err(Error::io(path))?)
    }

    /// [`Timeline::load`] of the text of the file `path`.
    ///
    /// # Errors
    /// Those of [`Timeline::load`].
    pub fn parse(path: &Path, text: &str) -> Result<(Timeline, TimelineLayout)> {
        let wrong = |span, found: &str, expected: &str| Error::in_text(path, text, span, found, expected, HELP);
        if text.len() > MOST_BYTES {
            let help = "generate the dance in parts";
            let expected = format!("a timeline of at most {MOST_BYTES} bytes, some thousand segments");
            return Err(Error::file(path, format!("{} bytes", text.len()), expected, help));
        }
        let file: TimelineFile = toml::from_str(text).map_err(|e| wrong(e.span(), e.message(), "a timeline"))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let clip_spans: BTreeMap<String, Range<usize>> =
            file.clips.iter().map(|(k, c)| (k.clone(), c.span())).collect();
        let (rig_span, segment_spans) = (file.rig.span(), file.segments.iter().map(Spanned::span).collect::<Vec<_>>());
        let mut notes = Vec::new();
        let found = |(name, clip): (String, Spanned<TimelineClip>)| {
            let mut clip = clip.into_inner();
            clip.file = folder.join(&clip.file);
            clip.map = clip.map.map(|map| map_in(folder, map));
            match clip.complete_from_sidecar() {
                Ok(words) => {
                    let words = words.map(|words| (clip.file.display().to_string(), words));
                    notes.extend(sidecar::describe_all(words.as_slice()));
                }
                // a broken sidecar costs its options, not the timeline
                Err(e) => notes.push(e.to_string()),
            }
            (name, clip)
        };
        let timeline = Timeline {
            rig: file.rig.into_inner(),
            transition: file.transition,
            seconds: file.seconds,
            clips: file.clips.into_iter().map(found).collect(),
            segments: file.segments.into_iter().map(Spanned::into_inner).collect(),
        };
        let mut layout = TimelineLayout::of(&timeline).map_err(|fault| match fault {
            Fault::Segment(n, what, expected) => wrong(segment_spans.get(n).cloned(), &what, &expected),
            Fault::Clip(name, what, expected) => wrong(clip_spans.get(&name).cloned(), &what, &expected),
            Fault::Rig(what, expected) => wrong(Some(rig_span.clone()), &what, &expected),
            Fault::Timeline(what, expected) => wrong(None, &what, &expected),
            Fault::Read(e) => e,
        })?;
        layout.notes.splice(0..0, notes);
        Ok((timeline, layout))
    }

    /// Reads the clips and lays the timeline out.
    ///
    /// # Errors
    /// As [`Timeline::load`], without lines.
    pub(crate) fn lay_out(&self) -> Result<TimelineLayout> {
        TimelineLayout::of(self).map_err(Error::from)
    }
}

/// A map as the timeline in a folder names it: a built-in one by its name, else a file, or its TOML.
fn map_in(folder: &Path, map: String) -> String {
    let is_file = SkeletonMap::builtin(&map).is_none() && !map.contains('\n');
    if is_file { folder.join(map).to_string_lossy().into_owned() } else { map }
}
