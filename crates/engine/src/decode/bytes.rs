//! The product of rows of bytes with a matrix of bytes: `vpdpbusd` of AVX512-VNNI.
//!
//! One instruction adds, to each of 16 sums, the products of four unsigned bytes with four signed ones. So a row is rounded
//! to bytes by a scale of its own, and the sums are whole numbers: a row's product is the same bits whatever rows are
//! computed with it. Sources: Intel, "Architecture Instruction Set Extensions Programming Reference", chapter 2; a
//! scale a row and a column: Dettmers et al., "LLM.int8()" (2022), section 2.
#![allow(unsafe_code)]

use super::kernel::Left;
use crate::dispatch;
use pulp::{Simd, WithSimd};

/// Numbers of k in a word.
pub(super) const WORD: usize = 4;
/// Columns of a panel: two vectors of sums.
pub(super) const PANEL: usize = 32;
/// The byte of a row that means 0.
const ZERO: i32 = 128;
/// The largest byte on either side of it.
const MOST: f32 = 127.0;
/// Rows whose sums stay in registers.
const TILE: usize = 8;

/// Whether this processor has the instruction, and the kernels may use it.
pub(super) fn are_there() -> bool {
    #[cfg(target_arch = "x86_64")]
    return dispatch::name() == "avx512"
        && std::is_x86_feature_detected!("avx512vnni")
        && std::is_x86_feature_detected!("avx512bw");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// Words that k numbers take.
pub(super) fn words(k: usize) -> usize {
    k.div_ceil(WORD)
}

/// Rows rounded to bytes.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// [tile][word][row of the tile]: four bytes a word, each [`ZERO`] higher than its number.
    numbers: Vec<u32>,
    /// (m): the factor of a row's bytes.
    scales: Vec<f32>,
    /// The bytes of a row.
    line: Vec<u8>,
}

impl Rows {
    /// Rounds the rows of `left`, k numbers each.
    pub fn round(&mut self, left: Left, k: usize) {
        let Rows { numbers, scales, line } = self;
        let (words, tiles) = (words(k), left.rows.div_ceil(TILE));
        numbers.resize(numbers.len().max(tiles * words * TILE), 0);
        scales.resize(scales.len().max(left.rows), 0.0);
        line.resize(line.len().max(words * WORD), 0);
        let line = &mut line[..words * WORD];
        // padding of the last word: the panels have zeros there, so any byte would do
        line[k..].fill(ZERO as u8);
        for (row, scale) in scales.iter_mut().take(left.rows).enumerate() {
            *scale = dispatch::run(Round { left, row, to: &mut line[..k] });
            let tile = &mut numbers[row / TILE * words * TILE..][..words * TILE];
            for (to, four) in tile.chunks_exact_mut(TILE).zip(line.as_chunks::<WORD>().0) {
                to[row % TILE] = u32::from_le_bytes(*four);
            }
        }
    }
}

/// Rounds a row; returns its scale, which isn't finite where a number isn't.
struct Round<'a> {
    left: Left<'a>,
    row: usize,
    to: &'a mut [u8],
}

impl WithSimd for Round<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let Left { data, rows, width, stride } = self.left;
        let (row, k) = (self.row, self.to.len());
        let parts = || {
            let starts = (0..k).step_by(width.max(1));
            starts.map(move |at| (at, &data[(at / width * rows + row) * stride..][..width.min(k - at)]))
        };
        let (mut most, mut all) = (simd.splat_f32s(0.0), simd.splat_f32s(0.0));
        let (mut last_most, mut last_all) = (0.0f32, 0.0f32);
        for (_, part) in parts() {
            let (vectors, rest) = S::as_simd_f32s(part);
            for x in vectors {
                let size = simd.abs_f32s(*x);
                most = simd.max_f32s(most, size);
                all = simd.add_f32s(all, size);
            }
            for x in rest {
                last_most = last_most.max(x.abs());
                last_all += x.abs();
            }
        }
        let most = simd.reduce_max_f32s(most).max(last_most);
        // a maximum may pass over NaN, a sum never does
        let all = simd.reduce_sum_f32s(all) + last_all;
        let scale = if all.is_finite() { most / MOST } else { f32::NAN };
        // infinite for the smallest `most`, and then the bytes are arbitrary: a scale below 3e-39 makes them nothing
        let inverse = if most > 0.0 && scale > 0.0 { MOST / most } else { 0.0 };
        // 1.5 * 2^23: added to it, a number is rounded to a whole one, which is in the last bits; the half keeps
        // negative ones in the same binade
        const WHOLE: f32 = 12_582_912.0;
        for (at, part) in parts() {
            for (to, x) in self.to[at..].iter_mut().zip(part) {
                // the flipped top bit adds 128 to a signed byte
                *to = ((x * inverse + WHOLE).to_bits() as u8) ^ ZERO as u8;
            }
        }
        scale
    }
}

/// Some panels of a matrix of bytes.
pub(super) struct Product<'a> {
    /// (m, panels), a row every `ldc` numbers.
    pub c: &'a mut [f32],
    pub ldc: usize,
    pub rows: &'a Rows,
    /// How many rows.
    pub m: usize,
    pub k: usize,
    /// [panel][word of k][column][number of the word].
    pub panels: &'a [i8],
    /// A factor for each column of these panels; `excess` and `bias` have a number for each, too.
    pub scale: &'a [f32],
    /// The sums of the columns times [`ZERO`], to be taken off.
    pub excess: &'a [i32],
    pub bias: &'a [f32],
}

/// The sum of a column's bytes times [`ZERO`].
pub(super) fn excess(column: impl Iterator<Item = i8>) -> i32 {
    column.map(|byte| ZERO * i32::from(byte)).sum()
}

impl Product<'_> {
    /// # Panics
    /// Slices that are too short; a processor for which [`are_there`] is false.
    pub fn run(self) {
        let (words, columns) = (words(self.k), self.scale.len());
        let Product { m, ldc, .. } = self;
        assert!(are_there() && columns.is_multiple_of(PANEL), "{columns} columns in panels");
        let tiles = m.div_ceil(TILE);
        assert!(
            self.rows.numbers.len() >= tiles * words * TILE && self.rows.scales.len() >= m,
            "{m} rows of {words} words"
        );
        assert!(self.panels.len() >= columns * words * WORD, "{columns} columns of {words} words");
        assert!(self.excess.len() == columns && self.bias.len() == columns && ldc >= columns, "{columns} columns");
        assert!(m == 0 || self.c.len() >= (m - 1) * ldc + columns, "{m} rows of {columns} sums");
        #[cfg(target_arch = "x86_64")]
        for first in (0..m).step_by(TILE) {
            // SAFETY: the instructions are there, and what is read and written is inside the slices (asserted).
            unsafe {
                match m - first {
                    1 => x86::tile::<1>(&self, first, words),
                    2 => x86::tile::<2>(&self, first, words),
                    3 => x86::tile::<3>(&self, first, words),
                    4 => x86::tile::<4>(&self, first, words),
                    5 => x86::tile::<5>(&self, first, words),
                    6 => x86::tile::<6>(&self, first, words),
                    7 => x86::tile::<7>(&self, first, words),
                    _ => x86::tile::<TILE>(&self, first, words),
                }
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{PANEL, Product, TILE};
    use std::arch::x86_64::{
        __m512i, _mm512_add_epi32, _mm512_add_ps, _mm512_cvtepi32_ps, _mm512_dpbusd_epi32, _mm512_loadu_ps,
        _mm512_loadu_si512, _mm512_mul_ps, _mm512_set1_epi32, _mm512_set1_ps, _mm512_setzero_si512, _mm512_storeu_ps,
        _mm512_sub_epi32,
    };

    const LANES: usize = PANEL / 2;

    /// Rows `first..first + M`, which one tile has, of all panels.
    ///
    /// # Safety
    /// A processor with AVX512-VNNI; slices as [`Product::run`] asserts.
    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    pub unsafe fn tile<const M: usize>(product: &Product, first: usize, words: usize) {
        let rows = product.rows.numbers[first * words..].as_ptr();
        for panel in 0..product.scale.len() / PANEL {
            // SAFETY: the caller's promise.
            unsafe {
                let right = product.panels.as_ptr().cast::<__m512i>().add(2 * panel * words);
                // a sum waits for its last product: one row alone needs four sums of each column to keep the unit busy
                let sums = if M == 1 { in_four::<M>(rows, right, words) } else { one_by_one::<M>(rows, right, words) };
                for (i, sums) in sums.iter().enumerate() {
                    let scale = _mm512_set1_ps(product.rows.scales[first + i]);
                    for (half, sum) in sums.iter().enumerate() {
                        let column = panel * PANEL + half * LANES;
                        // both may have wrapped: the difference is exact as long as k * 127^2 < 2^31, k up to 133,000
                        let whole =
                            _mm512_sub_epi32(*sum, _mm512_loadu_si512(product.excess.as_ptr().add(column).cast()));
                        let scale = _mm512_mul_ps(scale, _mm512_loadu_ps(product.scale.as_ptr().add(column)));
                        let found = _mm512_mul_ps(_mm512_cvtepi32_ps(whole), scale);
                        let bias = _mm512_loadu_ps(product.bias.as_ptr().add(column));
                        let to = product.c.as_ptr().cast_mut().add((first + i) * product.ldc + column);
                        _mm512_storeu_ps(to, _mm512_add_ps(found, bias));
                    }
                }
            }
        }
    }

    /// # Safety
    /// As [`tile`].
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    unsafe fn one_by_one<const M: usize>(rows: *const u32, right: *const __m512i, words: usize) -> [[__m512i; 2]; M] {
        let mut sums = [[_mm512_setzero_si512(); 2]; M];
        for word in 0..words {
            // SAFETY: the caller's promise.
            unsafe { step::<M>(&mut sums, rows.add(word * TILE), right.add(2 * word)) };
        }
        sums
    }

    /// As [`one_by_one`], with four sums of each column, one after the other.
    ///
    /// # Safety
    /// As [`tile`].
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    unsafe fn in_four<const M: usize>(rows: *const u32, right: *const __m512i, words: usize) -> [[__m512i; 2]; M] {
        let mut sums = [[[_mm512_setzero_si512(); 2]; M]; 4];
        for word in 0..words {
            // SAFETY: the caller's promise.
            unsafe { step::<M>(&mut sums[word % 4], rows.add(word * TILE), right.add(2 * word)) };
        }
        let [mut all, rest @ ..] = sums;
        for sums in rest {
            for i in 0..M {
                for half in 0..2 {
                    all[i][half] = _mm512_add_epi32(all[i][half], sums[i][half]);
                }
            }
        }
        all
    }

    /// # Safety
    /// As [`tile`].
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    unsafe fn step<const M: usize>(sums: &mut [[__m512i; 2]; M], rows: *const u32, right: *const __m512i) {
        // SAFETY: the caller's promise.
        unsafe {
            let halves = [_mm512_loadu_si512(right), _mm512_loadu_si512(right.add(1))];
            for (i, sums) in sums.iter_mut().enumerate() {
                let four = _mm512_set1_epi32(*rows.add(i) as i32);
                sums[0] = _mm512_dpbusd_epi32(sums[0], four, halves[0]);
                sums[1] = _mm512_dpbusd_epi32(sums[1], four, halves[1]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::numbers;
    use std::io::Write;

    #[test]
    fn products_are_those_of_plain_loops_over_rounded_rows() {
        if !are_there() {
            let _ = writeln!(std::io::stderr(), "SKIPPED decode::bytes: this processor has no vpdpbusd");
            return;
        }
        for m in [1, 2, 3, 7, 8, 9, 17] {
            for (k, width, columns) in [(1usize, 1, 32), (7, 3, 64), (64, 64, 96), (130, 64, 32), (515, 515, 64)] {
                let stride = width + 3;
                let data = numbers(1, k.div_ceil(width) * m * stride, 2.0);
                let at = |row: usize, i: usize| data[(i / width * m + row) * stride + i % width];
                let right: Vec<i8> = numbers(2, columns * k, 127.0).iter().map(|x| x.round() as i8).collect();
                let byte = |i: usize, j: usize| right[j * k + i];
                let mut panels = vec![0i8; columns * words(k) * WORD];
                for j in 0..columns {
                    for i in 0..k {
                        panels[((j / PANEL * words(k) + i / WORD) * PANEL + j % PANEL) * WORD + i % WORD] = byte(i, j);
                    }
                }
                let excess: Vec<i32> = (0..columns).map(|j| excess((0..k).map(|i| byte(i, j)))).collect();
                let (scale, bias) = (numbers(3, columns, 0.1), numbers(4, columns, 1.0));
                let mut rows = Rows::default();
                rows.round(Left { data: &data, rows: m, width, stride }, k);
                let ldc = columns + 5;
                let mut c = vec![7.0; m * ldc];
                let (left, panels, excess) = (&rows, &panels, &excess);
                Product { c: &mut c, ldc, rows: left, m, k, panels, scale: &scale, excess, bias: &bias }.run();
                for row in 0..m {
                    let most = (0..k).map(|i| at(row, i).abs()).fold(0.0, f32::max);
                    let rounded = |i: usize| (at(row, i) * (MOST / most)).round_ties_even() as i64;
                    for j in 0..columns {
                        let sum: i64 = (0..k).map(|i| rounded(i) * i64::from(byte(i, j))).sum();
                        let expected = sum as f32 * (most / MOST * scale[j]) + bias[j];
                        let found = c[row * ldc + j];
                        assert!(
                            (found - expected).abs() <= 2e-6 * (expected.abs() + 1.0),
                            "({m}, {k}): {found}, {expected}"
                        );
                    }
                    assert!(c[row * ldc + columns..(row + 1) * ldc].iter().all(|x| *x == 7.0));
                }
            }
        }
    }

    #[test]
    fn rows_of_zeros_are_biases_and_what_is_no_number_stays_none() {
        if !are_there() {
            return; // printed above
        }
        let (scale, bias, excess, panels) = (vec![1.0; 32], vec![0.5; 32], vec![128 * 8; 32], vec![1i8; 32 * 8]);
        // 1e-42 is subnormal: its scale vanishes
        for (x, expected) in [(0.0, 0.5), (f32::NAN, f32::NAN), (f32::INFINITY, f32::NAN), (1e-42, 0.5)] {
            let mut rows = Rows::default();
            rows.round(Left { data: &[0.0, x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], rows: 1, width: 8, stride: 8 }, 8);
            let mut c = vec![0.0; 32];
            let (panels, scale, excess, bias) = (&panels, &scale, &excess, &bias);
            Product { c: &mut c, ldc: 32, rows: &rows, m: 1, k: 8, panels, scale, excess, bias }.run();
            assert!(c.iter().all(|c| (c - expected).abs() < 1e-6 || (c.is_nan() && expected.is_nan())), "{x}: {c:?}");
        }
    }
}
