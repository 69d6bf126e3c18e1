//! Temperature, and sampling by probability.

use super::{Candidate, weights};
use kinelm_store::random;
use rand_chacha::ChaCha8Rng;

/// Divides the logits.
pub(crate) fn apply(left: &mut [Candidate], temperature: f64) {
    if temperature != 1.0 {
        left.iter_mut().for_each(|c| c.logit /= temperature);
    }
}

/// One of the ids, by their probabilities; the largest logit is 0.
pub fn sample(left: &[Candidate], rng: &mut ChaCha8Rng) -> Option<u32> {
    let weights = weights(left);
    let mut rest = random::unit(rng) * weights.iter().sum::<f64>();
    for (c, weight) in left.iter().zip(weights) {
        rest -= weight;
        if rest < 0.0 {
            return Some(c.id);
        }
    }
    // rounding errors have left a little
    super::greedy::sample(left)
}
