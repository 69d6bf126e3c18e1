//! Products of pairs of bf16 in vector registers: `vdpbf16ps` of AVX512-BF16.
//!
//! One instruction adds, to each of 16 sums in f32, the products of a pair of numbers. Source: Intel, "Architecture
//! Instruction Set Extensions Programming Reference", chapter 2.
#![allow(unsafe_code)]

use super::LDA;
use super::tiles::{Right, SIDE, SQUARE};

/// Rows of the sums that stay in registers, 24 of 32 with the two vectors of each.
pub(super) const ROWS: usize = 12;

/// Whether this processor has the instruction.
pub(super) fn are_there() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::is_x86_feature_detected!("avx512f") && std::is_x86_feature_detected!("avx512bf16");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// `c`, [`SQUARE`] columns and up to [`ROWS`] rows, one every `ldc` numbers, becomes (or, with `add`, grows by) the
/// product of `a`, as many rows of bf16 pairs, one every [`LDA`] words, and `right`.
///
/// # Panics
/// Slices that are too short; a processor for which [`are_there`] is false.
pub(super) fn multiply(c: &mut [f32], ldc: usize, rows: usize, a: &[u32], right: Right, add: bool) {
    assert!(are_there() && (1..=ROWS).contains(&rows), "{rows} rows of sums");
    right.check(c, ldc, rows, a, LDA);
    #[cfg(target_arch = "x86_64")]
    {
        let (c, a) = (c.as_mut_ptr(), a.as_ptr());
        // SAFETY: the instruction is there (asserted), and every row that is read or written is inside its slice
        // (asserted above).
        unsafe {
            match rows {
                1 => x86::multiply::<1>(c, ldc, a, right, add),
                2 => x86::multiply::<2>(c, ldc, a, right, add),
                3 => x86::multiply::<3>(c, ldc, a, right, add),
                4 => x86::multiply::<4>(c, ldc, a, right, add),
                5 => x86::multiply::<5>(c, ldc, a, right, add),
                6 => x86::multiply::<6>(c, ldc, a, right, add),
                7 => x86::multiply::<7>(c, ldc, a, right, add),
                8 => x86::multiply::<8>(c, ldc, a, right, add),
                9 => x86::multiply::<9>(c, ldc, a, right, add),
                10 => x86::multiply::<10>(c, ldc, a, right, add),
                11 => x86::multiply::<11>(c, ldc, a, right, add),
                _ => x86::multiply::<ROWS>(c, ldc, a, right, add),
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{LDA, Right, SIDE, SQUARE};
    use std::arch::x86_64::{
        __m512bh, __m512i, _mm512_add_ps, _mm512_dpbf16_ps, _mm512_loadu_ps, _mm512_loadu_si512, _mm512_set1_epi32,
        _mm512_setzero_ps, _mm512_storeu_ps,
    };
    use std::mem::transmute;

    /// # Safety
    /// A processor with AVX512-BF16; all rows inside what the pointers may touch.
    #[target_feature(enable = "avx512f,avx512bf16")]
    pub unsafe fn multiply<const M: usize>(c: *mut f32, ldc: usize, a: *const u32, right: Right, add: bool) {
        let mut sums = [[_mm512_setzero_ps(); 2]; M];
        let mut at = 0;
        for block in 0..right.blocks {
            let mut b = right.words[block * right.stride..].as_ptr();
            for _ in 0..right.steps * SIDE {
                // SAFETY: the caller's promise; the vectors are the same bits, two bf16 a word.
                unsafe {
                    let halves: [__m512bh; 2] =
                        [pairs(_mm512_loadu_si512(b.cast())), pairs(_mm512_loadu_si512(b.add(SQUARE / 2).cast()))];
                    for (i, sums) in sums.iter_mut().enumerate() {
                        let x = pairs(_mm512_set1_epi32(*a.add(i * LDA + at) as i32));
                        sums[0] = _mm512_dpbf16_ps(sums[0], x, halves[0]);
                        sums[1] = _mm512_dpbf16_ps(sums[1], x, halves[1]);
                    }
                    b = b.add(SQUARE);
                }
                at += 1;
            }
        }
        for (i, sums) in sums.iter().enumerate() {
            for (half, sum) in sums.iter().enumerate() {
                // SAFETY: the caller's promise.
                unsafe {
                    let to = c.add(i * ldc + half * SQUARE / 2);
                    let there = if add { _mm512_loadu_ps(to) } else { _mm512_setzero_ps() };
                    _mm512_storeu_ps(to, _mm512_add_ps(there, *sum));
                }
            }
        }
    }

    #[inline]
    #[target_feature(enable = "avx512f,avx512bf16")]
    fn pairs(words: __m512i) -> __m512bh {
        // SAFETY: both are 64 bytes of which any are valid.
        unsafe { transmute(words) }
    }
}
