//! What a classifier learns, and from what.

use crate::{Error, Result};
use kinelm_corpus::labels::LabelFilter;
use kinelm_train::{Schedule, TrainConfig};
use serde::{Deserialize, Serialize};

/// What to learn, from what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainOptions {
    /// The label fields to classify by.
    pub fields: Vec<String>,
    /// Labels that clips must have.
    pub only: Vec<LabelFilter>,
    /// The run's shape with random weights instead of its own.
    pub scratch: bool,
    /// The share of the training clips that are used, above 0 up to 1: of each class at least one clip.
    pub share: f64,
    /// Class tokens attend to those before them.
    pub compat: bool,
    /// Classes are weighted by their shares of the windows, instead of equally.
    pub unbalanced: bool,
    /// Updates.
    pub steps: u64,
    /// Windows of a step.
    pub batch: usize,
    /// The learning rate of the pretrained weights.
    pub rate: f64,
    /// That of the heads and the class tokens, which are new.
    pub head_rate: f64,
    /// Updates between measurements on the validation clips.
    pub eval_every: u64,
    /// Largest number of validation windows of a measurement, evenly spread; 0: all.
    pub eval_windows: usize,
    /// Measurements without improvement after which training ends; 0: never.
    pub patience: u64,
    /// The seed of all random numbers.
    pub seed: u64,
}

impl Default for TrainOptions {
    /// The thesis's where it states them (docs/classification.md).
    fn default() -> Self {
        TrainOptions {
            fields: Vec::new(),
            only: Vec::new(),
            scratch: false,
            share: 1.0,
            compat: false,
            unbalanced: false,
            steps: 1000,
            batch: 16,
            rate: 2e-5,
            head_rate: 1e-3,
            eval_every: 100,
            eval_windows: 512,
            patience: 0,
            seed: 1,
        }
    }
}

impl TrainOptions {
    /// 5 % of warm-up, then a cosine.
    pub(super) fn schedule(&self) -> TrainConfig {
        TrainConfig {
            batch: self.batch,
            steps: self.steps,
            learning_rate: self.rate,
            schedule: Schedule::Cosine,
            warmup: (self.steps / 20).max(1),
            seed: self.seed,
            ..TrainConfig::default()
        }
    }
}

/// The most windows of an update.
const MOST_BATCH: usize = 1 << 16;

pub(super) fn check(options: &TrainOptions) -> Result<()> {
    let TrainOptions { share, steps, batch, rate, head_rate, .. } = *options;
    let positive = |x: f64| x > 0.0 && x.is_finite();
    match () {
        () if !(share > 0.0 && share <= 1.0) => Err(Error::invalid_parameter("share", share, "above 0, at most 1")),
        () if steps == 0 => Err(Error::invalid_parameter("steps", steps, "1 or more")),
        () if !(1..=MOST_BATCH).contains(&batch) => {
            Err(Error::invalid_parameter("batch", batch, format!("1 to {MOST_BATCH} windows")))
        }
        () if !positive(rate) => Err(Error::invalid_parameter("rate", rate, "a number above 0")),
        () if !positive(head_rate) => Err(Error::invalid_parameter("head_rate", head_rate, "a number above 0")),
        () => Ok(()),
    }
}
