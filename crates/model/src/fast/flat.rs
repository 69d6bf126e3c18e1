//! One stack of blocks, in which every token is a row.

use super::input::{Inputs, TABLES};
use super::keys::Keys;
use super::stack::{Blocks, Stack};
use super::tables::{embed, into_table};
use super::{Fast, Windows};
use kinelm_engine::arena::Floats;
use kinelm_engine::block::{Rules, Shape};
use kinelm_engine::linear::Products;
use kinelm_engine::op::embedding::{self, Lookup};

/// The buffers of one shape.
pub(super) struct Flat {
    inputs: Inputs,
    stack: Stack,
}

impl Flat {
    pub fn new(model: &Fast, rows: usize, length: usize, products: Products, learn: bool) -> Flat {
        let config = &model.config;
        let width = config.width;
        let shape = Shape { batch: rows / length, tokens: length, width, heads: config.heads, hidden: 4 * width };
        let blocks = Blocks { prefix: "", layers: config.layers };
        Flat {
            inputs: Inputs::new(config, &model.tokens, rows, length),
            stack: Stack::new(&model.parameters, blocks, shape, products, learn),
        }
    }

    pub fn forward(&mut self, model: &Fast, windows: Windows, keys: Option<&Keys>) {
        let Windows { inputs, mask, length, .. } = windows;
        self.inputs.read(inputs, length);
        let tables = self.inputs.tables();
        let mut lookups = [Lookup { table: model.weight("token.weight"), ids: inputs }; TABLES + 1];
        for (lookup, (name, ids)) in lookups[1..].iter_mut().zip(tables) {
            *lookup = Lookup { table: model.weight(name), ids };
        }
        let (lookups, shape) = (&lookups[..=tables.len()], self.stack.shape());
        embed(self.stack.input(), shape.width, lookups);
        let rules = Rules { mask, dropout: None, rope: self.inputs.rope() };
        self.stack.forward(&model.weights, rules, keys);
    }

    /// The output of the last block (N, D).
    pub fn last(&self) -> &[f32] {
        self.stack.last()
    }

    /// From the gradient `dx` (N, D) of [`Flat::last`], which is used up, those of all tensors before it.
    pub fn backward(
        &mut self,
        model: &Fast,
        windows: Windows,
        keys: Option<&Keys>,
        dx: &mut [f32],
        gradients: &mut [Floats],
    ) {
        let Windows { inputs, mask, .. } = windows;
        let rules = Rules { mask, dropout: None, rope: self.inputs.rope() };
        self.stack.backward(&model.weights, gradients, dx, rules, keys);
        let shape = self.stack.shape();
        let token = model.index("token.weight");
        // a tied table holds the head's gradient by now, to which that of the lookups is added
        if !model.config.tied_head {
            gradients[token].fill(0.0);
        }
        embedding::backward(&mut gradients[token], shape.width, inputs, dx);
        for (name, ids) in self.inputs.tables() {
            into_table(&mut gradients[model.index(name)], shape.width, ids, dx);
        }
    }
}
