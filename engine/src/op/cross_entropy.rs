//! Cross-entropy of rows of logits (R, V) with their targets (R), the rows whose target is `ignored` left out. The
//! gradient, (softmax - one-hot) scale, takes the logits' place, so a head can work through its rows chunk by chunk and
//! needs no room for all of them.
//!
//! A logit of -inf is an id that cannot come. Rows with NaN or +inf cost NaN.

use super::math::{exp_falling, lanes_below, largest, sum};
use super::smoothing::Bins;
use crate::dispatch;
use pulp::{Simd, WithSimd};

/// What a row of logits is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Asked {
    /// The right column.
    pub target: u32,
    /// The first of the columns that can come.
    pub first: u32,
    /// How many can come; all others have probability 0.
    pub count: u32,
    /// The bins that the target is one of.
    pub bins: Bins,
}

/// How many targets count.
pub fn counted(targets: &[u32], ignored: u32) -> usize {
    targets.iter().filter(|t| **t != ignored).count()
}

/// The sum of -ln p(target), in nats; `logits` become their gradient times `scale`, 0 in the rows left out.
///
/// # Panics
/// Shapes that don't fit; a target that is neither below V nor `ignored`.
pub fn forward_backward(logits: &mut [f32], targets: &[u32], ignored: u32, scale: f32) -> f64 {
    let vocabulary = check(logits.len(), targets, ignored);
    dispatch::run(ForwardBackward { logits, vocabulary, targets, ignored, scale })
}

/// Writes -ln p(target) for each row, in nats, 0 for the rows left out.
///
/// # Panics
/// As [`forward_backward`], and where `nats` (R) has another length.
pub fn nats(nats: &mut [f64], logits: &[f32], targets: &[u32], ignored: u32) {
    let vocabulary = check(logits.len(), targets, ignored);
    assert!(nats.len() == targets.len(), "cross-entropy: {} results for {} rows", nats.len(), targets.len());
    dispatch::run(Nats { nats, logits, vocabulary, targets, ignored });
}

/// V.
fn check(logits: usize, targets: &[u32], ignored: u32) -> usize {
    if targets.is_empty() {
        assert!(logits == 0, "cross-entropy: {logits} logits without targets");
        return 1;
    }
    assert!(logits.is_multiple_of(targets.len()), "cross-entropy: {logits} logits for {} targets", targets.len());
    let vocabulary = logits / targets.len();
    if let Some(wrong) = targets.iter().find(|t| **t != ignored && **t as usize >= vocabulary) {
        panic!("cross-entropy: target {wrong} outside the vocabulary of {vocabulary} ids");
    }
    // what is ignored may have any id; without logits nothing else can be asked
    vocabulary.max(1)
}

struct ForwardBackward<'a> {
    logits: &'a mut [f32],
    vocabulary: usize,
    targets: &'a [u32],
    ignored: u32,
    scale: f32,
}

impl WithSimd for ForwardBackward<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let ForwardBackward { logits, vocabulary, targets, ignored, scale } = self;
        let mut all = 0.0;
        for (row, &target) in logits.chunks_exact_mut(vocabulary).zip(targets) {
            if target == ignored {
                row.fill(0.0);
                continue;
            }
            let most = most(simd, row);
            let aim = row[target as usize];
            let sum = powers(simd, row, most);
            all += cost(sum, most, aim);
            scaled(simd, row, scale / sum);
            row[target as usize] -= scale;
        }
        all
    }
}

struct Nats<'a> {
    nats: &'a mut [f64],
    logits: &'a [f32],
    vocabulary: usize,
    targets: &'a [u32],
    ignored: u32,
}

impl WithSimd for Nats<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Nats { nats, logits, vocabulary, targets, ignored } = self;
        nats.fill(0.0);
        for ((nats, row), &target) in nats.iter_mut().zip(logits.chunks_exact(vocabulary)).zip(targets) {
            if target != ignored {
                let most = most(simd, row);
                *nats = cost(sum_of_powers(simd, row, most), most, row[target as usize]);
            }
        }
    }
}

/// -ln p, given the sum of e^(logit - most).
#[inline(always)]
fn cost(sum: f32, most: f32, aim: f32) -> f64 {
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

/// 0 in the lanes behind the tail.
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

    fn targets(rows: usize, vocabulary: usize) -> Vec<u32> {
        let id = |r: usize| if r % 5 == 3 { IGNORED } else { (r * 7 % vocabulary) as u32 };
        (0..rows).map(id).collect()
    }

    fn expected(logits: &[f32], targets: &[u32], scale: f64) -> (Vec<f64>, Vec<f64>) {
        let vocabulary = logits.len() / targets.len();
        let cost = |(row, &t): (&[f32], &u32)| if t == IGNORED { 0.0 } else { scalar::nats(row, t) };
        let gradient = |(row, &t): (&[f32], &u32)| match t {
            IGNORED => vec![0.0; vocabulary],
            t => scalar::gradient(row, t, scale),
        };
        let rows = || logits.chunks(vocabulary).zip(targets);
        (rows().map(cost).collect(), rows().flat_map(gradient).collect())
    }

    #[test]
    fn costs_and_gradients_are_the_definition() {
        let shapes = (1..=67).map(|v| (9, v)).chain([(1, 1), (40, 400), (2, 5000)]);
        for ((n, vocabulary), lanes) in shapes.flat_map(|s| Lanes::ALL.map(|l| (s, l))) {
            for (range, shift) in [(1.0, 0.0), (20.0, 1000.0), (0.1, -3e4)] {
                let what = format!("{lanes:?} ({n}, {vocabulary}) {range}");
                let mut logits: Vec<f32> = numbers(3, n * vocabulary, range).iter().map(|x| x + shift).collect();
                let targets = targets(n, vocabulary);
                let (costs, gradient) = expected(&logits, &targets, 0.7);
                let mut found = vec![7.0; n];
                let (l, t) = (&logits, &targets);
                lanes.run(Nats { nats: &mut found, logits: l, vocabulary, targets: t, ignored: IGNORED });
                let single: Vec<f32> = found.iter().map(|&x| x as f32).collect();
                near(&what, &single, &costs, BOUND);
                let (logits, targets, ignored) = (&mut logits, &targets, IGNORED);
                let sum = lanes.run(ForwardBackward { logits, vocabulary, targets, ignored, scale: 0.7 });
                assert_eq!(sum, found.iter().sum::<f64>(), "{what}");
                near(&what, logits, &gradient, BOUND);
            }
        }
    }

    #[test]
    fn some_ids_cannot_come_and_what_is_no_number_shows() {
        const OUT: f32 = f32::NEG_INFINITY;
        for (lanes, vocabulary) in Lanes::ALL.iter().flat_map(|l| [8, 11, 64].map(|v| (l, v))) {
            let run = |row: &[f32], target| {
                let mut logits = row.to_vec();
                let targets = &[target];
                let (logits_, ignored) = (&mut logits, IGNORED);
                let op = ForwardBackward { logits: logits_, vocabulary, targets, ignored, scale: 1.0 };
                (lanes.run(op), logits)
            };
            let mut row = vec![OUT; vocabulary];
            row[1..4].fill(2.0);
            let (cost, gradient) = run(&row, 2);
            assert!((cost - 3f64.ln()).abs() < 1e-6, "{lanes:?}: {cost}");
            assert_eq!((gradient[0], gradient[vocabulary - 1]), (0.0, 0.0));
            assert!((gradient[2] + 2.0 / 3.0).abs() < 1e-6);
            assert_eq!(run(&row, 0).0, f64::INFINITY);
            for bad in [f32::NAN, f32::INFINITY] {
                assert!(run(&vec![bad; vocabulary], 1).0.is_nan(), "{lanes:?}");
                for place in 0..vocabulary {
                    let mut row = numbers(4, vocabulary, 90.0);
                    row[place] = bad;
                    assert!(run(&row, 1).0.is_nan(), "{lanes:?}: {bad} at {place}");
                }
            }
            assert!(run(&vec![OUT; vocabulary], 1).0.is_nan());
        }
    }

    #[test]
    fn the_doors_count_and_check() {
        let mut logits = [0.0; 6];
        let two = forward_backward(&mut logits, &[1, IGNORED, 0], IGNORED, 0.5);
        assert!((two - 2.0 * 2f64.ln()).abs() < 1e-12);
        assert_eq!(logits, [0.25, -0.25, 0.0, 0.0, -0.25, 0.25]);
        assert_eq!(counted(&[1, IGNORED, 0], IGNORED), 2);
        assert_eq!(forward_backward(&mut [], &[], IGNORED, 1.0), 0.0);
        let wrong = std::panic::catch_unwind(|| nats(&mut [0.0], &[0.0; 4], &[4], IGNORED)).unwrap_err();
        let message = wrong.downcast_ref::<String>().unwrap();
        assert_eq!(message, "cross-entropy: target 4 outside the vocabulary of 4 ids");
    }
}
