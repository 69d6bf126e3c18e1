//! What the training loop needs of a model, whatever computes it.

use super::batches::Batch;
use super::config::TrainConfig;
use super::fast::FastLearner;
use super::plain::Plain;
use crate::{Error, Result};
use candle_core::Tensor;
use kinelm_engine::linear::Products;
use kinelm_model::fast::Fast;
use kinelm_model::layout::Parameter;
use kinelm_model::{Compute, Gpt, ModelConfig, Scores, TokenLayout, weights};
use std::collections::BTreeMap;

/// What a step computes before its update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Mean over the targets that count, nats a token.
    pub loss: f64,
    /// Targets that count.
    pub counted: usize,
    /// Euclidean norm of the mean loss's gradient over all variables; may be infinite or no number.
    pub norm: f64,
}

/// A model that learns: weights, their gradients and the optimizer's moments, wherever they are kept.
///
/// It works on the rayon pool that it is called in, whose number of threads changes no bit.
pub trait Learner: Scores + Send {
    /// Loss and gradients of a batch, with the dropout of step `step`; the gradients stay here for [`Learner::update`].
    ///
    /// # Errors
    /// As [`Learner::gradients_of`].
    fn gradients(&mut self, batch: &Batch, step: u64) -> Result<Found> {
        self.gradients_of(std::slice::from_ref(batch), step)
    }

    /// The same of several batches as if they were one, computed one after the other in the memory of one: the mean is that
    /// over all their targets that count, and dropout counts their windows through.
    ///
    /// # Errors
    /// A loss that is not finite: the clips are named; what the device refuses.
    fn gradients_of(&mut self, batches: &[Batch], step: u64) -> Result<Found>;

    /// Moves the weights by the gradients found last, times `share`, at the learning rate `rate`.
    ///
    /// # Errors
    /// What the device refuses.
    fn update(&mut self, share: f64, rate: f64) -> Result<()>;

    /// The weights by name, in f32 on the CPU.
    ///
    /// # Errors
    /// What the device refuses.
    fn weights(&self) -> Result<BTreeMap<String, Tensor>>;

    /// The optimizer's moments, `first.{name}` and `second.{name}`, in f32 on the CPU.
    ///
    /// # Errors
    /// What the device refuses.
    fn moments(&self) -> Result<BTreeMap<String, Tensor>>;

    /// Goes on from these moments, which stood after `step` updates.
    ///
    /// # Errors
    /// Moments that are missing or of another shape, each named.
    fn restore(&mut self, moments: BTreeMap<String, Tensor>, step: u64) -> Result<()>;

    /// The moving average of the weights by name ([`super::average`]), in f32 on the CPU; none where the configuration
    /// has none.
    ///
    /// # Errors
    /// What the device refuses.
    fn averages(&self) -> Result<Option<BTreeMap<String, Tensor>>>;

    /// Goes on from this moving average.
    ///
    /// # Errors
    /// Tensors that are missing or of another shape, each named; a configuration without an average.
    fn restore_averages(&mut self, averages: BTreeMap<String, Tensor>) -> Result<()>;

    /// Weights and their average change places, to measure with the average and then to go on; nothing where there is
    /// none.
    ///
    /// # Errors
    /// What the device refuses.
    fn exchange(&mut self) -> Result<()>;
}

/// The learner of the form and on the device that are wanted, beginning with these `weights`.
///
/// # Errors
/// Weights that don't fit the configuration, a device that isn't there.
pub fn learner(
    model: &ModelConfig,
    tokens: &TokenLayout,
    train: &TrainConfig,
    weights: BTreeMap<String, Tensor>,
    (compute, products): (Compute, Products),
) -> Result<Box<dyn Learner>> {
    if compute.is_fast() {
        let mut fast = Fast::from_tensors(model, tokens, weights)?;
        fast.multiply_by(products);
        return Ok(Box::new(FastLearner::new(fast, train)));
    }
    let device = compute.device.open()?;
    let gpt = Gpt::from_tensors(model, tokens, weights::to_device(&weights, &device)?)?;
    Ok(Box::new(Plain::new(gpt, train)?))
}

/// What gradients of norm `norm` are multiplied with so that they stay within `limit` (0: no limit), as PyTorch clips.
pub fn clip_share(norm: f64, limit: f64) -> f64 {
    if limit > 0.0 { (limit / (norm + 1e-6)).min(1.0) } else { 1.0 }
}

/// The error of a loss that is not finite, on these of a batch's windows.
pub fn not_finite(loss: f64, clips: &[String]) -> Error {
    Error::NotFinite(format!("the loss is {loss} on {}", listed(clips.iter())))
}

/// The error of a moving average that the configuration doesn't have.
pub fn no_average() -> Error {
    Error::call("a moving average of the weights; expected none, as train.ema is 0")
}

/// The windows of a step for a message: the first of them, and how many more there are.
pub fn listed<'a>(mut clips: impl ExactSizeIterator<Item = &'a String>) -> String {
    const MOST: usize = 32;
    let some: Vec<&str> = clips.by_ref().take(MOST).map(String::as_str).collect();
    match clips.len() {
        0 => some.join(", "),
        more => format!("{} and {more} more windows", some.join(", ")),
    }
}

/// The tensors `all` in the order of the parameters, each of its shape; `what` they are is for the message.
pub fn in_order(
    what: &str,
    parameters: &[Parameter],
    all: &BTreeMap<String, Tensor>,
    name: impl Fn(&Parameter) -> String,
) -> Result<Vec<Tensor>> {
    let one = |p: &Parameter| {
        let name = name(p);
        let tensor = all.get(&name).filter(|t| t.dims() == p.shape).cloned();
        tensor.ok_or_else(|| Error::call(format!("the {what} has no {name} of shape {:?}", p.shape)))
    };
    parameters.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_model::layout;

    #[test]
    fn the_limit_of_a_norm() {
        assert!((clip_share(5.0, 1.0) - 0.2).abs() < 1e-6);
        assert_eq!(clip_share(0.5, 1.0), 1.0);
        assert_eq!(clip_share(5.0, 0.0), 1.0);
    }

    #[test]
    fn tensors_are_in_order_and_a_missing_one_is_named() {
        let (config, tokens) = kinelm_model::fixtures::every(36)
            .into_iter()
            .find(|(config, tokens)| !config.architecture.is_flat() && tokens.front > 1)
            .unwrap();
        let parameters = layout::parameters(&config, &tokens);
        let mut all: BTreeMap<String, Tensor> = layout::initial(&config, &tokens, 1).unwrap();
        all = all.into_iter().map(|(name, x)| (format!("first.{name}"), x.affine(1.0, 1.0).unwrap())).collect();
        let read =
            |all: &BTreeMap<String, Tensor>| in_order("optimizer", &parameters, all, |p| format!("first.{}", p.name));
        let whole = read(&all).unwrap();
        assert!(parameters.iter().zip(&whole).all(|(p, tensor)| tensor.dims() == p.shape));
        all.remove("first.frame.label.weight").unwrap();
        let refused = read(&all).unwrap_err().to_string();
        assert!(refused.contains("no first.frame.label.weight of shape [26, 12]"), "{refused}");
    }

    #[test]
    fn long_lists_are_cut() {
        let names: Vec<String> = (0..34).map(|i| format!("c{i}")).collect();
        assert_eq!(listed(names[..2].iter()), "c0, c1");
        assert!(listed(names.iter()).ends_with("c31 and 2 more windows"));
    }
}
