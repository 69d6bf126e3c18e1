//! Repetition penalty, for words of motion: it falls on the ids that stood at the same place of a word a short while ago.
//!
//! An id means nothing without its place, so an id that another joint had is no repetition. The probability of an id that
//! is one is divided by the penalty, once, however often it stood there: the logits of the original (Keskar et al., "CTRL",
//! 2019) are divided where they are positive and multiplied where not, which depends on where a model's logits have their
//! zero. A joint that stands still for good reason is pushed to a bin beside by it: it is against dances that freeze.

use super::Candidate;

/// Divides the probabilities of the `recent` ids by `penalty`, above 0.
pub fn apply(left: &mut [Candidate], recent: &[u32], penalty: f64) {
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
