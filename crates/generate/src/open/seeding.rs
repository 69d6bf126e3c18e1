//! The inputs of a dance's random streams beside the seed.
//!
//! Dances with the same random numbers come to move alike whatever they began from: the numbers choose a small step or a
//! large one in the same slots, and earlier frames leave the model's window. So the streams derive from what a dance is given
//! too. How it is sampled doesn't count, so that two ways of sampling can be compared.

use super::OpenRequest;
use crate::request::Seeding;
use sha2::{Digest, Sha256};

impl OpenRequest {
    /// A hash of what the dance is given; 0: nothing, or it doesn't count. The paths of the files don't enter.
    pub(super) fn inputs_hash(&self) -> u64 {
        let request = &self.resolved;
        if request.seeding == Seeding::Seed {
            return 0;
        }
        let given = self.prompt.as_ref().filter(|prompt| !prompt.lends());
        let prompt = given.map(|prompt| format!("prompt {}", prompt.clip.sha256));
        let path = self.way.as_ref().map(|way| format!("path {}", way.sha256));
        let from_s = request.music.as_ref().map_or(0.0, |music| music.from_s);
        let music = self.music.as_ref().map(|music| format!("music {} from {from_s}", music.sha256));
        let labels = request.labels.iter().map(|(field, value)| format!("label {field}={value}"));
        let timed = request.timed_labels.iter().map(|label| format!("label {label}"));
        hash(&prompt.into_iter().chain(path).chain(music).chain(labels).chain(timed).collect::<Vec<_>>())
    }
}

/// The first eight bytes of the inputs' SHA-256; 0 for none.
fn hash(inputs: &[String]) -> u64 {
    if inputs.is_empty() {
        return 0;
    }
    Sha256::digest(inputs.join("\n")).iter().take(8).fold(0, |number, &byte| number << 8 | u64::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_input_has_a_hash_of_its_own_and_none_has_0() {
        let hash = |inputs: &[&str]| hash(&inputs.iter().map(|&text| text.to_owned()).collect::<Vec<_>>());
        let (none, salsa, waltz) = (hash(&[]), hash(&["label genre=salsa"]), hash(&["label genre=waltz"]));
        assert!(none == 0 && salsa != 0 && waltz != 0 && salsa != waltz);
        assert_eq!(salsa, hash(&["label genre=salsa"]));
    }
}
