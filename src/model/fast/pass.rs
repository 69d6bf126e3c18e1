//! Forward and backward through all blocks, for batches of one shape.

use super::{BLOCK, Fast, Windows, block_tensors};
use crate::model::config::{ModelConfig, Positions, TokenLayout};
use crate::model::dropout::{Dropout, Purpose};
use crate::model::layout;
use crate::model::position::Counter;
use kinelm_engine::arena::Floats;
use kinelm_engine::block::{self, Saved, Shape};
use kinelm_engine::head;
use kinelm_engine::op::dropout;
use kinelm_engine::op::embedding::{self, Lookup, NONE};
use kinelm_engine::op::matmul::Store;
use rayon::prelude::*;

/// Rows of the embedding that a piece computes.
const EMBEDDED: usize = 64;

/// The buffers of one shape.
pub(super) struct Pass {
    shape: Shape,
    /// The names of the position tables and which row of each a token takes: (T), or (N) where words are counted.
    places: Vec<(&'static str, Vec<u32>)>,
    counter: Option<Counter>,
    /// (N, D) each: what goes into every block, and what comes out of the last; two that take turns if nothing is
    /// learned.
    stream: Vec<Floats>,
    /// One a block; one for all if nothing is learned.
    saved: Vec<Saved>,
    block: block::Workspace,
    head: head::Workspace,
    dx: Floats,
}

/// The keys of a step's dropout masks, drawn anew for every step into the same room.
pub(super) struct Keys {
    share: f64,
    embedding: Key,
    /// Of the attention's weights, of what the attention adds, of what the hidden layer adds.
    blocks: Vec<[Key; 3]>,
}

/// What is dropped for, and a key a sequence.
struct Key(Purpose, Vec<u64>);

impl Keys {
    pub fn new(layers: usize, batch: usize) -> Keys {
        let key = |name: &str| Key(Purpose::new(name), vec![0; batch]);
        let block = |layer| {
            let name = layout::block_name(layer);
            ["attention", "attention out", "mlp"].map(|part| key(&format!("{name} {part}")))
        };
        Keys { share: 0.0, embedding: key("embedding"), blocks: (0..layers).map(block).collect() }
    }

    /// Whether they are for so many sequences.
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

    fn block(&self, layer: usize) -> block::Dropout<'_> {
        let [attention, out, mlp] = self.blocks[layer].each_ref().map(|Key(_, keys)| &keys[..]);
        block::Dropout { share: self.share, attention, out, mlp }
    }
}

impl Pass {
    pub fn new(config: &ModelConfig, tokens: &TokenLayout, rows: usize, length: usize, learn: bool) -> Pass {
        let (d, layers) = (config.width, config.layers);
        let shape = Shape { batch: rows / length, tokens: length, width: d, heads: config.heads, hidden: 4 * d };
        let (streams, saved) = if learn { (layers + 1, layers) } else { (2, 1) };
        Pass {
            shape,
            places: places(config.positions, tokens, rows, length),
            counter: Counter::of(config, tokens),
            stream: (0..streams).map(|_| Floats::new(rows * d)).collect(),
            saved: (0..saved).map(|_| Saved::new(shape)).collect(),
            block: block::Workspace::new(shape, learn),
            head: head::Workspace::new(rows, d, tokens.vocabulary, learn),
            dx: Floats::new(if learn { rows * d } else { 0 }),
        }
    }

    pub fn fits(&self, rows: usize, length: usize) -> bool {
        (self.shape.rows(), self.shape.tokens) == (rows, length)
    }

    pub fn forward(&mut self, model: &Fast, windows: Windows, keys: Option<&Keys>) {
        let Windows { inputs, mask, length, .. } = windows;
        if let (Some(counter), [.., (_, words), (_, places)]) =
            (self.counter.filter(|c| c.reads()), &mut self.places[..])
        {
            let rows = inputs.chunks(length).zip(words.chunks_mut(length).zip(places.chunks_mut(length)));
            rows.for_each(|(window, (words, places))| counter.count(window, words, places));
        }
        let table = |name: &str| model.weight(name);
        // at most the token, a front row, a frame and a place
        let mut lookups = [Lookup { table: table("token.weight"), ids: inputs }; 4];
        for (lookup, (name, ids)) in lookups[1..].iter_mut().zip(&self.places) {
            *lookup = Lookup { table: table(name), ids };
        }
        let (lookups, width) = (&lookups[..=self.places.len()], self.shape.width);
        let pieces = self.stream[0].par_chunks_mut(EMBEDDED * width).enumerate();
        pieces.for_each(|(i, out)| embedding::forward(out, width, i * EMBEDDED, lookups));
        if let Some(keys) = keys {
            drop(&mut self.stream[0], self.shape, keys);
        }
        for layer in 0..model.config.layers {
            let (from, to) = two(&mut self.stream, layer);
            let saved = layer % self.saved.len();
            let dropout = keys.map(|k| k.block(layer));
            let saved = &mut self.saved[saved];
            block::forward(to, from, &model.block(layer), mask, dropout.as_ref(), saved, &mut self.block);
        }
    }

    /// The logits of all rows, a stretch at a time: the first row's number, and its logits.
    pub fn logits(&mut self, model: &Fast, take: &mut dyn FnMut(usize, &mut [f32])) {
        let last = &self.stream[model.config.layers % self.stream.len()];
        head::logits(last, model.norm(), model.weight(model.head_name()), &mut self.head, take);
    }

    /// Loss in nats, summed; `gradients` become those of the loss times `scale`.
    pub fn backward(
        &mut self,
        model: &Fast,
        windows: Windows,
        scale: f32,
        keys: Option<&Keys>,
        gradients: &mut [Floats],
    ) -> f64 {
        let Windows { inputs, targets, mask, .. } = windows;
        let index = |name: &str| model.rest(name).unwrap_or_else(|| panic!("a model has a {name}"));
        let (bias, weight, of_head) = (index("norm.bias"), index("norm.weight"), index(model.head_name()));
        let Ok([bias, weight, of_head]) = gradients.get_disjoint_mut([bias, weight, of_head]) else {
            panic!("{} gradients for a model of {}", gradients.len(), model.parameters.len());
        };
        let norm = block::Norm { weight: &mut **weight, bias: &mut **bias };
        let mut of_head = head::Gradients { dx: &mut self.dx, norm, head: of_head };
        let (last, head) = (&self.stream[model.config.layers], model.weight(model.head_name()));
        let targets = (targets, model.tokens.pad);
        let nats = head::loss(last, model.norm(), head, targets, scale, &mut of_head, Store::Set, &mut self.head);
        for layer in (0..model.config.layers).rev() {
            let Some(Ok(tensors)) =
                gradients.get_mut(layer * BLOCK..(layer + 1) * BLOCK).map(<&mut [Floats; BLOCK]>::try_from)
            else {
                panic!("{} gradients for a model of {}", gradients.len(), model.parameters.len());
            };
            let mut tensors = block_tensors(tensors.each_mut().map(|x| &mut **x));
            let dropout = keys.map(|k| k.block(layer));
            block::backward(
                &mut self.dx,
                &self.stream[layer],
                &model.block(layer),
                &mut tensors,
                Store::Set,
                mask,
                dropout.as_ref(),
                &self.saved[layer],
                &mut self.block,
            );
        }
        if let Some(keys) = keys {
            drop(&mut self.dx, self.shape, keys);
        }
        let token = index("token.weight");
        if !model.config.tied_head {
            gradients[token].fill(0.0);
        }
        let width = self.shape.width;
        embedding::backward(&mut gradients[token], width, inputs, &self.dx);
        for (name, ids) in &self.places {
            let table = &mut gradients[index(name)];
            table.fill(0.0);
            embedding::backward(table, width, ids, &self.dx);
        }
        nats
    }
}

/// Dropout of the embedded tokens (N, D), or of their gradient.
fn drop(x: &mut [f32], shape: Shape, keys: &Keys) {
    x.par_chunks_mut(shape.width).enumerate().for_each(|(row, x)| {
        let (sequence, token) = (row / shape.tokens, row % shape.tokens);
        dropout::apply(x, keys.embedding.1[sequence], token as u64, 0, keys.share);
    });
}

/// What goes into a block and where its output goes.
fn two(stream: &mut [Floats], layer: usize) -> (&[f32], &mut [f32]) {
    let (from, to) = (layer % stream.len(), (layer + 1) % stream.len());
    let (low, high) = stream.split_at_mut(from.max(to));
    if from < to { (&low[from], &mut high[0]) } else { (&high[0], &mut low[to]) }
}

/// The position tables and the row of each for the places `0..length` of a window; for all `rows` where words are counted.
fn places(positions: Positions, tokens: &TokenLayout, rows: usize, length: usize) -> Vec<(&'static str, Vec<u32>)> {
    let (word, front) = (tokens.word, tokens.front);
    let behind = |row: &dyn Fn(usize) -> usize| {
        let row = |i: usize| if i < front { NONE } else { row(i - front) as u32 };
        (0..if tokens.varying { rows } else { length }).map(|i| row(i % length)).collect()
    };
    match positions {
        Positions::Absolute => vec![("position.absolute.weight", (0..length as u32).collect())],
        Positions::FrameJoint | Positions::Rope => vec![
            ("position.front.weight", (0..length).map(|i| if i < front { i as u32 } else { NONE }).collect()),
            ("position.frame.weight", behind(&|k| k / word)),
            ("position.place.weight", behind(&|k| k % word)),
        ],
    }
}
