//! The network: first weights, and gradients of a batch.

use super::loss::loss;
use crate::form::Form;
use crate::train::{Parameters, parameter, uniform};
use crate::{Loss, PartWeights};
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::{Lstm, Shape};
use kinelm_model::layout::Parameter;

/// The tensors in the order of [`Shape::tensors`].
pub(crate) fn list(shape: &Shape) -> Vec<Parameter> {
    let of = |layer: usize| {
        ["input.weight", "own.weight", "input.bias", "own.bias"].map(|name| format!("layer.{layer:02}.{name}"))
    };
    let names = (0..shape.layers).flat_map(of).chain(["output.weight".into(), "output.bias".into()]);
    names.zip(shape.tensors()).map(|(name, size)| parameter(name, size)).collect()
}

/// Weights before training: uniform over +-1 / sqrt(D), as in PyTorch.
pub fn initial(shape: &Shape, seed: u64) -> Vec<Floats> {
    let most = 1.0 / (shape.width as f64).sqrt();
    let all = shape.tensors().into_iter().enumerate();
    all.map(|(i, [rows, columns])| uniform("aclstm weights", i, rows * columns, most, seed)).collect()
}

/// A network that learns.
pub struct Learner {
    form: Form,
    parts: PartWeights,
    lstm: Lstm,
    /// Its weights.
    pub parameters: Parameters,
    /// (T, B, C) gradients of the outputs.
    d_out: Floats,
}

impl Learner {
    /// Before the first update, on batches of `batch` sequences of `steps` steps.
    pub fn new(
        form: Form,
        parts: PartWeights,
        shape: Shape,
        batch: usize,
        steps: usize,
        weights: Vec<Floats>,
    ) -> Learner {
        Learner {
            form,
            parts,
            lstm: Lstm::new(shape, batch, steps, true),
            parameters: Parameters::new(list(&shape), weights),
            d_out: Floats::new(batch * steps * shape.channels),
        }
    }

    /// The loss of a batch: `inputs` and `targets` (T, B, C), and which steps have ground-truth input. Gradients stay here
    /// for [`Parameters::update`].
    ///
    /// # Panics
    /// Numbers of another shape than the batches'.
    pub fn gradients(&mut self, inputs: &[f32], targets: &[f32], given: &[bool]) -> Loss {
        let found = self.loss(inputs, targets, given);
        self.lstm.backward(&self.d_out, &mut self.parameters.optimizer.gradients);
        found
    }

    /// The same without gradients of the weights.
    ///
    /// # Panics
    /// As [`Learner::gradients`].
    pub fn loss(&mut self, inputs: &[f32], targets: &[f32], given: &[bool]) -> Loss {
        self.lstm.pack(&self.parameters.weights);
        self.lstm.rest();
        let channels = self.lstm.shape().channels;
        let outputs = self.lstm.forward(inputs, given);
        loss(self.form, self.parts, channels, outputs, targets, &mut self.d_out)
    }
}
