//! Four numbers of k at a time: `vpdpbusd` of AVX512-VNNI.
//!
//! One instruction adds, to each of 16 sums, the products of four unsigned bytes with four signed ones, so the numbers of
//! rows are raised by 128, and what the sums have in excess is taken off. Source: Intel, "Architecture Instruction Set
//! Extensions Programming Reference", chapter 2.
#![allow(unsafe_code)]

use super::Product;
use crate::dispatch;

/// Numbers of k in a word.
pub(super) const WORD: usize = 4;
/// Columns of a panel: two vectors of sums.
const PANEL: usize = 32;
/// Rows whose sums stay in registers.
#[cfg(target_arch = "x86_64")]
const TILE: usize = 8;
/// The byte of a row that means 0.
const ZERO: i32 = 128;

/// Whether this processor has the instruction, and the kernels may use it.
pub(super) fn are_there() -> bool {
    #[cfg(target_arch = "x86_64")]
    return dispatch::name() == "avx512"
        && std::is_x86_feature_detected!("avx512vnni")
        && std::is_x86_feature_detected!("avx512bw");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// A word of a row.
pub(super) fn packed(numbers: [i8; WORD]) -> u32 {
    // the flipped top bit adds 128 to a signed byte
    u32::from_le_bytes(numbers.map(i8::cast_unsigned)) ^ u32::from_le_bytes([ZERO as u8; WORD])
}

/// The sum of a column's bytes times [`ZERO`].
pub(super) fn excess(column: impl Iterator<Item = i8>) -> i32 {
    column.map(|byte| ZERO * i32::from(byte)).sum()
}

/// All rows of the product, of so many words.
///
/// # Panics
/// Panels of other sizes; a processor for which [`are_there`] is false.
pub(super) fn run(product: &mut Product, words: usize) {
    assert!(are_there() && product.panel == PANEL, "panels of {}", product.panel);
    #[cfg(target_arch = "x86_64")]
    for first in (0..product.m).step_by(TILE) {
        // SAFETY: the instructions are there (asserted), and `Product::run` asserts that what is read and written is inside
        // the slices.
        unsafe {
            match product.m - first {
                1 => x86::tile::<1>(product, first, words),
                2 => x86::tile::<2>(product, first, words),
                3 => x86::tile::<3>(product, first, words),
                4 => x86::tile::<4>(product, first, words),
                5 => x86::tile::<5>(product, first, words),
                6 => x86::tile::<6>(product, first, words),
                7 => x86::tile::<7>(product, first, words),
                _ => x86::tile::<TILE>(product, first, words),
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = words;
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{PANEL, Product};
    use std::arch::x86_64::{
        __m512i, _mm512_add_ps, _mm512_cvtepi32_ps, _mm512_dpbusd_epi32, _mm512_loadu_ps, _mm512_loadu_si512,
        _mm512_mul_ps, _mm512_set1_epi32, _mm512_set1_ps, _mm512_setzero_si512, _mm512_storeu_ps, _mm512_sub_epi32,
    };

    const LANES: usize = PANEL / 2;

    /// Rows `first..first + M` of all panels.
    ///
    /// # Safety
    /// A processor with AVX512-VNNI; slices as [`Product::run`] asserts.
    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    pub unsafe fn tile<const M: usize>(product: &mut Product, first: usize, words: usize) {
        let rows = product.rows.numbers[first * words..].as_ptr();
        let panels = product.scale.len() / PANEL;
        let mut panel = 0;
        while panel < panels {
            // SAFETY: the caller's promise.
            unsafe {
                let right = product.panels.as_ptr().cast::<__m512i>().add(2 * panel * words);
                // a sum waits for its last product, and one stream doesn't keep memory busy: one row reads four panels
                panel += match (M, panels - panel) {
                    (1, 4..) => side_by_side::<4>(product, first, panel, (rows, right, words)),
                    (1, 3) => side_by_side::<3>(product, first, panel, (rows, right, words)),
                    (1, 2) => side_by_side::<2>(product, first, panel, (rows, right, words)),
                    _ => one_by_one::<M>(product, first, panel, (rows, right, words)),
                };
            }
        }
    }

    /// Writes a panel's columns of a row.
    ///
    /// # Safety
    /// As [`tile`].
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    unsafe fn write(product: &mut Product, row: usize, panel: usize, sums: &[__m512i; 2]) {
        let scale = _mm512_set1_ps(product.rows.scales[row]);
        for (half, sum) in sums.iter().enumerate() {
            let column = panel * PANEL + half * LANES;
            // SAFETY: the caller's promise.
            unsafe {
                // both may have wrapped: the difference is exact as long as k * 127^2 < 2^31, k up to 133,000
                let whole = _mm512_sub_epi32(*sum, _mm512_loadu_si512(product.excess.as_ptr().add(column).cast()));
                let scale = _mm512_mul_ps(scale, _mm512_loadu_ps(product.scale.as_ptr().add(column)));
                let found = _mm512_mul_ps(_mm512_cvtepi32_ps(whole), scale);
                let bias = _mm512_loadu_ps(product.bias.as_ptr().add(column));
                let to = product.c.as_mut_ptr().add(row * product.ldc + column);
                _mm512_storeu_ps(to, _mm512_add_ps(found, bias));
            }
        }
    }

    /// Where the first row and the first panel begin, and their words.
    type Words = (*const u32, *const __m512i, usize);

    /// A panel of M rows; returns 1.
    ///
    /// # Safety
    /// As [`tile`].
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    unsafe fn one_by_one<const M: usize>(
        product: &mut Product,
        first: usize,
        panel: usize,
        (rows, right, words): Words,
    ) -> usize {
        let mut sums = [[_mm512_setzero_si512(); 2]; M];
        // SAFETY: the caller's promise.
        unsafe {
            for word in 0..words {
                let at = right.add(2 * word);
                let halves = [_mm512_loadu_si512(at), _mm512_loadu_si512(at.add(1))];
                for (i, sums) in sums.iter_mut().enumerate() {
                    let four = _mm512_set1_epi32(*rows.add(i * words + word) as i32);
                    sums[0] = _mm512_dpbusd_epi32(sums[0], four, halves[0]);
                    sums[1] = _mm512_dpbusd_epi32(sums[1], four, halves[1]);
                }
            }
            for (i, sums) in sums.iter().enumerate() {
                write(product, first + i, panel, sums);
            }
        }
        1
    }

    /// P panels of one row; returns P.
    ///
    /// # Safety
    /// As [`tile`].
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    unsafe fn side_by_side<const P: usize>(
        product: &mut Product,
        first: usize,
        panel: usize,
        (rows, right, words): Words,
    ) -> usize {
        let mut sums = [[_mm512_setzero_si512(); 2]; P];
        // SAFETY: the caller's promise.
        unsafe {
            for word in 0..words {
                let four = _mm512_set1_epi32(*rows.add(word) as i32);
                for (p, sums) in sums.iter_mut().enumerate() {
                    let at = right.add(2 * (p * words + word));
                    sums[0] = _mm512_dpbusd_epi32(sums[0], four, _mm512_loadu_si512(at));
                    sums[1] = _mm512_dpbusd_epi32(sums[1], four, _mm512_loadu_si512(at.add(1)));
                }
            }
            for (p, sums) in sums.iter().enumerate() {
                write(product, first, panel + p, sums);
            }
        }
        P
    }
}
