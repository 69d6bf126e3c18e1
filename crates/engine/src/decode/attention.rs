//! Attention of a block's tokens over all tokens of their stream so far, one head at a time.

use super::cache::{Stored, Unit};
use super::kernel::{Left, Product};
use crate::dispatch;
use crate::op::math::{exp_falling, largest, sum};
use crate::op::rope::Angles;
use pulp::{Simd, WithSimd};

/// Rows whose scores are in memory at a time.
pub(super) const SCORE_ROWS: usize = 24; // four tiles of the kernel's six rows: each key is read once for all of them

/// Rows of queries, and their places in the stream.
pub(super) struct Queries<'a> {
    /// Rows of query, key and value (d each); the queries are scaled in place.
    pub qkv: &'a mut [f32],
    /// From a row to the next.
    pub stride: usize,
    /// The place of the first.
    pub place: usize,
    /// Rotary positions of the rows, if they have any.
    pub rotary: Option<(&'a Angles, &'a [u32])>,
}

/// Stores the keys, rotated, and values of `queries` (m rows) in the `unit` of the cache, and writes the attention of
/// each row over all places up to its own to `out` (m, padded). `scores` has [`SCORE_ROWS`] rows of T, whole panels.
pub(super) fn attend<E: Stored>(out: &mut [f32], queries: Queries, cache: &mut [E], unit: Unit, scores: &mut [f32]) {
    let Unit { tokens, d, padded, panel } = unit;
    let Queries { qkv, stride, place, rotary } = queries;
    // half floats come 2^112 times too small from the cache (`Element::pair`): queries make up for it
    let factor = E::LEFT / (d as f32).sqrt();
    for (i, row) in qkv.chunks_mut(stride).enumerate() {
        if let Some((angles, positions)) = rotary {
            angles.rotate(&mut row[..d], positions[i]);
            angles.rotate(&mut row[d..2 * d], positions[i]);
        }
        unit.store(cache, place + i, &row[d..2 * d], &row[2 * d..3 * d]);
        row[..d].iter_mut().for_each(|q| *q *= factor);
    }
    let (keys, values) = unit.split(cache);
    for (i, (qkv, out)) in qkv.chunks(SCORE_ROWS * stride).zip(out.chunks_mut(SCORE_ROWS * padded)).enumerate() {
        let rows = qkv.len().div_ceil(stride);
        let first = place + i * SCORE_ROWS;
        // the last row's reach: earlier rows get the keys in between as weights of 0
        let seen = first + rows;
        let count = seen.div_ceil(panel);
        dispatch::run(Product {
            c: scores,
            ldc: tokens,
            left: Left::whole(qkv, rows, d, stride),
            k: d,
            panels: &keys[..count * panel * d],
            panel_stride: panel * d,
            count,
            // whole panels, though the last may hold keys of an earlier stream: the softmax hides them
            scale: &[],
            bias: &[],
        });
        let mut sums = [0.0; SCORE_ROWS];
        let columns = count * panel;
        dispatch::run(Softmax { scores, stride: tokens, columns, first, factor: E::LEFT, sums: &mut sums[..rows] });
        dispatch::run(Product {
            c: out,
            ldc: padded,
            left: Left::whole(scores, rows, tokens, tokens),
            k: seen,
            panels: values,
            panel_stride: tokens * panel,
            count: padded / panel,
            scale: &[],
            bias: &[],
        });
        // d numbers a row are divided here, instead of its T weights
        for (row, sum) in out.chunks_mut(padded).zip(sums) {
            row.iter_mut().for_each(|x| *x /= sum);
        }
    }
}

/// Rows of scores become e^(score - largest) times `factor`, 0 after the row's own place; `sums` gets the sums without
/// the factor. Row i sees `first + i + 1` columns of `columns`, which are whole panels.
struct Softmax<'a> {
    scores: &'a mut [f32],
    stride: usize,
    columns: usize,
    first: usize,
    factor: f32,
    sums: &'a mut [f32],
}

impl WithSimd for Softmax<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (i, (row, total)) in self.scores.chunks_mut(self.stride).zip(self.sums).enumerate() {
            // later rows, whose values the next product reads too, and the rest of the last panel: e^-infinity is 0
            row[self.first + i + 1..self.columns].fill(f32::NEG_INFINITY);
            let (row, _) = S::as_mut_simd_f32s(&mut row[..self.columns]);
            let mut most = simd.splat_f32s(f32::NEG_INFINITY);
            for x in row.iter() {
                most = simd.max_f32s(most, *x);
            }
            let most = simd.splat_f32s(largest(simd, most));
            let factor = simd.splat_f32s(self.factor);
            let mut all = simd.splat_f32s(0.0);
            for x in row.iter_mut() {
                let e = exp_falling(simd, simd.sub_f32s(*x, most));
                all = simd.add_f32s(all, e);
                *x = simd.mul_f32s(e, factor);
            }
            *total = sum(simd, all);
        }
    }
}
