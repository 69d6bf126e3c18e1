//! What decides a dance, as one value that a file can hold.

mod draws;
mod edit;
mod feet;
mod labels;
mod place;
mod requested;
mod span;
pub(crate) mod timeline;

pub use draws::Draws;
pub use edit::{Comes, Edit, Round};
pub use feet::FootMode;
pub use labels::TimedLabel;
pub use place::Place;
pub use requested::{LeadInKind, Length, Request};
pub use span::Span;
pub use timeline::{At, Segment, Timeline, TimelineClip};

use super::rest::RestJoints;
use super::sampling::Draw;
use crate::{Error, Result};
use kinelm_corpus::sidecar::as_written;
use kinelm_engine::decode::{KvKind, WeightKind};
use kinelm_model::lead_in::LeadInFrom;
use kinelm_model::{Compute, ReaderOptions};
use kinelm_motion::format::{Format, ReadOptions, RestFrame};
use kinelm_store::input;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Everything that decides a dance, but the bytes of the model and of the prompt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Resolved {
    /// The run folder.
    pub run: PathBuf,
    /// A clip of which something is followed.
    pub prompt: Option<PromptRequest>,
    /// What the model is told of the dance: values of label fields; fields that are left out are unknown.
    pub labels: BTreeMap<String, String>,
    /// What it is told of a time of the dance, beside those.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub timed_labels: Vec<TimedLabel>,
    /// How far labels and music are followed, 1: as the model has learned them. See [`super::guidance`].
    pub guidance: f64,
    /// How far gaps are led to what is given behind them, 1: as the model has learned it, 0: it is told nothing. See
    /// [`super::SamplingPlan::ahead`].
    #[serde(default, skip_serializing_if = "is_zero")]
    pub ahead: f64,
    /// The music that is danced to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub music: Option<MusicRequest>,
    /// Frames, at the model's rate; `None`: as many as the music has, or the prompt.
    pub frames: Option<usize>,
    /// The dance's length in seconds, asked for instead of frames; files tell frames.
    #[serde(skip)]
    pub seconds: Option<f64>,
    /// Frames a second of the file that is written, the frames between by slerp; `None`: the model's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// Frames in front of a dance that begins from nothing, dropped from the output: the first ones a model draws don't
    /// belong together yet.
    #[serde(default, skip_serializing_if = "is_none_at_all")]
    pub lead_in: usize,
    /// The second of a train clip that stands there; `None`: the model draws them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lead_in_from: Option<LeadInFrom>,
    /// First words that are drawn where one is given in part, see [`super::starts`]; 1: the dance's own alone.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub starts: usize,
    /// The seed of the draws.
    pub seed: u64,
    /// What makes them beside it.
    #[serde(default, skip_serializing_if = "Draws::is_seed")]
    pub draws: Draws,
    /// How free places are drawn.
    pub draw: Draw,
    /// The rig that the dance is written on.
    pub rig: Rig,
    /// What the joints do that the model doesn't know.
    pub rest_joints: RestJoints,
    /// Where the prompt stands and with it the dance; `None`: where the words leave it, at x = z = 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<Place>,
    /// What is done to the feet.
    #[serde(default, skip_serializing_if = "FootMode::is_off")]
    pub feet: FootMode,
    /// Where and how the model computes.
    pub computing: Computing,
}

impl Resolved {
    /// How the dance is read from `dance`, the file that it was written to: at its own rate, whole. An edited clip is its
    /// prompt's file with other numbers: what is left out of that is left out of both. Without a prompt the floor is at 0.
    pub fn read_back(&self, dance: &Path) -> ReadOptions {
        let Some(prompt) = &self.prompt else {
            return ReadOptions { floor: Some(0.0), ..as_written(dance, None) };
        };
        if self.rig != Rig::Prompt {
            return ReadOptions { floor: prompt.read.floor, ..as_written(dance, None) };
        }
        let own = as_written(dance, Some((&prompt.path, &prompt.read)));
        match &prompt.edit {
            Some(edit) if edit.round.is_none() => ReadOptions { skip: prompt.read.skip, rest: prompt.read.rest, ..own },
            _ => own,
        }
    }
}

fn is_zero(ahead: &f64) -> bool {
    *ahead == 0.0
}

fn one() -> usize {
    1
}

fn is_one(starts: &usize) -> bool {
    *starts == 1
}

fn is_none_at_all(frames: &usize) -> bool {
    *frames == 0
}

/// The music that is danced to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MusicRequest {
    /// The file.
    pub path: PathBuf,
    /// Its time when the dance begins, seconds.
    pub from_s: f64,
}

/// What is followed of a clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PromptRequest {
    /// The file.
    pub path: PathBuf,
    /// How it is read.
    pub read: ReadOptions,
    /// The joints that are followed, as [`kinelm_motion::joints::parse`] takes them; when a dance is asked for, names of the
    /// prompt's rig too.
    pub joints: Option<String>,
    /// The frame from which the dance goes on by itself: those before it are the prompt's.
    pub from_frame: Option<usize>,
    /// Clips that are laid into one on the file's rig: what is edited then, instead of the file itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<Timeline>,
    /// What is kept of it and what is invented, instead of these two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edit: Option<Edit>,
}

impl PromptRequest {
    /// The clip in a file, read as its format says, without a rest pose in front; nothing of it is given yet. How a dance
    /// of this program is read, [`kinelm_corpus::sidecar::reading_of`] says.
    pub fn of(path: impl Into<PathBuf>) -> PromptRequest {
        let read = ReadOptions { rest: RestFrame::Drop, ..ReadOptions::default() };
        PromptRequest { path: path.into(), read, joints: None, from_frame: None, plan: None, edit: None }
    }

    /// The bytes of the clip that is followed.
    ///
    /// # Errors
    /// A file that can't be read; a plan that can't be laid any more.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        match &self.plan {
            Some(plan) => plan.bytes(),
            None => {
                Format::of(&self.path)?; // refused by its name before it is read
                input::bytes(&self.path).map_err(Error::io(&self.path))
            }
        }
    }

    /// The files that are read.
    pub fn files(&self) -> Vec<PathBuf> {
        let of_plan = self.plan.iter().flat_map(|plan| plan.clips.values()).map(|clip| clip.file.clone());
        of_plan.chain([self.path.clone()]).collect()
    }
}

/// What a dance is written on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Rig {
    /// SMPL-24
    #[default]
    Model,
    /// The prompt's own
    Prompt,
}

/// Where and how the model computes. Other numbers of threads give the same bits; other devices, forms and ways to hold
/// numbers may not.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Computing {
    /// `cpu` or `cuda:N`.
    pub device: String,
    /// `auto` or `plain`.
    pub form: String,
    /// How weights are held: `f32` or `int8`.
    #[serde(with = "WeightName")]
    pub weights: WeightKind,
    /// How keys and values are held: `f32` or `f16`.
    #[serde(with = "KvName")]
    pub kv: KvKind,
    /// Instructions of the processor that the engine's kernels used. Told, not asked for.
    #[serde(default)]
    pub kernels: String,
}

/// [`WeightKind`] by its name: the engine knows no files.
#[derive(Serialize, Deserialize)]
#[serde(remote = "WeightKind", rename_all = "lowercase")]
enum WeightName {
    F32,
    Int8,
}

/// [`KvKind`] by its name.
#[derive(Serialize, Deserialize)]
#[serde(remote = "KvKind", rename_all = "lowercase")]
enum KvName {
    F32,
    F16,
}

impl Default for Computing {
    fn default() -> Computing {
        Computing::new(Compute::default(), WeightKind::F32, KvKind::F32)
    }
}

impl Computing {
    /// With the kernels of the processor at hand.
    pub fn new(compute: Compute, weights: WeightKind, kv: KvKind) -> Computing {
        Computing {
            device: compute.device.to_string(),
            form: compute.form.to_string(),
            weights,
            kv,
            kernels: kinelm_engine::dispatch::name().into(),
        }
    }

    /// Where and how.
    ///
    /// # Errors
    /// A device or a form that has no such name.
    pub fn compute(&self) -> Result<Compute> {
        Ok(Compute { device: self.device.parse()?, form: self.form.parse()? })
    }

    /// How the model is read, so many sequences side by side.
    pub fn reading(&self, streams: usize) -> ReaderOptions {
        ReaderOptions { streams, weights: self.weights, kv: self.kv }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_names_in_a_file_and_no_others_are_taken() {
        let computing = Computing::new(Compute::default(), WeightKind::Int8, KvKind::F16);
        let text = serde_json::to_string(&computing).unwrap();
        assert!(text.contains(r#""weights":"int8","kv":"f16""#), "{text}");
        assert_eq!(serde_json::from_str::<Computing>(&text).unwrap(), computing);
        let refused = serde_json::from_str::<Computing>(&text.replace("int8", "int4")).unwrap_err().to_string();
        assert!(refused.contains("`int4`") && refused.contains("f32") && refused.contains("int8"), "{refused}");
    }
}
