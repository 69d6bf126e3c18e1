//! The state of a training, and the metrics of its measurements.

use kinelm_model::fast::Losses;
use serde::{Deserialize, Serialize};

/// Metrics of a measurement, as `metrics.jsonl` has them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EvalMetrics {
    /// Updates done.
    pub step: u64,
    /// Mean -ln p of the motion's tokens over the updates since the last measurement.
    pub token_nats: f64,
    /// Mean weighted -ln p of the classes, summed over the fields.
    pub class_nats: f64,
    /// The same on the validation windows, unweighted.
    pub valid_nats: Option<f64>,
    /// Share of the validation windows that are classified right, averaged over the fields.
    pub valid_accuracy: Option<f64>,
}

/// The state of a training after an update.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct TrainState {
    /// Updates done.
    pub step: u64,
    /// Lines of `metrics.jsonl`.
    pub lines: usize,
    /// Whether the measurement after the last update was interrupted: it comes before the next.
    pub due: bool,
    /// The best measurement's step and -ln p.
    pub(super) best: u64,
    pub(super) valid_nats: Option<f64>,
    /// Measurements since.
    pub(super) worse: u64,
    pub(super) averages: Averages,
}

/// Sums of the losses since the last measurement.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Averages {
    updates: u32,
    tokens: f64,
    classes: f64,
}

impl Averages {
    /// Adds an update's losses, the motion's over `counted` tokens.
    pub(super) fn add(&mut self, found: Losses, counted: usize) {
        self.updates += 1;
        self.tokens += found.tokens / counted.max(1) as f64;
        self.classes += found.classes;
    }
}

impl TrainState {
    /// The metrics of a measurement. It is the best if it is better than those before; without validation clips every one
    /// is.
    pub(super) fn measured(&mut self, measured: Option<(f64, f64)>) -> EvalMetrics {
        let Averages { updates, tokens, classes } = std::mem::take(&mut self.averages);
        let updates = f64::from(updates.max(1));
        let (valid_nats, valid_accuracy) = measured.unzip();
        self.lines += 1;
        let better = match (valid_nats, self.valid_nats) {
            // of equals the earlier stays, and NaN is never better
            (Some(now), Some(before)) => now < before,
            _ => true,
        };
        match better {
            true => (self.best, self.valid_nats, self.worse) = (self.step, valid_nats, 0),
            false => self.worse += 1,
        }
        let (token_nats, class_nats) = (tokens / updates, classes / updates);
        EvalMetrics { step: self.step, token_nats, class_nats, valid_nats, valid_accuracy }
    }
}
