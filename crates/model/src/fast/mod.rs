//! The fast form of a model, on the CPU: the engine's parts in the order of [`super::Gpt`], which stays the oracle.
//!
//! It has the plain form's tensors, under their names, in buffers of its own; activations are allocated once for a shape
//! of batch and used again.

mod classes;
mod flat;
mod head;
mod input;
mod keys;
mod pass;
mod stack;
mod tables;
#[cfg(test)]
mod tests;
mod two_level;

pub use classes::{ClassRow, Losses};

use super::config::{ModelConfig, TokenLayout};
use super::forecast::Forecast;
use super::goal::Conditioning;
use super::layout::{Parameter, TRUNK};
use super::scores::{Scores, TokenWindows};
use super::{Architecture, Dropout, Gpt, ModelKind};
use crate::weights::{self, Weights, named};
use crate::{Error, Result};
use keys::Keys;
use kinelm_engine::arena::Floats;
use kinelm_engine::block;
use kinelm_engine::linear::Products;
use kinelm_engine::op::attention::Mask;
use kinelm_engine::op::smoothing::Smoothing;
use pass::Pass;

/// Tensors of a block, in the order of their names.
const BLOCK: usize = 12;

/// The inputs of a pass.
#[derive(Debug, Clone, Copy)]
pub struct Windows<'a> {
    /// (B, T) ids.
    pub inputs: &'a [u32],
    /// (B, T) ids; `<pad>` counts for nothing.
    pub targets: &'a [u32],
    /// T, at most the context.
    pub length: usize,
    /// Which tokens a token sees.
    pub mask: Mask<'a>,
    /// (B, H W) the frames before each window, `<pad>` where there are none; empty: none before any. H is
    /// [`ModelConfig::history`].
    pub history: &'a [u32],
    /// Goal conditioning of the frames of a two-level model.
    pub conditioning: Option<&'a Conditioning>,
}

/// Called in a backward pass at the final vectors' norm, with its input (N, D): adds to the gradients of that and of
/// the model's tensors.
type Added<'a> = &'a mut dyn FnMut(&Fast, &[f32], &mut [f32], &mut [Floats]);

/// A model whose passes the engine computes, on the rayon pool they are called in.
pub struct Fast {
    config: ModelConfig,
    tokens: TokenLayout,
    /// Sorted by name.
    parameters: Vec<Parameter>,
    weights: Vec<Floats>,
    forecast: Option<Forecast>,
    training: Option<Pass>,
    scoring: Option<Pass>,
    keys: Option<Keys>,
    smoothing: Option<Smoothing>,
    /// How the products of training are computed; those of scoring are f32.
    products: Products,
}

impl Fast {
    /// A model of these weights, copied.
    ///
    /// # Errors
    /// As [`Gpt::from_weights`].
    pub fn from_weights(config: &ModelConfig, tokens: &TokenLayout, weights: &Weights) -> Result<Fast> {
        let (all, forecast) = weights::checked(config, tokens, weights)?;
        let (parameters, weights) = all.into_iter().map(|(p, array)| (p, Floats::of(array.numbers()))).unzip();
        Ok(Fast {
            config: config.clone(),
            tokens: tokens.clone(),
            weights,
            parameters,
            forecast,
            training: None,
            scoring: None,
            keys: None,
            smoothing: None,
            products: Products::F32,
        })
    }

    /// The fast form of a model, whose numbers are copied.
    ///
    /// # Errors
    /// Errors of the model's device.
    pub fn of(gpt: &Gpt) -> Result<Fast> {
        Fast::from_weights(gpt.config(), gpt.tokens(), &gpt.weights()?)
    }

    /// The mask of attention in a model of this kind.
    pub fn mask(&self) -> Mask<'static> {
        match self.config.kind {
            ModelKind::Causal => Mask::Causal,
            ModelKind::Masked => Mask::Full,
        }
    }

    /// Targets are smoothed over neighbouring bins from now on, as [`Gpt::smooth_targets`] says.
    ///
    /// # Panics
    /// If the width is no positive number.
    pub fn smooth_targets(&mut self, width: Option<f64>) {
        self.smoothing = width.map(Smoothing::new);
    }

    /// How the products of the passes with gradients are computed from now on; likelihoods stay f32.
    pub fn multiply_by(&mut self, products: Products) {
        self.products = products;
    }

    /// Its weights, copied.
    pub fn weights(&self) -> Weights {
        self.named(&self.weights)
    }

    /// Numbers of its tensors as its weights: under their names, with its forecast.
    ///
    /// # Panics
    /// If they have other lengths than its tensors.
    pub fn named(&self, numbers: &[Floats]) -> Weights {
        let mut all = named(&self.parameters, numbers);
        all.extend(self.forecast.iter().flat_map(weights::of_forecast));
        all
    }

    /// The tensors that it learns, in the order of their names.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// The numbers of its tensors, in that order.
    pub fn weights_mut(&mut self) -> &mut [Floats] {
        &mut self.weights
    }

    /// Room for the gradients of its tensors, or anything else that has their shapes.
    pub fn like_weights(&self) -> Vec<Floats> {
        self.parameters.iter().map(|p| Floats::new(p.len())).collect()
    }

    /// Sum of -ln p over the targets that aren't `<pad>`, in nats; `gradients` become those of the mean.
    ///
    /// Nothing is allocated but for the first batch of a shape.
    ///
    /// # Errors
    /// Windows longer than the context, ids outside the vocabulary; under a relative head targets after no bin.
    pub fn gradients(&mut self, windows: Windows, dropout: Option<&Dropout>, gradients: &mut [Floats]) -> Result<f64> {
        self.gradients_and(windows, dropout, gradients, &mut |_, _, _, _| ())
    }

    fn gradients_and(
        &mut self,
        windows: Windows,
        dropout: Option<&Dropout>,
        gradients: &mut [Floats],
        added: Added,
    ) -> Result<f64> {
        self.check(windows)?;
        let Windows { inputs, targets, length, .. } = windows;
        // taken out, so that the pass may borrow the model; an error below drops it, and the next call builds another
        let pass = self.training.take().filter(|p| p.fits(inputs.len(), length, self.products));
        let mut pass = pass.unwrap_or_else(|| Pass::new(self, inputs.len(), length, self.products, true));
        pass.fill(self, windows);
        pass.set_targets(windows)?;
        let counted = targets.iter().filter(|&&t| t != self.tokens.pad).count();
        let batch = inputs.len() / length;
        let keys = dropout.map(|dropout| {
            let prefix = if self.config.architecture.is_flat() { "" } else { TRUNK };
            let fresh = || Keys::new(prefix, self.config.layers, batch);
            let mut keys = self.keys.take().filter(|k| k.fits(batch)).unwrap_or_else(fresh);
            keys.draw(dropout);
            keys
        });
        pass.forward(self, windows, keys.as_ref());
        let nats = pass.backward(self, windows, 1.0 / counted.max(1) as f32, keys.as_ref(), gradients, added);
        self.training = Some(pass);
        self.keys = keys;
        Ok(nats)
    }

    /// Logits (B, T, V), which is much: for tests and looking closely.
    ///
    /// # Errors
    /// Windows longer than the context, ids outside the vocabulary.
    pub fn logits(&mut self, windows: Windows) -> Result<Vec<f32>> {
        let mut all = vec![0.0; windows.inputs.len() * self.tokens.vocabulary];
        let mut pass = self.scored(windows)?;
        pass.forward(self, windows, None);
        pass.logits(self, windows, &mut all);
        self.scoring = Some(pass);
        Ok(all)
    }

    /// Room to score such windows.
    fn scored(&mut self, windows: Windows) -> Result<Pass> {
        self.check(windows)?;
        let (rows, length) = (windows.inputs.len(), windows.length);
        let pass = self.scoring.take().filter(|p| p.fits(rows, length, Products::F32));
        let mut pass = pass.unwrap_or_else(|| Pass::new(self, rows, length, Products::F32, false));
        pass.fill(self, windows);
        Ok(pass)
    }

    fn check(&self, windows: Windows) -> Result<()> {
        let Windows { inputs, targets, length, history, conditioning, .. } = windows;
        let (context, vocabulary) = (self.config.context, self.tokens.vocabulary);
        if length > context {
            let (needs, limit) = (format!("{length} tokens"), format!("{context} tokens"));
            return Err(Error::limit("a window", needs, limit, "the model's context holds no more"));
        }
        if length == 0 || !inputs.len().is_multiple_of(length) || inputs.len() != targets.len() {
            let found = (inputs.len(), targets.len());
            let found = format!("{} inputs and {} targets", found.0, found.1);
            return Err(Error::invalid("a batch", found, format!("as many of both, in windows of {length}")));
        }
        let words = (length + 1).saturating_sub(self.tokens.front);
        let whole = words > 0 && words.is_multiple_of(self.tokens.word);
        if self.config.architecture == Architecture::TwoLevel && !whole {
            let word = self.tokens.word;
            let expected = format!("whole frames of {word} for a two-level model");
            return Err(Error::invalid("the length of a window", format!("{length} tokens"), expected));
        }
        self.config.check_history(&self.tokens, inputs.len() / length, history)?;
        if let Some(conditioning) = conditioning {
            conditioning.check(&self.config, &self.tokens, inputs.len() / length, length)?;
        }
        match inputs.iter().chain(targets).find(|&&id| id as usize >= vocabulary) {
            Some(id) => Err(Error::invalid("a token", format!("id {id}"), format!("ids below {vocabulary}"))),
            None => Ok(()),
        }
    }

    /// A tensor's index.
    fn find(&self, name: &str) -> Option<usize> {
        self.parameters.binary_search_by(|p| p.name.as_str().cmp(name)).ok()
    }

    fn index(&self, name: &str) -> usize {
        self.find(name).unwrap_or_else(|| panic!("a model has a {name}"))
    }

    fn weight(&self, name: &str) -> &[f32] {
        self.find(name).map_or(&[], |i| &self.weights[i])
    }

    fn norm(&self) -> block::Norm<&[f32]> {
        block::Norm { weight: self.weight("norm.weight"), bias: self.weight("norm.bias") }
    }
}

/// A block's tensors from the order of their names.
fn block_tensors<T>(
    // alphabetical: attention.out, attention.qkv, mlp.down, mlp.up, norm1, norm2, each bias before weight
    [out_b, out_w, qkv_b, qkv_w, down_b, down_w, up_b, up_w, n1_b, n1_w, n2_b, n2_w]: [T; BLOCK],
) -> block::Tensors<T> {
    let linear = |weight, bias| block::Linear { weight, bias };
    block::Tensors {
        norm1: block::Norm { weight: n1_w, bias: n1_b },
        qkv: linear(qkv_w, qkv_b),
        out: linear(out_w, out_b),
        norm2: block::Norm { weight: n2_w, bias: n2_b },
        up: linear(up_w, up_b),
        down: linear(down_w, down_b),
    }
}

impl Scores for Fast {
    fn config(&self) -> &ModelConfig {
        &self.config
    }

    fn tokens(&self) -> &TokenLayout {
        &self.tokens
    }

    fn nats(&mut self, windows: TokenWindows, out: &mut [f32]) -> Result<()> {
        let TokenWindows { inputs, targets, length, history, conditioning } = windows;
        assert_eq!((inputs.len(), targets.len()), (out.len(), out.len()), "a target for every input and its nats");
        let windows = Windows { inputs, targets, length, mask: self.mask(), history, conditioning };
        let mut pass = self.scored(windows)?;
        pass.set_targets(windows)?;
        pass.forward(self, windows, None);
        pass.nats(self, out);
        self.scoring = Some(pass);
        Ok(())
    }
}
