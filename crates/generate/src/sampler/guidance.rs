//! Classifier-free guidance: every dance is read twice, with its conditions and without, and the difference between the two
//! readings is scaled.
//!
//! `logits = uncond + g (cond - uncond)`: 0 is the model without conditions, 1 with them, above 1 more than with them.
//! Logits serve as well as log-probabilities: a constant on all logits of one reading is the same constant on the result.
//! Labels, music and goals are conditions. Source: Ho, Salimans, "Classifier-Free Diffusion Guidance" (2022).
//!
//! Above 1 only what the conditioned reading itself finds likely is sampled ([`MIN_P`]). Far from the likely steps the
//! difference of two readings is that of two small numbers, and scaled it makes a dance jump where neither reading would
//! (docs/results/two-level.md, "Labels"). Dances to music have no such bound: what falls on a beat is rare elsewhere, and
//! under it they lose the beat (docs/results/music.md).

use crate::sampling;
use std::ops::Range;

/// Classifier-free guidance of a dance.
#[derive(Debug, Clone, PartialEq)]
pub struct Guidance {
    /// g, finite.
    pub scale: f64,
    /// The front of the unconditioned reading: as long as the plan's, every label `<unk>`.
    pub unconditioned: Vec<u32>,
}

/// Where g is above 1 and there is no music, what is less likely than this, as a share of the likeliest, by the conditioned
/// reading is never sampled: e^-2.
pub(crate) const MIN_P: f64 = 0.135;

/// Turns the conditioned logits into the guided ones, at scale g. A token that is impossible in either reading stays so. The
/// other logits become the conditioned ones.
pub(crate) fn mix(scale: f64, conditioned: &mut [f32], unconditioned: &mut [f32]) {
    for (c, u) in conditioned.iter_mut().zip(unconditioned) {
        // minus infinity less minus infinity is NaN
        let guided = match c.is_infinite() || u.is_infinite() {
            true => c.min(*u),
            false => (f64::from(*u) + scale * (f64::from(*c) - f64::from(*u))) as f32,
        };
        *u = std::mem::replace(c, guided);
    }
}

/// Of the `allowed` ids, ascending ranges, those that are sampled at scale g, by the conditioned logits (V) of all ids.
pub(crate) fn likely(scale: f64, conditioned: &[f32], allowed: Vec<Range<u32>>) -> Vec<Range<u32>> {
    let found = (scale > 1.0).then(|| sampling::likely(conditioned, &allowed, MIN_P)).flatten();
    found.unwrap_or(allowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_difference_is_scaled_and_what_is_impossible_stays_so() {
        let none = f32::NEG_INFINITY;
        let mixed = |scale: f64| {
            let mut with = [1.0, 3.0, none, none, 2.0];
            let mut without = [2.0, 1.0, none, 0.0, none];
            mix(scale, &mut with, &mut without);
            assert_eq!(without, [1.0, 3.0, none, none, 2.0]);
            with
        };
        assert_eq!(mixed(0.0), [2.0, 1.0, none, none, none]);
        assert_eq!(mixed(1.0), [1.0, 3.0, none, none, none]);
        assert_eq!(mixed(3.0), [-1.0, 7.0, none, none, none]);
        // NaN stays, so that the sampling rules refuse it
        let mut with = [f32::NAN];
        mix(2.0, &mut with, &mut [1.0]);
        assert!(with[0].is_nan());
    }

    #[test]
    fn above_1_only_what_the_conditioned_reading_finds_likely_is_left() {
        let none = f32::NEG_INFINITY;
        // e^-1.99 and e^-2.01 on both sides of the bound; id 0 is the likeliest, but the grammar forbids it
        let conditioned = [9.0, 1.0, -0.99, -1.01, 0.5, none];
        assert_eq!(likely(1.5, &conditioned, vec![1..3, 3..6]), [1..2, 2..3, 4..5]);
        assert_eq!(likely(1.0, &conditioned, vec![1..3, 3..6]), [1..3, 3..6]);
        // the sampling rules refuse broken logits, with their place
        for broken in [&[f32::NAN, 1.0][..], &[0.0]] {
            assert_eq!(likely(2.0, broken, vec![0..1, 1..2]), [0..1, 1..2]);
        }
    }
}
