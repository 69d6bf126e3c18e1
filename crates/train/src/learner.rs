//! A model that learns, whatever computes it.

use super::batches::Batch;
use super::config::TrainConfig;
use super::stages::Stages;
use crate::{Error, Result};
use kinelm_model::Scores;
use kinelm_model::weights::Weights;

/// Loss and gradient norm of a batch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BatchLoss {
    /// Mean over the targets that count, nats a token.
    pub loss: f64,
    /// Targets that count.
    pub counted: usize,
    /// Euclidean norm of the mean loss's gradient over all variables; may be infinite or NaN.
    pub norm: f64,
}

/// Weights, their gradients and the optimizer's moments, on any device.
///
/// It works on the rayon pool that it is called in, whose number of threads changes no bit.
pub trait Learner: Send {
    /// The model with its present weights, to be measured.
    fn scores(&mut self) -> &mut dyn Scores;

    /// Loss and gradients of a batch, with the dropout of step `step`. The gradients stay here for [`Learner::update`].
    ///
    /// # Errors
    /// As [`Learner::gradients_of`].
    fn gradients(&mut self, batch: &Batch, step: u64) -> Result<BatchLoss> {
        self.gradients_of(std::slice::from_ref(batch), step)
    }

    /// Loss and gradients of several batches as of one, computed one after the other in the memory of one: the mean is over
    /// all their targets that count, and dropout numbers their windows consecutively.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a loss that is not finite, with the clips; what the device refuses.
    fn gradients_of(&mut self, batches: &[Batch], step: u64) -> Result<BatchLoss>;

    /// Moves the weights by the last gradients times `share`, at the learning rate `rate`.
    ///
    /// # Errors
    /// Errors of the device.
    fn update(&mut self, share: f64, rate: f64) -> Result<()>;

    /// The weights by name, in f32 on the CPU.
    ///
    /// # Errors
    /// Errors of the device.
    fn weights(&self) -> Result<Weights>;

    /// The optimizer's moments, `first.{name}` and `second.{name}`, in f32 on the CPU.
    ///
    /// # Errors
    /// Errors of the device.
    fn moments(&self) -> Result<Weights>;

    /// Continues from the moments after `step` updates.
    ///
    /// # Errors
    /// Moments that are missing or of another shape, each named.
    fn restore(&mut self, moments: &Weights, step: u64) -> Result<()>;

    /// The moving average of the weights by name ([`super::ema`]), in f32 on the CPU; `None` where `train.ema` is 0.
    ///
    /// # Errors
    /// Errors of the device.
    fn averages(&self) -> Result<Option<Weights>>;

    /// Continues from this moving average.
    ///
    /// # Errors
    /// Tensors that are missing or of another shape, each named; a configuration without an average.
    fn restore_averages(&mut self, averages: &Weights) -> Result<()>;

    /// Swaps the weights and their average, to measure the average; does nothing without one.
    ///
    /// # Errors
    /// Errors of the device.
    fn swap_averages(&mut self) -> Result<()>;
}

/// A learner with the batches of its steps.
pub struct Fit<'a> {
    stages: Stages<'a>,
    /// The learner.
    pub learner: Box<dyn Learner>,
    clip_norm: f64,
}

impl<'a> Fit<'a> {
    /// `learner` on these windows.
    pub(crate) fn new(stages: Stages<'a>, learner: Box<dyn Learner>, train: &TrainConfig) -> Fit<'a> {
        Fit { stages, learner, clip_norm: train.clip_norm }
    }

    /// Loss and gradients of step `step`, and the number of its windows.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a loss or a gradient that is not finite, with the clips; what the device refuses.
    pub fn gradients(&mut self, step: u64) -> Result<(BatchLoss, usize)> {
        let batches = self.stages.of_step(step)?;
        let found = self.learner.gradients_of(&batches, step)?;
        let clips: Vec<&String> = batches.iter().flat_map(|b| &b.clips).collect();
        match found.norm.is_finite() {
            true => Ok((found, clips.len())),
            false => {
                let clips = listed(clips.into_iter());
                Err(Error::NotFinite(format!("the gradient's norm is {} on {clips}", found.norm)))
            }
        }
    }

    /// Moves the weights by the last gradients, whose norm is `norm`, at the learning rate `rate`.
    ///
    /// # Errors
    /// Errors of the device.
    pub fn update(&mut self, norm: f64, rate: f64) -> Result<()> {
        self.learner.update(clip_share(norm, self.clip_norm), rate)
    }
}

/// The factor that clips gradients of norm `norm` to `limit` (0: no limit), as PyTorch's `clip_grad_norm_`.
///
/// ```
/// # use kinelm_train::learner::clip_share;
/// assert!((clip_share(4.0, 1.0) - 0.25).abs() < 1e-6);
/// assert_eq!(clip_share(0.5, 1.0), 1.0);
/// ```
pub fn clip_share(norm: f64, limit: f64) -> f64 {
    // 1e-6 is PyTorch's, against a norm of 0
    if limit > 0.0 { (limit / (norm + 1e-6)).min(1.0) } else { 1.0 }
}

/// The error of a loss that is not finite, on these clips.
pub fn not_finite(loss: f64, clips: &[String]) -> Error {
    Error::NotFinite(format!("the loss is {loss} on {}", listed(clips.iter())))
}

/// The error of a moving average for a configuration without one.
pub(crate) fn no_average() -> Error {
    Error::invalid("train.ema", 0, "a decay above 0: there is a moving average of the weights")
}

/// The windows of a step for a message: the first 32, and how many more there are.
pub fn listed<'a>(mut clips: impl ExactSizeIterator<Item = &'a String>) -> String {
    const MOST: usize = 32;
    let some: Vec<&str> = clips.by_ref().take(MOST).map(String::as_str).collect();
    match clips.len() {
        0 => some.join(", "),
        more => format!("{} and {more} more windows", some.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_of_a_norm() {
        assert!((clip_share(5.0, 1.0) - 0.2).abs() < 1e-6);
        assert_eq!(clip_share(0.5, 1.0), 1.0);
        assert_eq!(clip_share(5.0, 0.0), 1.0);
    }

    #[test]
    fn long_lists_are_shortened() {
        let names: Vec<String> = (0..34).map(|i| format!("c{i}")).collect();
        assert_eq!(listed(names[..2].iter()), "c0, c1");
        assert!(listed(names.iter()).ends_with("c31 and 2 more windows"));
    }
}
