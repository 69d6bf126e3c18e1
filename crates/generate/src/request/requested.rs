//! What is requested of a model, before anything is decided.

use super::{Computing, FootMode, MusicRequest, PromptRequest, Rig, TimedLabel};
use crate::rest::RestJoints;
use crate::sampling::Draw;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// What is requested of a model. Every choice that is `None` is made by [`crate::open::OpenRequest::open`].
///
/// ```
/// use kinelm_generate::request::{Length, Request};
///
/// let request = Request { length: Some(Length::Seconds(10.0)), seed: 7, ..Request::of("run") };
/// assert_eq!((request.seed, request.guidance), (7, None));
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Request {
    /// The run folder of the model.
    pub run: PathBuf,
    /// A clip of which something is given.
    pub prompt: Option<PromptRequest>,
    /// Values of label fields for the whole dance; fields that are left out are unknown to the model.
    pub labels: BTreeMap<String, String>,
    /// Values of label fields for a time of the dance.
    pub timed_labels: Vec<TimedLabel>,
    /// Music to dance to.
    pub music: Option<MusicRequest>,
    /// How far labels and music are followed; 1: as the model has learned them. `None`: with music what suits the model's
    /// conditioning ([`crate::music::guidance`]), else 1.
    pub guidance: Option<f64>,
    /// How far gaps are led to what is given after them, 0 to 10; 1: as learned. `None`: [`crate::open::AHEAD`] where the
    /// model was trained for it and a gap ends, else 0.
    pub ahead: Option<f64>,
    /// How long the dance is. `None`: as long as what is given of the prompt, else as the music, else as the prompt.
    pub length: Option<Length>,
    /// Frames a second of the file that is written. `None`: the model's rate.
    pub fps: Option<f64>,
    /// What an unprompted dance goes on from. `None`: a second of a train clip where the run keeps some.
    pub lead_in: Option<LeadInKind>,
    /// Candidates for the first frame. `None`: [`crate::starts::STARTS`] where some joints of it are given after free ones.
    pub starts: Option<usize>,
    /// The seed of the random streams: the same seed gives the same dance.
    pub seed: u64,
    /// How free characters are sampled. Without any truncation (`top_k`, `top_p`, `min_p`, `greedy`), `top_p` is chosen:
    /// [`crate::sampling::TOP_P`], or [`crate::cut::GIVEN_TOP_P`] where joints are given from end to end.
    pub draw: Draw,
    /// The rig that the dance is written on. `None`: the prompt's own where a clip is edited, else the model's.
    pub rig: Option<Rig>,
    /// What the joints do that the model doesn't code. `None`: they follow the prompt, or hold the mean of the training
    /// clips.
    pub rest_joints: Option<RestJoints>,
    /// What is done to the feet. `None`: locked unless a leg is given.
    pub feet: Option<FootMode>,
    /// Where and how the model computes.
    pub computing: Computing,
}

/// How long a dance is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Length {
    /// In frames at the model's rate.
    Frames(usize),
    /// In seconds.
    Seconds(f64),
}

/// What an unprompted dance goes on from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum LeadInKind {
    /// Of a train clip, chosen by --seed and --label
    Train,
    /// Drawn by the model too
    None,
}

impl Default for Request {
    fn default() -> Request {
        Request::of(PathBuf::new())
    }
}

impl Request {
    /// A request of the model in the folder `run`, with seed 1.
    pub fn of(run: impl Into<PathBuf>) -> Request {
        Request {
            run: run.into(),
            prompt: None,
            labels: BTreeMap::new(),
            timed_labels: Vec::new(),
            music: None,
            guidance: None,
            ahead: None,
            length: None,
            fps: None,
            lead_in: None,
            starts: None,
            seed: 1,
            draw: Draw::default(),
            rig: None,
            rest_joints: None,
            feet: None,
            computing: Computing::default(),
        }
    }
}
