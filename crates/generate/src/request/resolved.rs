//! A request in which every option is decided.

use super::{
    Computing, FloorPath, FootMode, Length, MusicRequest, Placement, PromptRequest, Request, Rig, Seeding, TimedLabel,
    UncodedJoints,
};
use crate::sampling::Sampling;
use kinelm_corpus::sidecar::output_read_options;
use kinelm_model::lead_in::LeadInFrom;
use kinelm_motion::format::{Format, ReadOptions};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Everything that decides a dance, except the bytes of model, prompt and music. The sidecar of a dance holds it: running
/// it again gives the same bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Resolved {
    /// The run folder of the model.
    pub run: PathBuf,
    /// A clip of which something is given, or which lends its rig and its rate.
    pub prompt: Option<PromptRequest>,
    /// A path over the floor, along which the dance is led.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<FloorPath>,
    /// Values of label fields for the whole dance. Fields that are left out are unknown to the model.
    pub labels: BTreeMap<String, String>,
    /// Values of label fields for a part of the dance.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub timed_labels: Vec<TimedLabel>,
    /// Scale of classifier-free guidance by labels and music; 1 is the model as trained.
    pub guidance: f64,
    /// Scale of guidance towards the goals after gaps; 1 is the model as trained, 0 leaves the goals out.
    #[serde(default, skip_serializing_if = "is_default")]
    pub goal_guidance: f64,
    /// The music that is danced to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub music: Option<MusicRequest>,
    /// Frames at the model's rate.
    pub frames: usize,
    /// Frames per second of the file that is written.
    pub fps: f64,
    /// Lead-in frames, dropped from the output: the first frames that a model samples don't belong together yet.
    #[serde(default, skip_serializing_if = "is_default")]
    pub lead_in: usize,
    /// The second of a train clip that the lead-in is; `None`: the model samples the lead-in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lead_in_from: Option<LeadInFrom>,
    /// Candidates for the first frame, see [`crate::sampler`]; 1: no choice.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub first_frames: usize,
    /// Continuations of every block, of which the most believable is kept; 1: no choice.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub look_ahead: usize,
    /// Passes of a masked model over a window; `None`: the model is causal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub passes: Option<usize>,
    /// Seed of the random streams.
    pub seed: u64,
    /// Inputs of the random streams beside the seed.
    pub seeding: Seeding,
    /// How free characters are sampled.
    pub sampling: Sampling,
    /// The rig that the dance is written on.
    pub rig: Rig,
    /// Motion of the joints that the tokenizer doesn't code.
    pub uncoded_joints: UncodedJoints,
    /// The prompt's place, which is the dance's too; `None`: as decoded, at x = z = 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub placement: Option<Placement>,
    /// Foot locking.
    #[serde(default, skip_serializing_if = "is_default")]
    pub feet: FootMode,
    /// The device and the form that compute a model.
    pub computing: Computing,
}

impl Resolved {
    /// The request that resolves to it.
    pub fn request(&self) -> Request {
        Request {
            run: self.run.clone(),
            prompt: self.prompt.clone(),
            path: self.path.clone(),
            labels: self.labels.clone(),
            timed_labels: self.timed_labels.clone(),
            music: self.music.clone(),
            length: Some(Length::Frames(self.frames)),
            fps: Some(self.fps),
            sampling: self.sampling,
            rig: Some(self.rig),
            ..Request::default()
        }
    }

    /// How the dance is read from `dance`, the file that it was written to: at its own rate, whole. An edited clip is its
    /// prompt's file with other numbers, so it keeps the floor, and the frames that reading leaves out of the prompt are left
    /// out of it too. The floor of every other dance is y = 0.
    pub fn read_back(&self, dance: &Path) -> ReadOptions {
        let on_rig = self.prompt.as_ref().filter(|_| self.rig == Rig::Prompt);
        let own = match on_rig.filter(|prompt| prompt.is_character && Format::of_name(dance) == Some(Format::Glb)) {
            Some(prompt) => animation_of(prompt, dance),
            None => output_read_options(dance, on_rig.map(|prompt| (&*prompt.path, &prompt.read))),
        };
        let Some((prompt, edit)) = self.prompt.as_ref().and_then(|prompt| Some((prompt, prompt.edit.as_ref()?))) else {
            return ReadOptions { floor: Some(0.0), ..own };
        };
        // a VRM animation has its floor at 0, wherever that of the clip was
        let floor = if Format::of_name(dance) == Some(Format::Vrma) { Some(0.0) } else { prompt.read.floor };
        let own = ReadOptions { floor, ..own };
        match edit.looping.is_none() && on_rig.is_some() {
            true => ReadOptions { skip: prompt.read.skip, rest: prompt.read.rest, ..own },
            false => own,
        }
    }
}

/// How a dance is read that is an animation of its prompt's file: as the prompt was.
fn animation_of(prompt: &PromptRequest, dance: &Path) -> ReadOptions {
    let name = || dance.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let ReadOptions { unit, up, map, root, mirror_axis, floor, .. } = prompt.read.clone();
    let take = Some(prompt.replace_animation.clone().unwrap_or_else(name));
    ReadOptions { unit, up, map, root, mirror_axis, floor, take, ..ReadOptions::default() }
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

fn one() -> usize {
    1
}

fn is_one(candidates: &usize) -> bool {
    *candidates == 1
}
