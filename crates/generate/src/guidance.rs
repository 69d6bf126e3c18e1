//! Classifier-free guidance: every dance is read twice, with its conditions in front and with none, and the difference that
//! they make is enlarged.
//!
//! `logits = uncond + g (cond - uncond)`: 0 is the model without conditions, 1 with them, above 1 more than with them. A
//! constant on all logits of one reading is the same constant on all of the sum, so logits serve as well as
//! log-probabilities. Music is a condition as labels are. Frames that are told what is given ahead of them are led there in the
//! same way, by the reading that is told nothing. Source: Ho, Salimans, "Classifier-Free Diffusion Guidance" (2022).

/// How far conditions are followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guidance<'a> {
    /// g, finite.
    pub scale: f64,
    /// The front of the reading without conditions: as long as the plan's, every label `<unk>`.
    pub without: &'a [u32],
}

/// `with` becomes the guided logits, at the scale g. What can't come in either reading can't come.
pub fn mix(scale: f64, with: &mut [f32], without: &[f32]) {
    for (c, &u) in with.iter_mut().zip(without) {
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
    fn the_difference_is_enlarged_and_what_cannot_come_does_not() {
        let none = f32::NEG_INFINITY;
        let mixed = |scale: f64| {
            let mut with = [1.0, 3.0, none, none, 2.0];
            mix(scale, &mut with, &[2.0, 1.0, none, 0.0, none]);
            with
        };
        assert_eq!(mixed(0.0), [2.0, 1.0, none, none, none]);
        assert_eq!(mixed(1.0), [1.0, 3.0, none, none, none]);
        assert_eq!(mixed(3.0), [-1.0, 7.0, none, none, none]);
        // what is not a number is seen by the sampler
        let mut with = [f32::NAN];
        mix(2.0, &mut with, &[1.0]);
        assert!(with[0].is_nan());
    }
}
