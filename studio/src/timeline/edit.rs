//! The edits that a page may request of a timeline.

use super::file::TimelineFile;
use super::segments::{self, Cut};
use super::{Laid, Timelines};
use crate::library::Source;
use crate::{Error, Result};
use kinelm_generate::request::{Segment, Timeline};
use kinelm_motion::joints;
use kinelm_motion::moment::Moment;
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::ops::Range;

/// The longest time, seconds.
const LONGEST_S: f64 = 3600.0;

/// An edit. Clips are named by their ids, times are seconds of the dance.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
pub enum Edit {
    /// Adds a segment after the others.
    Add {
        /// The segment.
        segment: NewSegment,
    },
    /// Sets a key of a segment; `null` removes it.
    Set {
        /// The segment, from 0.
        index: usize,
        /// `clip`, `joints`, `from`, `to`, `at` or `labels`.
        key: String,
        /// Its value.
        value: Value,
    },
    /// Removes a segment.
    Remove {
        /// The segment, from 0.
        index: usize,
    },
    /// Cuts a segment in two.
    Split {
        /// The segment, from 0.
        index: usize,
        /// The time of the cut.
        at: f64,
    },
    /// Sets a key at the top; `null` removes it.
    SetTop {
        /// `rig`, `transition` or `seconds`.
        key: String,
        /// Its value.
        value: Value,
    },
    /// Takes a clip in; an empty timeline begins with all of it.
    UseClip {
        /// A clip or a dance.
        id: String,
    },
    /// Frees joints for a time.
    Free {
        /// A list of joints.
        joints: String,
        /// Beginning.
        from: f64,
        /// End.
        to: f64,
    },
    /// Gives joints of a clip for a time, instead of the segments that give them there.
    Give {
        /// A clip or a dance.
        clip: String,
        /// A list of joints.
        #[serde(default = "all_joints")]
        joints: String,
        /// Beginning.
        from: f64,
        /// End.
        to: f64,
        /// Beginning in the clip.
        #[serde(default)]
        at: f64,
    },
    /// Another text.
    Text {
        /// All of it.
        text: String,
    },
}

/// A segment that is added.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NewSegment {
    /// A clip or a dance.
    #[serde(default)]
    pub clip: Option<String>,
    /// A list of joints.
    #[serde(default)]
    pub joints: Option<String>,
    /// Beginning.
    pub from: f64,
    /// End.
    pub to: f64,
    /// Beginning in the clip.
    #[serde(default)]
    pub at: Option<f64>,
    /// Labels.
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
}

fn all_joints() -> String {
    "all".into()
}

impl Edit {
    /// The ids of clips and dances that it names.
    pub fn names(&self) -> Option<&str> {
        match self {
            Edit::Add { segment } => segment.clip.as_deref(),
            Edit::Set { key, value, .. } if key == "clip" => value.as_str(),
            Edit::SetTop { key, value } if key == "rig" => value.as_str(),
            Edit::UseClip { id } => Some(id),
            Edit::Give { clip, .. } => Some(clip),
            _ => None,
        }
    }

    /// A name of the step in a few plain words.
    pub fn words(&self) -> String {
        let shown = |joints: &str| if joints == "all" { "the whole body".into() } else { joints.replace('_', " ") };
        match self {
            Edit::Add { .. } => "add a segment".into(),
            Edit::Set { key, .. } if key == "labels" => "label a segment".into(),
            Edit::Set { key, .. } if key == "from" || key == "to" || key == "at" => "move a segment".into(),
            Edit::Set { .. } => "change a segment".into(),
            Edit::Remove { .. } => "remove a segment".into(),
            Edit::Split { .. } => "cut a segment".into(),
            Edit::SetTop { key, .. } => format!("set {key}"),
            Edit::UseClip { .. } => "use a clip".into(),
            Edit::Free { joints, .. } => format!("free {}", shown(joints)),
            Edit::Give { joints, .. } => format!("give {}", shown(joints)),
            Edit::Text { .. } => "edit the text".into(),
        }
    }
}

/// Carries out an edit, but for [`Edit::Text`].
pub(super) fn apply(timelines: &Timelines, file: &mut TimelineFile, edit: &Edit) -> Result<()> {
    let source = |id: &str| timelines.library().source(id);
    match edit {
        Edit::Add { segment } => {
            let NewSegment { clip, joints, from, to, at, labels } = segment;
            check(*from, *to)?;
            let clip = clip.as_deref().map(|id| Ok::<_, Error>(file.name_of(&source(id)?))).transpose()?;
            let mut keys =
                vec![("clip", json!(clip)), ("joints", json!(joints)), ("from", json!(from)), ("to", json!(to))];
            keys.push(("at", at.filter(|at| *at != 0.0).map_or(Value::Null, |at| json!(at))));
            keys.push(("labels", if labels.is_empty() { Value::Null } else { json!(labels) }));
            file.add(&keys)
        }
        Edit::Set { index, key, value } => {
            if !["clip", "joints", "from", "to", "at", "labels"].contains(&&**key) {
                return Err(Error::invalid_parameter("key", key, "clip, joints, from, to, at or labels"));
            }
            match value.as_str().filter(|_| key == "clip") {
                Some(id) => {
                    let name = file.name_of(&source(id)?);
                    file.set(*index, key, &json!(name))
                }
                None => file.set(*index, key, value),
            }
        }
        Edit::Remove { index } => file.remove(*index),
        Edit::SetTop { key, value } => match (&**key, value.as_str()) {
            // a page names a clip by its id, a hand by its name in the text
            ("rig", Some(id)) => {
                let is_name = file.clips().iter().any(|(name, _)| name == id);
                let name = if is_name { id.to_owned() } else { file.name_of(&source(id)?) };
                file.set_top(key, &json!(name))
            }
            ("transition" | "seconds", _) => file.set_top(key, value),
            _ => Err(Error::invalid_parameter("key", key, "rig, transition or seconds")),
        },
        Edit::UseClip { id } => {
            let source = source(id)?;
            let name = file.name_of(&source);
            match file.is_empty() {
                true => {
                    let to = source.frames as f64 / source.fps;
                    file.add(&[("clip", json!(name)), ("from", json!(0)), ("to", json!(to))])
                }
                false => Ok(()),
            }
        }
        Edit::Split { index, at } => {
            let (mut cuts, fps) = cuts(timelines, file)?;
            let frame = frame(*at, fps)?;
            let count = cuts.len();
            let cut = cuts.get(*index).ok_or_else(|| {
                Error::invalid_parameter("index", index, format!("one of the {count} segments, from 0"))
            })?;
            // both parts have a frame
            if !(cut.frames.start + 1..cut.frames.end).contains(&frame) {
                return Err(Error::invalid_parameter("at", at, "a time inside the segment"));
            }
            segments::split(&mut cuts, *index, frame, fps);
            file.write(&cuts, fps)
        }
        Edit::Free { joints, from, to } => {
            let (mut cuts, fps) = cuts(timelines, file)?;
            segments::free(&mut cuts, &selected(joints)?, frames(*from, *to, fps)?, fps);
            file.write(&cuts, fps)
        }
        Edit::Give { clip, joints, from, to, at } => {
            let source = source(clip)?;
            let name = file.name_of(&source);
            if file.is_empty() {
                check(*from, *to)?;
                return file.add(&[
                    ("clip", json!(name)),
                    ("joints", json!(joints)),
                    ("from", json!(from)),
                    ("to", json!(to)),
                    ("at", json!(at)),
                ]);
            }
            let (mut cuts, fps) = cuts(timelines, file)?;
            let new = Cut {
                origin: None,
                clip: Some(name),
                clip_fps: source.fps,
                joints: selected(joints)?,
                frames: frames(*from, *to, fps)?,
                at_s: *at,
                labels: BTreeMap::new(),
                // new, so all of it is written anyway
                changed: [false; 3],
            };
            if !(0.0..=LONGEST_S).contains(at) {
                return Err(Error::invalid_parameter("at", at, "a time of the clip"));
            }
            segments::give(&mut cuts, new, fps);
            file.write(&cuts, fps)
        }
        // `edited` has parsed it already
        Edit::Text { .. } => Ok(()),
    }
}

fn selected(list: &str) -> Result<Vec<usize>> {
    Ok(joints::parse(list)?.joints)
}

fn check(from: f64, to: f64) -> Result<()> {
    match 0.0 <= from && from < to && to <= LONGEST_S {
        true => Ok(()),
        false => Err(Error::invalid_parameter(
            "from",
            format!("{from} to {to}"),
            "an end after the beginning, within an hour",
        )),
    }
}

fn frame(s: f64, fps: f64) -> Result<usize> {
    match (0.0..=LONGEST_S).contains(&s) {
        // an hour at any rate fits a usize; NaN is in no range
        true => Ok((s * fps).round() as usize),
        false => Err(Error::invalid_parameter("at", s, "a time within an hour")),
    }
}

fn frames(from: f64, to: f64, fps: f64) -> Result<Range<usize>> {
    check(from, to)?;
    let frames = frame(from, fps)?..frame(to, fps)?;
    match frames.is_empty() {
        true => Err(Error::invalid_parameter("from", format!("{from} to {to}"), "a time of at least one frame")),
        false => Ok(frames),
    }
}

/// The segments of a file as numbers, and the rate of the dance.
pub(super) fn cuts(timelines: &Timelines, file: &TimelineFile) -> Result<(Vec<Cut>, f64)> {
    if file.is_empty() {
        return Err(Error::Conflict("the timeline is empty: use a clip first".into()));
    }
    let parsed = timelines.lay_out(&file.text())?;
    let fps = parsed.layout.fps;
    let sources = timelines.sources();
    let of = |(index, segment): (usize, &Segment)| cut(&parsed, &sources, index, segment);
    Ok((parsed.timeline.segments.iter().enumerate().map(of).collect(), fps))
}

fn cut(parsed: &Laid, sources: &[Source], index: usize, segment: &Segment) -> Cut {
    let fps = parsed.layout.fps;
    let placed = parsed.layout.segments.iter().find(|placed| placed.index == index);
    let frames = frames_of(segment, fps);
    // transitions may have taken its first frames from the layout, but not from the file
    let at = |placed: &kinelm_generate::timeline::PlacedSegment| {
        (placed.at as f64 - (placed.frames.start as f64 - frames.start as f64)) / fps
    };
    let at_s = match segment.at.0 {
        Moment::Seconds(s) => s,
        _ => placed.map_or(0.0, at),
    };
    let clip_fps = segment.clip.as_ref().and_then(|name| rate(&parsed.timeline, sources, name));
    Cut {
        origin: Some(index),
        clip: segment.clip.clone(),
        clip_fps: clip_fps.unwrap_or(fps),
        joints: placed.map_or(Vec::new(), |placed| placed.joints.clone()),
        frames,
        at_s,
        labels: segment.labels.clone(),
        changed: [false; 3],
    }
}

/// A segment's frames as its file has them, before transitions.
pub(super) fn frames_of(segment: &Segment, fps: f64) -> Range<usize> {
    let of = |moment: Moment| moment.frames(fps).max(0.0) as usize;
    of(segment.from.0)..of(segment.to.0)
}

/// The rate of a timeline's clip.
pub(super) fn rate(timeline: &Timeline, sources: &[Source], name: &str) -> Option<f64> {
    let file = &timeline.clips.get(name)?.file;
    // the paths first: links are followed only where they differ
    let same = |source: &&Source| source.path == *file || is_same(&source.path, file);
    sources.iter().find(same).map(|source| source.fps)
}

/// Whether two paths are one file.
pub(super) fn is_same(a: &std::path::Path, b: &std::path::Path) -> bool {
    a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b))
}
