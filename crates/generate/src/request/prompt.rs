//! The inputs that a request names: a clip and music.

use super::{Edit, Timeline};
use kinelm_motion::Motion;
use kinelm_motion::format::{ReadOptions, RestFrame};
use kinelm_motion::joints;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// The music that is danced to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MusicRequest {
    /// The sound file.
    pub path: PathBuf,
    /// Its time when the dance begins, seconds.
    pub from_s: f64,
}

impl MusicRequest {
    /// Music that the dance begins at a time of, seconds; by default with it.
    pub fn of(path: impl Into<PathBuf>, from_s: Option<f64>) -> MusicRequest {
        MusicRequest { path: path.into(), from_s: from_s.unwrap_or(0.0) }
    }
}

/// A clip, and which part of it is given. One of which nothing is given lends its rig and its rate to a new dance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PromptRequest {
    /// The file. Of a timeline: the file of the clip that lends its rig.
    pub path: PathBuf,
    /// What the file holds, where the clip is in memory: `path` then only names it, and no file is read.
    #[serde(skip)]
    pub bytes: Option<Arc<[u8]>>,
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
    /// The given and the generated parts, instead of `joints` and `from_frame`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edit: Option<Edit>,
    /// The animation of the file, by name, whose place a dance on its rig takes; `None` adds one of the dance's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replace_animation: Option<String>,
    /// Whether a dance on the rig of a VRM is written into a VRM, which players of VRM ignore.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub embed: bool,
    /// Whether the file is a character, into which a dance on its rig is written as an animation; known once it is read.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_character: bool,
}

impl PromptRequest {
    /// The clip in a file, read as its format says, a leading rest pose dropped. Nothing of it is given yet. How a dance of
    /// this program is read: [`kinelm_corpus::sidecar::read_options`].
    pub fn of(path: impl Into<PathBuf>) -> PromptRequest {
        let read = ReadOptions { rest: RestFrame::Drop, ..ReadOptions::default() };
        PromptRequest {
            path: path.into(),
            bytes: None,
            read,
            joints: None,
            from_frame: None,
            timeline: None,
            edit: None,
            replace_animation: None,
            embed: false,
            is_character: false,
        }
    }

    /// The file's motion, which says how a dance on its rig is written into the file.
    pub(crate) fn written_as_requested(&self, motion: Motion) -> kinelm_motion::Result<Motion> {
        let motion = match &self.replace_animation {
            Some(animation) => motion.replacing(animation)?,
            None => motion,
        };
        if self.embed { motion.embedded() } else { Ok(motion) }
    }

    /// Whether nothing is given: the clip lends its rig and its rate.
    pub fn lends(&self) -> bool {
        self.joints.is_none() && self.from_frame.is_none() && self.edit.is_none()
    }

    /// Whether the dance follows the clip's path, as far as the clip lasts: it continues from a frame, or the root is given.
    pub(crate) fn gives_path(&self) -> bool {
        let has_root = |list: &str| joints::parse(list).is_ok_and(|selection| selection.path);
        self.from_frame.is_some() || self.joints.as_deref().is_some_and(has_root)
    }

    /// The files that are read; a map that is a name or text is among them.
    pub fn files(&self) -> Vec<PathBuf> {
        let read = self.read.map.iter().map(PathBuf::from).chain(self.read.body_model.clone());
        let clips = self.timeline.iter().flat_map(|timeline| timeline.clips.values()).map(|clip| clip.file.clone());
        read.chain(clips).chain([self.path.clone()]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clip_lends_its_rig_or_gives_joints_and_perhaps_its_path() {
        let of = |joints: Option<&str>, from_frame| {
            let joints = joints.map(str::to_owned);
            let prompt = PromptRequest { joints, from_frame, ..PromptRequest::of("a.bvh") };
            (prompt.lends(), prompt.gives_path())
        };
        assert_eq!(of(None, None), (true, false));
        assert_eq!(of(Some("right_arm"), None), (false, false));
        assert_eq!(of(Some("pelvis"), None), (false, false), "its rotation alone");
        assert_eq!(of(Some("root,right_arm"), None), (false, true));
        assert_eq!(of(None, Some(20)), (false, true));
        let edited = PromptRequest { edit: Some(Edit::of(Vec::new())), ..PromptRequest::of("a.bvh") };
        assert!(!edited.lends());
    }
}
