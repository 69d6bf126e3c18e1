//! Min-p: the ids at least p times as likely as the most likely one. Source: Nguyen et al., "Turning Up the Heat: Min-p
//! Sampling" (2024).

use super::Candidate;

/// Keeps the ids whose probability is at least `p` times that of the most likely.
pub(crate) fn apply(left: &mut Vec<Candidate>, p: f64) {
    let top = left.iter().fold(f64::NEG_INFINITY, |top, c| top.max(c.logit));
    let least = top + least(p);
    left.retain(|c| c.logit >= least);
}

/// The least logit that stays where the most likely has 0, which stays at any p up to 1.
pub(crate) fn least(p: f64) -> f64 {
    p.ln()
}

#[cfg(test)]
mod tests {
    use super::super::tests::left_by;
    use super::*;

    #[test]
    fn ids_far_less_likely_than_the_most_likely_are_removed() {
        let logits = [0.1f64, 0.6, 0.25, 0.05].map(f64::ln);
        assert_eq!(left_by(&logits, |c| apply(c, 0.0)), [0, 1, 2, 3]);
        assert_eq!(left_by(&logits, |c| apply(c, 0.1)), [0, 1, 2]);
        assert_eq!(left_by(&logits, |c| apply(c, 0.4)), [1, 2]);
        assert_eq!(left_by(&logits, |c| apply(c, 1.0)), [1]);
    }
}
