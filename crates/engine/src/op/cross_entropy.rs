//! Cross-entropy of rows of logits. The gradient, (softmax - one-hot) scale, overwrites the logits, so a head can work
//! through its rows chunk by chunk.
//!
//! A logit of -inf is an id that can't follow, as is a column outside those that a row can have. Rows with NaN or +inf have
//! a loss of NaN.

use super::math::{exp_falling, lanes_below, largest, sum};
use super::smoothing::Smoothing;
use crate::bins::Bins;
use crate::dispatch;
use pulp::{Simd, WithSimd};

/// The target of a row of logits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RowTarget {
    /// The right column.
    pub target: u32,
    /// The first of the columns that can follow.
    pub first: u32,
    /// How many can follow; all others have probability 0.
    pub count: u32,
    /// The bins among which the target may be smoothed.
    pub bins: Bins,
}

/// The sum of -ln p of the `targets` (R) of the rows of `logits` (R, C), in nats; `logits` become its gradient times `scale`, 0
/// in the columns that can't follow. With `smoothing` the gradient is that of the cross-entropy with the smoothed targets.
///
/// # Panics
/// If shapes don't fit, or targets or bins are outside the columns that can follow.
pub fn forward_backward(logits: &mut [f32], targets: &[RowTarget], smoothing: Option<&Smoothing>, scale: f32) -> f64 {
    let columns = columns(logits.len(), targets.len());
    check_targets(columns, targets);
    dispatch::run(ForwardBackward { logits, columns, targets, smoothing, scale })
}

/// Writes -ln p of each of the `targets` (R) of the rows of `logits` (R, C), in nats.
///
/// # Panics
/// As [`forward_backward`], and where `nats` (R) has another length.
pub fn row_nats(nats: &mut [f64], logits: &[f32], targets: &[RowTarget]) {
    let columns = columns(logits.len(), targets.len());
    check_targets(columns, targets);
    assert!(nats.len() == targets.len(), "cross-entropy: {} results for {} rows", nats.len(), targets.len());
    dispatch::run(Nats { nats, logits, columns, targets: |row: usize| Some(targets[row]) });
}

/// Writes -ln p(target) for each row of `logits` (R, V), in nats, 0 for the rows whose target is `ignored`.
///
/// # Panics
/// If shapes don't fit, or a target is neither below V nor `ignored`.
pub fn nats(nats: &mut [f64], logits: &[f32], targets: &[u32], ignored: u32) {
    let columns = columns(logits.len(), targets.len());
    if let Some(wrong) = targets.iter().find(|t| **t != ignored && **t as usize >= columns) {
        panic!("cross-entropy: target {wrong} outside the vocabulary of {columns} ids");
    }
    assert!(nats.len() == targets.len(), "cross-entropy: {} results for {} rows", nats.len(), targets.len());
    let target_of = |target| RowTarget { target, first: 0, count: columns as u32, bins: Bins::NONE };
    let targets = |row: usize| (targets[row] != ignored).then(|| target_of(targets[row]));
    dispatch::run(Nats { nats, logits, columns, targets });
}

/// C.
fn columns(logits: usize, rows: usize) -> usize {
    if rows == 0 {
        assert!(logits == 0, "cross-entropy: {logits} logits for no rows");
        return 1;
    }
    assert!(logits.is_multiple_of(rows), "cross-entropy: {logits} logits for {rows} rows");
    // an ignored target may have any id
    (logits / rows).max(1)
}

fn check_targets(columns: usize, targets: &[RowTarget]) {
    let inside = |RowTarget { target, first, count, bins }: &RowTarget| {
        let end = first + count;
        let bins_end = bins.first + bins.count;
        let neighbours =
            bins.count == 0 || (bins.first..bins_end).contains(target) && *first <= bins.first && bins_end <= end;
        end as usize <= columns && (*first..end).contains(target) && neighbours
    };
    if let Some(wrong) = targets.iter().find(|a| !inside(a)) {
        panic!("cross-entropy: {wrong:?} of {columns} columns");
    }
}

struct ForwardBackward<'a> {
    logits: &'a mut [f32],
    columns: usize,
    targets: &'a [RowTarget],
    smoothing: Option<&'a Smoothing>,
    scale: f32,
}

impl WithSimd for ForwardBackward<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let ForwardBackward { logits, columns, targets, smoothing, scale } = self;
        let mut all = 0.0;
        for (row, &RowTarget { target, first, count, bins }) in logits.chunks_exact_mut(columns).zip(targets) {
            let can = &mut row[first as usize..][..count as usize];
            let most = most(simd, can);
            // before `powers` overwrites the row
            let aim = can[(target - first) as usize];
            let sum = powers(simd, can, most);
            // in f64: a batch adds some thousand costs
            all += cost(sum, most, aim);
            scaled(simd, can, scale / sum);
            row[..first as usize].fill(0.0);
            row[(first + count) as usize..].fill(0.0);
            match smoothing {
                None => row[target as usize] -= scale,
                Some(smoothing) => {
                    smoothing.shares(target, bins, |column, share| row[column as usize] -= scale * share as f32);
                }
            }
        }
        all
    }
}

struct Nats<'a, F> {
    nats: &'a mut [f64],
    logits: &'a [f32],
    columns: usize,
    /// A row's target; `None` if it is ignored.
    targets: F,
}

impl<F: Fn(usize) -> Option<RowTarget>> WithSimd for Nats<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Nats { nats, logits, columns, targets } = self;
        nats.fill(0.0);
        for (i, (nats, row)) in nats.iter_mut().zip(logits.chunks_exact(columns)).enumerate() {
            if let Some(RowTarget { target, first, count, .. }) = targets(i) {
                let can = &row[first as usize..][..count as usize];
                let most = most(simd, can);
                *nats = cost(sum_of_powers(simd, can, most), most, row[target as usize]);
            }
        }
    }
}

/// -ln p, given the sum of e^(logit - most).
#[inline(always)]
fn cost(sum: f32, most: f32, aim: f32) -> f64 {
    // the largest power is 1, so sum >= 1 and its logarithm loses nothing; an impossible target costs +infinity
    (sum as f64).ln() + (most as f64 - aim as f64)
}

/// The largest logit.
#[inline(always)]
fn most<S: Simd>(simd: S, row: &[f32]) -> f32 {
    let (vectors, tail) = S::as_simd_f32s(row);
    let (fours, rest) = vectors.as_chunks::<4>();
    let mut most = [simd.splat_f32s(f32::NEG_INFINITY); 4];
    for four in fours {
        for (m, x) in most.iter_mut().zip(four) {
            *m = simd.max_f32s(*m, *x);
        }
    }
    for x in rest {
        most[0] = simd.max_f32s(most[0], *x);
    }
    let most = simd.max_f32s(simd.max_f32s(most[0], most[1]), simd.max_f32s(most[2], most[3]));
    // NaN may be lost here; then its own power is NaN, and so are sum and cost
    tail.iter().fold(largest(simd, most), |m, &x| m.max(x))
}

/// The row becomes e^(logit - most); their sum.
#[inline(always)]
fn powers<S: Simd>(simd: S, row: &mut [f32], most: f32) -> f32 {
    let most = simd.splat_f32s(most);
    let (vectors, tail) = S::as_mut_simd_f32s(row);
    let (pairs, rest) = vectors.as_chunks_mut::<2>();
    let mut sums = [simd.splat_f32s(0.0); 2];
    for pair in pairs {
        for (s, x) in sums.iter_mut().zip(pair) {
            *x = exp_falling(simd, simd.sub_f32s(*x, most));
            *s = simd.add_f32s(*s, *x);
        }
    }
    for x in rest {
        *x = exp_falling(simd, simd.sub_f32s(*x, most));
        sums[0] = simd.add_f32s(sums[0], *x);
    }
    if !tail.is_empty() {
        let power = tail_powers(simd, tail, most);
        simd.partial_store_f32s(tail, power);
        sums[1] = simd.add_f32s(sums[1], power);
    }
    sum(simd, simd.add_f32s(sums[0], sums[1]))
}

/// As [`powers`], bit for bit, and the row stays.
#[inline(always)]
fn sum_of_powers<S: Simd>(simd: S, row: &[f32], most: f32) -> f32 {
    let most = simd.splat_f32s(most);
    let (vectors, tail) = S::as_simd_f32s(row);
    let (pairs, rest) = vectors.as_chunks::<2>();
    let mut sums = [simd.splat_f32s(0.0); 2];
    for pair in pairs {
        for (s, x) in sums.iter_mut().zip(pair) {
            *s = simd.add_f32s(*s, exp_falling(simd, simd.sub_f32s(*x, most)));
        }
    }
    for x in rest {
        sums[0] = simd.add_f32s(sums[0], exp_falling(simd, simd.sub_f32s(*x, most)));
    }
    if !tail.is_empty() {
        sums[1] = simd.add_f32s(sums[1], tail_powers(simd, tail, most));
    }
    sum(simd, simd.add_f32s(sums[0], sums[1]))
}

/// 0 in the lanes after the tail.
#[inline(always)]
fn tail_powers<S: Simd>(simd: S, tail: &[f32], most: S::f32s) -> S::f32s {
    let power = exp_falling(simd, simd.sub_f32s(simd.partial_load_f32s(tail), most));
    simd.select_f32s(lanes_below(simd, tail.len()), power, simd.splat_f32s(0.0))
}

#[inline(always)]
fn scaled<S: Simd>(simd: S, row: &mut [f32], factor: f32) {
    let (vectors, tail) = S::as_mut_simd_f32s(row);
    for x in vectors {
        *x = simd.mul_f32s(*x, simd.splat_f32s(factor));
    }
    tail.iter_mut().for_each(|x| *x *= factor);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, near, numbers};
    use crate::scalar::cross_entropy as scalar;

    /// An exponential and a sum of up to 5000 terms in at least one lane for each 250, relative to numbers up to 1.
    const BOUND: f64 = 2e-6;
    const IGNORED: u32 = 900_001;

    /// Rows that can have all columns, or some in the middle; targets with neighbours round a circle, up to ends, or none.
    fn targets(rows: usize, columns: usize) -> Vec<RowTarget> {
        let target_of = |r: usize| {
            let (first, last) = if r.is_multiple_of(2) { (0, columns) } else { (columns / 3, columns - columns / 5) };
            let (first, count) = (first as u32, (last - first) as u32);
            let target = first + (r * 7) as u32 % count;
            let bins = Bins { first, count, circular: r.is_multiple_of(3) };
            RowTarget { target, first, count, bins: if r % 5 == 4 { Bins::NONE } else { bins } }
        };
        (0..rows).map(target_of).collect()
    }

    /// Costs and gradients in f64.
    fn expected(
        logits: &[f32],
        targets: &[RowTarget],
        smoothing: Option<&Smoothing>,
        scale: f64,
    ) -> (Vec<f64>, Vec<f64>) {
        let rows = || logits.chunks(logits.len() / targets.len()).zip(targets);
        let can = |row: &[f32], a: &RowTarget| row[a.first as usize..][..a.count as usize].to_vec();
        let cost = |(row, a): (&[f32], &RowTarget)| scalar::nats(&can(row, a), a.target - a.first);
        let gradient = |(row, a): (&[f32], &RowTarget)| {
            let mut gradient = vec![0.0; row.len()];
            gradient[a.first as usize..][..a.count as usize].copy_from_slice(&scalar::probabilities(&can(row, a)));
            match smoothing {
                None => gradient[a.target as usize] -= 1.0,
                Some(s) => s.shares(a.target, a.bins, |column, share| gradient[column as usize] -= share),
            }
            gradient.iter().map(|g| g * scale).collect::<Vec<f64>>()
        };
        (rows().map(cost).collect(), rows().flat_map(gradient).collect())
    }

    #[test]
    fn costs_and_gradients_are_the_definition() {
        let shapes = (1..=67).map(|v| (9, v)).chain([(1, 1), (40, 400), (2, 5000)]);
        let smooth = Smoothing::new(0.75);
        for ((n, columns), lanes) in shapes.flat_map(|s| Lanes::ALL.map(|l| (s, l))) {
            for (range, shift, smoothing) in [(1.0, 0.0, Some(&smooth)), (20.0, 1000.0, None), (0.1, -3e4, None)] {
                let what = format!("{lanes:?} ({n}, {columns}) {range}");
                let mut logits: Vec<f32> = numbers(3, n * columns, range).iter().map(|x| x + shift).collect();
                let targets = targets(n, columns);
                let (costs, gradient) = expected(&logits, &targets, smoothing, 0.7);
                let mut found = vec![7.0; n];
                let target_of = |row: usize| Some(targets[row]);
                lanes.run(Nats { nats: &mut found, logits: &logits, columns, targets: target_of });
                let single: Vec<f32> = found.iter().map(|&x| x as f32).collect();
                near(&what, &single, &costs, BOUND);
                let (logits, targets) = (&mut logits, &targets);
                let sum = lanes.run(ForwardBackward { logits, columns, targets, smoothing, scale: 0.7 });
                assert_eq!(sum, found.iter().sum::<f64>(), "{what}");
                near(&what, logits, &gradient, BOUND);
            }
        }
    }

    #[test]
    fn some_ids_cannot_come_and_what_is_no_number_shows() {
        const OUT: f32 = f32::NEG_INFINITY;
        for (lanes, columns) in Lanes::ALL.iter().flat_map(|l| [8, 11, 64].map(|v| (l, v))) {
            let run = |row: &[f32], target| {
                let mut logits = row.to_vec();
                let targets = &[RowTarget { target, first: 0, count: columns as u32, bins: Bins::NONE }];
                let op = ForwardBackward { logits: &mut logits, columns, targets, smoothing: None, scale: 1.0 };
                (lanes.run(op), logits)
            };
            let mut row = vec![OUT; columns];
            row[1..4].fill(2.0);
            let (cost, gradient) = run(&row, 2);
            assert!((cost - 3f64.ln()).abs() < 1e-6, "{lanes:?}: {cost}");
            assert_eq!((gradient[0], gradient[columns - 1]), (0.0, 0.0));
            assert!((gradient[2] + 2.0 / 3.0).abs() < 1e-6);
            assert_eq!(run(&row, 0).0, f64::INFINITY);
            for bad in [f32::NAN, f32::INFINITY] {
                assert!(run(&vec![bad; columns], 1).0.is_nan(), "{lanes:?}");
                for place in 0..columns {
                    let mut row = numbers(4, columns, 90.0);
                    row[place] = bad;
                    assert!(run(&row, 1).0.is_nan(), "{lanes:?}: {bad} at {place}");
                }
            }
            assert!(run(&vec![OUT; columns], 1).0.is_nan());
        }
    }

    #[test]
    fn the_doors_count_and_check() {
        let mut logits = [0.0; 6];
        let target_of = |target, first, count| RowTarget { target, first, count, bins: Bins::NONE };
        let two =
            forward_backward(&mut logits, &[target_of(1, 0, 2), target_of(0, 0, 2), target_of(1, 1, 1)], None, 0.5);
        assert!((two - 2.0 * 2f64.ln()).abs() < 1e-12);
        assert_eq!(logits, [0.25, -0.25, -0.25, 0.25, 0.0, 0.0]);
        assert_eq!(forward_backward(&mut [], &[], None, 1.0), 0.0);
        let mut some = [9.0; 2];
        nats(&mut some, &[0.0; 4], &[IGNORED, 1], IGNORED);
        assert_eq!(some, [0.0, 2f64.ln()]);
        let said = |run: &dyn Fn()| {
            let wrong = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).unwrap_err();
            wrong.downcast_ref::<String>().unwrap().clone()
        };
        let message = said(&|| nats(&mut [0.0], &[0.0; 4], &[4], IGNORED));
        assert_eq!(message, "cross-entropy: target 4 outside the vocabulary of 4 ids");
        for wrong in [target_of(4, 0, 4), target_of(0, 1, 3), target_of(3, 2, 3)] {
            assert!(said(&|| row_nats(&mut [0.0], &[0.0; 4], &[wrong])).ends_with("of 4 columns"));
        }
    }
}
