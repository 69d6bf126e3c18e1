//! Attention of all heads for training: scores, softmax, dropout and weighted sum in one pass over tiles that stay in the
//! cache, and the same backwards. No (T, T) matrix is ever whole.
//!
//! A piece of work is one head of one sequence, on one thread. Queries, keys and values are read from where the product
//! before left them, rows (N, 3 D) of q, k, v, each with its heads side by side; results are head-major, one slice a
//! piece, and [`gather`] brings them back into rows. Source of the scheme: Dao et al., "FlashAttention" (2022).

mod backward;
mod forward;
mod softmax;
#[cfg(test)]
mod tests;

pub use backward::{Done, backward};
pub use forward::forward;

use super::dropout::{growth, threshold};
use super::matmul::copy;
use super::products::Products;
use crate::arena::Floats;
use crate::per_thread::PerThread;
use softmax::{Bias, Drops};
use std::ops::Range;

/// Rows of queries that go through scores, softmax and weighted sum at a time, at most.
const STEP: usize = 32;

/// Queries of a tile of the backward pass: the terms that each addition to the gradients of keys and values sums.
const QUERIES: usize = 96;

/// Keys of a tile. A row of a tile is followed by a cache line's room, so that rows don't meet in the cache.
const KEYS: usize = 2 * QUERIES;
const ROW: usize = KEYS + 16;

/// The sizes of an attention; D, the width of the model, is `heads * width`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// B: sequences.
    pub batch: usize,
    /// T: tokens of a sequence.
    pub tokens: usize,
    /// H: heads.
    pub heads: usize,
    /// d: numbers of a head.
    pub width: usize,
}

impl Shape {
    /// N = B T.
    pub fn rows(self) -> usize {
        self.batch * self.tokens
    }

    /// D = H d.
    pub fn columns(self) -> usize {
        self.heads * self.width
    }

    /// B H: the independent pieces of work.
    fn pieces(self) -> usize {
        self.batch * self.heads
    }

    fn is_empty(self) -> bool {
        self.rows() * self.columns() == 0
    }

    /// Multiplies numbers with 1/sqrt(d), the factor of the scores q k^T.
    fn scale(self, numbers: &mut [f32]) {
        let scale = 1.0 / (self.width as f32).sqrt();
        numbers.iter_mut().for_each(|x| *x *= scale);
    }
}

/// The keys that a query sees.
#[derive(Debug, Clone, Copy)]
pub enum Mask<'a> {
    /// Those up to its own place.
    Causal,
    /// All.
    Full,
    /// All, with a number added to each score before the softmax: (T, T), `[query][key]`, the same for all sequences, or
    /// (B, T, T). Minus infinity hides a key; a query that sees none has output 0, and gives no gradient. Numbers below
    /// -2e38 count as minus infinity.
    Additive(&'a [f32]),
    /// Those up to its own place, with numbers added as by `Additive`; the numbers of later keys are never read, and
    /// cost nothing.
    CausalAdditive(&'a [f32]),
}

impl<'a> Mask<'a> {
    fn is_causal(self) -> bool {
        matches!(self, Mask::Causal | Mask::CausalAdditive(_))
    }

    fn numbers(self) -> Option<&'a [f32]> {
        match self {
            Mask::Additive(numbers) | Mask::CausalAdditive(numbers) => Some(numbers),
            Mask::Causal | Mask::Full => None,
        }
    }
}

/// Dropout of weights.
#[derive(Debug, Clone, Copy)]
pub struct Dropout<'a> {
    /// A key a sequence; in its mask, row `h T + query` and column `key` are a weight of head h.
    pub keys: &'a [u64],
    /// The share that is dropped, `0.0..1.0`.
    pub share: f64,
}

/// The mask and the dropout of attention.
#[derive(Debug, Clone, Copy)]
pub struct Rules<'a> {
    /// The keys that a query sees.
    pub mask: Mask<'a>,
    /// None, or of a share of 0: none.
    pub dropout: Option<Dropout<'a>>,
}

impl Rules<'_> {
    fn check(self, shape: Shape) {
        if let Some(mask) = self.mask.numbers() {
            let square = shape.tokens * shape.tokens;
            let fits = mask.len() == square || mask.len() == shape.batch * square;
            assert!(fits, "a mask of {} numbers for {shape:?}", mask.len());
        }
        if let Some(dropout) = self.dropout {
            assert_eq!(dropout.keys.len(), shape.batch, "keys of a dropout for {shape:?}");
        }
    }

    fn is_causal(self) -> bool {
        self.mask.is_causal()
    }

    /// The mask of the piece's tile.
    fn bias(&self, shape: Shape, piece: usize, tile: Tile) -> Option<Bias<'_>> {
        let mask = self.mask.numbers()?;
        let square = shape.tokens * shape.tokens;
        // of one sequence both shapes have as many numbers, and sequence 0 is right for both
        let sequence = if mask.len() == square { 0 } else { piece / shape.heads };
        let first = sequence * square + tile.query * shape.tokens + tile.key;
        Some(Bias { numbers: &mask[first..], stride: shape.tokens })
    }

    /// The dropout of the piece's tile.
    fn drops(self, shape: Shape, piece: usize, tile: Tile) -> Option<Drops> {
        let dropout = self.dropout.filter(|dropout| dropout.share > 0.0)?;
        let (sequence, head) = (piece / shape.heads, piece % shape.heads);
        Some(Drops {
            key: dropout.keys[sequence],
            row: (head * shape.tokens + tile.query) as u64,
            column: tile.key as u32,
            threshold: threshold(dropout.share),
            growth: growth(dropout.share),
        })
    }
}

/// Room for the passes over one shape: a part for each thread of the pool that it is made in.
pub struct Workspace {
    shape: Shape,
    products: Products,
    scratch: PerThread<Scratch>,
}

struct Scratch {
    /// The tile's keys or values (KEYS, d).
    rows: Floats,
    /// Both in panels: k^T and v^T (d, KEYS), k / sqrt(d) or v (KEYS, d).
    keys_across: Floats,
    values_across: Floats,
    down: Floats,
    /// The tile's queries / sqrt(d) and gradients, in rows and in panels (QUERIES, d).
    queries: Floats,
    slopes: Floats,
    queries_down: Floats,
    slopes_down: Floats,
    /// Two tiles (QUERIES, ROW): scores, then weights; gradients of weights, then of scores.
    weights: Floats,
    changes: Floats,
    /// A number for each query: sum of weights, or of weights times their gradients.
    sums: Floats,
}

impl Workspace {
    /// Room for `shape` on the threads of this pool, its products computed by `products`.
    pub fn new(shape: Shape, products: Products) -> Workspace {
        let scratch = || {
            let (across, down) = (products.panels_len(shape.width, KEYS), products.panels_len(KEYS, shape.width));
            // the forward pass needs a step of queries, at most 32; the backward pass a tile of 96
            let (rows, panels) = (QUERIES * shape.width, products.panels_len(QUERIES, shape.width));
            Scratch {
                rows: Floats::new(KEYS * shape.width),
                keys_across: Floats::new(across),
                values_across: Floats::new(across),
                down: Floats::new(down),
                queries: Floats::new(rows),
                slopes: Floats::new(rows),
                queries_down: Floats::new(panels),
                slopes_down: Floats::new(panels),
                weights: Floats::new(QUERIES * ROW),
                changes: Floats::new(QUERIES * ROW),
                sums: Floats::new(shape.tokens),
            }
        };
        Workspace { shape, products, scratch: PerThread::new(scratch) }
    }
}

/// Some queries against some keys of a sequence.
#[derive(Clone, Copy)]
struct Tile {
    /// The first query, and how many.
    query: usize,
    rows: usize,
    /// The first key, and how many.
    key: usize,
    columns: usize,
    causal: bool,
}

impl Tile {
    /// How many of the tile's keys the query of this row sees.
    fn visible(self, row: usize) -> usize {
        match self.causal {
            true => (self.query + row + 1).saturating_sub(self.key).min(self.columns),
            false => self.columns,
        }
    }

    /// `rows` of the tile's queries from `first` on, against the keys that any of them sees.
    fn part(self, first: usize, rows: usize) -> Tile {
        let tile = Tile { query: self.query + first, rows, ..self };
        // the last row sees most: keys after it cost no product
        Tile { columns: tile.visible(rows - 1), ..tile }
    }
}

/// The part of qkv that a piece reads: `part` 0 for q, 1 for k, 2 for v, from token `token` on, a row every 3 D
/// numbers.
fn part_of(qkv: &[f32], shape: Shape, piece: usize, part: usize, token: usize) -> &[f32] {
    let (sequence, head) = (piece / shape.heads, piece % shape.heads);
    let row = sequence * shape.tokens + token;
    &qkv[row * 3 * shape.columns() + part * shape.columns() + head * shape.width..]
}

/// Rows of queries that go through a step: whole tiles of the products.
fn step(products: Products) -> usize {
    if products == Products::F32 { 24 } else { STEP }
}

/// Copies `rows` rows of `width` numbers, one every `stride`, to one after the other. Rows that are transposed or read
/// more than once go through such a copy: its many short reads wait for memory together.
fn copy_rows(to: &mut [f32], from: &[f32], stride: usize, rows: usize, width: usize) {
    for (to, from) in to.chunks_exact_mut(width).zip(from.chunks(stride)).take(rows) {
        copy(to, &from[..width]);
    }
}

/// `rows` of a head-major result as rows: from `heads` (B, H, P, T, d) to `to` (R, P D), where P is 1 for an output and 3
/// for the gradients of q, k, v.
///
/// # Panics
/// Slices of other lengths, or rows that aren't there.
pub fn gather(shape: Shape, parts: usize, heads: &[f32], rows: Range<usize>, to: &mut [f32]) {
    let (d, columns) = (shape.width, parts * shape.columns());
    assert_eq!(heads.len(), shape.rows() * columns, "{parts} parts of {shape:?}");
    assert!(rows.end <= shape.rows() && to.len() == rows.len() * columns, "rows {rows:?} of {shape:?}");
    if to.is_empty() {
        return;
    }
    for (row, to) in rows.zip(to.chunks_exact_mut(columns)) {
        let (sequence, token) = (row / shape.tokens, row % shape.tokens);
        for (place, to) in to.chunks_exact_mut(d).enumerate() {
            let (part, head) = (place / shape.heads, place % shape.heads);
            let at = ((sequence * shape.heads + head) * parts + part) * shape.tokens + token;
            copy(to, &heads[at * d..][..d]);
        }
    }
}
