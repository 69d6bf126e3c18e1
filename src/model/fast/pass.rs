//! Forward and backward through all blocks, for batches of one shape.

use super::classes::Added;
use super::head::Heads;
use super::input::{Inputs, TABLES};
use super::keys::Keys;
use super::{BLOCK, Fast, Windows, block_tensors};
use crate::Result;
use crate::model::config::{ModelConfig, TokenLayout};
use kinelm_engine::arena::Floats;
use kinelm_engine::block::{self, Rules, Saved, Shape};
use kinelm_engine::linear::Products;
use kinelm_engine::op::embedding::{self, Lookup};
use kinelm_engine::op::matmul::Store;
use rayon::prelude::*;

/// Rows of the embedding that a piece computes.
const EMBEDDED: usize = 64;

/// The buffers of one shape.
pub(super) struct Pass {
    shape: Shape,
    products: Products,
    inputs: Inputs,
    /// (N, D) each: what goes into every block, and what comes out of the last; two that take turns if nothing is
    /// learned.
    stream: Vec<Floats>,
    /// One a block; one for all if nothing is learned.
    saved: Vec<Saved>,
    block: block::Workspace,
    heads: Heads,
    dx: Floats,
}

impl Pass {
    pub fn new(
        config: &ModelConfig,
        tokens: &TokenLayout,
        rows: usize,
        length: usize,
        products: Products,
        learn: bool,
    ) -> Pass {
        let (d, layers) = (config.width, config.layers);
        let shape = Shape { batch: rows / length, tokens: length, width: d, heads: config.heads, hidden: 4 * d };
        let (streams, saved) = if learn { (layers + 1, layers) } else { (2, 1) };
        Pass {
            shape,
            products,
            inputs: Inputs::new(config, tokens, rows, length),
            stream: (0..streams).map(|_| Floats::new(rows * d)).collect(),
            saved: (0..saved).map(|_| Saved::new(shape)).collect(),
            block: block::Workspace::new(shape, products, learn),
            heads: Heads::new(config, tokens, rows, length, products, learn),
            dx: Floats::new(if learn { rows * d } else { 0 }),
        }
    }

    pub fn fits(&self, rows: usize, length: usize, products: Products) -> bool {
        (self.shape.rows(), self.shape.tokens, self.products) == (rows, length, products)
    }

    /// Takes the rows whose target counts.
    ///
    /// # Errors
    /// Targets that nothing answers.
    pub fn ask(&mut self, windows: Windows) -> Result<()> {
        self.heads.ask(windows.inputs, windows.targets, windows.length)
    }

    pub fn forward(&mut self, model: &Fast, windows: Windows, keys: Option<&Keys>) {
        let Windows { inputs, mask, length, .. } = windows;
        self.inputs.read(inputs, length);
        let tables = self.inputs.tables();
        let mut lookups = [Lookup { table: model.weight("token.weight"), ids: inputs }; TABLES + 1];
        for (lookup, (name, ids)) in lookups[1..].iter_mut().zip(tables) {
            *lookup = Lookup { table: model.weight(name), ids };
        }
        let (lookups, width) = (&lookups[..=tables.len()], self.shape.width);
        let pieces = self.stream[0].par_chunks_mut(EMBEDDED * width).enumerate();
        pieces.for_each(|(i, out)| embedding::forward(out, width, i * EMBEDDED, lookups));
        if let Some(keys) = keys {
            keys.drop_embedded(&mut self.stream[0], self.shape);
        }
        for layer in 0..model.config.layers {
            let (from, to) = two(&mut self.stream, layer);
            let saved = layer % self.saved.len();
            let rules = Rules { mask, dropout: keys.map(|k| k.block(layer)), rope: self.inputs.rope() };
            block::forward(to, from, &model.block(layer), rules, &mut self.saved[saved], &mut self.block);
        }
    }

    /// -ln p of what is asked of every row, in nats, 0 where nothing is.
    pub fn nats(&mut self, model: &Fast, out: &mut [f32]) {
        let last = &self.stream[model.config.layers % self.stream.len()];
        self.heads.nats(model, last, out);
    }

    /// The logits (N, V) of all rows.
    pub fn logits(&mut self, model: &Fast, windows: Windows, out: &mut [f32]) {
        let last = &self.stream[model.config.layers % self.stream.len()];
        self.heads.logits(model, last, windows.inputs, windows.length, out);
    }

    /// What the last block gave (N, D).
    pub fn last(&self, model: &Fast) -> &[f32] {
        &self.stream[model.config.layers % self.stream.len()]
    }

    /// Loss in nats, summed; `gradients` become those of the loss times `scale`, and of what `added` adds.
    pub fn backward(
        &mut self,
        model: &Fast,
        windows: Windows,
        scale: f32,
        keys: Option<&Keys>,
        gradients: &mut [Floats],
        added: Added,
    ) -> f64 {
        let Windows { inputs, mask, .. } = windows;
        let last = &self.stream[model.config.layers];
        let nats = self.heads.loss(model, last, scale, &mut self.dx, gradients);
        added(model, last, &mut self.dx, gradients);
        for layer in (0..model.config.layers).rev() {
            let Some(Ok(tensors)) =
                gradients.get_mut(layer * BLOCK..(layer + 1) * BLOCK).map(<&mut [Floats; BLOCK]>::try_from)
            else {
                panic!("{} gradients for a model of {}", gradients.len(), model.parameters.len());
            };
            let mut tensors = block_tensors(tensors.each_mut().map(|x| &mut **x));
            let rules = Rules { mask, dropout: keys.map(|k| k.block(layer)), rope: self.inputs.rope() };
            block::backward(
                &mut self.dx,
                &self.stream[layer],
                &model.block(layer),
                &mut tensors,
                Store::Set,
                rules,
                &self.saved[layer],
                &mut self.block,
            );
        }
        if let Some(keys) = keys {
            keys.drop_embedded(&mut self.dx, self.shape);
        }
        let index = |name: &str| model.rest(name).unwrap_or_else(|| panic!("a model has a {name}"));
        let token = index("token.weight");
        if !model.config.tied_head {
            gradients[token].fill(0.0);
        }
        let width = self.shape.width;
        embedding::backward(&mut gradients[token], width, inputs, &self.dx);
        for (name, ids) in self.inputs.tables() {
            let table = &mut gradients[index(name)];
            table.fill(0.0);
            embedding::backward(table, width, ids, &self.dx);
        }
        nats
    }
}

/// What goes into a block and where its output goes.
fn two(stream: &mut [Floats], layer: usize) -> (&[f32], &mut [f32]) {
    let (from, to) = (layer % stream.len(), (layer + 1) % stream.len());
    let (low, high) = stream.split_at_mut(from.max(to));
    if from < to { (&low[from], &mut high[0]) } else { (&high[0], &mut low[to]) }
}
