//! The softmax of a tile's rows and its gradient; everything else of attention is products.

use super::{ROW, STEP, Tile};
use crate::op::{dropout, math};
use pulp::{Simd, WithSimd};

/// A tile of a mask: from the tile's first query and key on, a row every `stride` numbers.
#[derive(Clone, Copy)]
pub(super) struct Bias<'a> {
    pub numbers: &'a [f32],
    pub stride: usize,
}

/// A tile of a dropout.
#[derive(Clone, Copy)]
pub(super) struct Drops {
    pub key: u64,
    /// Of the tile's first query and key.
    pub row: u64,
    pub column: u32,
    pub threshold: u32,
    pub growth: f32,
}

/// A tile's scores become weights e^(score - largest so far), not yet divided by their sum.
pub(super) struct Softmax<'a> {
    pub tile: Tile,
    /// (rows, ROW).
    pub scores: &'a mut [f32],
    pub bias: Option<Bias<'a>>,
    pub drops: Option<Drops>,
    /// A number a row, as earlier keys left it; -infinity and 0 before the first.
    pub largest: &'a mut [f32],
    pub sums: &'a mut [f32],
    /// (rows, d): earlier keys' weighted values, here scaled to the new largest score.
    pub out: &'a mut [f32],
}

impl WithSimd for Softmax<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let d = self.out.len() / self.tile.rows;
        // all rows' largest scores first: the exponentials of a row need not wait for its own
        let mut bases = [0.0; STEP];
        let state = self.largest.iter_mut().zip(self.sums.iter_mut()).zip(self.out.chunks_exact_mut(d));
        for (i, (scores, ((largest, sum), out))) in self.scores.chunks_mut(ROW).zip(state).enumerate() {
            let scores = seen::<S>(simd, self.tile, i, scores, self.bias);
            let before = *largest;
            *largest = before.max(greatest(simd, scores));
            // where nothing was seen yet, e^(-inf - 0) is 0; e^(-inf + inf) would be no number
            bases[i] = if *largest == f32::NEG_INFINITY { 0.0 } else { *largest };
            if self.tile.key > 0 && bases[i] != before {
                let shrink = (before - bases[i]).exp();
                *sum *= shrink;
                out.iter_mut().for_each(|x| *x *= shrink);
            }
        }
        let columns = self.tile.columns.next_multiple_of(S::F32_LANES);
        let rows = self.scores.chunks_mut(ROW).zip(bases).zip(self.sums);
        for (i, ((scores, base), sum)) in rows.enumerate() {
            let scores = S::as_mut_simd_f32s(&mut scores[..columns]).0;
            let total = weights(simd, scores, base);
            // before the dropout: weights are normalised over all keys, then dropped
            *sum = if self.tile.key == 0 { total } else { *sum + total };
            if let Some(drops) = self.drops {
                let factors = drops.row(i);
                for (vector, weight) in scores.iter_mut().enumerate() {
                    *weight = simd.mul_f32s(*weight, factors.at(simd, vector));
                }
            }
        }
    }
}

/// A tile's scores become weights after dropout, and the gradients of weights those of scores.
pub(super) struct SoftmaxBack<'a> {
    pub tile: Tile,
    /// (rows, ROW).
    pub scores: &'a mut [f32],
    /// (rows, ROW): gradient of each weight.
    pub changes: &'a mut [f32],
    pub bias: Option<Bias<'a>>,
    pub drops: Option<Drops>,
    /// A number a row: the logarithm of the sum of e^score, and the sum of weight times its gradient.
    pub log_sums: &'a [f32],
    pub means: &'a [f32],
}

impl WithSimd for SoftmaxBack<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let rows = self.scores.chunks_mut(ROW).zip(self.changes.chunks_mut(ROW));
        for (i, ((scores, changes), (log_sum, mean))) in rows.zip(self.log_sums.iter().zip(self.means)).enumerate() {
            let scores = seen::<S>(simd, self.tile, i, scores, self.bias);
            let changes = S::as_mut_simd_f32s(changes).0;
            let (log_sum, mean) = (simd.splat_f32s(*log_sum), simd.splat_f32s(*mean));
            let Some(drops) = self.drops else {
                for (score, change) in scores.iter_mut().zip(changes) {
                    *score = math::exp_falling(simd, simd.sub_f32s(*score, log_sum));
                    *change = simd.mul_f32s(*score, simd.sub_f32s(*change, mean));
                }
                continue;
            };
            let factors = drops.row(i);
            for (vector, (score, change)) in scores.iter_mut().zip(changes).enumerate() {
                let (weight, factor) =
                    (math::exp_falling(simd, simd.sub_f32s(*score, log_sum)), factors.at(simd, vector));
                *score = simd.mul_f32s(weight, factor);
                // the mean has the factors in it already, as the output has from which `Means` takes it
                *change = simd.mul_f32s(weight, simd.mul_add_e_f32s(*change, factor, simd.neg_f32s(mean)));
            }
        }
    }
}

impl Drops {
    #[inline(always)]
    fn row(self, row: usize) -> Factors {
        Factors { row_key: dropout::row_key(self.key, self.row + row as u64), drops: self }
    }
}

/// The factors of a row's weights: 0 or the growth.
#[derive(Clone, Copy)]
struct Factors {
    row_key: u32,
    drops: Drops,
}

impl Factors {
    #[inline(always)]
    fn at<S: Simd>(self, simd: S, vector: usize) -> S::f32s {
        let Drops { column, threshold, growth, .. } = self.drops;
        let column = column.wrapping_add((vector * S::F32_LANES) as u32);
        dropout::factors(simd, self.row_key, column, threshold, growth)
    }
}

/// The sum of each weight of a query times its gradient, which is that of its output times the output's own.
pub(super) struct Means<'a> {
    /// A number a row.
    pub means: &'a mut [f32],
    /// (rows, d) each, the second with a row every `stride` numbers.
    pub out: &'a [f32],
    pub d_out: &'a [f32],
    pub stride: usize,
}

impl WithSimd for Means<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let d = self.out.len() / self.means.len();
        let rows = self.out.chunks_exact(d).zip(self.d_out.chunks(self.stride));
        for (mean, (out, d_out)) in self.means.iter_mut().zip(rows) {
            let (out, out_rest) = S::as_simd_f32s(out);
            let (d_out, d_rest) = S::as_simd_f32s(&d_out[..d]);
            // partial loads fill with 0: an empty rest begins the sum with 0
            let mut sum = simd.mul_f32s(simd.partial_load_f32s(out_rest), simd.partial_load_f32s(d_rest));
            for (x, slope) in out.iter().zip(d_out) {
                sum = simd.mul_add_e_f32s(*x, *slope, sum);
            }
            *mean = math::sum(simd, sum);
        }
    }
}

/// A row of scores in whole vectors, hidden keys at -infinity, the mask added.
#[inline(always)]
fn seen<'a, S: Simd>(simd: S, tile: Tile, row: usize, scores: &'a mut [f32], bias: Option<Bias>) -> &'a mut [S::f32s] {
    let (lanes, visible) = (S::F32_LANES, tile.visible(row));
    // ROW has room for the last vector, and the product of earlier tiles may have left anything there
    let scores = &mut scores[..tile.columns.next_multiple_of(lanes)];
    scores[visible..].fill(f32::NEG_INFINITY);
    let scores = S::as_mut_simd_f32s(scores).0;
    if let Some(bias) = bias {
        let (bias, rest) = S::as_simd_f32s(&bias.numbers[row * bias.stride..][..visible]);
        let rest = (!rest.is_empty()).then(|| simd.partial_load_f32s(rest));
        for (score, bias) in scores.iter_mut().zip(bias.iter().copied().chain(rest)) {
            *score = simd.add_f32s(*score, bias);
        }
    }
    scores
}

#[inline(always)]
fn greatest<S: Simd>(simd: S, numbers: &[S::f32s]) -> f32 {
    // four, as a maximum waits some cycles for the last one
    let mut greatest = [simd.splat_f32s(f32::NEG_INFINITY); 4];
    let (fours, rest) = pulp::as_arrays::<4, _>(numbers);
    for four in fours {
        for (greatest, x) in greatest.iter_mut().zip(four) {
            *greatest = simd.max_f32s(*greatest, *x);
        }
    }
    for x in rest {
        greatest[0] = simd.max_f32s(greatest[0], *x);
    }
    let [a, b, c, d] = greatest;
    math::largest(simd, simd.max_f32s(simd.max_f32s(a, b), simd.max_f32s(c, d)))
}

/// Each score becomes e^(score - base); gives their sum.
#[inline(always)]
fn weights<S: Simd>(simd: S, scores: &mut [S::f32s], base: f32) -> f32 {
    let base = simd.splat_f32s(base);
    let mut sums = [simd.splat_f32s(0.0); 2];
    let (pairs, rest) = pulp::as_arrays_mut::<2, _>(scores);
    for pair in pairs {
        for (score, sum) in pair.iter_mut().zip(&mut sums) {
            *score = math::exp_falling(simd, simd.sub_f32s(*score, base));
            *sum = simd.add_f32s(*sum, *score);
        }
    }
    for score in rest {
        *score = math::exp_falling(simd, simd.sub_f32s(*score, base));
        sums[0] = simd.add_f32s(sums[0], *score);
    }
    math::sum(simd, simd.add_f32s(sums[0], sums[1]))
}
