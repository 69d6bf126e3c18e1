//! The state of a project: clips, dances, the timeline's text, the music; and the changes that lead from one state to
//! the next.

use super::{DANCES, MADE};
use kinelm_generate::best::Best;
use kinelm_generate::output::FreeSpan;
use kinelm_motion::format::{MirrorAxis, ReadOptions, RestFrame, Unit, Up};
use serde::{Deserialize, Serialize};
use std::path::{Component, Path, PathBuf};

/// The state of a project.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Document {
    /// In the order in which they came.
    pub clips: Vec<ClipRecord>,
    /// In the order in which they were made.
    pub dances: Vec<DanceRecord>,
    /// The text of the timeline; `None` before the first one.
    pub timeline: Option<String>,
    /// The music of the stage.
    pub music: Option<Music>,
}

/// A file of the library.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipRecord {
    /// `c1`, `c2`, ..
    pub id: String,
    /// The name that is shown.
    pub name: String,
    /// The file: absolute, or in the project's folder.
    pub file: PathBuf,
    /// The user's own statements about it, over the file's.
    #[serde(default)]
    pub reading: Reading,
}

/// A user's statements about a file. `None`: as the library finds it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Reading {
    /// The axis that is up.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<Up>,
    /// The unit of a BVH.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<Unit>,
    /// The true rate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fps_source: Option<f64>,
    /// Frames to leave out at the start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skip: Option<usize>,
    /// The name of a built-in skeleton map, or `maps/NAME.toml` of the project.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map: Option<String>,
    /// The height of the floor, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floor: Option<f64>,
    /// One of several figures, by its root or armature, or a joint to be the root.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub root: Option<String>,
    /// The animation of a file with several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub take: Option<String>,
    /// The axis along which the file is mirrored.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirror_axis: Option<MirrorAxis>,
}

impl Reading {
    /// The keys that can be stated.
    pub const KEYS: [&str; 9] = ["up", "unit", "fps_source", "skip", "map", "floor", "root", "take", "mirror_axis"];

    /// As the library has it: over the options in a sidecar of the file, if it has one, else as a prompt is read.
    pub fn options(&self, own: Option<&ReadOptions>) -> ReadOptions {
        let prompt = || ReadOptions { rest: RestFrame::Drop, ..ReadOptions::default() };
        let own = own.cloned().unwrap_or_else(prompt);
        ReadOptions {
            up: self.up.unwrap_or(own.up),
            unit: self.unit.unwrap_or(own.unit),
            fps_source: self.fps_source.or(own.fps_source),
            skip: self.skip.unwrap_or(own.skip),
            map: self.map.clone().or(own.map),
            floor: self.floor.or(own.floor),
            root: self.root.clone().or(own.root),
            take: self.take.clone().or(own.take),
            mirror_axis: self.mirror_axis.or(own.mirror_axis),
            ..own
        }
    }

    /// This reading with the statements of `other` over it.
    pub fn with(self, other: Reading) -> Reading {
        Reading {
            up: other.up.or(self.up),
            unit: other.unit.or(self.unit),
            fps_source: other.fps_source.or(self.fps_source),
            skip: other.skip.or(self.skip),
            map: other.map.or(self.map),
            floor: other.floor.or(self.floor),
            root: other.root.or(self.root),
            take: other.take.or(self.take),
            mirror_axis: other.mirror_axis.or(self.mirror_axis),
        }
    }
}

/// A dance that was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DanceRecord {
    /// `d1`, `d2`, ..
    pub id: String,
    /// The name that is shown.
    pub name: String,
    /// The file of a dance that isn't kept yet, in the project's folder; its sidecar is beside it.
    pub made: Option<PathBuf>,
    /// The file of a kept one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kept: Option<PathBuf>,
    /// Whether the user turned it down.
    #[serde(default)]
    pub rejected: bool,
    /// The job that made it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub job: Option<String>,
    /// Its number among those made side by side, from 1.
    pub variation: usize,
    /// The seed of the request.
    pub seed: u64,
    /// Its length.
    pub frames: usize,
    /// Its rate.
    pub fps: f64,
    /// Height of the floor it dances on, metres.
    #[serde(default)]
    pub floor_m: f64,
    /// Notes for the user, a line each.
    #[serde(default)]
    pub note: String,
    /// The clip or dance that it was made from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
    /// The clip or dance that lent its rig to a new dance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rig: Option<String>,
    /// The spans in which something is generated while the rest is given, seconds.
    #[serde(default)]
    pub generated_s: Vec<[f64; 2]>,
    /// The joints that are given throughout.
    #[serde(default)]
    pub given: String,
    /// The freed joints and times, as they were requested.
    #[serde(default)]
    pub free: String,
    /// The generated joints, and when.
    #[serde(default)]
    pub made_spans: Vec<MadeSpan>,
    /// Its rank, where the best was chosen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub best: Option<Best>,
    /// Whether it is one of those that a new project begins with.
    #[serde(default)]
    pub opening: bool,
}

/// Joints that are generated for a time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MadeSpan {
    /// SMPL ids.
    pub joints: Vec<usize>,
    /// Seconds.
    pub from: f64,
    /// Seconds.
    pub to: f64,
}

impl MadeSpan {
    /// From spans in frames.
    pub fn of(spans: &[FreeSpan], fps: f64) -> Vec<MadeSpan> {
        let seconds = |frame: usize| frame as f64 / fps;
        let of = |span: &FreeSpan| MadeSpan {
            joints: span.joints.clone(),
            from: seconds(span.frames.start),
            to: seconds(span.frames.end),
        };
        spans.iter().map(of).collect()
    }
}

/// The music of the stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Music {
    /// A file of the library.
    pub clip: String,
    /// Its time when a dance begins, seconds.
    #[serde(default)]
    pub from_s: f64,
}

/// A change of one thing; `None` is its absence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Change {
    /// A clip comes, goes, or is another.
    Clip {
        /// As it was.
        before: Option<Box<ClipRecord>>,
        /// As it is.
        after: Option<Box<ClipRecord>>,
    },
    /// A dance, likewise.
    Dance {
        /// As it was.
        before: Option<Box<DanceRecord>>,
        /// As it is.
        after: Option<Box<DanceRecord>>,
    },
    /// The timeline has another text.
    Timeline {
        /// As it was.
        before: Option<String>,
        /// As it is.
        after: Option<String>,
    },
    /// Other music.
    Music {
        /// As it was.
        before: Option<Music>,
        /// As it is.
        after: Option<Music>,
    },
}

impl Change {
    /// The change that takes this one back.
    pub fn inverse(&self) -> Change {
        match self.clone() {
            Change::Clip { before, after } => Change::Clip { before: after, after: before },
            Change::Dance { before, after } => Change::Dance { before: after, after: before },
            Change::Timeline { before, after } => Change::Timeline { before: after, after: before },
            Change::Music { before, after } => Change::Music { before: after, after: before },
        }
    }

    /// About how many bytes it takes.
    pub fn bytes(&self) -> usize {
        let text = |text: &Option<String>| text.as_ref().map_or(0, String::len);
        match self {
            Change::Timeline { before, after } => 64 + text(before) + text(after),
            // about a record with its names, twice
            _ => 1024,
        }
    }
}

impl Document {
    /// The clip with this id.
    pub fn clip(&self, id: &str) -> Option<&ClipRecord> {
        self.clips.iter().find(|clip| clip.id == id)
    }

    /// The dance with this id.
    pub fn dance(&self, id: &str) -> Option<&DanceRecord> {
        self.dances.iter().find(|dance| dance.id == id)
    }

    /// Carries a change out.
    pub fn apply(&mut self, change: &Change) {
        match change {
            Change::Clip { before, after } => {
                put(&mut self.clips, before.as_deref(), after.as_deref(), |clip| &clip.id);
            }
            Change::Dance { before, after } => {
                put(&mut self.dances, before.as_deref(), after.as_deref(), |dance| &dance.id);
            }
            Change::Timeline { after, .. } => self.timeline.clone_from(after),
            Change::Music { after, .. } => self.music.clone_from(after),
        }
    }
}

/// The number in an id such as `c12`.
pub fn number(id: &str) -> u64 {
    id.get(1..).and_then(|digits| digits.parse().ok()).unwrap_or(0)
}

/// Whether it is an id: a letter and digits.
pub fn is_id(id: &str) -> bool {
    let digits = id.strip_prefix(['c', 'd', 'j']).unwrap_or_default();
    !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())
}

impl ClipRecord {
    fn is_sound(&self) -> bool {
        // a file of the call is where it is; one of the project is nowhere else
        is_id(&self.id) && !self.file.components().any(|part| part == Component::ParentDir)
    }
}

impl DanceRecord {
    fn is_sound(&self) -> bool {
        let made = Path::new(MADE).join(format!("{}.bvh", self.id));
        let is_kept = |file: &PathBuf| {
            let is_bvh = file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bvh"));
            // exactly one folder deep: no `..`, no absolute path
            file.parent() == Some(Path::new(DANCES)) && file.file_name().is_some() && (is_bvh || self.made.is_none())
        };
        is_id(&self.id) && self.made.as_ref().is_none_or(|file| *file == made) && self.kept.as_ref().is_none_or(is_kept)
    }
}

impl Document {
    /// Whether a studio could have written its ids and files.
    pub fn is_sound(&self) -> bool {
        self.clips.iter().all(ClipRecord::is_sound) && self.dances.iter().all(DanceRecord::is_sound)
    }
}

impl Change {
    /// Whether a studio could have written its ids and files.
    pub fn is_sound(&self) -> bool {
        match self {
            Change::Clip { before, after } => [before, after].into_iter().flatten().all(|clip| clip.is_sound()),
            Change::Dance { before, after } => [before, after].into_iter().flatten().all(|dance| dance.is_sound()),
            Change::Timeline { .. } | Change::Music { .. } => true,
        }
    }
}

/// Puts `after` where the record of its id is, or where its number belongs; removes the record of `before` without one.
fn put<T: Clone>(all: &mut Vec<T>, before: Option<&T>, after: Option<&T>, id: fn(&T) -> &String) {
    let Some(after) = after else {
        if let Some(before) = before {
            all.retain(|record| id(record) != id(before));
        }
        return;
    };
    match all.iter_mut().find(|record| id(record) == id(after)) {
        Some(record) => *record = after.clone(),
        None => {
            // by number, so that a redo puts a record where it was
            let at = all.iter().position(|record| number(id(record)) > number(id(after))).unwrap_or(all.len());
            all.insert(at, after.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clip(id: &str) -> ClipRecord {
        ClipRecord { id: id.into(), name: id.into(), file: id.into(), reading: Reading::default() }
    }

    #[test]
    fn a_change_and_its_inverse_lead_back() {
        let mut document = Document::default();
        for id in ["c1", "c2", "c10"] {
            document.apply(&Change::Clip { before: None, after: Some(Box::new(clip(id))) });
        }
        document.apply(&Change::Timeline { before: None, after: Some("a".into()) });
        let start = document.clone();
        let renamed = ClipRecord { name: "b".into(), ..clip("c2") };
        let changes = [
            Change::Clip { before: Some(Box::new(clip("c2"))), after: Some(Box::new(renamed)) },
            Change::Clip { before: Some(Box::new(clip("c1"))), after: None },
            Change::Timeline { before: Some("a".into()), after: None },
            Change::Music { before: None, after: Some(Music { clip: "c2".into(), from_s: 1.0 }) },
        ];
        changes.iter().for_each(|change| document.apply(change));
        let ids = |document: &Document| document.clips.iter().map(|clip| clip.id.clone()).collect::<Vec<_>>();
        assert_eq!(
            (ids(&document), document.clip("c2").unwrap().name.as_str()),
            (vec!["c2".into(), "c10".into()], "b")
        );
        changes.iter().rev().for_each(|change| document.apply(&change.inverse()));
        assert_eq!(document, start, "the clip is back in its place");
    }

    #[test]
    fn what_a_user_states_wins_over_a_sidecar() {
        let own = ReadOptions { skip: 3, up: Up::Z, ..ReadOptions::default() };
        let stated = Reading { up: Some(Up::Y), floor: Some(0.1), ..Reading::default() };
        let options = stated.options(Some(&own));
        assert_eq!((options.up, options.skip, options.floor, options.rest), (Up::Y, 3, Some(0.1), RestFrame::Keep));
        assert_eq!(stated.options(None).rest, RestFrame::Drop);
        let both = stated.with(Reading { skip: Some(1), up: Some(Up::X), ..Reading::default() });
        assert_eq!((both.up, both.skip, both.floor), (Some(Up::X), Some(1), Some(0.1)));
    }
}
