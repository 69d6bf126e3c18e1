//! Top-p, nucleus sampling: the fewest most likely ids that have probability p together. Source: Holtzman et al., "The
//! Curious Case of Neural Text Degeneration" (2020).

use super::{Candidate, by_likelihood, keep_up_to, weights};

/// Keeps the fewest most likely whose probabilities reach `p` together, at least one; of equals the first.
pub(crate) fn apply(left: &mut Vec<Candidate>, p: f64) {
    if p >= 1.0 {
        return;
    }
    let weights = weights(left);
    let total: f64 = weights.iter().sum();
    // all below it together have half of 1 - p at most, so none of them is needed: few are left to be sorted
    let least = 0.5 * (1.0 - p) * total / weights.len() as f64;
    let likely = left.iter().zip(&weights).filter(|(_, weight)| **weight >= least);
    let mut likely: Vec<(Candidate, f64)> = likely.map(|(c, weight)| (*c, *weight)).collect();
    likely.sort_unstable_by(|(a, _), (b, _)| by_likelihood(a, b));
    let mut sum = 0.0;
    let reaches = likely.iter().find(|(_, weight)| {
        sum += weight;
        sum >= p * total
    });
    if let Some((last, _)) = reaches.or(likely.last()) {
        keep_up_to(left, *last);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::left_by;
    use super::*;

    #[test]
    fn the_fewest_that_reach_p_stay() {
        // 0.125, 0.5, 0.25, 0.125, exact in binary
        let logits = [0.125f64, 0.5, 0.25, 0.125].map(f64::ln);
        assert_eq!(left_by(&logits, |c| apply(c, 0.01)), [1]);
        assert_eq!(left_by(&logits, |c| apply(c, 0.49)), [1]);
        assert_eq!(left_by(&logits, |c| apply(c, 0.51)), [1, 2]);
        assert_eq!(left_by(&logits, |c| apply(c, 0.76)), [0, 1, 2]);
        assert_eq!(left_by(&logits, |c| apply(c, 0.9)), [0, 1, 2, 3]);
        assert_eq!(left_by(&logits, |c| apply(c, 1.0)), [0, 1, 2, 3]);
    }

    #[test]
    fn they_are_those_that_sorting_all_finds() {
        use rand_chacha::rand_core::{RngCore, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut number = || f64::from(rng.next_u32()) / f64::from(u32::MAX);
        for round in 0..300 {
            // peaked and flat ones, with equals, and with ids that are all but impossible
            let (steep, p) = ([0.5, 5.0, 50.0, 2000.0][round % 4], number());
            let mut logits: Vec<f64> = (0..360).map(|_| -(steep * number() * 64.0).round() / 64.0).collect();
            logits[round] = 0.0;
            let mut falling: Vec<(usize, f64)> = logits.iter().map(|l| l.exp()).enumerate().collect();
            falling.sort_by(|a, b| b.1.total_cmp(&a.1));
            let total: f64 = falling.iter().map(|(_, weight)| weight).sum();
            let mut sum = 0.0;
            let short = falling.iter().take_while(|(_, weight)| {
                sum += weight;
                sum < p * total
            });
            let n = short.count() + 1;
            let mut expected: Vec<u32> = falling[..n].iter().map(|(id, _)| *id as u32).collect();
            expected.sort_unstable();
            assert_eq!(left_by(&logits, |c| apply(c, p)), expected, "{steep} {p}");
        }
    }
}
