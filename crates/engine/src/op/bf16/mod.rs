//! Products of matrices whose numbers are rounded to bf16 and whose sums are f32.
//!
//! On the tiles of AMX, or in the vectors of AVX512-BF16. The same call as [`matmul::product`](super::matmul::product), with other panels. Letters as there.

mod dots;
mod pack;
mod tiles;

use super::matmul::{Left, Store};
use crate::arena::Floats;
use crate::dispatch;
use pack::{How, Pack, pairs};
use pulp::{Simd, WithSimd};
use std::cell::RefCell;
use std::sync::OnceLock;
use tiles::{Right, SIDE, SQUARE};

pub use pack::round;

/// Columns of a panel.
pub const PANEL: usize = SQUARE;

/// Pairs of k that are worked through before the sums go back to memory.
const DEPTH: usize = 256;
/// Rows of the left factor that are rounded at a time.
const ROWS: usize = 160;
/// Words between two rows of a rounded left factor: no power of two, whose rows would push each other out of the cache.
const LDA: usize = DEPTH + SIDE;

thread_local! {
    /// Rows of a left factor as words.
    static LEFT: RefCell<Floats> = RefCell::new(Floats::new(ROWS * LDA));
}

/// Rounds numbers in place.
pub fn round_all(numbers: &mut [f32]) {
    struct Round<'a>(&'a mut [f32]);
    impl WithSimd for Round<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            for x in self.0 {
                *x = f32::from_bits(round(*x) << 16);
            }
        }
    }
    dispatch::run(Round(numbers));
}

/// Instructions that multiply bf16.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Instructions {
    /// The tiles of AMX.
    Tiles,
    /// `vdpbf16ps` of AVX512-BF16.
    Dots,
}

impl Instructions {
    /// The best instructions of this machine, if it has any.
    pub fn here() -> Option<Instructions> {
        // once, since asking the kernel for AMX's state is a system call
        static HERE: OnceLock<Option<Instructions>> = OnceLock::new();
        *HERE.get_or_init(|| {
            let tiles = (dispatch::may_use_tiles() && tiles::are_there()).then_some(Instructions::Tiles);
            tiles.or((dispatch::may_use_dots() && dots::are_there()).then_some(Instructions::Dots))
        })
    }

    /// Rows of a product that are computed at once.
    fn rows(self) -> usize {
        match self {
            Instructions::Tiles => SQUARE,
            Instructions::Dots => dots::ROWS,
        }
    }

    /// Rows that are computed for `rows` rows: tiles are always whole.
    fn whole(self, rows: usize) -> usize {
        match self {
            Instructions::Tiles => rows.next_multiple_of(SIDE),
            Instructions::Dots => rows,
        }
    }

    fn multiply(self, c: &mut [f32], ldc: usize, rows: usize, a: &[u32], right: Right, add: bool) {
        match self {
            Instructions::Tiles => tiles::multiply(c, ldc, rows, a, LDA, right, add),
            Instructions::Dots => dots::multiply(c, ldc, rows, a, right, add),
        }
    }
}

/// Numbers that a (k, n) matrix takes in panels.
pub fn panels_len(k: usize, n: usize) -> usize {
    pack::panels_len(k, n)
}

/// Where row `k`, a multiple of 32, of a panel begins.
pub fn row(k: usize) -> usize {
    debug_assert!(k.is_multiple_of(pack::STEP), "row {k} is in the middle of a step");
    k / 2 * SQUARE
}

/// Packs `b` (k, n), a row every `ldb` numbers, in panels; zeros fill the last one.
///
/// # Panics
/// Slices that are too short.
pub fn pack(panels: &mut [f32], b: &[f32], ldb: usize, k: usize, n: usize) {
    let to = &mut bytemuck::cast_slice_mut(panels)[..panels_len(k, n)];
    Pack { to, from: b, stride: ldb, k, n, how: How::Panels }.run();
}

/// As [`pack`], from `bt`, the transposed (n, k), a row every `ldb` numbers.
///
/// # Panics
/// Slices that are too short.
pub fn pack_transposed(panels: &mut [f32], bt: &[f32], ldb: usize, k: usize, n: usize) {
    let to = &mut bytemuck::cast_slice_mut(panels)[..panels_len(k, n)];
    Pack { to, from: bt, stride: ldb, k, n, how: How::PanelsTransposed }.run();
}

/// `c` (m, n), a row every `ldc` numbers, becomes (or grows by) `a` times the matrix in `panels`, packed in blocks of
/// `block` rows. If all was packed in one block, a product may take fewer rows than it has.
///
/// # Panics
/// Slices that are too short for (m, k, n); where this machine has none of [`Instructions`].
pub fn product(
    c: &mut [f32],
    ldc: usize,
    (m, k, n): (usize, usize, usize),
    a: Left,
    (panels, block): (&[f32], usize),
    store: Store,
) {
    if m == 0 || n == 0 {
        return;
    }
    assert!(ldc >= n && c.len() >= (m - 1) * ldc + n, "a product of ({m}, {n}) in {} numbers", c.len());
    if k == 0 {
        if store == Store::Set {
            c.chunks_mut(ldc).take(m).for_each(|row| row[..n].fill(0.0));
        }
        return;
    }
    let words: &[u32] = bytemuck::cast_slice(panels);
    LEFT.with_borrow_mut(|left| {
        let left: &mut [u32] = bytemuck::cast_slice_mut(left);
        for first in (0..m).step_by(ROWS) {
            let rows = ROWS.min(m - first);
            let c = &mut c[first * ldc..];
            let (mut k0, mut store) = (0, store);
            while k0 < k {
                let part = Part::at(k0, k, block, n);
                part.round_left(left, a, first, rows, k0);
                part.multiply(c, ldc, (rows, n), left, words, store);
                (k0, store) = (k0 + part.blocks * part.high, Store::Add);
            }
        }
    });
}

/// A stretch of k that is multiplied in one go: some whole blocks of the panels, or a piece of one.
struct Part {
    blocks: usize,
    /// Rows of each.
    high: usize,
    /// Where its words begin in the first panel.
    begin: usize,
    /// Words of a panel, in its block.
    panel: usize,
    /// Words of a block.
    block: usize,
}

impl Part {
    fn at(k0: usize, k: usize, block: usize, n: usize) -> Part {
        let (index, inside) = (k0 / block, k0 % block);
        // all in one block: it may have more rows than are multiplied
        let height = if block >= k { block } else { block.min(k - index * block) };
        let words = panels_len(block, n);
        let (blocks, high) = match inside == 0 && block <= k - k0 && pairs(block) <= DEPTH {
            true => ((DEPTH / pairs(block)).min((k - k0) / block), block),
            // a part of one block: each block is padded to 32 rows on its own, so none is crossed
            false => (1, (height - inside).min(2 * DEPTH).min(k - k0)),
        };
        Part { blocks, high, begin: index * words + inside / 2 * SQUARE, panel: pairs(height) * SQUARE, block: words }
    }

    /// Rows `first..` of the left factor, from step `k0` on.
    fn round_left(&self, left: &mut [u32], a: Left, first: usize, rows: usize, k0: usize) {
        for i in 0..self.blocks {
            let begin = k0 + i * self.high;
            let (from, stride, how) = match a {
                Left::Rows { a, lda } => (&a[first * lda + begin..], lda, How::Rows(LDA)),
                Left::Columns { a, lda } => (&a[begin * lda + first..], lda, How::RowsTransposed(LDA)),
            };
            Pack { to: &mut left[i * pairs(self.high)..], from, stride, k: self.high, n: rows, how }.run();
        }
    }

    fn multiply(
        &self,
        c: &mut [f32],
        ldc: usize,
        (rows, n): (usize, usize),
        left: &[u32],
        words: &[u32],
        store: Store,
    ) {
        let steps = pairs(self.high) / SIDE;
        let by = Instructions::here().expect("a processor that multiplies bf16");
        for (panel, column) in (0..n).step_by(SQUARE).enumerate() {
            let words = &words[self.begin + panel * self.panel..];
            let right = Right { words, steps, blocks: self.blocks, stride: self.block };
            let columns = SQUARE.min(n - column);
            for row in (0..rows).step_by(by.rows()) {
                let high = by.rows().min(rows - row);
                let whole = by.whole(high);
                let a = &left[row * LDA..];
                let c = &mut c[row * ldc + column..];
                if high == whole && columns == SQUARE {
                    by.multiply(c, ldc, whole, a, right, store == Store::Add);
                    continue;
                }
                // the kernels write whole squares: beside an edge they would write into the next row of c
                let mut edge = [0.0; SQUARE * SQUARE];
                by.multiply(&mut edge, SQUARE, whole, a, right, false);
                for (c, sums) in c.chunks_mut(ldc).zip(edge.chunks(SQUARE)).take(high) {
                    for (c, sum) in c[..columns].iter_mut().zip(sums) {
                        *c = if store == Store::Add { *c + sum } else { *sum };
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
