//! Which ids may stand at a place of a word.

use crate::vocab::{FIRST_CHARACTER, SPACE};
use std::ops::Range;

/// The ids that a place allows: a character's at the C channels, the space's after them. Whatever keeps to it decodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grammar {
    characters: u32,
    channels: usize,
}

impl Grammar {
    pub(crate) fn new(characters: u32, channels: usize) -> Self {
        Grammar { characters, channels }
    }

    /// W, the tokens of a word with its space.
    pub fn word(&self) -> usize {
        self.channels + 1
    }

    /// The ids allowed at a place; places count from the start of a word and go on into the next one.
    pub fn allowed(&self, place: usize) -> Range<u32> {
        if place % self.word() < self.channels {
            FIRST_CHARACTER..FIRST_CHARACTER + self.characters
        } else {
            SPACE..SPACE + 1
        }
    }

    /// Whether an id may stand at a place.
    pub fn allows(&self, place: usize, id: u32) -> bool {
        self.allowed(place).contains(&id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn characters_then_a_space() {
        let g = Grammar::new(360, 42);
        assert_eq!(g.word(), 43);
        assert_eq!((g.allowed(0), g.allowed(41), g.allowed(42), g.allowed(43)), (6..366, 6..366, 5..6, 6..366));
        assert!(g.allows(42, 5) && !g.allows(42, 6) && !g.allows(0, 5) && !g.allows(0, 366));
    }
}
