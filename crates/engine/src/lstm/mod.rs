//! LSTM layers with a linear output, over sequences in which the network is fed its own output, and backpropagation through
//! time.
//!
//! Letters: T steps, B sequences, C channels of input and output, D units of a layer, L layers, I inputs of a layer (C or D).
//! Rows are stored step by step: (T, B, ..).
//!
//! A step's input is either given or the previous step's output, for all sequences alike ([`Lstm::forward`]). The sequence
//! falls into stretches whose inputs are all known when they begin: a given step joins the stretch before it, a fed one
//! begins a new one. In a stretch each layer multiplies all its inputs in one product; its recurrence takes a product per
//! step, of all four gates at once. Gradients go back through the same stretches and through fed outputs; the gradients of
//! weights are one product each over all steps.
//!
//! [`Single`] is one such layer, with teacher forcing at some steps, for other networks.
//!
//! Threads share a step's columns, [`UNITS`] units at a time, so that every number is summed by one thread.
//!
//! ```
//! use kinelm_engine::arena::Floats;
//! use kinelm_engine::lstm::{Lstm, Shape, Wiring};
//!
//! let shape = Shape { channels: 2, width: 4, layers: 1, wiring: Wiring::Fixed };
//! let weights: Vec<Floats> = shape.tensors().iter().map(|[rows, columns]| Floats::of(&vec![0.1; rows * columns])).collect();
//! let mut network = Lstm::new(shape, 1, 3, false);
//! network.pack(&weights);
//! network.rest();
//! // the first step is given, two are fed
//! let outputs = network.forward(&[1.0, -1.0, 0.0, 0.0, 0.0, 0.0], &[true, false, false]).to_vec();
//! assert_eq!(outputs.len(), 6);
//! assert!(outputs[4] > outputs[2] && outputs[2] > outputs[0]);
//! ```

mod backward;
mod columns;
mod forward;
mod layer;
mod single;
#[cfg(test)]
mod tests;

use crate::arena::Floats;
use columns::Columns;
use layer::Layer;
use std::ops::Range;

pub use layer::TeacherForcing;
pub use single::Single;

/// Units of a layer that a thread computes at a time.
pub const UNITS: usize = 64;

/// The connection between layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wiring {
    /// A layer's input is the output of the one below at the same step.
    #[default]
    Fixed,
    /// Its input is that of the previous step, so that an input reaches the output L - 1 steps late.
    Compat,
}

/// The shape of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// C.
    pub channels: usize,
    /// D.
    pub width: usize,
    /// L.
    pub layers: usize,
    /// The connection between layers.
    pub wiring: Wiring,
}

impl Shape {
    /// Rows and columns of the tensors in their order: of each layer the weights of its input (I, 4D) and of its own last
    /// output (D, 4D), and the biases of both (4D), columns by gates i, f, g, o; then the output's weight (D, C) and bias
    /// (C). A vector has one row.
    pub fn tensors(&self) -> Vec<[usize; 2]> {
        let (c, d) = (self.channels, self.width);
        let of = |layer: usize| [[if layer == 0 { c } else { d }, 4 * d], [d, 4 * d], [1, 4 * d], [1, 4 * d]];
        (0..self.layers).flat_map(of).chain([[d, c], [1, c]]).collect()
    }

    /// Numbers of all tensors.
    pub fn parameters(&self) -> usize {
        self.tensors().iter().map(|[rows, columns]| rows * columns).sum()
    }
}

/// A network's weights, packed for products, and the memory of a pass over up to T steps of B sequences.
pub struct Lstm {
    shape: Shape,
    /// Numbers of each tensor.
    sizes: Vec<usize>,
    batch: usize,
    /// T, the most steps.
    steps: usize,
    /// For each step of the last pass: was its input given?
    given: Vec<bool>,
    layers: Vec<Layer>,
    /// (T, B, C): inputs of the first layer.
    x: Floats,
    /// (T + 1, B, C): the output before the first step, then those of all steps.
    y: Floats,
    output: Columns,
    bias: Floats,
    back: Option<Back>,
}

struct Back {
    /// (T, B, C).
    dy: Floats,
    /// (B, C), of one fed step.
    dx: Floats,
    /// To the top layer.
    output: Columns,
    sums: Sums,
}

/// Gradients of rows in panels, and the sums of their columns per piece.
struct Sums {
    panels: Floats,
    partial: Floats,
}

impl Lstm {
    /// Memory for sequences of up to `steps` steps, `batch` side by side; `backward`: for gradients too.
    ///
    /// # Panics
    /// If a size is 0.
    pub fn new(shape: Shape, batch: usize, steps: usize, backward: bool) -> Lstm {
        let Shape { channels: c, width: d, layers, .. } = shape;
        assert!(c * d * layers * batch * steps > 0, "{shape:?}, {batch} sequences of {steps} steps");
        let (rows, widest) = (batch * steps, c.max(4 * d));
        let layer = |l: usize| Layer::new(if l == 0 { c } else { d }, d, batch, steps, backward);
        Lstm {
            shape,
            sizes: shape.tensors().iter().map(|[rows, columns]| rows * columns).collect(),
            batch,
            steps,
            given: Vec::with_capacity(steps),
            layers: (0..layers).map(layer).collect(),
            x: Floats::new(rows * c),
            y: Floats::new((rows + batch) * c),
            output: Columns::new(d, c, rows),
            bias: Floats::new(c),
            back: backward.then(|| Back {
                dy: Floats::new(rows * c),
                dx: Floats::new(batch * c),
                output: Columns::new(c, d, rows),
                sums: Sums::new(rows, widest),
            }),
        }
    }

    /// The network's shape.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Takes over weights, in the order of [`Shape::tensors`]: before the first pass and after every update.
    ///
    /// # Panics
    /// If tensors have other shapes.
    pub fn pack(&mut self, weights: &[Floats]) {
        let sizes = weights.iter().map(|w| w.len());
        assert!(sizes.eq(self.sizes.iter().copied()), "expected tensors of {:?} numbers", self.sizes);
        for (layer, four) in self.layers.iter_mut().zip(weights.chunks_exact(4)) {
            layer.pack([&four[0], &four[1], &four[2], &four[3]]);
        }
        let last = 4 * self.shape.layers;
        self.output.pack(&weights[last]);
        self.bias.copy_from_slice(&weights[last + 1]);
        if let Some(back) = &mut self.back {
            back.output.pack_transposed(&weights[last]);
        }
    }

    /// The next pass begins with a state and an output of 0.
    pub fn rest(&mut self) {
        let (b, c) = (self.batch, self.shape.channels);
        self.y[..b * c].fill(0.0);
        self.layers.iter_mut().for_each(|layer| layer.rest());
    }

    /// The next pass goes on where the last one ended: called after [`Lstm::forward`], before a backward pass, which
    /// forgets how many steps that had.
    pub fn carry(&mut self) {
        let (steps, row) = (self.given.len(), self.batch * self.shape.channels);
        self.y.copy_within(steps * row..(steps + 1) * row, 0);
        self.layers.iter_mut().for_each(|layer| layer.carry(steps));
    }

    /// (B, C): the input of a fed first step.
    pub fn last_output(&self) -> &[f32] {
        &self.y[..self.batch * self.shape.channels]
    }
}

/// The stretches of a sequence whose inputs are all known when they begin.
fn stretches(given: &[bool]) -> impl DoubleEndedIterator<Item = Range<usize>> + '_ {
    let begins = move |t: &usize| *t == 0 || !given[*t];
    let end = move |t: usize| (t + 1..given.len()).find(|n| !given[*n]).unwrap_or(given.len());
    (0..given.len()).filter(begins).map(move |t| t..end(t))
}
