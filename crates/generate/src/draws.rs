//! Which random numbers a dance draws with.
//!
//! Dances that draw with the same numbers come to move alike, whatever they began from: the numbers choose a small turn or a
//! large one at the same places, and what stood further back than a model sees is forgotten. So what a dance is given makes
//! its numbers, together with the seed. How it is drawn doesn't, so that two ways of drawing can be compared.

use super::open::OpenRequest;
use rand_chacha::rand_core::RngCore;
use sha2::{Digest, Sha256};

impl OpenRequest {
    /// What the dance is given, as a number; 0: nothing, or it doesn't count. Where the files lie changes nothing.
    pub(super) fn given_number(&self) -> u64 {
        let recipe = &self.recipe;
        if recipe.draws.is_seed() {
            return 0;
        }
        let prompt = self.prompt.as_ref().map(|prompt| format!("prompt {}", prompt.clip.sha256));
        let from_s = recipe.music.as_ref().map_or(0.0, |music| music.from_s);
        let music = self.music.as_ref().map(|music| format!("music {} from {from_s}", music.sha256));
        let labels = recipe.labels.iter().map(|(field, value)| format!("label {field}={value}"));
        let timed = recipe.timed_labels.iter().map(|label| format!("label {label}"));
        number(&prompt.into_iter().chain(music).chain(labels).chain(timed).collect::<Vec<_>>())
    }
}

/// A number for what is given; 0 for nothing.
fn number(given: &[String]) -> u64 {
    if given.is_empty() {
        return 0;
    }
    Sha256::digest(given.join("\n")).iter().take(8).fold(0, |number, &byte| number << 8 | u64::from(byte))
}

/// The seed of a dance that is given something.
pub(super) fn seed(seed: u64, given: u64) -> u64 {
    match given {
        0 => seed,
        given => kinelm_store::random::stream(seed, "given", given, 0).next_u64(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_makes_another_seed_and_nothing_makes_none() {
        let number = |given: &[&str]| number(&given.iter().map(|&text| text.to_owned()).collect::<Vec<_>>());
        let (none, salsa, waltz) = (number(&[]), number(&["label genre=salsa"]), number(&["label genre=waltz"]));
        assert_eq!((none, seed(5, none)), (0, 5));
        let seeds = [seed(5, none), seed(5, salsa), seed(5, waltz), seed(6, salsa)];
        assert!((1..4).all(|i| !seeds[..i].contains(&seeds[i])), "{seeds:?}");
        assert_eq!(seed(5, salsa), seed(5, number(&["label genre=salsa"])));
    }
}
