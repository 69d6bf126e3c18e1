//! Tensors that learn by Adam outside the GPT: by name, on disk, and as they move.

use super::adamw::MOMENTS;
use crate::{Error, Result};
use candle_core::{Device, Tensor};
use kinelm_engine::arena::Floats;
use kinelm_engine::op::adamw;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Adam's, as PyTorch has them where nobody says.
const BETAS: [f64; 2] = [0.9, 0.999];
const EPSILON: f64 = 1e-8;

/// Names of tensors with their rows and columns; those that end in `bias` have one row, on disk one dimension.
pub type List = Vec<(String, [usize; 2])>;

/// The shape of a tensor on disk.
fn dimensions([rows, columns]: [usize; 2], name: &str) -> Vec<usize> {
    if name.ends_with("bias") { vec![columns] } else { vec![rows, columns] }
}

/// Numbers as tensors by name, `before` in front of the names.
///
/// # Errors
/// What the tensor library refuses.
pub fn tensors(list: &List, numbers: &[Floats], before: &str) -> Result<BTreeMap<String, Tensor>> {
    let one = |((name, size), numbers): (&(String, [usize; 2]), &Floats)| {
        let tensor = Tensor::from_slice(numbers, dimensions(*size, name), &Device::Cpu)?;
        Ok((format!("{before}{name}"), tensor))
    };
    list.iter().zip(numbers).map(one).collect()
}

/// The way back.
///
/// # Errors
/// [`Error::Weights`] for a tensor that is missing or of another shape.
pub fn numbers(list: &List, tensors: &BTreeMap<String, Tensor>, before: &str) -> Result<Vec<Floats>> {
    let one = |(name, size): &(String, [usize; 2])| {
        let (name, expected) = (format!("{before}{name}"), dimensions(*size, name));
        match tensors.get(&name) {
            Some(tensor) if tensor.dims() == expected => Ok(Floats::of(&tensor.flatten_all()?.to_vec1::<f32>()?)),
            Some(tensor) => {
                Err(Error::Weights(format!("tensor {name} of shape {:?}, expected {expected:?}", tensor.dims())))
            }
            None => Err(Error::Weights(format!("no tensor {name} of shape {expected:?}"))),
        }
    };
    list.iter().map(one).collect()
}

/// Weights, their gradients and Adam's moments.
pub struct Parameters {
    list: List,
    /// In the order of the list.
    pub weights: Vec<Floats>,
    /// The same.
    pub gradients: Vec<Floats>,
    moments: [Vec<Floats>; 2],
    step: u64,
}

impl Parameters {
    /// Before the first update.
    pub fn new(list: List, weights: Vec<Floats>) -> Parameters {
        let like = || weights.iter().map(|w| Floats::new(w.len())).collect::<Vec<_>>();
        Parameters { list, gradients: like(), moments: [like(), like()], weights, step: 0 }
    }

    /// Moves the weights by their gradients: Adam, which is AdamW without decay. Gradients whose norm is above `clip`
    /// are made so long first.
    pub fn update(&mut self, rate: f64, clip: Option<f64>) {
        self.step += 1;
        let share = clip.map_or(1.0, |most| {
            let norm = self.gradients.iter().map(|g| adamw::norm_squared(g)).sum::<f64>().sqrt();
            if norm > most { most / norm } else { 1.0 }
        });
        let step = adamw::Step::new(self.step, rate, BETAS, EPSILON, 0.0, share);
        let [first, second] = &mut self.moments;
        let all = (&mut self.weights, first, second, &self.gradients);
        all.into_par_iter().for_each(|(x, m, v, g)| adamw::update(x, m, v, g, &step));
    }

    /// The weights by name.
    ///
    /// # Errors
    /// What the tensor library refuses.
    pub fn weights(&self) -> Result<BTreeMap<String, Tensor>> {
        tensors(&self.list, &self.weights, "")
    }

    /// The optimizer's moments by name.
    ///
    /// # Errors
    /// What the tensor library refuses.
    pub fn moments(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut all = BTreeMap::new();
        for (prefix, moment) in MOMENTS.iter().zip(&self.moments) {
            all.extend(tensors(&self.list, moment, &format!("{prefix}."))?);
        }
        Ok(all)
    }

    /// Goes on from these moments, which stood after `step` updates.
    ///
    /// # Errors
    /// Tensors that are missing or of another shape.
    pub fn restore(&mut self, moments: &BTreeMap<String, Tensor>, step: u64) -> Result<()> {
        for (prefix, moment) in MOMENTS.iter().zip(&mut self.moments) {
            *moment = numbers(&self.list, moments, &format!("{prefix}."))?;
        }
        self.step = step;
        Ok(())
    }
}
