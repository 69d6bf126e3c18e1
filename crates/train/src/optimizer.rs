//! AdamW on the CPU: gradients and moments of a list of tensors, updated in place.
//!
//! The plain form has its own, from tensor operations: `super::adamw`.

use crate::{Error, Result};
use candle_core::Tensor;
use kinelm_engine::arena::Floats;
use kinelm_engine::op::adamw::{self, Step};
use kinelm_model::fast::named;
use kinelm_model::layout::Parameter;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// The prefixes of the names of the two moments in a checkpoint.
pub const MOMENTS: [&str; 2] = ["first", "second"];

/// Tensors by name.
pub type Tensors = BTreeMap<String, Tensor>;

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
    ///
    /// # Errors
    /// The tensor library's.
    pub fn moments(&self) -> Result<Tensors> {
        let mut all = Tensors::new();
        for (prefix, moment) in MOMENTS.iter().zip(&self.moments) {
            let tensors = named(&self.parameters, moment)?;
            all.extend(tensors.into_iter().map(|(name, tensor)| (format!("{prefix}.{name}"), tensor)));
        }
        Ok(all)
    }

    /// Continues from the moments after `updates` updates.
    ///
    /// # Errors
    /// [`Error::Weights`] for a moment that is missing or of another shape.
    pub fn restore(&mut self, moments: &Tensors, updates: u64) -> Result<()> {
        for (prefix, moment) in MOMENTS.iter().zip(&mut self.moments) {
            *moment = floats("optimizer", &self.parameters, moments, |p| format!("{prefix}.{}", p.name))?;
        }
        self.updates = updates;
        Ok(())
    }
}

/// The tensors `all` in the order of the parameters, under the names that `name` gives. `what` they are is for the message.
///
/// # Errors
/// [`Error::Weights`] for a tensor that is missing or of another shape.
pub(crate) fn in_order(
    what: &str,
    parameters: &[Parameter],
    all: &Tensors,
    name: impl Fn(&Parameter) -> String,
) -> Result<Vec<Tensor>> {
    let one = |p: &Parameter| {
        let name = name(p);
        let tensor = all.get(&name).filter(|t| t.dims() == p.shape).cloned();
        tensor.ok_or_else(|| Error::Weights(format!("the {what} has no {name} of shape {:?}", p.shape)))
    };
    parameters.iter().map(one).collect()
}

/// As `in_order`, their numbers.
///
/// # Errors
/// As `in_order`; tensors that aren't f32.
pub fn floats(
    what: &str,
    parameters: &[Parameter],
    all: &Tensors,
    name: impl Fn(&Parameter) -> String,
) -> Result<Vec<Floats>> {
    let tensors = in_order(what, parameters, all, name)?;
    tensors.iter().map(|tensor| Ok(Floats::of(&tensor.flatten_all()?.to_vec1::<f32>()?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_model::layout;

    #[test]
    fn missing_tensors_are_named() {
        let (config, tokens) = kinelm_model::fixtures::every(36)
            .into_iter()
            .find(|(config, tokens)| !config.architecture.is_flat() && tokens.front > 1)
            .unwrap();
        let parameters = layout::parameters(&config, &tokens);
        let all: Tensors = layout::initial(&config, &tokens, 1).unwrap();
        let mut all: Tensors = all.into_iter().map(|(name, x)| (format!("first.{name}"), x)).collect();
        let read = |all: &Tensors| in_order("optimizer", &parameters, all, |p| format!("first.{}", p.name));
        for (p, tensor) in parameters.iter().zip(read(&all).unwrap()) {
            assert_eq!(tensor.dims(), &*p.shape, "{}", p.name);
        }
        all.remove("first.frame.label.weight").unwrap();
        let message = read(&all).unwrap_err().to_string();
        assert!(message.contains("no first.frame.label.weight of shape [26, 12]"), "{message}");
    }
}
