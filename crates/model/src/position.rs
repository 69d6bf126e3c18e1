//! The word of the window that a token belongs to, and its place in the word: counted from the tokens where words differ
//! in length.

use super::config::{ModelConfig, Positions, TokenLayout};
use super::layout::word_rows;

/// Counts words, and slots in them. Positions after the end of their table take its last row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Counter {
    space: u32,
    front: usize,
    /// W, if all words have one length.
    length: Option<usize>,
    words: usize,
    slots: usize,
}

/// Position of a token after the front, counted from the tokens before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct WordPosition {
    /// The number of its word.
    pub word: usize,
    /// Its slot in the word.
    pub slot: usize,
}

impl Counter {
    /// `None` where positions know no words.
    pub fn of(config: &ModelConfig, tokens: &TokenLayout) -> Option<Counter> {
        let words = match config.positions {
            Positions::Absolute => return None,
            Positions::FrameJoint => word_rows(config, tokens),
            // rotary angles need no table, so nothing limits the words
            Positions::Rope => usize::MAX,
        };
        Some(Counter {
            space: tokens.space,
            front: tokens.front,
            length: (!tokens.varying).then_some(tokens.word),
            words,
            slots: tokens.word,
        })
    }

    /// Whether the tokens of a window decide, and not their number alone.
    pub fn reads(self) -> bool {
        self.length.is_none()
    }

    /// The position after that of the token `id`.
    pub fn next(self, at: WordPosition, id: u32) -> WordPosition {
        match self.length.map_or(id == self.space, |length| at.slot + 1 == length) {
            true => WordPosition { word: at.word + 1, slot: 0 },
            false => WordPosition { slot: at.slot + 1, ..at },
        }
    }

    /// A position's rows of the tables.
    pub fn rows(self, at: WordPosition) -> WordPosition {
        // words of varying length may be longer than any that the tokenizer was fitted on
        WordPosition { word: at.word.min(self.words - 1), slot: at.slot.min(self.slots - 1) }
    }

    /// The rows of every token of `window`; the front tokens' stay as they are.
    pub fn count(self, window: &[u32], words: &mut [u32], slots: &mut [u32]) {
        let mut at = WordPosition::default();
        let tokens = window.iter().zip(words.iter_mut().zip(slots)).skip(self.front);
        for (&id, (to_word, to_slot)) in tokens {
            let rows = self.rows(at);
            (*to_word, *to_slot) = (rows.word as u32, rows.slot as u32);
            at = self.next(at, id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_places_are_counted_up_to_the_last_row() {
        let tokens = TokenLayout {
            vocabulary: 11,
            word: 3,
            varying: true,
            front: 1,
            pad: 0,
            bos: 1,
            space: 5,
            places: Vec::new(),
        };
        let config = ModelConfig { context: 6, ..Default::default() };
        let count = |config: &ModelConfig, tokens: &TokenLayout| {
            let counter = Counter::of(config, tokens).unwrap();
            let (mut words, mut places) = ([9; 12], [9; 12]);
            counter.count(&[1, 7, 5, 5, 8, 8, 8, 8, 5, 9, 5, 6], &mut words, &mut places);
            (words, places)
        };
        // three words at most, places of three
        let places = [9, 0, 1, 0, 0, 1, 2, 2, 2, 0, 1, 0];
        assert_eq!(count(&config, &tokens), ([9, 0, 0, 1, 2, 2, 2, 2, 2, 2, 2, 2], places));
        let rope = ModelConfig { positions: Positions::Rope, ..config.clone() };
        assert_eq!(count(&rope, &tokens), ([9, 0, 0, 1, 2, 2, 2, 2, 2, 3, 3, 4], places));
        let fixed = TokenLayout { varying: false, ..tokens.clone() };
        let places = [9, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1];
        assert_eq!(count(&rope, &fixed), ([9, 0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3], places));
        assert!(Counter::of(&ModelConfig { positions: Positions::Absolute, ..config }, &tokens).is_none());
    }
}
