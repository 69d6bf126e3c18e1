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
                1 => x86::rows::<1>(product, first, words),
                2 => x86::rows::<2>(product, first, words),
                3 => x86::rows::<3>(product, first, words),
                4 => x86::rows::<4>(product, first, words),
                5 => x86::rows::<5>(product, first, words),
                6 => x86::rows::<6>(product, first, words),
                7 => x86::rows::<7>(product, first, words),
                _ => x86::rows::<TILE>(product, first, words),
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
    pub unsafe fn rows<const M: usize>(product: &mut Product, first: usize, words: usize) {
        let panels = product.scale.len() / PANEL;
        let mut panel = 0;
        while panel < panels {
            // SAFETY: the caller's promise.
            unsafe {
                // a sum waits for its last product, and one stream doesn't keep memory busy: one row reads four panels
                panel += match (M, panels - panel) {
                    (1, 4..) => tile::<M, 4>(product, first, panel, words),
                    (1, 3) => tile::<M, 3>(product, first, panel, words),
                    (1, 2) => tile::<M, 2>(product, first, panel, words),
                    _ => tile::<M, 1>(product, first, panel, words),
                };
            }
        }
    }

    /// M rows from `first` on of P panels from `panel` on; returns P.
    ///
    /// # Safety
    /// As [`rows`].
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    unsafe fn tile<const M: usize, const P: usize>(
        product: &mut Product,
        first: usize,
        panel: usize,
        words: usize,
    ) -> usize {
        let left = product.rows.numbers[first * words..].as_ptr();
        let mut sums = [[[_mm512_setzero_si512(); 2]; P]; M];
        // SAFETY: the caller's promise.
        unsafe {
            let right = product.panels.as_ptr().cast::<__m512i>().add(2 * panel * words);
            for word in 0..words {
                for p in 0..P {
                    let at = right.add(2 * (p * words + word));
                    let halves = [_mm512_loadu_si512(at), _mm512_loadu_si512(at.add(1))];
                    for (i, sums) in sums.iter_mut().enumerate() {
                        let four = _mm512_set1_epi32(*left.add(i * words + word) as i32);
                        sums[p][0] = _mm512_dpbusd_epi32(sums[p][0], four, halves[0]);
                        sums[p][1] = _mm512_dpbusd_epi32(sums[p][1], four, halves[1]);
                    }
                }
            }
            for (i, sums) in sums.iter().enumerate() {
                for (p, sums) in sums.iter().enumerate() {
                    write(product, first + i, panel + p, sums);
                }
            }
        }
        P
    }

    /// Writes a panel's columns of a row.
    ///
    /// # Safety
    /// As [`rows`].
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
}
