//! Top-p, nucleus sampling: the fewest most likely ids that have probability p together. Source: Holtzman et al., "The
//! Curious Case of Neural Text Degeneration" (2020).

use super::{Candidate, keep_most_likely};

/// Keeps the fewest most likely whose probabilities reach `p` together, at least one; of equals the first.
pub fn apply(left: &mut Vec<Candidate>, p: f64) {
    if p >= 1.0 {
        return;
    }
    let mut falling: Vec<f64> = left.iter().map(|c| c.logit).collect();
    falling.sort_by(|a, b| b.total_cmp(a));
    let total: f64 = falling.iter().map(|l| l.exp()).sum();
    let mut sum = 0.0;
    let short = falling.iter().take_while(|l| {
        sum += l.exp();
        sum < p * total
    });
    let n = short.count() + 1;
    keep_most_likely(left, n);
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
}
