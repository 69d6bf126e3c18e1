//! What decides a dance, as one value that a file can hold.

use super::place::Place;
use super::rest::RestJoints;
use super::sampling::Draw;
use crate::model::{Compute, Reading};
use crate::{Error, Result};
use kinelm_engine::decode::{KvKind, WeightKind};
use kinelm_motion::format::ReadOptions;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Everything that decides a dance, but the bytes of the model and of the prompt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The run folder.
    pub run: PathBuf,
    /// A clip of which something is followed.
    pub prompt: Option<PromptRecipe>,
    /// What the model is told of the dance: values of label fields; fields that are left out are unknown.
    pub labels: BTreeMap<String, String>,
    /// How far the labels are followed, 1: as the model has learned them. See [`super::guidance`].
    pub guidance: f64,
    /// Frames, at the model's rate; `None`: as many as the prompt has.
    pub frames: Option<usize>,
    /// The seed of the draws.
    pub seed: u64,
    /// How free places are drawn.
    pub draw: Draw,
    /// The rig that the dance is written on.
    pub rig: Rig,
    /// What the joints do that the model doesn't know.
    pub rest_joints: RestJoints,
    /// Where the prompt stands and with it the dance; `None`: where the words leave it, at x = z = 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<Place>,
    /// Where and how the model computes.
    pub computing: Computing,
}

/// What is followed of a clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PromptRecipe {
    /// The file.
    pub path: PathBuf,
    /// How it is read.
    pub read: ReadOptions,
    /// The joints that are followed, as [`kinelm_motion::joints::parse`] takes them; when a dance is asked for, names of the
    /// prompt's rig too.
    pub joints: Option<String>,
    /// The frame from which the dance goes on by itself: those before it are the prompt's.
    pub from_frame: Option<usize>,
}

/// What a dance is written on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rig {
    /// SMPL-24.
    #[default]
    Model,
    /// The prompt's own.
    Prompt,
}

/// Where and how the model computes, in words. Other numbers of threads give the same bits; other devices, forms and ways
/// to hold numbers may not.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Computing {
    /// `cpu` or `cuda:N`.
    pub device: String,
    /// `auto` or `plain`.
    pub form: String,
    /// How weights are held: `f32` or `int8`.
    pub weights: String,
    /// How keys and values are held: `f32` or `f16`.
    pub kv: String,
    /// Instructions of the processor that the engine's kernels used. Told, not asked for.
    #[serde(default)]
    pub kernels: String,
}

impl Computing {
    /// In words.
    pub fn new(compute: Compute, weights: WeightKind, kv: KvKind) -> Computing {
        let weights = match weights {
            WeightKind::F32 => "f32",
            WeightKind::Int8 => "int8",
        };
        let kv = match kv {
            KvKind::F32 => "f32",
            KvKind::F16 => "f16",
        };
        Computing {
            device: compute.device.to_string(),
            form: compute.form.to_string(),
            weights: weights.into(),
            kv: kv.into(),
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
    ///
    /// # Errors
    /// Weights, keys or values that can't be held like that.
    pub fn reading(&self, streams: usize) -> Result<Reading> {
        let weights = match self.weights.as_str() {
            "f32" => WeightKind::F32,
            "int8" => WeightKind::Int8,
            other => return Err(Error::Call(format!("weights held as `{other}`; expected f32 or int8"))),
        };
        let kv = match self.kv.as_str() {
            "f32" => KvKind::F32,
            "f16" => KvKind::F16,
            other => return Err(Error::Call(format!("keys and values held as `{other}`; expected f32 or f16"))),
        };
        Ok(Reading { streams, weights, kv })
    }
}
