//! A stack of blocks with its keys and values: vectors in, vectors out.

use super::attention::{self, Queries, SCORE_ROWS};
use super::cache::{KvCache, KvKind, Stored, Unit};
use super::kernel::Left;
use super::matrix::{Matrix, PIECE};
use super::rope::Turns;
use super::weights::{Block, Norm};
use crate::arena::Floats;
use crate::op::{gelu, layer_norm};
use rayon::prelude::*;
use std::ops::Range;

/// Rows that go through the layers together; what is longer is cut.
const ROWS: usize = 192;

/// Multiply-adds that are worth another thread.
const WORTH: usize = 1 << 17;

/// Reads of fewer multiply-adds stay on the thread they are called on, if it is none of a pool's.
const ALONE: usize = 1 << 20;

/// How large a stack of blocks is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stack {
    /// L.
    pub layers: usize,
    /// H, divides the width.
    pub heads: usize,
    /// D.
    pub width: usize,
}

impl Stack {
    /// Multiply-adds of a row with the weights, about.
    pub(super) fn multiply_adds(&self) -> usize {
        self.layers * 12 * self.width * self.width
    }
}

/// Rows of one stream, one behind the other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    pub stream: usize,
    /// The place of the first; what the stream kept from there on is forgotten.
    pub place: usize,
    pub rows: usize,
}

/// A row whose logits are asked for, and which input of which stream it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asked {
    pub row: usize,
    pub stream: usize,
    pub place: usize,
}

/// What streams keep of the rows that went through a stack of blocks, and the rows that go next. Each row sees the rows
/// at earlier places of its stream, whatever stood there last: how far a stream goes back is its reader's to know.
pub(super) struct Layers {
    cache: KvCache,
    /// What of the next rows belongs to which stream. Taken in this order, so a stream can begin anew among them.
    runs: Vec<Run>,
    rows: usize,
    /// The most rows.
    room_for: usize,
    pub room: Room,
}

/// Scratch for some rows at most; what is used of it depends on the rows there are.
pub(super) struct Room {
    pub x: Floats,       // (m, D)
    pub normed: Floats,  // (m, D)
    stats: Floats,       // (m, 2)
    pub words: Vec<u32>, // (m), those that the rows stand in, if queries and keys are turned
    qkv: Floats,         // (H, m, 3 d)
    heads: Floats,       // (H, m, d), d whole panels
    scores: Floats,      // (H, SCORE_ROWS, T)
    pub pieces: Floats,  // (n / PIECE, m, PIECE) for the widest n
    hidden: Floats,      // (4 D / PIECE, m, PIECE)
}

impl Layers {
    /// For `streams` of `places` each, and `rows` in a read at most. `widest` are the columns of the widest product
    /// beside those of the blocks.
    pub fn new(
        kv: KvKind,
        stack: Stack,
        (streams, places): (usize, usize),
        rows: usize,
        turned: bool,
        widest: usize,
    ) -> Layers {
        let Stack { layers, heads, width } = stack;
        let (d, unit) = (width / heads, Unit::new(places, width / heads));
        let rows = ROWS.min(rows);
        let hidden = (4 * width).next_multiple_of(PIECE);
        let room = Room {
            x: Floats::new(rows * width),
            normed: Floats::new(rows * width),
            stats: Floats::new(rows * 2),
            words: vec![0; if turned { rows } else { 0 }],
            qkv: Floats::new(rows * heads * (3 * d).next_multiple_of(unit.panel)),
            heads: Floats::new(rows * heads * unit.padded),
            scores: Floats::new(heads * SCORE_ROWS * unit.tokens),
            pieces: Floats::new(rows * hidden.max(widest.next_multiple_of(PIECE))),
            hidden: Floats::new(rows * hidden),
        };
        let cache = KvCache::new(kv, layers, heads, streams, unit);
        Layers { cache, runs: Vec::with_capacity(rows), rows: 0, room_for: rows, room }
    }

    pub fn kv(&self) -> KvKind {
        self.cache.kind()
    }

    /// The rows that go next.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// What of them belongs to which stream.
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// How many more there is room for.
    pub fn free(&self) -> usize {
        self.room_for - self.rows
    }

    /// Adds a run to the rows that go next; the first of its rows, which are the caller's to write.
    pub fn push(&mut self, run: Run) -> usize {
        let first = self.rows;
        self.rows += run.rows;
        self.runs.push(run);
        first
    }

    /// There are no rows that go next.
    pub fn clear(&mut self) {
        self.runs.clear();
        self.rows = 0;
    }

    /// Takes the rows through the blocks.
    pub fn pass(&mut self, blocks: &[Block], turns: Option<&Turns>) {
        match self.cache.kind() {
            KvKind::F32 => self.typed::<f32>(blocks, turns),
            KvKind::F16 => self.typed::<u16>(blocks, turns),
        }
    }

    fn typed<E: Stored>(&mut self, blocks: &[Block], turns: Option<&Turns>) {
        let unit = self.cache.unit();
        for (i, block) in blocks.iter().enumerate() {
            let layer = self.cache.layer::<E>(i);
            self.room.attention(block, self.rows, (&self.runs, turns), layer, unit);
            self.room.mlp(block, self.rows);
        }
    }

    /// Brings the rows that are asked for, in their order, to the front, and norms them.
    pub fn finish(&mut self, asked: &[Asked], norm: &Norm) {
        let width = norm.weight.len();
        for (to, asked) in asked.iter().enumerate() {
            self.room.x.copy_within(asked.row * width..(asked.row + 1) * width, to * width);
        }
        self.room.norm(norm, asked.len());
    }
}

impl Room {
    /// x += attention(norm1(x)).
    fn attention<E: Stored>(
        &mut self,
        block: &Block,
        rows: usize,
        (runs, turns): (&[Run], Option<&Turns>),
        cache: &mut [E],
        unit: Unit,
    ) {
        self.norm(&block.norm1, rows);
        let width = block.norm1.weight.len();
        let left = Left::whole(&self.normed, rows, width, width);
        let stride = block.heads[0].piece();
        let per_head = cache.len() / block.heads.len();
        let seen = runs.iter().map(|run| run.place + run.rows).max().unwrap_or(0);
        let work = rows * (block.heads[0].work() + 2 * seen * unit.d);
        let words = &self.words;
        self.qkv
            .par_chunks_mut(rows * stride)
            .zip(self.heads.par_chunks_mut(rows * unit.padded))
            .zip(self.scores.par_chunks_mut(SCORE_ROWS * unit.tokens))
            .zip(cache.par_chunks_mut(per_head))
            .zip(&block.heads)
            .with_min_len(worth(work))
            .for_each(|((((qkv, out), scores), cache), weights)| {
                weights.product(qkv, 0, left);
                let mut first = 0;
                for run in runs {
                    let qkv = &mut qkv[first * stride..][..run.rows * stride];
                    let out = &mut out[first * unit.padded..][..run.rows * unit.padded];
                    let cache = &mut cache[run.stream * unit.len()..][..unit.len()];
                    let turns = turns.map(|turns| (turns, &words[first..][..run.rows]));
                    attention::attend(out, Queries { qkv, stride, place: run.place, turns }, cache, unit, scores);
                    first += run.rows;
                }
            });
        let left = Left { data: &self.heads, rows, width: unit.d, stride: unit.padded };
        products(&block.out, 0..block.out.pieces(), &mut self.pieces, left);
        self.add(rows, width);
    }

    /// x += down(gelu(up(norm2(x)))).
    fn mlp(&mut self, block: &Block, rows: usize) {
        self.norm(&block.norm2, rows);
        let width = block.norm2.weight.len();
        let left = Left::whole(&self.normed, rows, width, width);
        self.pieces
            .par_chunks_mut(rows * PIECE)
            .zip(self.hidden.par_chunks_mut(rows * PIECE))
            .take(block.up.pieces())
            .enumerate()
            .with_min_len(worth(rows * block.up.work()))
            .for_each(|(piece, (up, hidden))| {
                block.up.product(up, piece, left);
                gelu::forward(hidden, up);
            });
        let left = Left { data: &self.hidden, rows, width: PIECE, stride: PIECE };
        products(&block.down, 0..block.down.pieces(), &mut self.pieces, left);
        self.add(rows, width);
    }

    /// normed = norm(x).
    pub fn norm(&mut self, norm: &Norm, rows: usize) {
        let width = norm.weight.len();
        let per = rows_at_once(width);
        self.normed[..rows * width]
            .par_chunks_mut(per * width)
            .zip(self.stats[..rows * 2].par_chunks_mut(per * 2))
            .zip(self.x[..rows * width].par_chunks(per * width))
            .for_each(|((out, stats), x)| layer_norm::forward(out, stats, x, &norm.weight, &norm.bias));
    }

    /// x += the product in `pieces`.
    pub fn add(&mut self, rows: usize, width: usize) {
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

/// Some pieces of the product of `left` with `matrix`, one behind the other.
pub(super) fn products(matrix: &Matrix, wanted: Range<usize>, pieces: &mut [f32], left: Left) {
    pieces
        .par_chunks_mut(left.rows * PIECE)
        .take(wanted.len())
        .enumerate()
        .with_min_len(worth(left.rows * matrix.work()))
        .for_each(|(i, c)| matrix.product(c, wanted.start + i, left));
}

/// Pieces of `work` multiply-adds that one thread takes at least.
fn worth(work: usize) -> usize {
    WORTH.div_ceil(work.max(1))
}

/// Rows of a few additions a number that one thread takes.
fn rows_at_once(width: usize) -> usize {
    (WORTH / 8).div_ceil(width.max(1))
}

/// Goes on in the pool, once instead of for every piece of work, if so many multiply-adds are worth it.
pub(super) fn in_pool(multiply_adds: usize, read: impl FnOnce() + Send) {
    if multiply_adds < ALONE || rayon::current_thread_index().is_some() {
        read();
    } else {
        rayon::join(read, || ());
    }
}
