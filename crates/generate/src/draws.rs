//! Which random numbers a dance draws with.
//!
//! Dances that draw with the same numbers come to move alike, whatever they began from: the numbers choose a small turn or a
//! large one at the same places, and what stood further back than a model sees is forgotten. So what a dance is given makes
//! its numbers, together with the seed. How it is drawn doesn't, so that two ways of drawing can be compared.

use super::make::Ready;
use rand_chacha::rand_core::RngCore;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// What makes the numbers that a dance draws with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Draws {
    /// The seed alone, as in files of before 2026-11-23, which don't say.
    #[default]
    Seed,
    /// The seed, the bytes of prompt and music, and the labels. With none of them as [`Draws::Seed`].
    Given,
}

impl Draws {
    /// Whether the seed alone makes them.
    pub fn is_seed(&self) -> bool {
        *self == Draws::Seed
    }
}

impl Ready {
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

    #[test]
    fn files_that_do_not_say_drew_by_the_seed_alone() {
        assert!(Draws::default().is_seed());
        assert_eq!(serde_json::to_string(&Draws::Given).unwrap(), "\"given\"");
    }
}
