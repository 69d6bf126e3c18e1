//! Intervals of means by bootstrap over takes, since clips of one take are not independent.
//!
//! Limits: plain percentile intervals without a bias correction; over a handful of takes they are too narrow.

use kinelm_store::random;

/// Resamples of takes.
const RESAMPLES: usize = 2000;

/// A take, and sum and count over its clips.
type Take<'a> = (&'a str, f64, f64);

/// The middle 95 % of sum over count, when takes are resampled with replacement; each part is (take, sum, count).
///
/// Source: Efron, "Bootstrap methods" (1979), of clusters.
pub fn interval<'a>(parts: impl IntoIterator<Item = (&'a str, f64, f64)>) -> [f64; 2] {
    let takes = by_take(parts);
    middle(|resample| mean(&takes, &resampled(takes.len(), resample, 0)))
}

/// The same of the difference of two means, the second's less the first's. Where both have the same takes, each
/// resample has the same takes of both.
pub(crate) fn difference<'a>(parts: [impl IntoIterator<Item = (&'a str, f64, f64)>; 2]) -> [f64; 2] {
    let [mut a, mut b] = parts.map(by_take);
    // index i must be the same take on both sides, or paired resamples would mix takes
    a.sort_by_key(|take| take.0);
    b.sort_by_key(|take| take.0);
    let paired = a.iter().map(|take| take.0).eq(b.iter().map(|take| take.0));
    middle(|resample| {
        let of_a = resampled(a.len(), resample, 0);
        // unpaired sides need independent streams: on one stream their errors would cancel
        let of_b = if paired { of_a.clone() } else { resampled(b.len(), resample, 1) };
        mean(&b, &of_b) - mean(&a, &of_a)
    })
}

fn by_take<'a>(parts: impl IntoIterator<Item = Take<'a>>) -> Vec<Take<'a>> {
    let mut takes: Vec<Take> = Vec::new();
    for (take, sum, count) in parts {
        match takes.iter_mut().find(|(known, ..)| *known == take) {
            Some((_, s, n)) => (*s, *n) = (*s + sum, *n + count),
            None => takes.push((take, sum, count)),
        }
    }
    takes
}

/// The indices of a resample's takes.
fn resampled(takes: usize, resample: usize, side: u64) -> Vec<usize> {
    let mut rng = random::stream(0, "takes", resample as u64, side);
    (0..takes).map(|_| ((random::unit(&mut rng) * takes as f64) as usize).min(takes - 1)).collect()
}

fn mean(takes: &[Take], resample: &[usize]) -> f64 {
    let (sum, all) = resample.iter().map(|&t| takes[t]).fold((0.0, 0.0), |(sum, all), (_, s, n)| (sum + s, all + n));
    sum / all
}

fn middle(one: impl Fn(usize) -> f64) -> [f64; 2] {
    let mut found: Vec<f64> = (0..RESAMPLES).map(one).collect();
    found.sort_by(f64::total_cmp);
    [0.025, 0.975].map(|share| found[(share * RESAMPLES as f64) as usize])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clips_of_one_take_count_once() {
        assert_eq!(interval([("a", 3.0, 1.0), ("a", 5.0, 1.0)]), [4.0, 4.0]);
        let [low, high] = interval((0..20).map(|i| (["a", "b", "c", "d"][i % 4], (i % 4) as f64, 1.0)));
        assert!((0.0..1.0).contains(&low) && high > 2.0 && high <= 3.0, "{low} {high}");
    }

    #[test]
    fn what_differs_by_as_much_in_every_take_differs_for_sure() {
        let of = |more: f64| (0..12).map(move |i| (["a", "b", "c", "d"][i % 4], (i % 4) as f64 + more, 1.0));
        assert_eq!(difference([of(0.0).collect::<Vec<_>>(), of(0.5).collect()]), [0.5, 0.5]);
        let other = of(0.5).map(|(take, sum, n)| (if take == "a" { "e" } else { take }, sum, n));
        let [low, high] = difference([of(0.0).collect::<Vec<_>>(), other.collect()]);
        assert!(low < 0.0 && high > 1.0, "{low} {high}");
    }
}
