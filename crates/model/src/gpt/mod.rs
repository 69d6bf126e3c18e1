//! A pre-norm GPT-2 over the words of a dance: the plain form, differentiable, on any device, which faster forms are
//! compared with.
//!
//! Letters: B batch, T tokens, V vocabulary.

#[cfg(test)]
mod tests;

use crate::cache::Cache;
use crate::config::{ModelConfig, TokenLayout};
use crate::dropout::Dropout;
use crate::forecast::Forecast;
use crate::goal::Conditioning;
use crate::net::{Beside, Net};
use crate::ops::Mask;
use crate::weights::{self, Array, Weights};
use crate::{DeviceName, Error, Result};
use candle_core::{Device, Tensor, Var};
use kinelm_engine::op::smoothing::Smoothing;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A model: its shape and its variables.
pub struct Gpt {
    config: ModelConfig,
    tokens: TokenLayout,
    vars: BTreeMap<String, Var>,
    forecast: Option<Arc<Forecast>>,
    net: Net,
    smoothing: Option<Smoothing>,
}

impl Gpt {
    /// A model before training, on the CPU.
    ///
    /// # Errors
    /// A configuration that doesn't hold: the key and its limits.
    pub fn new(config: &ModelConfig, tokens: &TokenLayout, seed: u64) -> Result<Gpt> {
        config.validate_for(tokens)?;
        Gpt::from_weights(config, tokens, &weights::initial(config, tokens, seed), DeviceName::Cpu)
    }

    /// A model of these weights, copied to `device`.
    ///
    /// # Errors
    /// As [`Gpt::new`]; a device that isn't there; arrays that are missing, not the model's, or of another shape: each is named.
    pub fn from_weights(
        config: &ModelConfig,
        tokens: &TokenLayout,
        weights: &Weights,
        device: DeviceName,
    ) -> Result<Gpt> {
        let device = device.open()?;
        let (all, forecast) = weights::checked(config, tokens, weights)?;
        let vars = all.into_iter().map(|(p, array)| Ok((p.name, Var::from_tensor(&array.tensor(&device)?)?)));
        Gpt::from_vars(config, tokens, vars.collect::<Result<_>>()?, forecast.map(Arc::new))
    }

    /// A model of its variables, which are all there.
    pub(crate) fn from_vars(
        config: &ModelConfig,
        tokens: &TokenLayout,
        vars: BTreeMap<String, Var>,
        forecast: Option<Arc<Forecast>>,
    ) -> Result<Gpt> {
        let tensors = vars.iter().map(|(name, var)| (name, var.as_tensor().clone()));
        let net = Net::new(config, tokens, tensors, forecast.clone())?;
        Ok(Gpt { config: config.clone(), tokens: tokens.clone(), vars, forecast, net, smoothing: None })
    }

    /// The `[model]` table it was made from.
    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// The layout of its tokens.
    pub fn tokens(&self) -> &TokenLayout {
        &self.tokens
    }

    /// Its variables by name, in the order of the names.
    pub fn vars(&self) -> &BTreeMap<String, Var> {
        &self.vars
    }

    /// Its weights, copied, in f32.
    ///
    /// # Errors
    /// Errors of the device.
    pub fn weights(&self) -> Result<Weights> {
        self.named(self.vars.values().map(|var| var.as_tensor()))
    }

    /// Numbers of its variables as its weights: under their names, with its forecast.
    ///
    /// # Errors
    /// Errors of the device.
    pub fn named<'a>(&self, numbers: impl Iterator<Item = &'a Tensor>) -> Result<Weights> {
        let mut all: Weights =
            self.vars.keys().zip(numbers).map(|(name, x)| Ok((name.clone(), Array::of(x)?))).collect::<Result<_>>()?;
        all.extend(self.forecast.iter().flat_map(|forecast| weights::of_forecast(forecast)));
        Ok(all)
    }

    /// Its forecast, if it has one.
    pub(crate) fn forecast(&self) -> Option<&Arc<Forecast>> {
        self.forecast.as_ref()
    }

    /// The same model in f64, for checking gradients.
    ///
    /// # Errors
    /// None in practice.
    #[cfg(test)]
    pub fn to_f64(&self) -> Result<Gpt> {
        let var = |(name, var): (&String, &Var)| {
            Ok((name.clone(), Var::from_tensor(&var.as_tensor().to_dtype(candle_core::DType::F64)?)?))
        };
        Gpt::from_vars(
            &self.config,
            &self.tokens,
            self.vars.iter().map(var).collect::<Result<_>>()?,
            self.forecast.clone(),
        )
    }

    /// The device it is on.
    pub fn device(&self) -> &Device {
        self.net.device()
    }

    /// `ids` (B, T) for [`Gpt::forward`], T = `length`.
    ///
    /// # Errors
    /// Ids outside the vocabulary (not every device would refuse them), more tokens than the context.
    ///
    /// # Panics
    /// If they are not whole windows of `length`.
    pub fn ids(&self, ids: &[u32], length: usize) -> Result<Tensor> {
        self.check_length(length)?;
        self.net.ids(ids, length)
    }

    /// Logits (B, T, V) of the token after each of `ids` (B, T), in a masked model of the token itself, T at most the
    /// context; minus infinity where an id can't come. Differentiable.
    ///
    /// # Errors
    /// More tokens than the context, what the device refuses.
    pub fn forward(&self, ids: &Tensor, dropout: Option<&Dropout>) -> Result<Tensor> {
        self.forward_masked(ids, &self.mask(), dropout)
    }

    /// As [`Gpt::forward`], with attention that sees what `mask` lets it.
    ///
    /// # Errors
    /// As [`Gpt::forward`]; a mask of another shape.
    pub(crate) fn forward_masked(&self, ids: &Tensor, mask: &Mask, dropout: Option<&Dropout>) -> Result<Tensor> {
        self.check_length(ids.dims2()?.1)?;
        self.net.forward(ids, mask, Beside { dropout, ..Default::default() }, None)
    }

    /// As [`Gpt::forward`], with the frames before the windows (B, H W) and conditioning.
    ///
    /// # Errors
    /// As [`Gpt::forward`]; a history of other frames, and conditioning of others.
    #[cfg(test)]
    pub fn forward_beside(
        &self,
        ids: &Tensor,
        dropout: Option<&Dropout>,
        history: &[u32],
        conditioning: Option<&Conditioning>,
    ) -> Result<Tensor> {
        self.check_beside(ids, history, conditioning)?;
        self.net.forward(ids, &self.mask(), Beside { dropout, history, conditioning }, None)
    }

    /// The input of the heads for `ids` (B, T): the final norm's output (B T, D). Differentiable.
    ///
    /// # Errors
    /// As `Gpt::forward_masked`.
    pub fn final_vectors(&self, ids: &Tensor, mask: &Mask) -> Result<Tensor> {
        self.check_length(ids.dims2()?.1)?;
        self.net.final_vectors(ids, mask)
    }

    /// As [`Gpt::forward`] without dropout and without a graph for gradients.
    ///
    /// # Errors
    /// As [`Gpt::forward`].
    pub fn predict(&self, ids: &Tensor) -> Result<Tensor> {
        self.check_length(ids.dims2()?.1)?;
        self.frozen()?.forward(ids, &self.mask(), Beside::default(), None)
    }

    /// The mask of attention in a model of this kind.
    pub fn mask(&self) -> Mask {
        self.net.mask()
    }

    /// Targets are smoothed over neighbouring bins from now on, by a kernel `width` bins wide; `None`: no longer. Losses
    /// stay those of the targets themselves; their gradients don't.
    ///
    /// # Panics
    /// If the width is no positive number.
    pub fn smooth_targets(&mut self, width: Option<f64>) {
        self.smoothing = width.map(Smoothing::new);
    }

    /// Sum over the targets that aren't `<pad>` of -ln p, in nats; `targets` holds B T ids.
    ///
    /// # Errors
    /// As [`Gpt::forward`]; targets outside the vocabulary; under a relative head targets without a bin before them.
    pub fn loss_sum(&self, ids: &Tensor, targets: &[u32], dropout: Option<&Dropout>) -> Result<Tensor> {
        self.loss_sum_conditioned(ids, targets, dropout, &[], None)
    }

    /// As [`Gpt::loss_sum`], with the frames before the windows (B, H W) and conditioning.
    ///
    /// # Errors
    /// As [`Gpt::loss_sum`]; a history of other frames, and conditioning of others.
    pub fn loss_sum_conditioned(
        &self,
        ids: &Tensor,
        targets: &[u32],
        dropout: Option<&Dropout>,
        history: &[u32],
        conditioning: Option<&Conditioning>,
    ) -> Result<Tensor> {
        self.check(ids, targets)?;
        self.check_beside(ids, history, conditioning)?;
        Ok(self
            .net
            .nats(ids, targets, Beside { dropout, history, conditioning }, self.smoothing.as_ref())?
            .sum_all()?)
    }

    /// Mean cross-entropy over the targets that aren't `<pad>`, in nats a token; 0 where there are none.
    ///
    /// # Errors
    /// As [`Gpt::loss_sum`].
    #[cfg(test)]
    pub fn loss(&self, ids: &Tensor, targets: &[u32], dropout: Option<&Dropout>) -> Result<Tensor> {
        let counted = targets.iter().filter(|&&t| t != self.tokens.pad).count();
        Ok((self.loss_sum(ids, targets, dropout)? / counted.max(1) as f64)?)
    }

    /// A reader of one sequence that remembers what it read.
    ///
    /// It shares the model's numbers: training steps taken later are seen by what it reads then.
    ///
    /// # Errors
    /// A two-level model; no memory on the device.
    pub fn cache(&self) -> Result<Cache> {
        if !self.config.architecture.is_flat() {
            let why = "a two-level model reads whole windows in it; generate with the form auto on the cpu";
            return Err(Error::unsupported("token-by-token decoding in the plain form", why));
        }
        let c = &self.config;
        Cache::new(self.frozen()?, c.layers, c.heads, c.context, c.width / c.heads, self.device())
    }

    pub(super) fn frozen_nats(
        &self,
        ids: &Tensor,
        targets: &[u32],
        history: &[u32],
        conditioning: Option<&Conditioning>,
    ) -> Result<Tensor> {
        self.check(ids, targets)?;
        self.check_beside(ids, history, conditioning)?;
        self.frozen()?.nats(ids, targets, Beside { dropout: None, history, conditioning }, None)
    }

    fn check_beside(&self, ids: &Tensor, history: &[u32], conditioning: Option<&Conditioning>) -> Result<()> {
        let (batch, length) = ids.dims2()?;
        self.config.check_history(&self.tokens, batch, history)?;
        conditioning.map_or(Ok(()), |conditioning| conditioning.check(&self.config, &self.tokens, batch, length))
    }

    fn check(&self, ids: &Tensor, targets: &[u32]) -> Result<()> {
        self.check_length(ids.dims2()?.1)?;
        if ids.elem_count() != targets.len() {
            let expected = format!("{}, one per input", ids.elem_count());
            return Err(Error::invalid("the number of targets", targets.len(), expected));
        }
        let vocabulary = self.tokens.vocabulary;
        match targets.iter().find(|&&t| t as usize >= vocabulary) {
            Some(id) => Err(Error::invalid("a target", format!("id {id}"), format!("ids below {vocabulary}"))),
            None => Ok(()),
        }
    }

    fn frozen(&self) -> Result<Net> {
        // detached tensors share the numbers but record no graph, so a long reading doesn't grow
        let tensors = self.vars.iter().map(|(name, var)| (name, var.as_tensor().detach()));
        Net::new(&self.config, &self.tokens, tensors, self.forecast.clone())
    }

    fn check_length(&self, found: usize) -> Result<()> {
        match found <= self.config.context {
            true => Ok(()),
            false => {
                let (needs, limit) = (format!("{found} tokens"), format!("{} tokens", self.config.context));
                Err(Error::limit("a window", needs, limit, "the model's context holds no more"))
            }
        }
    }
}
