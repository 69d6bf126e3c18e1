//! Top-k: the k most likely ids. Source: Fan, Lewis, Dauphin, "Hierarchical Neural Story Generation" (2018).

use super::{Candidate, by_likelihood, keep_up_to};

/// Keeps the `k` most likely, at least one; of equals the first.
pub(crate) fn apply(left: &mut Vec<Candidate>, k: usize) {
    if k < left.len() {
        let last = *left.clone().select_nth_unstable_by(k.max(1) - 1, by_likelihood).1;
        keep_up_to(left, last);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::left_by;
    use super::*;

    #[test]
    fn the_first_of_equals_stay() {
        let logits = [1.0, 3.0, 2.0, 3.0, 3.0];
        assert_eq!(left_by(&logits, |c| apply(c, 1)), [1]);
        assert_eq!(left_by(&logits, |c| apply(c, 2)), [1, 3]);
        assert_eq!(left_by(&logits, |c| apply(c, 4)), [1, 2, 3, 4]);
        assert_eq!(left_by(&logits, |c| apply(c, 5)), left_by(&logits, |c| apply(c, 99)));
    }
}
