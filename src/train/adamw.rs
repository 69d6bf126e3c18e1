//! AdamW, in place: one pass over each variable, moments in f32.
//!
//! Source: Loshchilov and Hutter, "Decoupled weight decay regularization" (2019); the order of operations is PyTorch's.

use super::config::TrainConfig;
use crate::model::Gpt;
use crate::model::layout::{self, Parameter};
use crate::{Error, Result};
use candle_core::{CpuStorage, InplaceOp1, Layout, Tensor};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// Numbers that one parallel task takes; norms add up task by task, so they don't depend on the threads.
const CHUNK: usize = 65_536;

/// The gradient of every variable, in the order of their names.
pub type Gradients = Vec<Vec<f32>>;

/// The optimizer's state.
pub struct AdamW {
    parameters: Vec<Parameter>,
    moments: Vec<[Vec<f32>; 2]>,
    betas: [f64; 2],
    epsilon: f64,
    weight_decay: f64,
    /// Updates done.
    step: u64,
}

impl AdamW {
    /// Before the first update.
    pub fn new(model: &Gpt, config: &TrainConfig) -> AdamW {
        let parameters = layout::parameters(model.config(), model.tokens());
        let moments = parameters.iter().map(|p| [vec![0.0; p.len()], vec![0.0; p.len()]]).collect();
        let TrainConfig { betas, epsilon, weight_decay, .. } = *config;
        AdamW { parameters, moments, betas, epsilon, weight_decay, step: 0 }
    }

    /// Moves every variable of `model` by its gradient times `share`, at the learning rate `rate`.
    ///
    /// # Errors
    /// Gradients of another model.
    pub fn update(&mut self, model: &Gpt, gradients: &Gradients, share: f64, rate: f64) -> Result<()> {
        if gradients.len() != self.parameters.len() {
            return Err(Error::Call(format!("{} gradients for {} variables", gradients.len(), self.parameters.len())));
        }
        self.step += 1;
        let correction = self.betas.map(|b| 1.0 - b.powf(self.step as f64));
        for ((parameter, moments), gradient) in self.parameters.iter().zip(&mut self.moments).zip(gradients) {
            let [m, v] = moments;
            let update = Update {
                gradient,
                moments: Mutex::new((m, v)),
                share: share as f32,
                betas: self.betas.map(|b| b as f32),
                step: (rate / correction[0]) as f32,
                root: (1.0 / correction[1].sqrt()) as f32,
                epsilon: self.epsilon as f32,
                keep: if parameter.decays { (1.0 - rate * self.weight_decay) as f32 } else { 1.0 },
            };
            model.vars()[&parameter.name].inplace_op1(&update)?;
        }
        Ok(())
    }

    /// The moments as tensors: `first.{name}` and `second.{name}`.
    ///
    /// # Errors
    /// None in practice.
    pub fn tensors(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut all = BTreeMap::new();
        for (p, moments) in self.parameters.iter().zip(&self.moments) {
            for (prefix, moment) in ["first", "second"].iter().zip(moments) {
                let tensor = Tensor::from_slice(moment, p.shape.as_slice(), &candle_core::Device::Cpu)?;
                all.insert(format!("{prefix}.{}", p.name), tensor);
            }
        }
        Ok(all)
    }

    /// Goes on from the state after `step` updates.
    ///
    /// # Errors
    /// Moments that are missing or of another shape, each named.
    pub fn restore(&mut self, mut tensors: BTreeMap<String, Tensor>, step: u64) -> Result<()> {
        for (p, moments) in self.parameters.iter().zip(&mut self.moments) {
            for (prefix, moment) in ["first", "second"].iter().zip(moments) {
                let name = format!("{prefix}.{}", p.name);
                let tensor = tensors.remove(&name).filter(|t| t.dims() == p.shape);
                let missing = || Error::Call(format!("the optimizer has no {name} of shape {:?}", p.shape));
                *moment = tensor.ok_or_else(missing)?.flatten_all()?.to_vec1()?;
            }
        }
        self.step = step;
        Ok(())
    }
}

/// The update of one variable.
struct Update<'a> {
    gradient: &'a [f32],
    // the library's in-place operations take &self
    moments: Mutex<(&'a mut Vec<f32>, &'a mut Vec<f32>)>,
    share: f32,
    betas: [f32; 2],
    step: f32,
    root: f32,
    epsilon: f32,
    keep: f32,
}

impl InplaceOp1 for Update<'_> {
    fn name(&self) -> &'static str {
        "adamw"
    }

    fn cpu_fwd(&self, storage: &mut CpuStorage, layout: &Layout) -> candle_core::Result<()> {
        let (CpuStorage::F32(x), Some((start, end))) = (storage, layout.contiguous_offsets()) else {
            candle_core::bail!("variables to train are contiguous f32")
        };
        let x = &mut x[start..end];
        let mut moments = self.moments.lock().unwrap_or_else(|e| e.into_inner());
        let (first, second) = &mut *moments;
        if [first.len(), second.len(), self.gradient.len()] != [x.len(); 3] {
            candle_core::bail!("{} gradients for {} numbers", self.gradient.len(), x.len());
        }
        let chunks = x.par_chunks_mut(CHUNK).zip(first.par_chunks_mut(CHUNK)).zip(second.par_chunks_mut(CHUNK));
        chunks.zip(self.gradient.par_chunks(CHUNK)).for_each(|(((x, m), v), g)| self.chunk(x, m, v, g));
        Ok(())
    }
}

impl Update<'_> {
    fn chunk(&self, x: &mut [f32], m: &mut [f32], v: &mut [f32], g: &[f32]) {
        let [b1, b2] = self.betas;
        for (((x, m), v), &g) in x.iter_mut().zip(m).zip(v).zip(g) {
            let g = g * self.share;
            *m = b1 * *m + (1.0 - b1) * g;
            *v = b2 * *v + (1.0 - b2) * g * g;
            *x = *x * self.keep - self.step * *m / (v.sqrt() * self.root + self.epsilon);
        }
    }
}

/// Euclidean norm over all gradients, added up in a fixed order in f64.
pub fn norm(gradients: &Gradients) -> f64 {
    let squares = |g: &[f32]| g.iter().map(|&x| x as f64 * x as f64).sum::<f64>();
    let partial: Vec<f64> = gradients.iter().flat_map(|g| g.chunks(CHUNK)).map(squares).collect();
    partial.iter().sum::<f64>().sqrt()
}

/// What gradients of norm `norm` are multiplied with so that they stay within `limit` (0: no limit), as PyTorch clips.
pub fn clip_share(norm: f64, limit: f64) -> f64 {
    if limit > 0.0 { (limit / (norm + 1e-6)).min(1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{ModelConfig, TokenLayout};

    #[test]
    fn two_updates_by_hand() {
        let tokens = TokenLayout { vocabulary: 11, word: 4, pad: 0, bos: 1, space: 5 };
        let model = ModelConfig { layers: 1, heads: 1, width: 2, context: 10, ..Default::default() };
        let gpt = Gpt::new(&model, &tokens, 1).unwrap();
        let config = TrainConfig { betas: [0.9, 0.99], weight_decay: 0.5, ..Default::default() };
        let mut adamw = AdamW::new(&gpt, &config);
        let numbers = |name: &str| gpt.vars()[name].flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let names = ["block.00.mlp.up.weight", "token.weight", "norm.weight"];
        let before = names.map(numbers);
        let gradients: Gradients = gpt.vars().values().map(|v| vec![2.0; v.elem_count()]).collect();
        let opposite: Gradients = gpt.vars().values().map(|v| vec![-1.0; v.elem_count()]).collect();
        adamw.update(&gpt, &gradients, 0.5, 0.1).unwrap();
        adamw.update(&gpt, &opposite, 1.0, 0.1).unwrap();
        // gradients 1 and -1: first moments 0.1, then 0.09 - 0.1 = -0.01; second ones 0.01, then 0.0199
        let moves = |x: f64, decay: f64| {
            let x = x * (1.0 - 0.1 * decay) - 0.1 * 1.0 / (1.0 + 1e-8);
            x * (1.0 - 0.1 * decay) - 0.1 * (-0.01 / 0.19) / ((0.0199f64 / 0.0199).sqrt() + 1e-8)
        };
        for ((name, before), decay) in names.iter().zip(&before).zip([0.5, 0.0, 0.0]) {
            for (x, &b) in numbers(name).iter().zip(before) {
                let expected = moves(b as f64, decay);
                assert!((*x as f64 - expected).abs() < 2e-7, "{name}: {x}, expected {expected}");
            }
        }
    }

    #[test]
    fn norms_and_their_limit() {
        assert_eq!(norm(&vec![vec![3.0], vec![0.0, 4.0]]), 5.0);
        assert!((clip_share(5.0, 1.0) - 0.2).abs() < 1e-6);
        assert_eq!(clip_share(0.5, 1.0), 1.0);
        assert_eq!(clip_share(5.0, 0.0), 1.0);
        assert!(norm(&vec![vec![f32::NAN]]).is_nan());
    }
}
