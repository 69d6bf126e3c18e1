//! Numbers rounded to bf16 and packed for the tiles.
//!
//! A word holds two bf16: the lower half comes first. A left factor is rows of words, pairs of neighbours in k. A right
//! factor is panels of [`SQUARE`] columns; a row of a panel holds pairs of rows of the matrix, column by column.

use super::tiles::{SIDE, SQUARE};
use crate::dispatch;
use pulp::{Simd, WithSimd};

/// Steps of k are whole: 16 pairs of rows.
pub(super) const STEP: usize = 2 * SIDE;

/// `x` rounded to the nearest bf16, ties to even, as its upper 16 bits; NaN stays one.
#[inline(always)]
pub fn round(x: f32) -> u32 {
    let bits = x.to_bits();
    // a half rounds up if the last remaining bit is 1; a carry into the exponent is right, up to infinity
    let nearest = bits.wrapping_add(0x7fff + (bits >> 16 & 1)) >> 16;
    // cut off, a NaN with its payload in the lower bits would be infinity: the quiet bit is set
    if bits & 0x7fff_ffff > 0x7f80_0000 { bits >> 16 | 0x40 } else { nearest }
}

#[inline(always)]
fn pair(first: f32, second: f32) -> u32 {
    round(first) | round(second) << 16
}

/// Words of a row of pairs over k.
pub(super) fn pairs(k: usize) -> usize {
    k.next_multiple_of(STEP) / 2
}

/// Words that a (k, n) matrix takes in panels.
pub(super) fn panels_len(k: usize, n: usize) -> usize {
    n.next_multiple_of(SQUARE) * pairs(k)
}

/// A packing, as a kernel.
pub(super) struct Pack<'a> {
    pub to: &'a mut [u32],
    pub from: &'a [f32],
    /// From a row of `from` to the next.
    pub stride: usize,
    pub k: usize,
    pub n: usize,
    pub how: How,
}

#[derive(Clone, Copy)]
pub(super) enum How {
    /// A right factor from its rows, (k, n).
    Panels,
    /// A right factor from its columns, (n, k).
    PanelsTransposed,
    /// A left factor from its rows, (n, k), and the words from a row of the result to the next.
    Rows(usize),
    /// A left factor from its columns, (k, n).
    RowsTransposed(usize),
}

impl Pack<'_> {
    pub fn run(self) {
        dispatch::run(self);
    }
}

impl WithSimd for Pack<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        match self.how {
            How::Panels => self.panels(),
            How::PanelsTransposed => self.panels_transposed(),
            How::Rows(lda) => self.rows(lda),
            How::RowsTransposed(lda) => self.rows_transposed(lda),
        }
    }
}

impl Pack<'_> {
    #[inline(always)]
    fn panels(self) {
        let Pack { to, from, stride, k, n, .. } = self;
        let pairs = pairs(k);
        for (panel, first) in to.chunks_exact_mut(pairs * SQUARE).zip((0..n).step_by(SQUARE)) {
            let columns = SQUARE.min(n - first);
            for (p, to) in panel.chunks_exact_mut(SQUARE).enumerate() {
                let row = |k: usize| &from[k * stride + first..][..columns];
                match (2 * p < k, 2 * p + 1 < k) {
                    (true, true) => {
                        let (upper, lower) = (row(2 * p), row(2 * p + 1));
                        if columns == SQUARE {
                            let (to, _) = pulp::as_arrays_mut::<SQUARE, _>(to);
                            let (upper, lower) =
                                (pulp::as_arrays::<SQUARE, _>(upper).0, pulp::as_arrays::<SQUARE, _>(lower).0);
                            for i in 0..SQUARE {
                                to[0][i] = pair(upper[0][i], lower[0][i]);
                            }
                        } else {
                            to.fill(0);
                            for ((to, x), y) in to.iter_mut().zip(upper).zip(lower) {
                                *to = pair(*x, *y);
                            }
                        }
                    }
                    (true, false) => {
                        to.fill(0);
                        to.iter_mut().zip(row(2 * p)).for_each(|(to, x)| *to = round(*x));
                    }
                    _ => to.fill(0),
                }
            }
        }
    }

    #[inline(always)]
    fn panels_transposed(self) {
        let Pack { to, from, stride, k, n, .. } = self;
        let pairs = pairs(k);
        for (panel, first) in to.chunks_exact_mut(pairs * SQUARE).zip((0..n).step_by(SQUARE)) {
            let columns = SQUARE.min(n - first);
            if columns < SQUARE || !k.is_multiple_of(STEP) {
                panel.fill(0);
            }
            for group in (0..columns).step_by(8) {
                let high = 8.min(columns - group);
                // eight rows always, so that the loop unrolls; the last one again where there are fewer
                let row = |j: usize| &from[(first + group + j.min(high - 1)) * stride..][..k];
                let rows: [&[f32]; 8] = [row(0), row(1), row(2), row(3), row(4), row(5), row(6), row(7)];
                for (p, to) in panel.chunks_exact_mut(SQUARE).take(k / 2).enumerate() {
                    let mut words = [0; 8];
                    for j in 0..8 {
                        words[j] = pair(rows[j][2 * p], rows[j][2 * p + 1]);
                    }
                    to[group..group + high].copy_from_slice(&words[..high]);
                }
                if k % 2 == 1 {
                    for j in 0..high {
                        panel[k / 2 * SQUARE + group + j] = round(rows[j][k - 1]);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn rows(self, lda: usize) {
        let Pack { to, from, stride, k, n, .. } = self;
        for i in 0..n {
            let halves: &mut [u16] = bytemuck::cast_slice_mut(&mut to[i * lda..][..pairs(k)]);
            let from = &from[i * stride..][..k];
            let (some, rest) = halves.split_at_mut(k);
            for (to, x) in some.iter_mut().zip(from) {
                *to = round(*x) as u16;
            }
            rest.fill(0);
        }
    }

    #[inline(always)]
    fn rows_transposed(self, lda: usize) {
        let Pack { to, from, stride, k, n, .. } = self;
        for first in (0..n).step_by(SIDE) {
            let high = SIDE.min(n - first);
            let mut p = 0;
            while p < pairs(k) {
                // eight pairs of sixteen columns: transposed in registers, stored as eight words a row
                let mut square = [[0; SIDE]; 8];
                for (q, words) in square.iter_mut().enumerate() {
                    let k0 = 2 * (p + q);
                    if k0 + 1 < k && high == SIDE {
                        let upper = pulp::as_arrays::<SIDE, _>(&from[k0 * stride + first..][..SIDE]).0[0];
                        let lower = pulp::as_arrays::<SIDE, _>(&from[(k0 + 1) * stride + first..][..SIDE]).0[0];
                        for i in 0..SIDE {
                            words[i] = pair(upper[i], lower[i]);
                        }
                    } else {
                        for (i, word) in words.iter_mut().enumerate().take(high) {
                            let at = |k0: usize| if k0 < k { round(from[k0 * stride + first + i]) } else { 0 };
                            *word = at(k0) | at(k0 + 1) << 16;
                        }
                    }
                }
                for i in 0..high {
                    let to = &mut to[(first + i) * lda + p..][..8];
                    for q in 0..8 {
                        to[q] = square[q][i];
                    }
                }
                p += 8;
            }
        }
    }
}
