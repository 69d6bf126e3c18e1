//! AdamW on the CPU: gradients and moments of a list of tensors, updated in place.
//!
//! The plain form has its own, from tensor operations: `super::adamw`.

use crate::Result;
use kinelm_engine::arena::Floats;
use kinelm_engine::op::adamw::{self, Step};
use kinelm_model::layout::Parameter;
use kinelm_model::weights::{Weights, floats, named};
use rayon::prelude::*;

/// The prefixes of the names of the two moments in a checkpoint.
pub const MOMENTS: [&str; 2] = ["first", "second"];

/// Gradients and AdamW's moments of some tensors. All vectors are in the order of the parameters.
pub struct Optimizer {
    parameters: Vec<Parameter>,
    /// Gradients of the last batch.
    pub gradients: Vec<Floats>,
    moments: [Vec<Floats>; 2],
    /// Sum of squares of each gradient.
    squares: Vec<f64>,
    updates: u64,
}

/// The numbers of AdamW that all tensors share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adam {
    /// Decay of the two moments.
    pub betas: [f64; 2],
    /// Added to the root of the second moment.
    pub epsilon: f64,
}

impl Default for Adam {
    /// PyTorch's defaults.
    fn default() -> Adam {
        Adam { betas: [0.9, 0.999], epsilon: 1e-8 }
    }
}

/// How one tensor moves in an update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Learning rate.
    pub rate: f64,
    /// Weight decay.
    pub decay: f64,
    /// From this number of the tensor on, another rate, without decay.
    pub tail: Option<(usize, f64)>,
}

impl Optimizer {
    /// Before the first update.
    pub fn new(parameters: Vec<Parameter>) -> Optimizer {
        let zeros = || parameters.iter().map(|p| Floats::new(p.len())).collect::<Vec<_>>();
        let (gradients, moments) = (zeros(), [zeros(), zeros()]);
        Optimizer { squares: vec![0.0; parameters.len()], gradients, moments, parameters, updates: 0 }
    }

    /// Updates done.
    pub(crate) fn updates(&self) -> u64 {
        self.updates
    }

    /// Euclidean norm of all gradients together.
    pub fn norm(&mut self) -> f64 {
        let squares = self.squares.par_iter_mut().zip(&self.gradients);
        squares.for_each(|(square, gradient)| *square = adamw::norm_squared(gradient));
        // summed in the order of the tensors: the number of threads changes no bit
        self.squares.iter().sum::<f64>().sqrt()
    }

    /// Moves `weights` by the gradients times `share`, each tensor as `rates` says of its index and parameter.
    pub fn update<'a>(
        &mut self,
        weights: impl IndexedParallelIterator<Item = &'a mut Floats>,
        Adam { betas, epsilon }: Adam,
        share: f64,
        rates: impl Fn(usize, &Parameter) -> Rates + Sync,
    ) {
        self.updates += 1;
        let step = |rate, decay| Step::new(self.updates, rate, betas, epsilon, decay, share);
        let [first, second] = &mut self.moments;
        let all = (weights, first, second, &self.gradients, &self.parameters).into_par_iter().enumerate();
        all.for_each(|(i, (x, m, v, g, parameter))| {
            let Rates { rate, decay, tail } = rates(i, parameter);
            let (at, tail) = tail.unwrap_or((x.len(), rate));
            let (x, x_tail) = x.split_at_mut(at);
            let (m, m_tail) = m.split_at_mut(at);
            let (v, v_tail) = v.split_at_mut(at);
            let (g, g_tail) = g.split_at(at);
            adamw::update(x, m, v, g, &step(rate, decay));
            if !x_tail.is_empty() {
                adamw::update(x_tail, m_tail, v_tail, g_tail, &step(tail, 0.0));
            }
        });
    }

    /// The moments by name: `first.{name}` and `second.{name}`.
    pub fn moments(&self) -> Weights {
        let mut all = Weights::new();
        for (prefix, moment) in MOMENTS.iter().zip(&self.moments) {
            let arrays = named(&self.parameters, moment).into_iter();
            all.extend(arrays.map(|(name, array)| (format!("{prefix}.{name}"), array)));
        }
        all
    }

    /// Continues from the moments after `updates` updates.
    ///
    /// # Errors
    /// [`kinelm_model::Error::Weights`] for a moment that is missing or of another shape.
    pub fn restore(&mut self, moments: &Weights, updates: u64) -> Result<()> {
        for (prefix, moment) in MOMENTS.iter().zip(&mut self.moments) {
            *moment = floats("optimizer", &self.parameters, moments, |p| format!("{prefix}.{}", p.name))?;
        }
        self.updates = updates;
        Ok(())
    }
}
