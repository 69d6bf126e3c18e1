//! A network's weights: first ones, on disk, and as they learn.

use super::form::Form;
use super::loss::loss;
use crate::random;
use crate::train::adamw::MOMENTS;
use crate::{Error, Result};
use candle_core::{Device, Tensor};
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::{Lstm, Shape};
use kinelm_engine::op::adamw;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Adam's, as PyTorch has them where nobody says.
const BETAS: [f64; 2] = [0.9, 0.999];
const EPSILON: f64 = 1e-8;

/// Names of the tensors in the order of [`Shape::tensors`].
pub fn names(shape: &Shape) -> Vec<String> {
    let of = |layer: usize| {
        ["input.weight", "own.weight", "input.bias", "own.bias"].map(|name| format!("layer.{layer:02}.{name}"))
    };
    (0..shape.layers).flat_map(of).chain(["output.weight".into(), "output.bias".into()]).collect()
}

/// The shape of a tensor on disk: vectors have one dimension.
fn dimensions([rows, columns]: [usize; 2], name: &str) -> Vec<usize> {
    if name.ends_with("bias") { vec![columns] } else { vec![rows, columns] }
}

/// Weights before training: even over +-1 / sqrt(D), as PyTorch's layers begin.
pub fn initial(shape: &Shape, seed: u64) -> Vec<Floats> {
    let most = 1.0 / (shape.width as f64).sqrt();
    let of = |(i, [rows, columns]): (usize, [usize; 2])| {
        let mut rng = random::stream(seed, "aclstm weights", 0, i as u64);
        let numbers: Vec<f32> =
            (0..rows * columns).map(|_| ((2.0 * random::unit(&mut rng) - 1.0) * most) as f32).collect();
        Floats::of(&numbers)
    };
    shape.tensors().into_iter().enumerate().map(of).collect()
}

/// Numbers as tensors by name, `before` in front of the names.
///
/// # Errors
/// What the tensor library refuses.
pub fn tensors(shape: &Shape, numbers: &[Floats], before: &str) -> Result<BTreeMap<String, Tensor>> {
    let all = names(shape).into_iter().zip(shape.tensors()).zip(numbers);
    let one = |((name, size), numbers): ((String, [usize; 2]), &Floats)| {
        let tensor = Tensor::from_slice(numbers, dimensions(size, &name), &Device::Cpu)?;
        Ok((format!("{before}{name}"), tensor))
    };
    all.map(one).collect()
}

/// The way back.
///
/// # Errors
/// [`Error::Weights`] for a tensor that is missing or of another shape.
pub fn numbers(shape: &Shape, tensors: &BTreeMap<String, Tensor>, before: &str) -> Result<Vec<Floats>> {
    let one = |(name, size): (String, [usize; 2])| {
        let (name, expected) = (format!("{before}{name}"), dimensions(size, &name));
        match tensors.get(&name) {
            Some(tensor) if tensor.dims() == expected => Ok(Floats::of(&tensor.flatten_all()?.to_vec1::<f32>()?)),
            Some(tensor) => {
                Err(Error::Weights(format!("tensor {name} of shape {:?}, expected {expected:?}", tensor.dims())))
            }
            None => Err(Error::Weights(format!("no tensor {name} of shape {expected:?}"))),
        }
    };
    names(shape).into_iter().zip(shape.tensors()).map(one).collect()
}

/// A network that learns.
pub struct Learner {
    form: Form,
    lstm: Lstm,
    weights: Vec<Floats>,
    gradients: Vec<Floats>,
    moments: [Vec<Floats>; 2],
    /// (T, B, C), of the outputs.
    pull: Floats,
    step: u64,
}

impl Learner {
    /// Before the first update, on batches of `batch` sequences of `steps` steps.
    pub fn new(form: Form, shape: Shape, (batch, steps): (usize, usize), weights: Vec<Floats>) -> Learner {
        let like = || weights.iter().map(|w| Floats::new(w.len())).collect::<Vec<_>>();
        Learner {
            form,
            lstm: Lstm::new(shape, batch, steps, true),
            gradients: like(),
            moments: [like(), like()],
            weights,
            pull: Floats::new(batch * steps * shape.channels),
            step: 0,
        }
    }

    /// The loss of a batch: `inputs` and `targets` (T, B, C), and which steps see true frames; gradients stay here for
    /// [`Learner::update`].
    ///
    /// # Panics
    /// Numbers of another shape than the batches'.
    pub fn gradients(&mut self, inputs: &[f32], targets: &[f32], given: &[bool]) -> f64 {
        self.lstm.pack(&self.weights);
        self.lstm.rest();
        let channels = self.lstm.shape().channels;
        let outputs = self.lstm.forward(inputs, given);
        let found = loss(self.form, channels, outputs, targets, &mut self.pull);
        self.lstm.backward(&self.pull, &mut self.gradients);
        found
    }

    /// Moves the weights by the gradients found last: Adam, which is AdamW without decay.
    pub fn update(&mut self, rate: f64) {
        self.step += 1;
        let step = adamw::Step::new(self.step, rate, BETAS, EPSILON, 0.0, 1.0);
        let [first, second] = &mut self.moments;
        let all = (&mut self.weights, first, second, &self.gradients);
        all.into_par_iter().for_each(|(x, m, v, g)| adamw::update(x, m, v, g, &step));
    }

    /// The gradients found last.
    pub fn gradients_found(&self) -> &[Floats] {
        &self.gradients
    }

    /// The weights by name.
    ///
    /// # Errors
    /// What the tensor library refuses.
    pub fn weights(&self) -> Result<BTreeMap<String, Tensor>> {
        tensors(self.lstm.shape(), &self.weights, "")
    }

    /// The optimizer's moments by name.
    ///
    /// # Errors
    /// What the tensor library refuses.
    pub fn moments(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut all = BTreeMap::new();
        for (prefix, moment) in MOMENTS.iter().zip(&self.moments) {
            all.extend(tensors(self.lstm.shape(), moment, &format!("{prefix}."))?);
        }
        Ok(all)
    }

    /// Goes on from these moments, which stood after `step` updates.
    ///
    /// # Errors
    /// Tensors that are missing or of another shape.
    pub fn restore(&mut self, moments: &BTreeMap<String, Tensor>, step: u64) -> Result<()> {
        for (prefix, moment) in MOMENTS.iter().zip(&mut self.moments) {
            *moment = numbers(self.lstm.shape(), moments, &format!("{prefix}."))?;
        }
        self.step = step;
        Ok(())
    }
}
