//! Repetition penalty for words of motion: it applies to the ids that were in the same slot of a recent word.
//!
//! An id means nothing without its slot, so an id of another joint is no repetition. The probability of a repeated id is
//! divided by the penalty, once, however often it occurred. The original (Keskar et al., "CTRL", 2019) divides positive
//! logits and multiplies negative ones, which depends on an offset that a softmax ignores. The penalty works against dances
//! that freeze; a joint that rests for good reason is pushed to the next bin by it.

use super::Candidate;

/// Divides the probabilities of the `recent` ids by `penalty`, above 0.
pub(crate) fn apply(left: &mut [Candidate], recent: &[u32], penalty: f64) {
    if recent.is_empty() {
        return;
    }
    let less = penalty.ln();
    for c in left.iter_mut().filter(|c| recent.contains(&c.id)) {
        c.logit -= less;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_probability_is_divided_once() {
        let mut left = [(3, -1.0), (4, 0.0), (5, 2.0)].map(|(id, logit)| Candidate { id, logit });
        apply(&mut left, &[5, 9, 3, 5], 2.0);
        let less = 2f64.ln();
        assert_eq!(left.map(|c| c.logit), [-1.0 - less, 0.0, 2.0 - less]);
    }
}
