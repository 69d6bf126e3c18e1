//! The learner of a form and a device.

use super::config::TrainConfig;
use super::fast::FastLearner;
use super::learner::Learner;
use super::plain::Plain;
use crate::Result;
use kinelm_engine::linear::Products;
use kinelm_model::fast::Fast;
use kinelm_model::weights::Weights;
use kinelm_model::{Compute, Gpt, ModelConfig, TokenLayout};

/// The learner of a form and a device, beginning with these `weights`.
///
/// # Errors
/// Weights that don't fit the configuration, a device that isn't there.
pub fn learner(
    model: &ModelConfig,
    tokens: &TokenLayout,
    train: &TrainConfig,
    weights: &Weights,
    compute: Compute,
    products: Products,
) -> Result<Box<dyn Learner>> {
    if compute.is_fast() {
        let mut fast = Fast::from_weights(model, tokens, weights)?;
        fast.multiply_by(products);
        return Ok(Box::new(FastLearner::new(fast, train)));
    }
    let gpt = Gpt::from_weights(model, tokens, weights, compute.device)?;
    Ok(Box::new(Plain::new(gpt, train)?))
}
