//! A stack of blocks with its keys and values: rows in, rows out.

use super::attention::{self, SCORE_ROWS};
use super::bytes;
use super::cache::{KvCache, KvKind, Run, Stored, Unit};
use super::kernel::Left;
use super::matrix::{Matrix, PIECE, Product};
use super::weights::{Block, Norm, Stack, StackWeights};
use crate::arena::Floats;
use crate::op::rope::Angles;
use crate::op::{gelu, layer_norm};
use rayon::prelude::*;
use std::ops::Range;

/// Rows that go through the layers together, at most; callers cut longer reads.
const ROWS: usize = 192;

/// Multiply-adds that are worth another thread.
const WORTH: usize = 1 << 17;

/// Reads of fewer multiply-adds aren't worth entering a pool from outside.
const ALONE: usize = 1 << 21;

/// Streams of rows through a stack of blocks: the keys and values of earlier rows, and the rows of the next pass. Each
/// row attends to the last rows at all earlier places of its stream; the caller knows how far a stream has come.
///
/// A pass: [`push`](Self::push) a run, write its rows into [`rows_mut`](Self::rows_mut), [`forward`](Self::forward),
/// [`norm`](Self::norm), [`product`](Self::product) with the head, [`clear`](Self::clear).
pub struct StackDecoder {
    cache: KvCache,
    width: usize,
    /// The rows of the next pass by stream, processed in this order: a stream can begin anew among them.
    runs: Vec<Run>,
    rows: usize,
    /// The most rows of a pass.
    capacity: usize,
    scratch: Scratch,
}

/// Scratch for the rows of a pass.
struct Scratch {
    x: Floats,            // (m, D)
    normed: Floats,       // (m, D)
    stats: Floats,        // (m, 2)
    positions: Vec<u32>,  // (m), rotary positions
    qkv: Floats,          // (H, m, 3 d)
    heads: Floats,        // (H, m, d), d whole panels
    scores: Floats,       // (H, SCORE_ROWS, T)
    pieces: Floats,       // (n / PIECE, m, PIECE) for the widest n
    hidden: Floats,       // (4 D / PIECE, m, PIECE)
    rounded: bytes::Rows, // left operands as bytes, for matrices that need them
}

impl StackDecoder {
    /// A decoder of `streams` with `places` each, whose passes have `rows` rows at most (a pass never has more than 192).
    /// `widest` is the number of columns of the widest [`Matrix`] that its rows are multiplied by.
    pub fn new(
        weights: &StackWeights,
        kv: KvKind,
        streams: usize,
        places: usize,
        rows: usize,
        widest: usize,
    ) -> StackDecoder {
        let Stack { layers, heads, width } = weights.stack();
        let (d, unit) = (width / heads, Unit::new(places, width / heads));
        let rows = ROWS.min(rows);
        let hidden = (4 * width).next_multiple_of(PIECE);
        let scratch = Scratch {
            x: Floats::new(rows * width),
            normed: Floats::new(rows * width),
            stats: Floats::new(rows * 2),
            positions: vec![0; rows],
            qkv: Floats::new(rows * heads * (3 * d).next_multiple_of(unit.panel)),
            heads: Floats::new(rows * heads * unit.padded),
            scores: Floats::new(heads * SCORE_ROWS * unit.tokens),
            pieces: Floats::new(rows * hidden.max(widest.next_multiple_of(PIECE))),
            hidden: Floats::new(rows * hidden),
            rounded: bytes::Rows::default(),
        };
        let cache = KvCache::new(kv, layers, heads, streams, unit);
        StackDecoder { cache, width, runs: Vec::with_capacity(rows), rows: 0, capacity: rows, scratch }
    }

    /// The keys and values of a stream, for another stream, or a decoder made of the same arguments, to go on from.
    ///
    /// # Panics
    /// If there is no such stream.
    pub fn save(&self, stream: usize) -> Vec<f32> {
        self.cache.save(stream)
    }

    /// Gives a stream the keys and values that [`StackDecoder::save`] returned.
    ///
    /// # Panics
    /// If there is no such stream.
    pub fn restore(&mut self, stream: usize, saved: &[f32]) {
        self.cache.restore(stream, saved);
    }

    /// Rows of the next pass.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// How many more rows the next pass has room for.
    pub fn free(&self) -> usize {
        self.capacity - self.rows
    }

    /// Adds a run to the next pass; returns its first row, from which the caller writes [`Self::rows_mut`].
    ///
    /// # Panics
    /// If there is no room for it.
    pub fn push(&mut self, run: Run) -> usize {
        assert!(run.rows <= self.free(), "{} rows, room for {}", run.rows, self.free());
        let first = self.rows;
        self.rows += run.rows;
        // a later run of the same stream attends to this one: `attention` stores each run before it takes the next
        self.runs.push(run);
        first
    }

    /// (m, D): the rows of the next pass from `first` on; after [`Self::forward`], its output.
    pub fn rows_mut(&mut self, first: usize) -> &mut [f32] {
        &mut self.scratch.x[first * self.width..self.rows * self.width]
    }

    /// (m): the rotary positions of the rows from `first` on; read only where the weights have angles.
    pub fn positions_mut(&mut self, first: usize) -> &mut [u32] {
        &mut self.scratch.positions[first..self.rows]
    }

    /// Empties the next pass.
    pub fn clear(&mut self) {
        self.runs.clear();
        self.rows = 0;
    }

    /// Adds the product of `left` (m, k) with `matrix` (k, D) to the rows.
    pub fn add_product(&mut self, matrix: &Matrix, left: &[f32]) {
        let k = left.len() / self.rows;
        let Scratch { pieces, rounded, .. } = &mut self.scratch;
        products(matrix, 0..matrix.pieces(), pieces, Left::whole(left, self.rows, k, k), rounded);
        self.scratch.add(self.rows, self.width);
    }

    /// Takes the rows through the blocks.
    pub fn forward(&mut self, weights: &StackWeights) {
        match self.cache.kind() {
            KvKind::F32 => self.typed::<f32>(weights),
            KvKind::F16 => self.typed::<u16>(weights),
            KvKind::Int8 => self.typed::<i8>(weights),
        }
    }

    fn typed<E: Stored>(&mut self, weights: &StackWeights) {
        let unit = self.cache.unit();
        for (i, block) in weights.blocks.iter().enumerate() {
            let layer = self.cache.layer::<E>(i);
            self.scratch.attention(block, self.rows, &self.runs, weights.angles.as_ref(), layer, unit);
            self.scratch.mlp(block, self.rows);
        }
    }

    /// Normalises some rows, given in ascending order, as the rows 0, 1, .. of [`Self::product`]. The rows themselves
    /// are overwritten.
    pub fn norm(&mut self, norm: &Norm, rows: impl Iterator<Item = usize>) {
        let (width, mut n) = (self.width, 0);
        for row in rows {
            // ascending, so n <= row: no row is overwritten before it is moved
            self.scratch.x.copy_within(row * width..(row + 1) * width, n * width);
            n += 1;
        }
        self.scratch.norm(norm, n);
    }

    /// Columns of the product of some normed rows with a matrix.
    pub fn product(
        &mut self,
        matrix: &Matrix,
        rows: impl Iterator<Item = usize>,
        columns: Range<usize>,
    ) -> Product<'_> {
        let Scratch { x, normed, pieces, rounded, .. } = &mut self.scratch;
        let (width, mut n) = (self.width, 0);
        for row in rows {
            // x is free by now, and the kernel needs the rows one after the other
            x[n * width..][..width].copy_from_slice(&normed[row * width..][..width]);
            n += 1;
        }
        let range = columns.start / PIECE..columns.end.div_ceil(PIECE);
        products(matrix, range.clone(), pieces, Left::whole(x, n, width, width), rounded);
        Product { pieces, rows: n, first: range.start }
    }
}

impl Scratch {
    /// x += attention(norm1(x)).
    fn attention<E: Stored>(
        &mut self,
        block: &Block,
        rows: usize,
        runs: &[Run],
        angles: Option<&Angles>,
        cache: &mut [E],
        unit: Unit,
    ) {
        self.norm(&block.norm1, rows);
        let width = block.norm1.weight.len();
        let left = Left::whole(&self.normed, rows, width, width);
        round(&mut self.rounded, &block.heads[0], left);
        let rounded = &self.rounded;
        let stride = block.heads[0].piece();
        let per_head = cache.len() / block.heads.len();
        // an upper bound for all rows: it decides how heads are shared out, not what is computed
        let seen = runs.iter().map(|run| run.place + run.rows).max().unwrap_or(0);
        let work = rows * (block.heads[0].work() + 2 * seen * unit.d);
        let positions = &self.positions;
        self.qkv
            .par_chunks_mut(rows * stride)
            .zip(self.heads.par_chunks_mut(rows * unit.padded))
            .zip(self.scores.par_chunks_mut(SCORE_ROWS * unit.tokens))
            .zip(cache.par_chunks_mut(per_head))
            .zip(&block.heads)
            .with_min_len(worth(work))
            .for_each(|((((qkv, out), scores), cache), weights)| {
                weights.product(qkv, 0, left, rounded);
                let rotary = angles.map(|angles| (angles, &positions[..rows]));
                attention::Head { qkv, stride, out, runs, rotary, scores }.attend(cache, unit);
            });
        let left = Left { data: &self.heads, rows, width: unit.d, stride: unit.padded };
        products(&block.out, 0..block.out.pieces(), &mut self.pieces, left, &mut self.rounded);
        self.add(rows, width);
    }

    /// x += down(gelu(up(norm2(x)))).
    fn mlp(&mut self, block: &Block, rows: usize) {
        self.norm(&block.norm2, rows);
        let width = block.norm2.weight.len();
        let left = Left::whole(&self.normed, rows, width, width);
        round(&mut self.rounded, &block.up, left);
        let rounded = &self.rounded;
        self.pieces
            .par_chunks_mut(rows * PIECE)
            .zip(self.hidden.par_chunks_mut(rows * PIECE))
            .take(block.up.pieces())
            .enumerate()
            .with_min_len(worth(rows * block.up.work()))
            .for_each(|(piece, (up, hidden))| {
                block.up.product(up, piece, left, rounded);
                gelu::forward(hidden, up);
            });
        let left = Left { data: &self.hidden, rows, width: PIECE, stride: PIECE };
        products(&block.down, 0..block.down.pieces(), &mut self.pieces, left, &mut self.rounded);
        self.add(rows, width);
    }

    /// normed = norm(x).
    fn norm(&mut self, norm: &Norm, rows: usize) {
        let width = norm.weight.len();
        let per = rows_at_once(width);
        self.normed[..rows * width]
            .par_chunks_mut(per * width)
            .zip(self.stats[..rows * 2].par_chunks_mut(per * 2))
            .zip(self.x[..rows * width].par_chunks(per * width))
            .for_each(|((out, stats), x)| layer_norm::forward(out, stats, x, &norm.weight, &norm.bias));
    }

    /// x += the product in `pieces`.
    fn add(&mut self, rows: usize, width: usize) {
        // the sum is per number: how rows are shared changes no bit
        let per = rows_at_once(width);
        let pieces = &self.pieces;
        self.x[..rows * width].par_chunks_mut(per * width).enumerate().for_each(|(i, x)| {
            for (row, x) in x.chunks_exact_mut(width).enumerate() {
                for (x, piece) in x.chunks_mut(PIECE).zip(pieces.chunks_exact(rows * PIECE)) {
                    let piece = &piece[(i * per + row) * PIECE..][..x.len()];
                    x.iter_mut().zip(piece).for_each(|(x, y)| *x += y);
                }
            }
        });
    }
}

/// The pieces `range` of the product of `left` with `matrix`, one after the other.
fn products(matrix: &Matrix, range: Range<usize>, pieces: &mut [f32], left: Left, rounded: &mut bytes::Rows) {
    round(rounded, matrix, left);
    let rounded = &*rounded;
    pieces
        .par_chunks_mut(left.rows * PIECE)
        .take(range.len())
        .enumerate()
        .with_min_len(worth(left.rows * matrix.work()))
        .for_each(|(i, c)| matrix.product(c, range.start + i, left, rounded));
}

/// Rounds the rows of `left` where a matrix meets bytes.
fn round(rounded: &mut bytes::Rows, matrix: &Matrix, left: Left) {
    if let Some(way) = matrix.way() {
        rounded.round(left, matrix.rows(), way);
    }
}

/// The least number of pieces of `work` multiply-adds for one thread.
fn worth(work: usize) -> usize {
    WORTH.div_ceil(work.max(1))
}

/// Rows that one thread takes where each number costs a few additions.
fn rows_at_once(width: usize) -> usize {
    (WORTH / 8).div_ceil(width.max(1))
}

/// Runs `read` in the current rayon pool if its number of multiply-adds is worth it, else on this thread: entering the
/// pool once is cheaper than for every product.
pub fn in_pool(multiply_adds: usize, read: impl FnOnce() + Send) {
    if multiply_adds < ALONE || rayon::current_thread_index().is_some() {
        read();
    } else {
        // join moves the call onto a pool's thread; `install` would need the pool's handle
        rayon::join(read, || ());
    }
}
