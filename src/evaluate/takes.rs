//! How sure a mean is: clips of one take are no independent ones, so that takes are drawn.

use crate::random;

/// Resamples of takes.
const RESAMPLES: usize = 2000;

/// The middle 95 % of sums over counts, when takes are drawn with replacement; each part is (take, sum, count).
///
/// Source: Efron, "Bootstrap methods" (1979), of clusters.
pub fn interval<'a>(parts: impl IntoIterator<Item = (&'a str, f64, f64)>) -> [f64; 2] {
    let mut takes: Vec<(&str, f64, f64)> = Vec::new();
    for (take, sum, count) in parts {
        match takes.iter_mut().find(|(known, ..)| *known == take) {
            Some((_, s, n)) => (*s, *n) = (*s + sum, *n + count),
            None => takes.push((take, sum, count)),
        }
    }
    let one = |resample: usize| {
        let mut rng = random::stream(0, "takes", resample as u64, 0);
        let (mut sum, mut all) = (0.0, 0.0);
        for _ in 0..takes.len() {
            let (_, s, n) = takes[((random::unit(&mut rng) * takes.len() as f64) as usize).min(takes.len() - 1)];
            (sum, all) = (sum + s, all + n);
        }
        sum / all
    };
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
}
