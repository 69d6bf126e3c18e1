//! The memory that training a model takes, checked before anything is allocated.
//!
//! An estimate for the fast form: the graph of the plain form takes more.

use super::config::TrainConfig;
use super::stages;
use crate::Result;
use kinelm_model::{Architecture, ModelConfig, TokenLayout, layout};
use kinelm_store::memory;

/// About how many bytes training takes: weights, gradients, two moments, and the sum of gradients and the average of weights
/// where used; eleven numbers per token, layer and unit of width for the backward pass, and the workspace of one layer.
pub fn needed(config: &ModelConfig, tokens: &TokenLayout, train: &TrainConfig) -> u128 {
    let copies = 4 + u128::from(train.accumulate > 1) + u128::from(train.ema > 0.0);
    let parameters: u128 = layout::parameters(config, tokens).iter().map(|p| p.len() as u128).sum();
    let tokens_a_step = stages::most_tokens(train, config, tokens) as u128;
    // the rows of a two-level decoder are tokens; those of its trunk are few
    let (layers, width) = match config.architecture {
        Architecture::Flat => (config.layers, config.width),
        Architecture::TwoLevel => (config.decoder().layers, config.decoder().width),
    };
    let activations = tokens_a_step * width as u128 * (11 * layers as u128 + 30);
    4 * (copies * parameters + activations)
}

/// Refuses a model that doesn't fit into the free memory.
///
/// # Errors
/// [`kinelm_store::Error::Limit`]; nothing where the system doesn't report its free memory.
pub fn check(config: &ModelConfig, tokens: &TokenLayout, train: &TrainConfig) -> Result<()> {
    let help = "lower model.width, model.layers, model.context (model.window for two levels) or train.batch (with \
                train.accumulate raised as much, a step stays the same)";
    Ok(memory::check(needed(config, tokens, train), "training this model on these batches", help)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_refused_in_gigabytes() {
        let tokens = TokenLayout {
            vocabulary: 400,
            word: 43,
            varying: false,
            front: 1,
            pad: 0,
            bos: 1,
            space: 5,
            places: Vec::new(),
        };
        let thesis = ModelConfig { layers: 8, heads: 8, width: 512, context: 1024, ..Default::default() };
        // 26 million parameters of four numbers, 1,024 x 512 x 118 more
        let one = TrainConfig { batch: 1, ..Default::default() };
        let bytes = needed(&thesis, &tokens, &one) as f64;
        assert!((bytes / 662e6 - 1.0).abs() < 0.02, "{bytes}");
        // a sum of gradients and an average of weights: two numbers a parameter more
        let more = TrainConfig { accumulate: 8, ema: 0.999, ..one.clone() };
        assert!(((needed(&thesis, &tokens, &more) as f64 - bytes) / 203.7e6 - 1.0).abs() < 0.01);
        let huge = ModelConfig { layers: 96, width: 8192, ..thesis.clone() };
        let message = check(&huge, &tokens, &one).map_err(|e| e.to_string());
        if memory::free().is_some() {
            assert!(message.unwrap_err().contains("lower model.width"));
        }
        check(&ModelConfig::default(), &tokens, &one).unwrap();
    }
}
