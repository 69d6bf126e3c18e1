//! The fast model as it learns, on the CPU.

use super::adamw::MOMENTS;
use super::average;
use super::batches::Batch;
use super::config::TrainConfig;
use super::learner::{Found, Learner, in_order, no_average, not_finite};
use crate::Result;
use candle_core::Tensor;
use kinelm_engine::arena::Floats;
use kinelm_engine::op::adamw;
use kinelm_model::fast::{Fast, Windows, named};
use kinelm_model::goal::Conditioning;
use kinelm_model::layout::{Parameter, Role};
use kinelm_model::{Dropout, ModelConfig, Scores, TokenLayout};
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
    roles: Vec<Role>,
    /// Of several batches: their gradients, summed. Empty where a step has one.
    sum: Vec<Floats>,
    /// The moving average of the weights, if there is one.
    averages: Option<Vec<Floats>>,
    train: TrainConfig,
    /// Updates done.
    step: u64,
}

impl FastLearner {
    /// Before the first update.
    pub fn new(mut model: Fast, train: &TrainConfig) -> FastLearner {
        model.smooth_targets(train.smoothing());
        FastLearner {
            gradients: model.like_weights(),
            moments: [model.like_weights(), model.like_weights()],
            squares: vec![0.0; model.parameters().len()],
            roles: model.parameters().iter().map(|p| p.role).collect(),
            sum: if train.accumulate > 1 { model.like_weights() } else { Vec::new() },
            averages: (train.ema > 0.0).then(|| model.like_weights()),
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

impl FastLearner {
    /// Gradients of one batch, whose windows have the numbers from `first` on in their step, and its nats.
    fn of_batch(&mut self, batch: &Batch, step: u64, first: u64) -> Result<f64> {
        let share = Scores::config(&self.model).dropout;
        let dropout = (share > 0.0).then_some(Dropout { share, seed: self.train.seed, step, first });
        let (inputs, targets, told) = (&batch.inputs, &batch.targets, batch.conditioning.as_ref());
        let windows = Windows { inputs, targets, length: batch.length(), mask: self.model.mask(), conditioning: told };
        let nats = self.model.gradients(windows, dropout.as_ref(), &mut self.gradients)?;
        match nats.is_finite() {
            true => Ok(nats),
            false => Err(not_finite(nats, &batch.clips)),
        }
    }

    /// The same of several, summed by their shares of the targets that count.
    fn of_batches(&mut self, batches: &[Batch], step: u64) -> Result<f64> {
        let pad = Scores::tokens(&self.model).pad;
        let counted = |batch: &Batch| batch.counted(pad) as f64;
        let all = batches.iter().map(counted).sum::<f64>().max(1.0);
        if self.sum.is_empty() {
            self.sum = self.model.like_weights();
        }
        let (mut nats, mut first) = (0.0, 0);
        for (i, batch) in batches.iter().enumerate() {
            nats += self.of_batch(batch, step, first)?;
            first += batch.clips.len() as u64;
            let share = (counted(batch) / all) as f32;
            let sums = self.sum.par_iter_mut().zip(&self.gradients);
            sums.for_each(|(sum, gradient)| average::add(sum, gradient, share, i == 0));
        }
        std::mem::swap(&mut self.sum, &mut self.gradients);
        Ok(nats)
    }
}

impl Learner for FastLearner {
    fn gradients_of(&mut self, batches: &[Batch], step: u64) -> Result<Found> {
        let nats = match batches {
            [batch] => self.of_batch(batch, step, 0)?,
            several => self.of_batches(several, step)?,
        };
        let pad = Scores::tokens(&self.model).pad;
        let counted = batches.iter().map(|b| b.counted(pad)).sum::<usize>();
        let loss = nats / counted.max(1) as f64;
        let squares = self.squares.par_iter_mut().zip(&self.gradients);
        squares.for_each(|(square, gradient)| *square = adamw::norm_squared(gradient));
        Ok(Found { loss, counted, norm: self.squares.iter().sum::<f64>().sqrt() })
    }

    fn update(&mut self, share: f64, rate: f64) -> Result<()> {
        self.step += 1;
        let TrainConfig { betas, epsilon, weight_decay, table_rate, .. } = self.train;
        let step = |rate, decay| adamw::Step::new(self.step, rate, betas, epsilon, decay, share);
        let (vectors, matrices, tables) = (step(rate, 0.0), step(rate, weight_decay), step(rate * table_rate, 0.0));
        let of = |role| match role {
            Role::Vector => &vectors,
            Role::Matrix => &matrices,
            Role::Table => &tables,
        };
        let [first, second] = &mut self.moments;
        let all = (self.model.weights_mut(), first, second, &self.gradients, &self.roles);
        all.into_par_iter().for_each(|(x, m, v, g, &role)| adamw::update(x, m, v, g, of(role)));
        if let Some(averages) = &mut self.averages {
            let share = average::share(self.train.ema, self.step) as f32;
            let all = averages.par_iter_mut().zip(self.model.weights_mut());
            all.for_each(|(a, x)| average::towards(a, x, share));
        }
        Ok(())
    }

    fn weights(&self) -> Result<BTreeMap<String, Tensor>> {
        self.model.tensors()
    }

    fn moments(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut all = BTreeMap::new();
        for (prefix, moment) in MOMENTS.iter().zip(&self.moments) {
            let tensors = named(self.model.parameters(), moment)?;
            all.extend(tensors.into_iter().map(|(name, tensor)| (format!("{prefix}.{name}"), tensor)));
        }
        Ok(all)
    }

    fn restore(&mut self, moments: BTreeMap<String, Tensor>, step: u64) -> Result<()> {
        for (prefix, moment) in MOMENTS.iter().zip(&mut self.moments) {
            let name = |p: &Parameter| format!("{prefix}.{}", p.name);
            fill(moment, &in_order("optimizer", self.model.parameters(), &moments, name)?)?;
        }
        self.step = step;
        Ok(())
    }

    fn averages(&self) -> Result<Option<BTreeMap<String, Tensor>>> {
        self.averages.as_ref().map(|averages| named(self.model.parameters(), averages)).transpose()
    }

    fn restore_averages(&mut self, averages: BTreeMap<String, Tensor>) -> Result<()> {
        let own = self.averages.as_mut().ok_or_else(no_average)?;
        fill(own, &in_order("average", self.model.parameters(), &averages, |p| p.name.clone())?)
    }

    fn exchange(&mut self) -> Result<()> {
        if let Some(averages) = &mut self.averages {
            self.model.weights_mut().swap_with_slice(averages);
        }
        Ok(())
    }
}

/// Copies tensors into buffers.
///
/// # Errors
/// Tensors that are not f32.
pub fn fill(buffers: &mut [Floats], tensors: &[Tensor]) -> Result<()> {
    for (buffer, tensor) in buffers.iter_mut().zip(tensors) {
        buffer.copy_from_slice(&tensor.flatten_all()?.to_vec1::<f32>()?);
    }
    Ok(())
}

impl Scores for FastLearner {
    fn config(&self) -> &ModelConfig {
        Scores::config(&self.model)
    }

    fn tokens(&self) -> &TokenLayout {
        Scores::tokens(&self.model)
    }

    fn nats_conditioned(
        &mut self,
        windows: (&[u32], &[u32]),
        length: usize,
        told: Option<&Conditioning>,
        out: &mut [f32],
    ) -> Result<()> {
        self.model.nats_conditioned(windows, length, told, out)
    }
}
