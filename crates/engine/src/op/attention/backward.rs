//! Backward: for each block of keys, the queries that see it, a tile of rows at a time.

use super::softmax::{Means, SoftmaxBack};
use super::{KEYS, QUERIES, ROW, Rules, Scratch, Shape, Tile, Workspace, copy_rows, part_of, step};
use crate::dispatch;
use crate::op::matmul::{Left, Store};
use crate::op::products::{Products, Right};
use rayon::prelude::*;

/// The input and output of [`forward`](super::forward()), and the gradient of its output as rows.
#[derive(Clone, Copy)]
pub struct Done<'a> {
    /// (N, 3 D).
    pub qkv: &'a [f32],
    /// (B, H, T, d).
    pub out: &'a [f32],
    /// (B, H, T).
    pub log_sums: &'a [f32],
    /// (N, D).
    pub d_out: &'a [f32],
}

/// Gradients of queries, keys and values: `d_qkv` (B, H, 3, T, d) is overwritten.
///
/// # Panics
/// Slices of other lengths, a mask of another, and a workspace of another shape.
pub fn backward(shape: Shape, done: Done, rules: Rules, space: &Workspace, d_qkv: &mut [f32]) {
    let (rows, columns) = (shape.rows(), shape.columns());
    assert_eq!(space.shape, shape, "a workspace for another shape");
    assert_eq!(done.qkv.len(), rows * 3 * columns, "queries, keys and values of {shape:?}");
    assert_eq!(done.out.len(), rows * columns, "outputs of {shape:?}");
    assert_eq!(done.d_out.len(), rows * columns, "gradients of outputs of {shape:?}");
    assert_eq!(done.log_sums.len(), rows * shape.heads, "sums of {shape:?}");
    assert_eq!(d_qkv.len(), rows * 3 * columns, "gradients of {shape:?}");
    rules.check(shape);
    if shape.is_empty() {
        return;
    }
    let size = shape.tokens * shape.width;
    d_qkv.par_chunks_mut(3 * size).enumerate().for_each(|(piece, gradients)| {
        let (d_queries, rest) = gradients.split_at_mut(size);
        let (d_keys, d_values) = rest.split_at_mut(size);
        let products = space.products;
        let head = Piece { shape, products, done, rules, piece, d_queries, d_keys, d_values };
        space.scratch.with(|scratch| head.run(scratch));
        if shape.tokens == 1 {
            // a single key's weight is 1 whatever its score, but rounding leaves dw - mean near 0, not at it
            gradients[..2 * size].fill(0.0);
        }
    });
}

/// A head of a sequence.
struct Piece<'a> {
    shape: Shape,
    products: Products,
    done: Done<'a>,
    rules: Rules<'a>,
    piece: usize,
    /// (T, d) each.
    d_queries: &'a mut [f32],
    d_keys: &'a mut [f32],
    d_values: &'a mut [f32],
}

impl Piece<'_> {
    fn run(mut self, scratch: &mut Scratch) {
        let (d, t, stride) = (self.shape.width, self.shape.tokens, 3 * self.shape.columns());
        // sum over keys of w dw = out . d_out: no need for the whole row of weights
        let (means, out) = (&mut scratch.sums[..t], &self.done.out[self.piece * t * d..][..t * d]);
        dispatch::run(Means { means, out, d_out: self.d_out(0), stride: self.shape.columns() });
        for key in (0..t).step_by(KEYS) {
            let columns = KEYS.min(t - key);
            let part = |part| part_of(self.done.qkv, self.shape, self.piece, part, key);
            copy_rows(&mut scratch.rows, part(2), stride, columns, d);
            self.products.pack_transposed(&mut scratch.values_across, &scratch.rows, d, d, columns);
            copy_rows(&mut scratch.rows, part(1), stride, columns, d);
            self.products.pack_transposed(&mut scratch.keys_across, &scratch.rows, d, d, columns);
            // scores are of queries that are scaled, and so are their gradients by the keys
            self.shape.scale(&mut scratch.rows[..columns * d]);
            self.products.pack(&mut scratch.down, &scratch.rows, d, columns, d);
            // earlier queries see none of these keys
            let first = if self.rules.is_causal() { key } else { 0 };
            for query in (first..t).step_by(QUERIES) {
                let rows = QUERIES.min(t - query);
                let tile = Tile { query, rows, key, columns, causal: self.rules.is_causal() };
                self.tile(scratch, tile);
            }
        }
    }

    /// The gradient of the output's rows, from token `query` on, a row every D numbers.
    fn d_out(&self, query: usize) -> &[f32] {
        let Shape { tokens, heads, width, .. } = self.shape;
        let row = self.piece / heads * tokens + query;
        &self.done.d_out[row * heads * width + self.piece % heads * width..]
    }

    /// The tile's part of all three gradients.
    fn tile(&mut self, scratch: &mut Scratch, tile: Tile) {
        let (d, stride) = (self.shape.width, self.shape.columns());
        let Tile { query, rows, key, .. } = tile;
        let queries = part_of(self.done.qkv, self.shape, self.piece, 0, query);
        copy_rows(&mut scratch.queries, queries, 3 * stride, rows, d);
        self.shape.scale(&mut scratch.queries[..rows * d]);
        copy_rows(&mut scratch.slopes, self.d_out(query), stride, rows, d);
        self.products.pack(&mut scratch.queries_down, &scratch.queries, d, rows, d);
        self.products.pack(&mut scratch.slopes_down, &scratch.slopes, d, rows, d);
        let step = step(self.products);
        for first in (0..rows).step_by(step) {
            self.step(scratch, tile.part(first, step.min(rows - first)), first, tile.columns);
        }
        // keys up to the tile's first query are seen by all its rows, later ones from their own step on
        let all = if tile.causal { tile.columns.min(query - key) } else { tile.columns };
        let mut from = 0;
        while from < tile.visible(rows - 1) {
            let (columns, skip) = match from < all {
                true => (all, 0),
                false => (step.min(tile.visible(rows - 1) - from), key + from - query),
            };
            // the first queries that see a key begin its sums
            let store = if query + skip == if tile.causal { key + from } else { 0 } { Store::Set } else { Store::Add };
            let sum = |to: &mut [f32], a: &[f32], panels: &[f32]| {
                // weights (queries, keys) as the transposed left factor: a sum over queries for each key
                let left = Left::Columns { a: &a[skip * ROW + from..], lda: ROW };
                let right = Right { panels, block: rows, first: skip };
                let to = &mut to[(key + from) * d..];
                self.products.product(to, d, (columns, rows - skip, d), left, right, store);
            };
            sum(self.d_keys, &scratch.changes, &scratch.queries_down);
            sum(self.d_values, &scratch.weights, &scratch.slopes_down);
            from += columns;
        }
    }

    /// Weights and gradients of scores of a step of the tile's rows, from row `first` on, and their part of the queries'
    /// gradient.
    fn step(&mut self, scratch: &mut Scratch, tile: Tile, first: usize, packed: usize) {
        let (d, t) = (self.shape.width, self.shape.tokens);
        let Tile { query, rows, key, columns, .. } = tile;
        let scores = &mut scratch.weights[first * ROW..(first + rows) * ROW];
        let changes = &mut scratch.changes[first * ROW..(first + rows) * ROW];
        let across = |to: &mut [f32], a: &[f32], panels: &[f32]| {
            let left = Left::Rows { a: &a[first * d..], lda: d };
            let right = Right { panels, block: d, first: 0 };
            self.products.product(to, ROW, (rows, d, columns), left, right, Store::Set);
        };
        across(scores, &scratch.queries, &scratch.keys_across);
        across(changes, &scratch.slopes, &scratch.values_across);

        let bias = self.rules.bias(self.shape, self.piece, tile);
        let drops = self.rules.drops(self.shape, self.piece, tile);
        let log_sums = &self.done.log_sums[self.piece * t + query..][..rows];
        let means = &scratch.sums[query..query + rows];
        dispatch::run(SoftmaxBack { tile, scores, changes, bias, drops, log_sums, means });

        let left = Left::Rows { a: changes, lda: ROW };
        let down = Right { panels: &scratch.down, block: packed, first: 0 };
        let store = if key == 0 { Store::Set } else { Store::Add };
        // keys come in blocks, so a query's gradient grows over the outer loop; block 0 is seen by all
        self.products.product(&mut self.d_queries[query * d..], d, (rows, columns, d), left, down, store);
    }
}
