//! A network's weights: first ones, and as they learn.

use super::form::Form;
use super::loss::loss;
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::{Lstm, Shape};
use kinelm_store::random;
use kinelm_train::parameters::{List, Parameters};

/// The tensors in the order of [`Shape::tensors`].
pub fn list(shape: &Shape) -> List {
    let of = |layer: usize| {
        ["input.weight", "own.weight", "input.bias", "own.bias"].map(|name| format!("layer.{layer:02}.{name}"))
    };
    let names = (0..shape.layers).flat_map(of).chain(["output.weight".into(), "output.bias".into()]);
    names.zip(shape.tensors()).collect()
}

/// Weights before training: even over +-1 / sqrt(D), as PyTorch's layers begin.
pub fn initial(shape: &Shape, seed: u64) -> Vec<Floats> {
    let most = 1.0 / (shape.width as f64).sqrt();
    let all = shape.tensors().into_iter().enumerate();
    all.map(|(i, [rows, columns])| even(("aclstm weights", i), rows * columns, most, seed)).collect()
}

/// Numbers even over +-`most`, of the stream of a purpose and a place.
pub fn even((purpose, index): (&str, usize), len: usize, most: f64, seed: u64) -> Floats {
    let mut rng = random::stream(seed, purpose, 0, index as u64);
    let numbers: Vec<f32> = (0..len).map(|_| ((2.0 * random::unit(&mut rng) - 1.0) * most) as f32).collect();
    Floats::of(&numbers)
}

/// A network that learns.
pub struct Learner {
    form: Form,
    lstm: Lstm,
    /// Its weights.
    pub parameters: Parameters,
    /// (T, B, C), of the outputs.
    pull: Floats,
}

impl Learner {
    /// Before the first update, on batches of `batch` sequences of `steps` steps.
    pub fn new(form: Form, shape: Shape, (batch, steps): (usize, usize), weights: Vec<Floats>) -> Learner {
        Learner {
            form,
            lstm: Lstm::new(shape, batch, steps, true),
            parameters: Parameters::new(list(&shape), weights),
            pull: Floats::new(batch * steps * shape.channels),
        }
    }

    /// The loss of a batch: `inputs` and `targets` (T, B, C), and which steps see true frames; gradients stay here for
    /// [`Parameters::update`].
    ///
    /// # Panics
    /// Numbers of another shape than the batches'.
    pub fn gradients(&mut self, inputs: &[f32], targets: &[f32], given: &[bool]) -> f64 {
        self.lstm.pack(&self.parameters.weights);
        self.lstm.rest();
        let channels = self.lstm.shape().channels;
        let outputs = self.lstm.forward(inputs, given);
        let found = loss(self.form, channels, outputs, targets, &mut self.pull);
        self.lstm.backward(&self.pull, &mut self.parameters.gradients);
        found
    }
}
