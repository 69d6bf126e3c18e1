//! Products of matrices, on one thread: a left factor as it is in memory times a right factor in panels.
//!
//! Letters: m rows of the product, n columns, k the shared dimension. The right factor is packed once, in panels of
//! `panel` columns, and then read from front to back; a tile of `TILE` rows by one panel stays in registers over up to
//! `DEPTH` steps of k. Source of the scheme: Goto and van de Geijn, "Anatomy of high-performance matrix
//! multiplication" (2008); the left factor is not repacked where its rows are contiguous, because 64 rows of it fit the cache.

use crate::arena::Floats;
use crate::dispatch;
use pulp::{Simd, WithSimd};
use std::cell::RefCell;
use std::sync::OnceLock;

/// Rows of a tile: with two vectors each they take 12 of the 16 vector registers of AVX2, and 16 of the 32 of AVX-512.
const TILE: usize = 6;
const WIDE_TILE: usize = 8;

/// Steps of k before a tile goes back to memory: a panel of 256 rows fills half of a 32 KB cache on AVX2.
const DEPTH: usize = 256;

/// A multiple of both tile heights.
pub(crate) const TILES: usize = 24; // 4 of 6 rows, 3 of 8

/// Rows of the left factor that are worked through before the next panel's turn.
pub(crate) const ROWS: usize = 6 * TILES;

/// Up to this many columns of the product, a transposed left factor is read in place: it is read so few times that
/// transposing it costs more.
const DIRECT: usize = 64;

/// The left factor.
#[derive(Debug, Clone, Copy)]
pub enum Left<'a> {
    /// (m, k), a row every `lda` numbers.
    Rows {
        /// Its numbers.
        a: &'a [f32],
        /// From a row to the next.
        lda: usize,
    },
    /// Given transposed: (k, m), a row every `lda` numbers.
    Columns {
        /// Its numbers.
        a: &'a [f32],
        /// From a row to the next.
        lda: usize,
    },
}

/// What a product does with the numbers of its output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Store {
    /// They are overwritten.
    Set,
    /// The product is added to them.
    Add,
}

/// The right factor (k, n) in panels.
#[derive(Debug, Clone, Copy)]
pub struct Panels<'a> {
    /// Its numbers: `[block][panel][row of the block][column of the panel]`.
    pub numbers: &'a [f32],
    /// Rows of a block; the last block may have fewer. If all was packed in one block, a product may take fewer rows than
    /// it has.
    pub block: usize,
}

/// Columns of a panel: twice the lanes of a vector.
pub(crate) fn panel() -> usize {
    struct Lanes;
    impl WithSimd for Lanes {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> usize {
            2 * S::F32_LANES
        }
    }
    static PANEL: OnceLock<usize> = OnceLock::new();
    *PANEL.get_or_init(|| dispatch::run(Lanes))
}

/// Numbers that a (k, n) matrix takes in panels: n rounded up to whole ones.
pub fn panels_len(k: usize, n: usize) -> usize {
    n.next_multiple_of(panel()) * k
}

/// Packs `b` (k, n), a row every `ldb` numbers, in panels; zeros fill the last one.
///
/// # Panics
/// Slices that are too short.
pub fn pack(panels: &mut [f32], b: &[f32], ldb: usize, k: usize, n: usize) {
    pack_width(panel(), panels, b, ldb, k, n);
}

fn pack_width(width: usize, panels: &mut [f32], b: &[f32], ldb: usize, k: usize, n: usize) {
    if k == 0 {
        return;
    }
    for (panel, first) in panels[..n.next_multiple_of(width) * k].chunks_exact_mut(k * width).zip((0..n).step_by(width))
    {
        let columns = width.min(n - first);
        for (to, row) in panel.chunks_exact_mut(width).zip(0..k) {
            copy(&mut to[..columns], &b[row * ldb + first..][..columns]);
            to[columns..].fill(0.0);
        }
    }
}

/// Copies a row. Panels and heads have rows of these lengths, and an array of a length that the compiler knows is a few
/// moves; a call costs more than those.
#[inline(always)]
pub(crate) fn copy(to: &mut [f32], from: &[f32]) {
    fn array<const N: usize>(to: &mut [f32], from: &[f32]) {
        let to: &mut [f32; N] = to.try_into().expect("a row of N numbers");
        *to = from.try_into().expect("a row as long");
    }
    match to.len() {
        16 => array::<16>(to, from),
        32 => array::<32>(to, from),
        64 => array::<64>(to, from),
        _ => to.copy_from_slice(from),
    }
}

/// As [`pack`], from `bt`, the transposed (n, k), a row every `ldb` numbers.
///
/// # Panics
/// Slices that are too short.
pub fn pack_transposed(panels: &mut [f32], bt: &[f32], ldb: usize, k: usize, n: usize) {
    pack_transposed_width(panel(), panels, bt, ldb, k, n);
}

fn pack_transposed_width(width: usize, panels: &mut [f32], bt: &[f32], ldb: usize, k: usize, n: usize) {
    if k == 0 {
        return;
    }
    for (panel, first) in panels[..n.next_multiple_of(width) * k].chunks_exact_mut(k * width).zip((0..n).step_by(width))
    {
        let columns = width.min(n - first);
        if columns < width {
            panel.fill(0.0);
        }
        // four rows at a time, four steps of each: squares of sixteen numbers are transposed in registers
        let mut column = 0;
        while column + 4 <= columns {
            let row = |i: usize| pulp::as_arrays::<4, _>(&bt[(first + column + i) * ldb..][..k]);
            let [(r0, t0), (r1, t1), (r2, t2), (r3, t3)] = [row(0), row(1), row(2), row(3)];
            let (quads, rest) = panel.split_at_mut(r0.len() * 4 * width);
            let rows = r0.iter().zip(r1).zip(r2.iter().zip(r3));
            for (to, ((r0, r1), (r2, r3))) in quads.chunks_exact_mut(4 * width).zip(rows) {
                for i in 0..4 {
                    to[i * width + column..][..4].copy_from_slice(&[r0[i], r1[i], r2[i], r3[i]]);
                }
            }
            for (i, to) in rest.chunks_exact_mut(width).enumerate() {
                to[column..column + 4].copy_from_slice(&[t0[i], t1[i], t2[i], t3[i]]);
            }
            column += 4;
        }
        for column in column..columns {
            let row = &bt[(first + column) * ldb..][..k];
            for (to, x) in panel.chunks_exact_mut(width).zip(row) {
                to[column] = *x;
            }
        }
    }
}

/// `c` (m, n), a row every `ldc` numbers, becomes (or grows by) `a` times the matrix in `panels`.
///
/// The sum over k has the same order for any m, so a row's product doesn't depend on the rows beside it.
///
/// # Panics
/// Slices that are too short for (m, k, n).
pub fn product(c: &mut [f32], ldc: usize, (m, k, n): (usize, usize, usize), a: Left, panels: Panels, store: Store) {
    if m == 0 || n == 0 {
        return;
    }
    assert!(ldc >= n && c.len() >= (m - 1) * ldc + n, "a product of ({m}, {n}) in {} numbers", c.len());
    assert!(panels.numbers.len() >= panels_len(k, n), "({k}, {n}) in panels of {} numbers", panels.numbers.len());
    // borrowed out here: a closure inside the kernel would be compiled without its instructions
    TURNED.with_borrow_mut(|turned| dispatch::run(Product { c, ldc, m, k, n, a, panels, store, turned }));
}

struct Product<'a> {
    c: &'a mut [f32],
    ldc: usize,
    m: usize,
    k: usize,
    n: usize,
    a: Left<'a>,
    panels: Panels<'a>,
    store: Store,
    turned: &'a mut [f32],
}

thread_local! {
    /// A block of a transposed left factor, as tiles.
    static TURNED: RefCell<Floats> = RefCell::new(Floats::new(ROWS * DEPTH));
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F32_LANES >= 16 {
            true => self.all::<S, WIDE_TILE>(simd),
            false => self.all::<S, TILE>(simd),
        }
    }
}

impl Product<'_> {
    #[inline(always)]
    fn all<S: Simd, const HIGH: usize>(mut self, simd: S) {
        // a sum over nothing is 0, but no tile would come to write it
        if self.k == 0 {
            if self.store == Store::Set {
                self.c.chunks_mut(self.ldc).take(self.m).for_each(|row| row[..self.n].fill(0.0));
            }
            return;
        }
        for first in (0..self.m).step_by(ROWS) {
            let rows = ROWS.min(self.m - first);
            let mut store = self.store;
            for k0 in (0..self.k).step_by(DEPTH) {
                let depth = DEPTH.min(self.k - k0);
                if let Left::Columns { a, lda } = self.a
                    && self.n > DIRECT
                {
                    turn::<HIGH>(self.turned, a, lda, first, rows, k0, depth);
                }
                self.block::<S, HIGH>(simd, first, rows, k0, depth, store);
                // the parts of k after the first add to what it has set
                store = Store::Add;
            }
        }
    }
}

/// Rows `first..` of a transposed left factor, steps `k0..` of k, as tiles: `[tile][step][row of the tile]`.
///
/// Step by step, so that a line of the factor is fetched once: the distance of its rows is often a power of two, and
/// then they push each other out of the cache.
#[inline(always)]
fn turn<const HIGH: usize>(
    turned: &mut [f32],
    a: &[f32],
    lda: usize,
    first: usize,
    rows: usize,
    k0: usize,
    depth: usize,
) {
    let whole = rows / HIGH;
    let (tiles, rest) = turned.split_at_mut(whole * depth * HIGH);
    let (tiles, _) = pulp::as_arrays_mut::<HIGH, _>(tiles);
    for step in 0..depth {
        let (columns, last) = pulp::as_arrays::<HIGH, _>(&a[(k0 + step) * lda + first..][..rows]);
        for (tile, column) in columns.iter().enumerate() {
            tiles[tile * depth + step] = *column;
        }
        if !last.is_empty() {
            rest[step * last.len()..][..last.len()].copy_from_slice(last);
        }
    }
}

impl Product<'_> {
    #[inline(always)]
    fn block<S: Simd, const HIGH: usize>(
        &mut self,
        simd: S,
        first: usize,
        rows: usize,
        k0: usize,
        depth: usize,
        store: Store,
    ) {
        let width = 2 * S::F32_LANES;
        for (panel, column) in (0..self.n).step_by(width).enumerate() {
            let (begin, steps) = self.steps(width, panel, k0, k0 + depth);
            for row in (0..rows).step_by(HIGH) {
                let high = HIGH.min(rows - row);
                let tile = Tile { row: first + row, turned: row * depth, column, panel, k0, depth, begin, steps };
                // a height that the compiler knows: only then are a tile's sums registers
                match high {
                    _ if high == HIGH => self.tile::<S, HIGH>(simd, tile, store),
                    1 => self.tile::<S, 1>(simd, tile, store),
                    2 => self.tile::<S, 2>(simd, tile, store),
                    3 => self.tile::<S, 3>(simd, tile, store),
                    4 => self.tile::<S, 4>(simd, tile, store),
                    5 => self.tile::<S, 5>(simd, tile, store),
                    6 if HIGH > 6 => self.tile::<S, 6>(simd, tile, store),
                    7 if HIGH > 6 => self.tile::<S, 7>(simd, tile, store),
                    _ => unreachable!("a tile of {high} rows"),
                }
            }
        }
    }

    /// Where step k of a panel begins, and how many steps up to `end` follow it in one block of the panels.
    #[inline(always)]
    fn steps(&self, width: usize, panel: usize, k: usize, end: usize) -> (usize, usize) {
        let (block, inside) = (k / self.panels.block, k % self.panels.block);
        let high = match self.panels.block >= self.k {
            // one block may hold more rows than k, and its panels are as high as it is
            true => self.panels.block,
            false => self.panels.block.min(self.k - block * self.panels.block),
        };
        let begin = block * self.panels.block * self.n.next_multiple_of(width) + (panel * high + inside) * width;
        (begin, (high - inside).min(end - k))
    }

    #[inline(always)]
    fn tile<S: Simd, const M: usize>(&mut self, simd: S, at: Tile, store: Store) {
        let width = 2 * S::F32_LANES;
        let mut sums = [[simd.splat_f32s(0.0); 2]; M];
        let (mut k, end) = (at.k0, at.k0 + at.depth);
        let (mut begin, mut steps) = (at.begin, at.steps);
        loop {
            let b = pulp::as_arrays::<2, _>(S::as_simd_f32s(&self.panels.numbers[begin..][..steps * width]).0).0;
            match self.a {
                Left::Rows { a, lda } => by_rows(simd, &mut sums, &a[at.row * lda + k..], lda, b),
                Left::Columns { a, lda } if self.n <= DIRECT => {
                    by_columns_there(simd, &mut sums, &a[k * lda + at.row..], lda, b);
                }
                Left::Columns { .. } => {
                    let a = pulp::as_arrays::<M, _>(&self.turned[at.turned + (k - at.k0) * M..][..steps * M]).0;
                    by_columns(simd, &mut sums, a, b);
                }
            }
            k += steps;
            if k == end {
                break;
            }
            (begin, steps) = self.steps(width, at.panel, k, end);
        }
        let columns = width.min(self.n - at.column);
        let c = &mut self.c[at.row * self.ldc + at.column..];
        match store {
            _ if columns < width => {
                for (c, sum) in c.chunks_mut(self.ldc).zip(sums) {
                    put_part(simd, &mut c[..columns], sum, store);
                }
            }
            Store::Set => put::<S, M, false>(simd, c, self.ldc, sums),
            Store::Add => put::<S, M, true>(simd, c, self.ldc, sums),
        }
    }
}

/// The place of a tile.
#[derive(Clone, Copy)]
struct Tile {
    row: usize,
    /// Where its rows of a transposed left factor begin.
    turned: usize,
    column: usize,
    panel: usize,
    k0: usize,
    depth: usize,
    /// Where its first steps of the panel begin, and how many are contiguous there.
    begin: usize,
    steps: usize,
}

#[inline(always)]
fn by_rows<S: Simd, const M: usize>(simd: S, sums: &mut [[S::f32s; 2]; M], a: &[f32], lda: usize, b: &[[S::f32s; 2]]) {
    // a copy: through the reference the sums would live in memory, not in registers
    let mut local = *sums;
    let (fours, rest) = pulp::as_arrays::<4, _>(b);
    // loops and no `map`: what the compiler leaves as a call costs as much as ten steps
    let mut quads: [&[[f32; 4]]; M] = [&[]; M];
    let mut tails: [&[f32]; M] = [&[]; M];
    for i in 0..M {
        let (quad, tail) = pulp::as_arrays::<4, _>(&a[i * lda..][..b.len()]);
        (quads[i], tails[i]) = (&quad[..fours.len()], &tail[..rest.len()]);
    }
    for (q, b) in fours.iter().enumerate() {
        for k in 0..4 {
            let mut x = [0.0; M];
            for i in 0..M {
                x[i] = quads[i][q][k];
            }
            step(simd, &mut local, x, b[k]);
        }
    }
    for (k, b) in rest.iter().enumerate() {
        let mut x = [0.0; M];
        for i in 0..M {
            x[i] = tails[i][k];
        }
        step(simd, &mut local, x, *b);
    }
    *sums = local;
}

#[inline(always)]
fn step<S: Simd, const M: usize>(simd: S, sums: &mut [[S::f32s; 2]; M], a: [f32; M], b: [S::f32s; 2]) {
    for i in 0..M {
        let x = simd.splat_f32s(a[i]);
        sums[i][0] = simd.mul_add_e_f32s(x, b[0], sums[i][0]);
        sums[i][1] = simd.mul_add_e_f32s(x, b[1], sums[i][1]);
    }
}

#[inline(always)]
fn by_columns_there<S: Simd, const M: usize>(
    simd: S,
    sums: &mut [[S::f32s; 2]; M],
    a: &[f32],
    lda: usize,
    b: &[[S::f32s; 2]],
) {
    let mut local = *sums;
    for (a, b) in a.chunks(lda).zip(b) {
        let mut x = [0.0; M];
        x.copy_from_slice(&a[..M]);
        step(simd, &mut local, x, *b);
    }
    *sums = local;
}

#[inline(always)]
fn by_columns<S: Simd, const M: usize>(simd: S, sums: &mut [[S::f32s; 2]; M], a: &[[f32; M]], b: &[[S::f32s; 2]]) {
    let mut local = *sums;
    for (a, b) in a.iter().zip(b) {
        step(simd, &mut local, *a, *b);
    }
    *sums = local;
}

/// Rows of whole panels, short enough for the compiler to unroll: the sums never leave the registers.
#[inline(always)]
fn put<S: Simd, const M: usize, const ADD: bool>(simd: S, c: &mut [f32], ldc: usize, sums: [[S::f32s; 2]; M]) {
    for i in 0..M {
        let row = S::as_mut_simd_f32s(&mut c[i * ldc..][..2 * S::F32_LANES]).0;
        for half in 0..2 {
            row[half] = match ADD {
                true => simd.add_f32s(row[half], sums[i][half]),
                false => sums[i][half],
            };
        }
    }
}

#[inline(always)]
fn put_part<S: Simd>(simd: S, c: &mut [f32], sum: [S::f32s; 2], store: Store) {
    for (part, sum) in c.chunks_mut(S::F32_LANES).zip(sum) {
        let sum = match store {
            Store::Set => sum,
            Store::Add => simd.add_f32s(simd.partial_load_f32s(part), sum),
        };
        simd.partial_store_f32s(part, sum);
    }
}

#[cfg(test)]
mod tests;
