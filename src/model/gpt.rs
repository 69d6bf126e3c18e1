//! A pre-norm GPT-2 over the words of a dance: the plain form, differentiable, on any device, which faster forms are
//! compared with.
//!
//! Letters: B batch, T tokens, V vocabulary.

use super::cache::Cache;
use super::config::{ModelConfig, TokenLayout};
use super::dropout::Dropout;
use super::layout;
use super::net::Net;
use super::ops::{self, Mask};
use crate::{Error, Result};
use candle_core::{DType, Device, Tensor, Var};
use std::collections::BTreeMap;

/// A model: its shape and its variables.
pub struct Gpt {
    config: ModelConfig,
    tokens: TokenLayout,
    vars: BTreeMap<String, Var>,
    net: Net,
}

impl Gpt {
    /// A model before training, on the CPU.
    ///
    /// # Errors
    /// A configuration that doesn't hold: the key and its limits.
    pub fn new(config: &ModelConfig, tokens: &TokenLayout, seed: u64) -> Result<Gpt> {
        config.validate_for(tokens)?;
        Gpt::from_tensors(config, tokens, layout::initial(config, tokens, seed)?)
    }

    /// A model of these tensors, copied, on the device where they are.
    ///
    /// # Errors
    /// As [`Gpt::new`]; tensors that are missing, not the model's, or of another shape: each is named.
    pub fn from_tensors(
        config: &ModelConfig,
        tokens: &TokenLayout,
        mut tensors: BTreeMap<String, Tensor>,
    ) -> Result<Gpt> {
        config.validate_for(tokens)?;
        let mut vars = BTreeMap::new();
        for p in layout::parameters(config, tokens) {
            let tensor = tensors.remove(&p.name).ok_or_else(|| {
                Error::Call(format!("the weights have no tensor {}; expected one of shape {:?}", p.name, p.shape))
            })?;
            if tensor.dims() != p.shape {
                return Err(Error::Call(format!(
                    "tensor {} has shape {:?}; this model expects {:?}",
                    p.name,
                    tensor.dims(),
                    p.shape
                )));
            }
            vars.insert(p.name, Var::from_tensor(&tensor)?);
        }
        if let Some(name) = tensors.keys().next() {
            return Err(Error::Call(format!("the weights have a tensor {name} that this model has no place for")));
        }
        let net = Net::new(config, tokens, &|name| vars[name].as_tensor().clone());
        Ok(Gpt { config: config.clone(), tokens: tokens.clone(), vars, net })
    }

    /// The `[model]` table it was made from.
    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// What its tokenizer decided.
    pub fn tokens(&self) -> &TokenLayout {
        &self.tokens
    }

    /// Its variables by name, in the order of the names.
    pub fn vars(&self) -> &BTreeMap<String, Var> {
        &self.vars
    }

    /// The same model in f64, for checking gradients.
    ///
    /// # Errors
    /// None in practice.
    pub fn to_f64(&self) -> Result<Gpt> {
        let tensors = self.vars.iter().map(|(n, v)| Ok((n.clone(), v.as_tensor().to_dtype(DType::F64)?)));
        Gpt::from_tensors(&self.config, &self.tokens, tensors.collect::<Result<_>>()?)
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

    /// Logits (B, T, V) of the token behind each of `ids` (B, T), T at most the context; differentiable.
    ///
    /// # Errors
    /// More tokens than the context, what the device refuses.
    pub fn forward(&self, ids: &Tensor, dropout: Option<&Dropout>) -> Result<Tensor> {
        self.forward_masked(ids, &Mask::Causal, dropout)
    }

    /// As [`Gpt::forward`], with attention that sees what `mask` lets it.
    ///
    /// # Errors
    /// As [`Gpt::forward`]; a mask of another shape.
    pub fn forward_masked(&self, ids: &Tensor, mask: &Mask, dropout: Option<&Dropout>) -> Result<Tensor> {
        self.check_length(ids.dims2()?.1)?;
        Ok(self.net.forward(ids, mask, dropout, None)?)
    }

    /// As [`Gpt::forward`] without dropout, and nothing is kept for gradients.
    ///
    /// # Errors
    /// As [`Gpt::forward`].
    pub fn predict(&self, ids: &Tensor) -> Result<Tensor> {
        self.check_length(ids.dims2()?.1)?;
        Ok(self.frozen().forward(ids, &Mask::Causal, None, None)?)
    }

    /// Sum over the targets that aren't `<pad>` of -ln p, in nats; `targets` holds B T ids.
    ///
    /// # Errors
    /// As [`Gpt::forward`]; targets outside the vocabulary.
    pub fn loss_sum(&self, ids: &Tensor, targets: &[u32], dropout: Option<&Dropout>) -> Result<Tensor> {
        let logits = self.forward(ids, dropout)?.flatten_to(1)?;
        Ok(ops::cross_entropy(&logits, targets, self.tokens.pad)?.sum_all()?)
    }

    /// Mean cross-entropy over the targets that aren't `<pad>`, in nats a token; 0 where there are none.
    ///
    /// # Errors
    /// As [`Gpt::loss_sum`].
    pub fn loss(&self, ids: &Tensor, targets: &[u32], dropout: Option<&Dropout>) -> Result<Tensor> {
        let counted = targets.iter().filter(|&&t| t != self.tokens.pad).count();
        Ok((self.loss_sum(ids, targets, dropout)? / counted.max(1) as f64)?)
    }

    /// A reader of one sequence that remembers what it read.
    ///
    /// It shares the model's numbers: training steps taken later are seen by what it reads then.
    ///
    /// # Errors
    /// No memory on the device.
    pub fn cache(&self) -> Result<Cache> {
        let c = &self.config;
        Cache::new(self.frozen(), (c.layers, c.heads, c.context, c.width / c.heads), self.device())
    }

    pub(super) fn frozen_nats(&self, ids: &Tensor, targets: &[u32]) -> Result<Tensor> {
        let logits = self.predict(ids)?.flatten_to(1)?;
        Ok(ops::cross_entropy(&logits, targets, self.tokens.pad)?)
    }

    fn frozen(&self) -> Net {
        Net::new(&self.config, &self.tokens, &|name| self.vars[name].as_tensor().detach())
    }

    fn check_length(&self, found: usize) -> Result<()> {
        match found <= self.config.context {
            true => Ok(()),
            false => Err(Error::Call(format!("a window of {found} tokens; the context holds {}", self.config.context))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Positions;
    use rand_chacha::rand_core::RngCore;

    const TOKENS: TokenLayout =
        TokenLayout { vocabulary: 11, word: 4, varying: false, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new() };

    /// With words of any length.
    const VARYING: TokenLayout =
        TokenLayout { vocabulary: 11, word: 4, varying: true, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new() };

    fn small(positions: Positions, tied_head: bool) -> Gpt {
        small_of(&TOKENS, positions, tied_head)
    }

    fn small_of(tokens: &TokenLayout, positions: Positions, tied_head: bool) -> Gpt {
        let config =
            ModelConfig { layers: 2, heads: 2, width: 8, context: 10, positions, tied_head, ..Default::default() };
        let gpt = Gpt::new(&config, tokens, 1).unwrap();
        // away from zeros and ones, where gradients could be right by accident
        for (name, var) in gpt.vars() {
            let shift = ops::check::random(name, var.dims(), 0.3).to_dtype(DType::F32).unwrap();
            var.set(&(var.as_tensor() + shift).unwrap()).unwrap();
        }
        gpt
    }

    fn ids(n: usize) -> Vec<u32> {
        let mut rng = crate::random::stream(3, "ids", 0, 0);
        (0..n).map(|_| 5 + rng.next_u32() % 6).collect()
    }

    #[test]
    fn every_variable_has_the_gradient_that_finite_differences_find() {
        for (tokens, positions, tied) in [
            (&TOKENS, Positions::FrameJoint, true),
            (&VARYING, Positions::FrameJoint, true),
            (&TOKENS, Positions::Absolute, false),
        ] {
            let gpt = small_of(tokens, positions, tied).to_f64().unwrap();
            let mut inputs = ids(18);
            (inputs[0], inputs[9]) = (1, 1);
            // as many words as a window has rows for
            inputs[1..9].fill(5);
            let mut targets = ids(18);
            targets[16..].fill(0);
            let inputs = Tensor::new(inputs, &Device::Cpu).unwrap().reshape((2, 9)).unwrap();
            let dropout = Dropout { share: 0.2, seed: 1, step: 0, first: 0 };
            for dropout in [None, Some(&dropout)] {
                let loss = || gpt.loss(&inputs, &targets, dropout).unwrap();
                let grads = loss().backward().unwrap();
                let at = |v: &Var, numbers: &[f64]| {
                    v.set(&Tensor::new(numbers, &Device::Cpu).unwrap().reshape(v.dims()).unwrap()).unwrap();
                    loss().to_scalar::<f64>().unwrap()
                };
                for (name, var) in gpt.vars() {
                    let grad = grads.get(var.as_tensor()).unwrap_or_else(|| panic!("{name} got no gradient"));
                    let grad = grad.flatten_all().unwrap().to_vec1::<f64>().unwrap();
                    let numbers = var.flatten_all().unwrap().to_vec1::<f64>().unwrap();
                    // five numbers of every tensor, spread over it
                    for i in (0..5).map(|k| k * (numbers.len() - 1) / 4) {
                        let moved = |by: f64| {
                            let mut x = numbers.clone();
                            x[i] += by;
                            at(var, &x)
                        };
                        let h = 1e-5;
                        let expected = (moved(h) - moved(-h)) / (2.0 * h);
                        let apart = (grad[i] - expected).abs();
                        assert!(apart < 1e-7, "{name}[{i}]: gradient {}, differences {expected}", grad[i]);
                    }
                    at(var, &numbers);
                    assert!(grad.iter().any(|g| *g != 0.0), "{name}: the gradient is 0 everywhere");
                }
            }
        }
    }

    #[test]
    fn reading_in_blocks_is_reading_at_once_to_1e_5() {
        for (layout, positions) in
            [(&TOKENS, Positions::Absolute), (&TOKENS, Positions::FrameJoint), (&VARYING, Positions::FrameJoint)]
        {
            let gpt = small_of(layout, positions, true);
            let mut tokens = ids(10);
            tokens[0] = 1;
            let all = Tensor::new(tokens.as_slice(), &Device::Cpu).unwrap().unsqueeze(0).unwrap();
            let truth = gpt.forward(&all, None).unwrap().squeeze(0).unwrap().to_vec2::<f32>().unwrap();
            let mut cache = gpt.cache().unwrap();
            for cuts in [vec![10], vec![1; 10], vec![4, 1, 5], vec![1, 9]] {
                cache.reset();
                let mut read = 0;
                for n in cuts {
                    let logits = cache.read_all(&tokens[read..read + n]).unwrap().to_vec2::<f32>().unwrap();
                    for (row, truth) in logits.iter().zip(&truth[read..]) {
                        let apart = row.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                        assert!(apart < 1e-5, "place {read}: {apart}");
                    }
                    read += n;
                }
                assert!(cache.read(&[6]).unwrap_err().to_string().contains("behind 10 read"));
            }
            cache.truncate(3);
            assert_eq!((cache.len(), cache.read(&tokens[3..]).unwrap()), (3, cache_again(&mut cache, &tokens)));
        }
    }

    fn cache_again(cache: &mut Cache, tokens: &[u32]) -> Vec<f32> {
        cache.reset();
        cache.read(&tokens[..3]).unwrap();
        cache.read(&tokens[3..]).unwrap()
    }

    #[test]
    fn a_later_token_changes_no_earlier_logit() {
        let gpt = small(Positions::FrameJoint, true);
        let logits = |t: &[u32]| {
            let t = Tensor::new(t, &Device::Cpu).unwrap().unsqueeze(0).unwrap();
            gpt.predict(&t).unwrap().squeeze(0).unwrap().to_vec2::<f32>().unwrap()
        };
        let (a, mut other) = (ids(10), ids(10));
        other[6] = if other[6] == 6 { 7 } else { 6 };
        let (a, b) = (logits(&a), logits(&other));
        assert_eq!(a[..6], b[..6]);
        assert_ne!(a[6], b[6]);
    }

    #[test]
    fn attention_sees_what_the_mask_lets_it() {
        let gpt = small(Positions::Absolute, true);
        let ids = gpt.ids(&ids(20), 10).unwrap();
        let logits = |mask: &Mask| {
            gpt.forward_masked(&ids, mask, None).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap()
        };
        let hide = |hidden: &dyn Fn(usize, usize) -> bool| {
            let add = (0..100).map(|i| if hidden(i / 10, i % 10) { f32::NEG_INFINITY } else { 0.0 });
            Mask::Additive(Tensor::from_vec(add.collect(), (10, 10), &Device::Cpu).unwrap())
        };
        assert_eq!(logits(&hide(&|q, k| k > q)), logits(&Mask::Causal));
        assert_eq!(logits(&hide(&|_, _| false)), logits(&Mask::Full));
        assert_ne!(logits(&Mask::Full), logits(&Mask::Causal));
        // a mask of each sequence; a query that sees nothing is no NaN, in values or gradients
        let per_sequence = Tensor::new(&[0f32, f32::NEG_INFINITY], &Device::Cpu).unwrap();
        let mask = Mask::Additive(per_sequence.reshape((2, 1, 1, 1)).unwrap());
        let all = logits(&mask);
        assert_eq!(all[..110], logits(&Mask::Full)[..110]);
        assert_ne!(all[110..], logits(&Mask::Full)[110..]);
        let grads = gpt.forward_masked(&ids, &mask, None).unwrap().sum_all().unwrap().backward().unwrap();
        for (name, var) in gpt.vars() {
            let grad = grads.get(var.as_tensor()).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
            assert!(grad.iter().all(|g| g.is_finite()), "{name}");
        }
    }

    #[test]
    fn wrong_windows_and_weights_are_refused_by_name() {
        let gpt = small(Positions::FrameJoint, true);
        let long = Tensor::zeros((1, 11), DType::U32, &Device::Cpu).unwrap();
        let message = gpt.forward(&long, None).unwrap_err().to_string();
        assert_eq!(message, "a window of 11 tokens; the context holds 10");
        let message = gpt.ids(&[3, 11], 2).unwrap_err().to_string();
        assert_eq!(message, "id 11 outside the vocabulary of 11 ids");
        let mut tensors: BTreeMap<_, _> = gpt.vars().iter().map(|(n, v)| (n.clone(), v.as_tensor().clone())).collect();
        let load = |t: &BTreeMap<String, Tensor>| {
            Gpt::from_tensors(gpt.config(), gpt.tokens(), t.clone()).err().map(|e| e.to_string()).unwrap_or_default()
        };
        assert_eq!(load(&tensors), "");
        tensors.insert("head.weight".into(), long.clone());
        assert!(load(&tensors).contains("head.weight that this model has no place for"));
        tensors.remove("head.weight");
        tensors.insert("norm.bias".into(), long);
        assert!(load(&tensors).contains("norm.bias has shape [1, 11]; this model expects [8]"));
        tensors.remove("norm.bias");
        assert!(load(&tensors).contains("no tensor norm.bias"));
    }
}
