//! The fast form as it learns, on the CPU.

use super::batches::Batch;
use super::config::TrainConfig;
use super::ema;
use super::learner::{BatchLoss, Learner, no_average, not_finite};
use super::optimizer::{Adam, Optimizer, Rates};
use crate::Result;
use kinelm_engine::arena::Floats;
use kinelm_model::fast::{Fast, Windows};
use kinelm_model::layout::{Parameter, Role};
use kinelm_model::weights::{Weights, floats};
use kinelm_model::{Dropout, Scores};
use rayon::prelude::*;

/// The fast form and its optimizer.
pub struct FastLearner {
    model: Fast,
    optimizer: Optimizer,
    /// Weighted sum of the gradients of several batches; empty where a step has one.
    sum: Vec<Floats>,
    /// The moving average of the weights, if there is one.
    averages: Option<Vec<Floats>>,
    train: TrainConfig,
}

impl FastLearner {
    /// Before the first update.
    pub fn new(mut model: Fast, train: &TrainConfig) -> FastLearner {
        model.smooth_targets(train.smoothing());
        FastLearner {
            optimizer: Optimizer::new(model.parameters().to_vec()),
            sum: if train.accumulate > 1 { model.like_weights() } else { Vec::new() },
            averages: (train.ema > 0.0).then(|| model.like_weights()),
            model,
            train: train.clone(),
        }
    }

    /// The last gradients, by the names of their tensors.
    #[cfg(test)]
    pub(crate) fn gradients_by_name(&self) -> impl Iterator<Item = (&str, &[f32])> {
        let names = self.model.parameters().iter().map(|p| p.name.as_str());
        names.zip(self.optimizer.gradients.iter().map(|g| &**g))
    }

    /// Gradients of one batch, whose windows have the numbers from `first` on in their step, and its nats.
    fn of_batch(&mut self, batch: &Batch, step: u64, first: u64) -> Result<f64> {
        let share = Scores::config(&self.model).dropout;
        let dropout = (share > 0.0).then_some(Dropout { share, seed: self.train.seed, step, first });
        let Batch { inputs, targets, history, conditioning, .. } = batch;
        let (length, mask, conditioning) = (batch.length(), self.model.mask(), conditioning.as_ref());
        let windows = Windows { inputs, targets, length, mask, history, conditioning };
        let nats = self.model.gradients(windows, dropout.as_ref(), &mut self.optimizer.gradients)?;
        match nats.is_finite() {
            true => Ok(nats),
            // before the update: these numbers haven't reached the weights yet
            false => Err(not_finite(nats, &batch.clips)),
        }
    }

    /// The same of several batches, weighted by their shares of the targets that count.
    fn of_batches(&mut self, batches: &[Batch], step: u64) -> Result<f64> {
        let pad = Scores::tokens(&self.model).pad;
        let counted = |batch: &Batch| batch.counted(pad) as f64;
        // each batch's gradient is of its own mean; shares of the targets make it the mean over all
        let all = batches.iter().map(counted).sum::<f64>().max(1.0);
        if self.sum.is_empty() {
            self.sum = self.model.like_weights();
        }
        let (mut nats, mut first) = (0.0, 0);
        for (i, batch) in batches.iter().enumerate() {
            nats += self.of_batch(batch, step, first)?;
            first += batch.clips.len() as u64;
            let share = (counted(batch) / all) as f32;
            let sums = self.sum.par_iter_mut().zip(&self.optimizer.gradients);
            sums.for_each(|(sum, gradient)| ema::add(sum, gradient, share, i == 0));
        }
        // swapped, not copied: the next step overwrites `sum`
        std::mem::swap(&mut self.sum, &mut self.optimizer.gradients);
        Ok(nats)
    }
}

impl Learner for FastLearner {
    fn scores(&mut self) -> &mut dyn Scores {
        &mut self.model
    }

    fn gradients_of(&mut self, batches: &[Batch], step: u64) -> Result<BatchLoss> {
        let nats = match batches {
            [batch] => self.of_batch(batch, step, 0)?,
            several => self.of_batches(several, step)?,
        };
        let pad = Scores::tokens(&self.model).pad;
        let counted = batches.iter().map(|b| b.counted(pad)).sum::<usize>();
        Ok(BatchLoss { loss: nats / counted.max(1) as f64, counted, norm: self.optimizer.norm() })
    }

    fn update(&mut self, share: f64, rate: f64) -> Result<()> {
        let TrainConfig { betas, epsilon, weight_decay, table_rate, ema, .. } = self.train;
        let rates = |_, parameter: &Parameter| match parameter.role {
            Role::Vector => Rates { rate, decay: 0.0, tail: None },
            Role::Matrix => Rates { rate, decay: weight_decay, tail: None },
            Role::Table => Rates { rate: rate * table_rate, decay: 0.0, tail: None },
        };
        self.optimizer.update(self.model.weights_mut().par_iter_mut(), Adam { betas, epsilon }, share, rates);
        if let Some(averages) = &mut self.averages {
            let share = ema::share(ema, self.optimizer.updates()) as f32;
            let all = averages.par_iter_mut().zip(self.model.weights_mut());
            all.for_each(|(a, x)| ema::towards(a, x, share));
        }
        Ok(())
    }

    fn weights(&self) -> Result<Weights> {
        Ok(self.model.weights())
    }

    fn moments(&self) -> Result<Weights> {
        Ok(self.optimizer.moments())
    }

    fn restore(&mut self, moments: &Weights, step: u64) -> Result<()> {
        self.optimizer.restore(moments, step)
    }

    fn averages(&self) -> Result<Option<Weights>> {
        Ok(self.averages.as_ref().map(|averages| self.model.named(averages)))
    }

    fn restore_averages(&mut self, averages: &Weights) -> Result<()> {
        let own = self.averages.as_mut().ok_or_else(no_average)?;
        *own = floats("average", self.model.parameters(), averages, |p| p.name.clone())?;
        Ok(())
    }

    fn swap_averages(&mut self) -> Result<()> {
        if let Some(averages) = &mut self.averages {
            self.model.weights_mut().swap_with_slice(averages);
        }
        Ok(())
    }
}
