//! The inputs that a request names: a clip and music.

use super::{Edit, Timeline};
use kinelm_motion::format::{ReadOptions, RestFrame};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The music that is danced to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MusicRequest {
    /// The sound file.
    pub path: PathBuf,
    /// Its time when the dance begins, seconds.
    pub from_s: f64,
}

/// A clip, and which part of it is given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PromptRequest {
    /// The file. Of a timeline: the file of the clip that lends its rig.
    pub path: PathBuf,
    /// How it is read.
    pub read: ReadOptions,
    /// The joints that are given throughout, as [`kinelm_motion::joints::parse`] takes them or as the prompt's rig names
    /// them. A resolved request has SMPL's names.
    pub joints: Option<String>,
    /// The frame from which the dance continues by itself: the frames before it are the prompt's.
    pub from_frame: Option<usize>,
    /// Clips arranged in time, composed into one clip on the file's rig; that clip is edited instead of the file itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timeline: Option<Timeline>,
    /// What stays and what is generated, instead of `joints` and `from_frame`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edit: Option<Edit>,
}

impl PromptRequest {
    /// The clip in a file, read as its format says, a leading rest pose dropped. Nothing of it is given yet. How a dance of
    /// this program is read: [`kinelm_corpus::sidecar::read_options`].
    pub fn of(path: impl Into<PathBuf>) -> PromptRequest {
        let read = ReadOptions { rest: RestFrame::Drop, ..ReadOptions::default() };
        PromptRequest { path: path.into(), read, joints: None, from_frame: None, timeline: None, edit: None }
    }

    /// The files that are read.
    pub fn files(&self) -> Vec<PathBuf> {
        let clips = self.timeline.iter().flat_map(|timeline| timeline.clips.values()).map(|clip| clip.file.clone());
        clips.chain([self.path.clone()]).collect()
    }
}
