//! The keys of a step's dropout masks.

use crate::dropout::{Dropout, Purpose};
use crate::layout;
use kinelm_engine::block;
use kinelm_engine::op::dropout;
use rayon::prelude::*;

/// Set anew for every step in the same buffers.
pub(super) struct Keys {
    share: f64,
    embedding: Key,
    /// Of the attention's weights, of what the attention adds, of what the hidden layer adds.
    blocks: Vec<[Key; 3]>,
}

/// The purpose of a mask, and a key per sequence.
struct Key(Purpose, Vec<u64>);

impl Keys {
    /// For blocks whose names begin with `prefix`.
    pub fn new(prefix: &str, layers: usize, batch: usize) -> Keys {
        let key = |name: &str| Key(Purpose::new(name), vec![0; batch]);
        let block = |layer| {
            let name = format!("{prefix}{}", layout::block_name(layer));
            ["attention", "attention out", "mlp"].map(|part| key(&format!("{name} {part}")))
        };
        Keys { share: 0.0, embedding: key("embedding"), blocks: (0..layers).map(block).collect() }
    }

    /// Whether they are for `batch` sequences.
    pub fn fits(&self, batch: usize) -> bool {
        self.embedding.1.len() == batch
    }

    /// The keys of a step.
    pub fn draw(&mut self, dropout: &Dropout) {
        self.share = dropout.share;
        for Key(purpose, keys) in self.blocks.iter_mut().flatten().chain([&mut self.embedding]) {
            keys.iter_mut().enumerate().for_each(|(sequence, key)| *key = dropout.key(purpose, sequence));
        }
    }

    pub fn block(&self, layer: usize) -> block::Dropout<'_> {
        let [attention, out, mlp] = self.blocks[layer].each_ref().map(|Key(_, keys)| &keys[..]);
        block::Dropout { share: self.share, attention, out, mlp }
    }

    /// Drops from the embedded tokens or frames (N, D), or from their gradient.
    pub fn drop_embedded(&self, x: &mut [f32], shape: block::Shape) {
        x.par_chunks_mut(shape.width).enumerate().for_each(|(row, x)| {
            let (sequence, row) = (row / shape.tokens, row % shape.tokens);
            dropout::apply(x, self.embedding.1[sequence], row as u64, 0, self.share);
        });
    }
}
