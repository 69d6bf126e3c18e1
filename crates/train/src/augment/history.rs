//! Noise on the history: a generating model's history has errors, from which it learns to return.
//!
//! Each input code of a window is moved by a rounded Gaussian number of bins, whose deviation is random per window. Targets
//! stay. After the input corruption of T2M-GPT (Zhang et al. 2023), which replaces codes by random ones.

use crate::{Error, Result};
use kinelm_store::random;
use kinelm_tokenizer::{SlotIds, Tokenizer};
use rand_chacha::rand_core::RngCore;

/// The share of the windows with noise.
const SHARE: f64 = 0.7;

/// The largest deviation, bins.
pub const MOST: f64 = 16.0;

/// The bins of a word's slots.
#[derive(Debug)]
pub struct History {
    places: Vec<SlotIds>,
    most: f64,
}

impl History {
    /// For a deviation of up to `most` bins.
    ///
    /// # Errors
    /// Words whose places have no bins of one kind each.
    pub fn of(tokenizer: &Tokenizer, most: f64) -> Result<History> {
        let places = tokenizer.slot_ids();
        match places.is_empty() {
            false => Ok(History { places, most }),
            true => {
                let why = "the slots of these words have no bins that could be moved (tiles, merges, words of different length)";
                Err(Error::unsupported("augment.history_noise", format!("{why}; leave it out")))
            }
        }
    }

    /// Adds noise to the codes of `inputs`, which begin with a word's first token. Ids that are no bins of their slot stay.
    pub fn disturb(&self, inputs: &mut [u32], rng: &mut impl RngCore) {
        let (is_noisy, deviation) = (random::unit(rng) < SHARE, self.most * random::unit(rng));
        if !is_noisy {
            return;
        }
        let word = self.places.len() + 1;
        for (k, id) in inputs.iter_mut().enumerate() {
            let Some(kind) = self.places.get(k % word) else { continue };
            // `<mask>` and `<pad>` have no bin and stay
            let Some(bin) = kind.bin(*id) else { continue };
            *id = kind.first + moved(*kind, bin, (deviation * random::normal(rng)).round() as i64);
        }
    }
}

/// A bin moved by `by` bins, wrapping around for angles, else clamped to the ends.
fn moved(kind: SlotIds, bin: u32, by: i64) -> u32 {
    let (bin, count) = (i64::from(bin) + by, i64::from(kind.count));
    (if kind.circular { bin.rem_euclid(count) } else { bin.clamp(0, count - 1) }) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANGLE: SlotIds = SlotIds { first: 6, count: 10, circular: true };
    const STEP: SlotIds = SlotIds { first: 20, count: 5, circular: false };

    #[test]
    fn bins_wrap_around_or_are_clamped() {
        assert_eq!([-12, -1, 0, 11].map(|by| moved(ANGLE, 0, by)), [8, 9, 0, 1]);
        assert_eq!([-9, -1, 1, 9].map(|by| moved(STEP, 1, by)), [0, 0, 2, 4]);
    }

    #[test]
    fn every_code_moves_independently_and_nothing_else_does() {
        let history = History { places: vec![ANGLE, STEP], most: 2.0 };
        let clean: Vec<u32> = (0..3000).flat_map(|i| [6 + i % 10, 20 + i % 5, 5]).chain([0, 3, 6]).collect();
        let (mut disturbed, mut squares) = (0, 0.0);
        for window in 0..200 {
            let mut noisy = clean.clone();
            history.disturb(&mut noisy, &mut random::stream(1, "history", window, 0));
            assert!(noisy.iter().zip(&clean).all(|(a, b)| a == b || (6..16).contains(a) || (20..25).contains(a)));
            assert!(noisy.iter().skip(2).step_by(3).take(3000).all(|id| *id == 5), "spaces stay");
            assert_eq!(noisy[9000..9002], [0, 3], "so does what is no bin");
            let steps = noisy.iter().zip(&clean).step_by(3).take(3000).map(|(a, b)| {
                let step = (i64::from(*a) - i64::from(*b)).rem_euclid(10);
                step.min(10 - step) as f64
            });
            let sum: f64 = steps.map(|s| s * s).sum();
            disturbed += u32::from(noisy != clean);
            squares += sum / 3000.0;
        }
        // 140 of 200, deviation 6.5; few of them have a deviation too small to move anything
        assert!((115..161).contains(&disturbed), "{disturbed}");
        // the mean of sd^2 over 0..2 is 4/3, of rounding 1/12, in seven tenths
        assert!((squares / 200.0 - 0.99).abs() < 0.2, "{}", squares / 200.0);
    }
}
