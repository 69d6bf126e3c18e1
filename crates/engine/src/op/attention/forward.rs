//! Forward: for each block of keys, the queries that see it, a step of rows at a time.

use super::softmax::Softmax;
use super::{KEYS, ROW, Rules, Scratch, Shape, Tile, Workspace, copy_rows, part_of, step};
use crate::dispatch;
use crate::op::matmul::{Left, Store};
use crate::op::products::{Products, Right};
use rayon::prelude::*;
use std::ops::Range;

/// Attention of all heads.
///
/// `qkv` (N, 3 D), a row q, k, v; `out` (B, H, T, d); `log_sums` (B, H, T): the logarithm of the sum of e^score, which
/// [`backward`](super::backward()) reads, infinity where a query sees nothing.
///
/// # Panics
/// Slices of other lengths, a mask of another, and a workspace of another shape.
pub fn forward(shape: Shape, qkv: &[f32], rules: Rules, space: &Workspace, out: &mut [f32], log_sums: &mut [f32]) {
    assert_eq!(space.shape, shape, "a workspace for another shape");
    assert_eq!(qkv.len(), shape.rows() * 3 * shape.columns(), "queries, keys and values of {shape:?}");
    assert_eq!(out.len(), shape.rows() * shape.columns(), "outputs of {shape:?}");
    assert_eq!(log_sums.len(), shape.pieces() * shape.tokens, "sums of {shape:?}");
    rules.check(shape);
    if shape.is_empty() {
        return;
    }
    let (t, d) = (shape.tokens, shape.width);
    let products = space.products;
    let span = span(shape, step(products));
    let pieces = out.par_chunks_mut(t * d).zip(log_sums.par_chunks_mut(t)).enumerate();
    pieces.for_each(|(piece, (out, log_sums))| {
        let spans = out.par_chunks_mut(span * d).zip(log_sums.par_chunks_mut(span)).enumerate();
        spans.for_each(|(at, (out, log_sums))| {
            let queries = at * span..at * span + log_sums.len();
            space
                .scratch
                .with(|scratch| Piece { shape, products, qkv, rules, piece, queries, out, log_sums }.run(scratch));
        });
    });
}

/// Queries that a thread takes at a time: all of a head, but fewer where there are fewer heads than threads. Each span
/// packs its keys anew, which the products of 8 steps outweigh.
fn span(shape: Shape, step: usize) -> usize {
    // depends on the threads, but changes no bit: a query meets the same blocks of keys in every span
    let spans = (2 * rayon::current_num_threads()).div_ceil(shape.pieces());
    match shape.pieces() < rayon::current_num_threads() {
        true => shape.tokens.div_ceil(spans).next_multiple_of(8 * step),
        false => shape.tokens,
    }
}

/// Some queries of a head of a sequence.
struct Piece<'a> {
    shape: Shape,
    products: Products,
    qkv: &'a [f32],
    rules: Rules<'a>,
    piece: usize,
    queries: Range<usize>,
    out: &'a mut [f32],
    log_sums: &'a mut [f32],
}

impl Piece<'_> {
    fn run(mut self, scratch: &mut Scratch) {
        let (d, stride) = (self.shape.width, 3 * self.shape.columns());
        // not the tokens: later queries, and their keys, are another span's
        let seen = if self.rules.is_causal() { self.queries.end } else { self.shape.tokens };
        for key in (0..seen).step_by(KEYS) {
            let columns = KEYS.min(seen - key);
            let part = |part| part_of(self.qkv, self.shape, self.piece, part, key);
            copy_rows(&mut scratch.rows, part(1), stride, columns, d);
            self.products.pack_transposed(&mut scratch.keys_across, &scratch.rows, d, d, columns);
            self.products.pack(&mut scratch.down, part(2), stride, columns, d);
            let first = if self.rules.is_causal() { key.max(self.queries.start) } else { self.queries.start };
            let step = step(self.products);
            for query in (first..self.queries.end).step_by(step) {
                let rows = step.min(self.queries.end - query);
                let tile = Tile { query, rows, key, columns, causal: self.rules.is_causal() };
                self.step(scratch, tile.part(0, rows), columns);
            }
        }
    }

    /// The tile's part of its queries' outputs; the last key divides by the sum.
    fn step(&mut self, scratch: &mut Scratch, tile: Tile, packed: usize) {
        let (d, t) = (self.shape.width, self.shape.tokens);
        let Tile { query, rows, key, columns, causal } = tile;
        let (from, stride) = (part_of(self.qkv, self.shape, self.piece, 0, query), 3 * self.shape.columns());
        copy_rows(&mut scratch.queries, from, stride, rows, d);
        self.shape.scale(&mut scratch.queries[..rows * d]);
        let scores = &mut scratch.weights[..rows * ROW];
        let left = Left::Rows { a: &scratch.queries, lda: d };
        let across = Right { panels: &scratch.keys_across, block: d, first: 0 };
        self.products.product(scores, ROW, (rows, d, columns), left, across, Store::Set);

        let at = query - self.queries.start;
        let out = &mut self.out[at * d..(at + rows) * d];
        let (largest, sums) = (&mut self.log_sums[at..at + rows], &mut scratch.sums[at..at + rows]);
        // a row's softmax goes on from block to block of keys, and scales down what it has where a larger score comes
        if key == 0 {
            largest.fill(f32::NEG_INFINITY);
        }
        let bias = self.rules.bias(self.shape, self.piece, tile);
        let drops = self.rules.drops(self.shape, self.piece, tile);
        dispatch::run(Softmax { tile, scores, bias, drops, largest, sums, out });

        let left = Left::Rows { a: scores, lda: ROW };
        let down = Right { panels: &scratch.down, block: packed, first: 0 };
        let store = if key == 0 { Store::Set } else { Store::Add };
        self.products.product(out, d, (rows, columns, d), left, down, store);
        // once a row, after the last keys that it sees, and not once a block
        if key + packed >= if causal { query + rows } else { t } {
            divide(out, largest, sums);
        }
    }
}

/// Outputs by the sums of their weights; then the largest score becomes the logarithm of the sum of e^score.
fn divide(out: &mut [f32], largest: &mut [f32], sums: &[f32]) {
    let d = out.len() / sums.len();
    for ((out, largest), sum) in out.chunks_exact_mut(d).zip(largest).zip(sums) {
        if *sum == 0.0 {
            // sees nothing: its output is 0 already, and e^(score - infinity) gives no gradient either
            *largest = f32::INFINITY;
            continue;
        }
        let inverse = 1.0 / sum;
        out.iter_mut().for_each(|x| *x *= inverse);
        // ln(sum e^s) = m + ln(sum e^(s - m)), which neither overflows nor vanishes
        *largest += sum.ln();
    }
}
