//! A stack of blocks: forward and backward through them, for batches of one shape.

use super::keys::Keys;
use super::{BLOCK, block_tensors};
use crate::layout::{Parameter, block_name};
use kinelm_engine::arena::Floats;
use kinelm_engine::block::{self, Rules, Saved, Shape};
use kinelm_engine::linear::Products;
use kinelm_engine::op::matmul::Store;

/// Which blocks of a model they are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blocks<'a> {
    /// The prefix of their names.
    pub prefix: &'a str,
    /// How many.
    pub layers: usize,
}

/// The buffers of one shape.
pub(super) struct Stack {
    shape: Shape,
    layers: usize,
    /// Index of the first block's first tensor among the model's.
    first: usize,
    /// (N, D) each: what goes into every block, and what comes out of the last; two that take turns if nothing is
    /// learned.
    stream: Vec<Floats>,
    /// One a block; one for all if nothing is learned.
    saved: Vec<Saved>,
    space: block::Workspace,
}

impl Stack {
    /// Room for the blocks of a model of these `parameters`; `learn`: for training too.
    ///
    /// # Panics
    /// Blocks that the model doesn't have.
    pub fn new(parameters: &[Parameter], blocks: Blocks, shape: Shape, products: Products, learn: bool) -> Stack {
        let Blocks { prefix, layers } = blocks;
        let name = format!("{prefix}{}.", block_name(0));
        let first = parameters.iter().position(|p| p.name.starts_with(&name));
        // the backward pass reads every block's input and saved activations; scoring only the last
        let (streams, saved) = if learn { (layers + 1, layers) } else { (2, 1) };
        Stack {
            shape,
            layers,
            first: first.unwrap_or_else(|| panic!("a model has {name}")),
            stream: (0..streams).map(|_| Floats::new(shape.rows() * shape.width)).collect(),
            saved: (0..saved).map(|_| Saved::new(shape)).collect(),
            space: block::Workspace::new(shape, products, learn),
        }
    }

    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// (N, D) The input of the first block.
    pub fn input(&mut self) -> &mut [f32] {
        &mut self.stream[0]
    }

    /// (N, D) The output of the last block.
    pub fn last(&self) -> &[f32] {
        &self.stream[self.layers % self.stream.len()]
    }

    /// Drops by `keys` from the input and in the blocks, which follow `rules` otherwise.
    pub fn forward(&mut self, weights: &[Floats], rules: Rules, keys: Option<&Keys>) {
        if let Some(keys) = keys {
            keys.drop_embedded(&mut self.stream[0], self.shape);
        }
        for layer in 0..self.layers {
            let rules = Rules { dropout: keys.map(|keys| keys.block(layer)), ..rules };
            let (from, to) = two(&mut self.stream, layer);
            let saved = layer % self.saved.len();
            // names sort by layer as they have two digits, and a block's tensors are neighbours
            let tensors = block(weights, self.first + layer * BLOCK);
            block::forward(to, from, &tensors, rules, &mut self.saved[saved], &mut self.space);
        }
    }

    /// `dx` (N, D), the gradient of [`Stack::last`], becomes that of the input; the blocks' go to `gradients`.
    pub fn backward(
        &mut self,
        weights: &[Floats],
        gradients: &mut [Floats],
        dx: &mut [f32],
        rules: Rules,
        keys: Option<&Keys>,
    ) {
        for layer in (0..self.layers).rev() {
            let rules = Rules { dropout: keys.map(|keys| keys.block(layer)), ..rules };
            let first = self.first + layer * BLOCK;
            let Some(Ok(tensors)) = gradients.get_mut(first..first + BLOCK).map(<&mut [Floats; BLOCK]>::try_from)
            else {
                panic!("{} gradients for a model of {} tensors", gradients.len(), weights.len());
            };
            let mut tensors = block_tensors(tensors.each_mut().map(|x| &mut **x));
            let (x, saved) = (&self.stream[layer], &self.saved[layer]);
            let own = block(weights, first);
            block::backward(dx, x, &own, &mut tensors, Store::Set, rules, saved, &mut self.space);
        }
        if let Some(keys) = keys {
            // the same mask again: a dropped input passes no gradient, one that stays passes it grown
            keys.drop_embedded(dx, self.shape);
        }
    }
}

/// The weights of the block whose tensors begin at `first`.
fn block(weights: &[Floats], first: usize) -> block::Weights<'_> {
    block_tensors(std::array::from_fn(|i| &*weights[first + i]))
}

/// The input and the output buffer of a block.
fn two(stream: &mut [Floats], layer: usize) -> (&[f32], &mut [f32]) {
    let (from, to) = (layer % stream.len(), (layer + 1) % stream.len());
    // with two buffers they take turns, so `from` may be the higher one
    let (low, high) = stream.split_at_mut(from.max(to));
    if from < to { (&low[from], &mut high[0]) } else { (&high[0], &mut low[to]) }
}
