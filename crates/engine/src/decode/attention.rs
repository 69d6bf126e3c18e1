//! Attention of a block's tokens over all tokens of their stream so far, one head at a time.

use super::apart::{APART, Apart, Single};
use super::cache::{Run, Store, Stored, Unit};
use super::kernel::{Left, Product};
use crate::dispatch;
use crate::op::math::{LaneSums, exp_falling, largest};
use crate::op::rope::Angles;
use pulp::{Simd, WithSimd};

/// Rows whose scores are in memory at a time.
pub(super) const SCORE_ROWS: usize = 24; // four tiles of the kernel's six rows: each key is read once for all of them

/// The rows of a pass in one head.
pub(super) struct Head<'a> {
    /// (m) rows of query, key and value (d each); the queries are scaled in place.
    pub qkv: &'a mut [f32],
    /// From a row to the next.
    pub stride: usize,
    /// (m, padded): becomes what each row attends to.
    pub out: &'a mut [f32],
    /// The streams of the rows.
    pub runs: &'a [Run],
    /// Rotary positions of the rows, if they have any.
    pub rotary: Option<(&'a Angles, &'a [u32])>,
    /// [`SCORE_ROWS`] rows of T, whole panels.
    pub scores: &'a mut [f32],
}

impl Head<'_> {
    /// Stores the keys, rotated, and values of the rows in the units of their streams, and lets each row attend to all
    /// places of its stream up to its own.
    pub fn attend<E: Stored>(mut self, cache: &mut [E], unit: Unit) {
        let (mut first, mut runs) = (0, self.runs);
        while let [run, ..] = runs {
            let singles = singles(runs);
            let (now, later) = runs.split_at(singles.max(1));
            let rows = if singles > 1 { singles } else { run.rows };
            for (row, (stream, place)) in (first..).zip(places(now)) {
                self.store(row, &mut cache[unit.of::<E>(stream)], unit, place);
            }
            if singles > 1 {
                self.apart(first, now, cache, unit);
            } else {
                self.together(first, *run, &cache[unit.of::<E>(run.stream)], unit);
            }
            (first, runs) = (first + rows, later);
        }
    }

    /// Stores key and value of a row, and scales its query.
    fn store<E: Stored>(&mut self, row: usize, cache: &mut [E], unit: Unit, place: usize) {
        let d = unit.d;
        let qkv = &mut self.qkv[row * self.stride..][..3 * d];
        if let Some((angles, positions)) = self.rotary {
            angles.rotate(&mut qkv[..d], positions[row]);
            angles.rotate(&mut qkv[d..2 * d], positions[row]);
        }
        let (key, value) = qkv[d..].split_at(d);
        dispatch::run(Store { cache, unit, place, key, value });
        // half floats come 2^112 times too small from the cache (`Element::pair`): queries make up for it
        let factor = E::LEFT / (d as f32).sqrt();
        qkv[..d].iter_mut().for_each(|q| *q *= factor);
    }

    /// The rows of one stream, from `first` on.
    fn together<E: Stored>(&mut self, first: usize, run: Run, cache: &[E], unit: Unit) {
        let Unit { tokens, d, padded, panel } = unit;
        let (keys, values, [key_scales, value_scales]) = unit.split(cache);
        for done in (0..run.rows).step_by(SCORE_ROWS) {
            let (row, rows) = (first + done, SCORE_ROWS.min(run.rows - done));
            let before = run.place + done;
            // the last row's reach: earlier rows get the keys in between as weights of 0
            let seen = before + rows;
            let count = seen.div_ceil(panel);
            let columns = count * panel;
            dispatch::run(Product {
                c: self.scores,
                ldc: tokens,
                left: Left::whole(&self.qkv[row * self.stride..], rows, d, self.stride),
                k: d,
                panels: &keys[..columns * d],
                panel_stride: panel * d,
                count,
                // whole panels, though the last may hold keys of an earlier stream: the softmax hides them
                scale: key_scales.get(..columns).unwrap_or_default(),
                bias: &[],
            });
            let factors = value_scales.get(..columns).unwrap_or_default();
            let mut of_rows = [Weights::default(); SCORE_ROWS];
            let of_rows = &mut of_rows[..rows];
            for (i, row) in of_rows.iter_mut().enumerate() {
                *row = Weights { seen: before + i + 1, factors, sum: 0.0 };
            }
            dispatch::run(Softmax { scores: self.scores, stride: tokens, columns, factor: E::LEFT, rows: of_rows });
            let out = &mut self.out[row * padded..][..rows * padded];
            dispatch::run(Product {
                c: out,
                ldc: padded,
                left: Left::whole(self.scores, rows, tokens, tokens),
                k: seen,
                panels: values,
                panel_stride: tokens * panel,
                count: padded / panel,
                scale: &[],
                bias: &[],
            });
            divide(out, padded, of_rows);
        }
    }

    /// A row each of some streams, from `first` on.
    fn apart<E: Stored>(&mut self, first: usize, runs: &[Run], cache: &[E], unit: Unit) {
        let Unit { tokens, d, padded, panel } = unit;
        let units = || runs.iter().map(|run| unit.split(&cache[unit.of::<E>(run.stream)]));
        let columns = |run: &Run| (run.place + 1).next_multiple_of(panel);
        let mut rows = [const { None }; APART];
        let queries = self.qkv[first * self.stride..].chunks(self.stride);
        let scores = self.scores.chunks_mut(tokens).zip(queries).zip(runs).zip(units());
        for (row, (((c, query), run), (keys, _, [scales, _]))) in rows.iter_mut().zip(scores) {
            let scale = scales.get(..columns(run)).unwrap_or_default();
            let (c, left) = (&mut c[..columns(run)], &query[..d]);
            *row = Some(Single { c, left, panels: keys, panel_stride: panel * d, scale });
        }
        dispatch::run(Apart(&mut rows));
        let most = runs.iter().map(columns).max().unwrap_or(0);
        let mut of_rows = [Weights::default(); APART];
        let of_rows = &mut of_rows[..runs.len()];
        for ((row, run), (_, _, [_, scales])) in of_rows.iter_mut().zip(runs).zip(units()) {
            *row = Weights { seen: run.place + 1, factors: scales.get(..most).unwrap_or_default(), sum: 0.0 };
        }
        dispatch::run(Softmax { scores: self.scores, stride: tokens, columns: most, factor: E::LEFT, rows: of_rows });
        let mut rows = [const { None }; APART];
        let out = &mut self.out[first * padded..][..runs.len() * padded];
        let values = out.chunks_mut(padded).zip(self.scores.chunks(tokens)).zip(runs).zip(units());
        for (row, (((c, scores), run), (_, values, _))) in rows.iter_mut().zip(values) {
            let left = &scores[..=run.place];
            *row = Some(Single { c, left, panels: values, panel_stride: tokens * panel, scale: &[] });
        }
        dispatch::run(Apart(&mut rows));
        divide(out, padded, of_rows);
    }
}

/// How many of the first runs are single rows, of streams of their own.
fn singles(runs: &[Run]) -> usize {
    let is_single = |i: &usize| runs[*i].rows == 1 && runs[..*i].iter().all(|run| run.stream != runs[*i].stream);
    (0..runs.len().min(APART)).take_while(is_single).count()
}

/// The stream and the place of each row.
fn places(runs: &[Run]) -> impl Iterator<Item = (usize, usize)> {
    runs.iter().flat_map(|run| (run.place..run.place + run.rows).map(|place| (run.stream, place)))
}

/// Divides rows by the sums of their weights: d numbers a row, instead of its T weights.
fn divide(out: &mut [f32], padded: usize, rows: &[Weights]) {
    for (row, Weights { sum, .. }) in out.chunks_mut(padded).zip(rows) {
        row.iter_mut().for_each(|x| *x /= sum);
    }
}

/// The weights of a row.
#[derive(Debug, Clone, Copy, Default)]
struct Weights<'a> {
    /// Places that it sees.
    seen: usize,
    /// A factor for each column, or none.
    factors: &'a [f32],
    /// Becomes their sum, without factors.
    sum: f32,
}

/// Rows of scores become e^(score - largest) times `factor` and those of their columns, 0 after what a row sees. All have
/// `columns`, which are whole panels.
struct Softmax<'a, 'b> {
    scores: &'a mut [f32],
    stride: usize,
    columns: usize,
    factor: f32,
    rows: &'a mut [Weights<'b>],
}

impl WithSimd for Softmax<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (row, Weights { seen, factors, sum }) in self.scores.chunks_mut(self.stride).zip(self.rows) {
            // later rows, whose values the next product reads too, and the rest of the last panel: e^-infinity is 0
            row[*seen..self.columns].fill(f32::NEG_INFINITY);
            let (row, _) = S::as_mut_simd_f32s(&mut row[..self.columns]);
            let mut most = simd.splat_f32s(f32::NEG_INFINITY);
            for x in row.iter() {
                most = simd.max_f32s(most, *x);
            }
            let most = simd.splat_f32s(largest(simd, most));
            let factor = simd.splat_f32s(self.factor);
            let mut all = LaneSums::new(simd);
            for x in row.chunks_mut(LaneSums::<S>::VECTORS) {
                for x in x.iter_mut() {
                    *x = exp_falling(simd, simd.sub_f32s(*x, most));
                }
                all.update(x, |sum, x| simd.add_f32s(sum, x));
                for x in x {
                    *x = simd.mul_f32s(*x, factor);
                }
            }
            *sum = all.total(simd);
            for (x, factor) in row.iter_mut().zip(S::as_simd_f32s(factors).0) {
                *x = simd.mul_f32s(*x, *factor);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, numbers};

    #[test]
    fn weights_have_the_same_bits_on_all_vectors() {
        let (columns, stride) = (96, 128);
        let (scores, factors) = (numbers(1, 3 * stride, 9.0), numbers(2, columns, 1.0));
        let all = Lanes::fused().map(|lanes| {
            let mut scores = scores.clone();
            let mut rows = [3, 77, 96].map(|seen| Weights { seen, factors: &factors, sum: 0.0 });
            lanes.run(Softmax { scores: &mut scores, stride, columns, factor: 2.0, rows: &mut rows });
            (scores, rows.map(|row| row.sum))
        });
        let all: Vec<_> = all.collect();
        assert!(all.iter().all(|one| one == &all[0]));
        // and they are what they are meant to be
        let (weights, sums) = &all[0];
        for (i, seen) in [3, 77, 96].into_iter().enumerate() {
            let row = &scores[i * stride..][..columns];
            let most = row[..seen].iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let expected = |j: usize| if j < seen { f64::from(row[j] - most).exp() } else { 0.0 };
            let sum: f64 = (0..columns).map(expected).sum();
            assert!((f64::from(sums[i]) / sum - 1.0).abs() < 1e-6, "row {i}");
            for j in 0..columns {
                let expected = expected(j) * 2.0 * f64::from(factors[j]);
                assert!((f64::from(weights[i * stride + j]) - expected).abs() < 1e-6, "row {i}, column {j}");
            }
        }
    }
}
