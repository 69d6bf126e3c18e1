//! Classifier-free guidance: every dance is read twice, with its conditions and without, and the difference between the two
//! readings is scaled.
//!
//! `logits = uncond + g (cond - uncond)`: 0 is the model without conditions, 1 with them, above 1 more than with them.
//! Logits serve as well as log-probabilities: a constant on all logits of one reading is the same constant on the result.
//! Labels, music and goals are conditions. Source: Ho, Salimans, "Classifier-Free Diffusion Guidance" (2022).

/// Classifier-free guidance of a dance.
#[derive(Debug, Clone, PartialEq)]
pub struct Guidance {
    /// g, finite.
    pub scale: f64,
    /// The front of the unconditioned reading: as long as the plan's, every label `<unk>`.
    pub unconditioned: Vec<u32>,
}

/// Turns the conditioned logits into the guided ones, at scale g. A token that is impossible in either reading stays so.
pub(crate) fn mix(scale: f64, conditioned: &mut [f32], unconditioned: &[f32]) {
    for (c, &u) in conditioned.iter_mut().zip(unconditioned) {
        // minus infinity less minus infinity is NaN
        *c = match c.is_infinite() || u.is_infinite() {
            true => c.min(u),
            false => (f64::from(u) + scale * (f64::from(*c) - f64::from(u))) as f32,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_difference_is_scaled_and_what_is_impossible_stays_so() {
        let none = f32::NEG_INFINITY;
        let mixed = |scale: f64| {
            let mut with = [1.0, 3.0, none, none, 2.0];
            mix(scale, &mut with, &[2.0, 1.0, none, 0.0, none]);
            with
        };
        assert_eq!(mixed(0.0), [2.0, 1.0, none, none, none]);
        assert_eq!(mixed(1.0), [1.0, 3.0, none, none, none]);
        assert_eq!(mixed(3.0), [-1.0, 7.0, none, none, none]);
        // NaN stays, so that the sampling rules refuse it
        let mut with = [f32::NAN];
        mix(2.0, &mut with, &[1.0]);
        assert!(with[0].is_nan());
    }
}
