//! Timelines: clips arranged in time, from which one dance is made.

use kinelm_motion::format::{MirrorAxis, ReadOptions, RestFrame, Unit, Up};
use kinelm_motion::moment::Moment;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A timeline, its paths relative to the working folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Timeline {
    /// The clip on whose rig, at whose rate and on whose floor the dance is written.
    pub rig: String,
    /// The time that is generated between one clip and the next. Default 1 second.
    #[serde(default = "default_transition")]
    pub transition: At,
    /// Length of the dance. Default: up to the end of the last segment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<At>,
    /// The clips by name.
    pub clips: BTreeMap<String, TimelineClip>,
    /// Which clip is given when.
    #[serde(rename = "segment")]
    pub segments: Vec<Segment>,
}

pub(crate) fn default_transition() -> At {
    At(Moment::Seconds(1.0))
}

/// A clip, and how it is read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimelineClip {
    /// The file.
    pub file: PathBuf,
    /// Its true rate, where the file states another.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fps_source: Option<f64>,
    /// Frames at its beginning to leave out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skip: Option<usize>,
    /// The unit of a BVH.
    #[serde(default)]
    pub unit: Unit,
    /// Which axis is up.
    #[serde(default)]
    pub up: Up,
    /// The skeleton map: a name or a file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<String>,
    /// Height of its floor, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<f64>,
    /// One of several figures, by its root or armature, or a joint to be the root.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub root: Option<String>,
    /// The animation of a file with several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub take: Option<String>,
    /// The axis along which the file is mirrored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mirror_axis: Option<MirrorAxis>,
}

impl TimelineClip {
    /// How the file is read.
    pub fn options(&self) -> ReadOptions {
        let (fps_source, skip, unit, up) = (self.fps_source, self.skip.unwrap_or(0), self.unit, self.up);
        let (map, floor, mirror_axis) = (self.map.clone(), self.floor, self.mirror_axis);
        let (root, take) = (self.root.clone(), self.take.clone());
        let stated = ReadOptions { fps_source, skip, unit, up, map, floor, root, take, ..ReadOptions::default() };
        ReadOptions { mirror_axis, rest: RestFrame::Drop, ..stated }
    }
}

/// Joints of a clip for a time of the dance, labels for a time of the dance, or both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// The clip's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clip: Option<String>,
    /// As [`kinelm_motion::joints::parse`] takes them, or as the clip's rig names its own.
    #[serde(default = "all_joints")]
    pub joints: String,
    /// Beginning in the dance.
    pub from: At,
    /// End in the dance, exclusive.
    pub to: At,
    /// Beginning in the clip. Default 0.
    #[serde(default)]
    pub at: At,
    /// Values of label fields.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub labels: BTreeMap<String, String>,
}

fn all_joints() -> String {
    "all".into()
}

/// A moment: a number of seconds, or a text such as `2.5s` or `40f`.
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
