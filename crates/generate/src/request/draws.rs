//! What makes the random numbers that a dance draws with.

use serde::{Deserialize, Serialize};

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_do_not_say_drew_by_the_seed_alone() {
        assert!(Draws::default().is_seed());
        assert_eq!(serde_json::to_string(&Draws::Given).unwrap(), "\"given\"");
    }
}
