//! The fast model as it learns, on the CPU.

use super::batches::Batch;
use super::config::TrainConfig;
use super::learner::{Found, Learner, not_finite};
use crate::model::fast::{Fast, Windows, named};
use crate::model::{Dropout, ModelConfig, Scores, TokenLayout};
use crate::{Error, Result};
use candle_core::Tensor;
use kinelm_engine::arena::Floats;
use kinelm_engine::op::adamw;
use kinelm_engine::op::attention::Mask;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// The fast model and its optimizer.
pub struct FastLearner {
    model: Fast,
    /// As the model's tensors: gradients of the last batch, first and second moments.
    gradients: Vec<Floats>,
    moments: [Vec<Floats>; 2],
    /// Of each gradient: its squares, summed.
    squares: Vec<f64>,
    /// Whether weight decay pulls at a tensor.
    decays: Vec<bool>,
    train: TrainConfig,
    /// Updates done.
    step: u64,
}

impl FastLearner {
    /// Before the first update.
    pub fn new(model: Fast, train: &TrainConfig) -> FastLearner {
        FastLearner {
            gradients: model.like_weights(),
            moments: [model.like_weights(), model.like_weights()],
            squares: vec![0.0; model.parameters().len()],
            decays: model.parameters().iter().map(|p| p.decays).collect(),
            model,
            train: train.clone(),
            step: 0,
        }
    }

    /// The gradients found last, by the names of their tensors.
    pub fn gradients_by_name(&self) -> impl Iterator<Item = (&str, &[f32])> {
        self.model.parameters().iter().map(|p| p.name.as_str()).zip(self.gradients.iter().map(|g| &**g))
    }
}

impl Learner for FastLearner {
    fn gradients(&mut self, batch: &Batch, step: u64) -> Result<Found> {
        let counted = batch.counted(Scores::tokens(&self.model).pad);
        let share = Scores::config(&self.model).dropout;
        let dropout = (share > 0.0).then_some(Dropout { share, seed: self.train.seed, step, first: 0 });
        let (inputs, targets) = (&batch.inputs, &batch.targets);
        let windows = Windows { inputs, targets, length: batch.length(), mask: Mask::Causal };
        let nats = self.model.gradients(windows, dropout.as_ref(), &mut self.gradients)?;
        let loss = nats / counted.max(1) as f64;
        if !loss.is_finite() {
            return Err(not_finite(loss, &batch.clips));
        }
        let squares = self.squares.par_iter_mut().zip(&self.gradients);
        squares.for_each(|(square, gradient)| *square = adamw::norm_squared(gradient));
        Ok(Found { loss, counted, norm: self.squares.iter().sum::<f64>().sqrt() })
    }

    fn update(&mut self, share: f64, rate: f64) -> Result<()> {
        self.step += 1;
        let TrainConfig { betas, epsilon, weight_decay, .. } = self.train;
        let step = |decay| adamw::Step::new(self.step, rate, betas, epsilon, decay, share);
        let steps = [step(0.0), step(weight_decay)];
        let [first, second] = &mut self.moments;
        let all = (self.model.weights_mut(), first, second, &self.gradients, &self.decays);
        all.into_par_iter().for_each(|(x, m, v, g, &decays)| adamw::update(x, m, v, g, &steps[usize::from(decays)]));
        Ok(())
    }

    fn weights(&self) -> Result<BTreeMap<String, Tensor>> {
        self.model.tensors()
    }

    fn moments(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut all = BTreeMap::new();
        for (prefix, moment) in ["first", "second"].iter().zip(&self.moments) {
            let tensors = named(self.model.parameters(), moment)?;
            all.extend(tensors.into_iter().map(|(name, tensor)| (format!("{prefix}.{name}"), tensor)));
        }
        Ok(all)
    }

    fn restore(&mut self, mut moments: BTreeMap<String, Tensor>, step: u64) -> Result<()> {
        for (prefix, moment) in ["first", "second"].iter().zip(&mut self.moments) {
            for (p, numbers) in self.model.parameters().iter().zip(moment) {
                let name = format!("{prefix}.{}", p.name);
                let tensor = moments.remove(&name).filter(|t| t.dims() == p.shape);
                let missing = || Error::Call(format!("the optimizer has no {name} of shape {:?}", p.shape));
                numbers.copy_from_slice(&tensor.ok_or_else(missing)?.flatten_all()?.to_vec1::<f32>()?);
            }
        }
        self.step = step;
        Ok(())
    }
}

impl Scores for FastLearner {
    fn config(&self) -> &ModelConfig {
        Scores::config(&self.model)
    }

    fn tokens(&self) -> &TokenLayout {
        Scores::tokens(&self.model)
    }

    fn nats(&mut self, inputs: &[u32], targets: &[u32], length: usize, out: &mut [f32]) -> Result<()> {
        self.model.nats(inputs, targets, length, out)
    }
}
