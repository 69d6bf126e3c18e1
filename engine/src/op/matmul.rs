//! Products of matrices, on one thread: a left factor as it lies in memory times a right factor in panels.
//!
//! Letters: m rows of the product, n columns, k the shared dimension. The right factor is laid out once, in panels of
//! [`panel`] columns, and then read from front to back; a tile of `TILE` rows by one panel stays in registers over up to
//! `DEPTH` steps of k. Source of the scheme: Goto and van de Geijn, "Anatomy of high-performance matrix
//! multiplication" (2008); the left factor is not repacked where its rows are contiguous, because 64 rows of it fit the cache.

use crate::arena::Floats;
use crate::dispatch;
use pulp::{Simd, WithSimd};
use std::cell::RefCell;
use std::sync::OnceLock;

/// Rows of a tile: with two vectors each they take 12 of the 16 vector registers of AVX2.
pub(crate) const TILE: usize = 6;

/// Steps of k before a tile goes back to memory: a panel of so many rows fills half of a 32 KB cache on AVX2.
const DEPTH: usize = 256;

/// Rows of the left factor that are worked through before the next panel's turn.
pub(crate) const ROWS: usize = 24 * TILE;

/// Up to so many columns of the product, a transposed left factor is read where it lies: it is read so few times that
/// turning it costs more.
const DIRECT: usize = 64;

/// The left factor.
#[derive(Debug, Clone, Copy)]
pub enum Left<'a> {
    /// (m, k), rows `lda` apart.
    Rows {
        /// Its numbers.
        a: &'a [f32],
        /// From a row to the next.
        lda: usize,
    },
    /// Given transposed: (k, m), rows `lda` apart.
    Columns {
        /// Its numbers.
        a: &'a [f32],
        /// From a row to the next.
        lda: usize,
    },
}

/// What happens to the numbers that are there.
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
pub fn panel() -> usize {
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

/// Lays `b` (k, n), rows `ldb` apart, out in panels; zeros fill the last one.
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

/// Short rows are copied in eights: a call for each costs more than the copy.
pub(crate) fn copy(to: &mut [f32], from: &[f32]) {
    let (eights, rest) = pulp::as_arrays_mut::<8, _>(to);
    let (from, last) = pulp::as_arrays::<8, _>(from);
    for (to, from) in eights.iter_mut().zip(from) {
        *to = *from;
    }
    for (to, from) in rest.iter_mut().zip(last) {
        *to = *from;
    }
}

/// As [`pack`], from `bt`, the transposed (n, k), rows `ldb` apart.
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
        // four rows at a time, four steps of each: squares of sixteen numbers are turned in registers
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

/// `c` (m, n), rows `ldc` apart, becomes (or grows by) `scale` times `a` times the matrix in `panels`.
///
/// The sum over k has the same order for any m, so a row's product doesn't depend on the rows beside it.
///
/// # Panics
/// Slices that are too short for (m, k, n).
pub fn product(
    c: &mut [f32],
    ldc: usize,
    (m, k, n): (usize, usize, usize),
    a: Left,
    panels: Panels,
    scale: f32,
    store: Store,
) {
    if m == 0 || n == 0 {
        return;
    }
    assert!(ldc >= n && c.len() >= (m - 1) * ldc + n, "a product of ({m}, {n}) in {} numbers", c.len());
    assert!(panels.numbers.len() >= panels_len(k, n), "({k}, {n}) in panels of {} numbers", panels.numbers.len());
    // borrowed out here: a closure inside the kernel would be compiled without its instructions
    TURNED.with_borrow_mut(|turned| dispatch::run(Product { c, ldc, m, k, n, a, panels, scale, store, turned }));
}

struct Product<'a> {
    c: &'a mut [f32],
    ldc: usize,
    m: usize,
    k: usize,
    n: usize,
    a: Left<'a>,
    panels: Panels<'a>,
    scale: f32,
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
    fn with_simd<S: Simd>(mut self, simd: S) {
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
                    turn(self.turned, a, lda, first, rows, k0, depth);
                }
                self.block(simd, first, rows, k0, depth, store);
                store = Store::Add;
            }
        }
    }
}

/// Rows `first..` of a transposed left factor, steps `k0..` of k, as tiles: `[tile][step][row of the tile]`.
///
/// Step by step, so that a line of the factor is fetched once: its rows are often a power of two apart and push each other
/// out of the cache.
#[inline(always)]
fn turn(turned: &mut [f32], a: &[f32], lda: usize, first: usize, rows: usize, k0: usize, depth: usize) {
    let whole = rows / TILE;
    let (tiles, rest) = turned.split_at_mut(whole * depth * TILE);
    let (tiles, _) = pulp::as_arrays_mut::<TILE, _>(tiles);
    for step in 0..depth {
        let (six, last) = pulp::as_arrays::<TILE, _>(&a[(k0 + step) * lda + first..][..rows]);
        for (tile, six) in six.iter().enumerate() {
            tiles[tile * depth + step] = *six;
        }
        if !last.is_empty() {
            rest[step * last.len()..][..last.len()].copy_from_slice(last);
        }
    }
}

impl Product<'_> {
    #[inline(always)]
    fn block<S: Simd>(&mut self, simd: S, first: usize, rows: usize, k0: usize, depth: usize, store: Store) {
        let width = 2 * S::F32_LANES;
        for (panel, column) in (0..self.n).step_by(width).enumerate() {
            let (begin, steps) = self.steps(width, panel, k0, k0 + depth);
            for row in (0..rows).step_by(TILE) {
                let high = TILE.min(rows - row);
                let tile = Tile { row: first + row, turned: row * depth, column, panel, k0, depth, begin, steps };
                match high {
                    1 => self.tile::<S, 1>(simd, tile, store),
                    2 => self.tile::<S, 2>(simd, tile, store),
                    3 => self.tile::<S, 3>(simd, tile, store),
                    4 => self.tile::<S, 4>(simd, tile, store),
                    5 => self.tile::<S, 5>(simd, tile, store),
                    _ => self.tile::<S, TILE>(simd, tile, store),
                }
            }
        }
    }

    /// Where step k of a panel lies, and how many steps up to `end` lie behind it, in one block of the panels.
    #[inline(always)]
    fn steps(&self, width: usize, panel: usize, k: usize, end: usize) -> (usize, usize) {
        let (block, inside) = (k / self.panels.block, k % self.panels.block);
        let high = match self.panels.block >= self.k {
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
                    put_part(simd, &mut c[..columns], sum, self.scale, store);
                }
            }
            Store::Set => put::<S, M, false>(simd, c, self.ldc, sums, self.scale),
            Store::Add => put::<S, M, true>(simd, c, self.ldc, sums, self.scale),
        }
    }
}

/// Where a tile lies.
#[derive(Clone, Copy)]
struct Tile {
    row: usize,
    /// Where its rows of a turned left factor begin.
    turned: usize,
    column: usize,
    panel: usize,
    k0: usize,
    depth: usize,
    /// Where its first steps of the panel lie, and how many lie there together.
    begin: usize,
    steps: usize,
}

#[inline(always)]
fn by_rows<S: Simd, const M: usize>(simd: S, sums: &mut [[S::f32s; 2]; M], a: &[f32], lda: usize, b: &[[S::f32s; 2]]) {
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
fn put<S: Simd, const M: usize, const ADD: bool>(
    simd: S,
    c: &mut [f32],
    ldc: usize,
    sums: [[S::f32s; 2]; M],
    scale: f32,
) {
    let scale = simd.splat_f32s(scale);
    for i in 0..M {
        let row = S::as_mut_simd_f32s(&mut c[i * ldc..][..2 * S::F32_LANES]).0;
        for half in 0..2 {
            row[half] = match ADD {
                true => simd.mul_add_e_f32s(sums[i][half], scale, row[half]),
                false => simd.mul_f32s(sums[i][half], scale),
            };
        }
    }
}

#[inline(always)]
fn put_part<S: Simd>(simd: S, c: &mut [f32], sum: [S::f32s; 2], scale: f32, store: Store) {
    let scale = simd.splat_f32s(scale);
    for (part, sum) in c.chunks_mut(S::F32_LANES).zip(sum) {
        let sum = match store {
            Store::Set => simd.mul_f32s(sum, scale),
            Store::Add => simd.mul_add_e_f32s(sum, scale, simd.partial_load_f32s(part)),
        };
        simd.partial_store_f32s(part, sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scalar;

    fn numbers(n: usize, seed: u32) -> Vec<f32> {
        let mut x = seed.wrapping_mul(2654435761) | 1;
        let mut next = || {
            x ^= x << 13;
            x ^= x >> 17;
            x ^= x << 5;
            x as f32 / u32::MAX as f32 - 0.5
        };
        (0..n).map(|_| next()).collect()
    }

    /// Sums of k products of numbers below 0.5 in f32: k/4 times 2^-24 twice over, and some room.
    fn bound(k: usize) -> f64 {
        1e-6 + k as f64 * 6e-8
    }

    fn check<S: Simd>(simd: S, (m, k, n): (usize, usize, usize), columns: bool, block: usize) {
        let width = 2 * S::F32_LANES;
        let (lda, ldc) = (if columns { m + 3 } else { k + 3 }, n + 2);
        let left = numbers(if columns { k * lda } else { m * lda }, 1);
        let a = if columns { Left::Columns { a: &left, lda } } else { Left::Rows { a: &left, lda } };
        let b = numbers(k * n, 2);
        let turned: Vec<f32> = (0..k * n).map(|x| b[x % k * n + x / k]).collect();
        let truth = scalar::matmul::product((m, k, n), a, &b);
        let mut packed = vec![f32::NAN; n.next_multiple_of(width) * k];
        for from_turned in [false, true] {
            let mut at = 0;
            for first in (0..k).step_by(block) {
                let rows = block.min(k - first);
                let to = &mut packed[at..];
                match from_turned {
                    false => pack_width(width, to, &b[first * n..], n, rows, n),
                    true => pack_transposed_width(width, to, &turned[first..], k, rows, n),
                }
                at += rows * n.next_multiple_of(width);
            }
            let before = numbers(m * ldc, 3);
            for (store, scale) in [(Store::Set, 1.0), (Store::Add, -0.5)] {
                let mut c = before.clone();
                let panels = Panels { numbers: &packed, block };
                let turned = &mut vec![f32::NAN; ROWS * DEPTH];
                Product { c: &mut c, ldc, m, k, n, a, panels, scale, store, turned }.with_simd(simd);
                for (i, (c, before)) in c.iter().zip(&before).enumerate() {
                    let (row, column) = (i / ldc, i % ldc);
                    let there = if store == Store::Add { *before as f64 } else { 0.0 };
                    let expected = match column < n {
                        true => there + scale as f64 * truth[row * n + column],
                        false => *before as f64,
                    };
                    let apart = (*c as f64 - expected).abs();
                    let what =
                        format!("({m}, {k}, {n}) columns {columns} block {block} {store:?} at ({row}, {column})");
                    assert!(apart <= bound(k), "{what}: {c}, expected {expected}");
                }
            }
        }
    }

    fn check_all<S: Simd + Copy>(simd: S) {
        for m in [1, 2, 5, 6, 7, 12, 13, 97, 100] {
            for (k, n) in [(1, 1), (3, 15), (5, 16), (8, 33), (31, 64), (31, 65), (300, 7), (257, 90)] {
                for columns in [false, true] {
                    for block in [k, 1, 7, 64, 256] {
                        check(simd, (m, k, n), columns, block.min(k));
                    }
                }
            }
        }
    }

    #[test]
    fn every_shape_is_what_plain_loops_give_on_these_kernels() {
        struct All;
        impl WithSimd for All {
            type Output = ();
            fn with_simd<S: Simd>(self, simd: S) {
                check_all(simd);
            }
        }
        dispatch::run(All);
    }

    #[test]
    fn every_width_of_vector_gives_the_same() {
        check_all(pulp::Scalar);
        for shape in [(1, 5, 70), (13, 300, 33), (7, 9, 64), (13, 300, 70)] {
            for columns in [false, true] {
                check(pulp::Scalar128b, shape, columns, 4);
                check(pulp::Scalar256b, shape, columns, 4);
                check(pulp::Scalar512b, shape, columns, 4);
            }
        }
    }

    #[test]
    fn nothing_times_nothing_is_nothing() {
        let mut c = vec![3.0; 4];
        product(
            &mut c,
            2,
            (2, 0, 2),
            Left::Rows { a: &[], lda: 0 },
            Panels { numbers: &[], block: 1 },
            1.0,
            Store::Set,
        );
        assert_eq!(c, [0.0; 4]);
        product(
            &mut c,
            2,
            (0, 3, 2),
            Left::Rows { a: &[], lda: 3 },
            Panels { numbers: &[], block: 3 },
            1.0,
            Store::Set,
        );
    }

    #[test]
    fn a_product_may_take_some_of_the_packed_rows() {
        let (m, k, n) = (7, 40, 2 * panel() + 3);
        let (a, b) = (numbers(m * k, 1), numbers(k * n, 2));
        let mut packed = vec![0.0; panels_len(k, n)];
        pack(&mut packed, &b, n, k, n);
        for (first, steps) in [(0, 40), (0, 13), (5, 35), (8, 1), (39, 1)] {
            let left = Left::Rows { a: &a[first..], lda: k };
            let some = Panels { numbers: &packed[first * panel()..], block: k };
            let mut c = vec![0.0; m * n];
            product(&mut c, n, (m, steps, n), left, some, 1.0, Store::Set);
            let truth = scalar::matmul::product((m, steps, n), Left::Rows { a: &a[first..], lda: k }, &b[first * n..]);
            let apart = c.iter().zip(truth).map(|(c, t)| (*c as f64 - t).abs()).fold(0.0, f64::max);
            assert!(apart <= bound(k), "steps {first}..{}: {apart:e} apart", first + steps);
        }
    }

    #[test]
    fn a_row_does_not_depend_on_the_rows_beside_it() {
        let (k, n) = (300, 40);
        let (a, b) = (numbers(9 * k, 1), numbers(k * n, 2));
        let mut packed = vec![0.0; panels_len(k, n)];
        pack(&mut packed, &b, n, k, n);
        let rows = |first: usize, m: usize| {
            let mut c = vec![0.0; m * n];
            let left = Left::Rows { a: &a[first * k..], lda: k };
            product(&mut c, n, (m, k, n), left, Panels { numbers: &packed, block: k }, 1.0, Store::Set);
            c
        };
        let all = rows(0, 9);
        for (first, m) in [(0, 1), (3, 2), (1, 6), (8, 1)] {
            assert_eq!(rows(first, m), all[first * n..][..m * n]);
        }
    }
}
