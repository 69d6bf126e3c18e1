//! The word of the window that a token belongs to, and its place in the word: counted from the tokens where words differ
//! in length.

use super::config::{ModelConfig, Positions, TokenLayout};
use super::layout::word_rows;
use kinelm_engine::words::Stand;

/// Counts words, and places in them. Those behind the end of their table take its last row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Counter {
    space: u32,
    front: usize,
    /// W, if all words have so many tokens.
    length: Option<usize>,
    words: usize,
    places: usize,
}

impl Counter {
    /// `None` where positions know no words.
    pub fn of(config: &ModelConfig, tokens: &TokenLayout) -> Option<Counter> {
        let words = match config.positions {
            Positions::Absolute => return None,
            Positions::FrameJoint => word_rows(config, tokens),
            // turns have no table that could end
            Positions::Rope => usize::MAX,
        };
        Some(Counter {
            space: tokens.space,
            front: tokens.front,
            length: (!tokens.varying).then_some(tokens.word),
            words,
            places: tokens.word,
        })
    }

    /// Whether the tokens of a window decide, and not their number alone.
    pub fn reads(self) -> bool {
        self.length.is_none()
    }

    /// The word and the place of every token of `window`; the front tokens' stay as they are.
    pub fn count(self, window: &[u32], words: &mut [u32], places: &mut [u32]) {
        let mut stand = Stand::default();
        let tokens = window.iter().zip(words.iter_mut().zip(places)).skip(self.front);
        for (&id, (to_word, to_place)) in tokens {
            *to_word = stand.word.min(self.words - 1) as u32;
            *to_place = stand.place.min(self.places - 1) as u32;
            stand = stand.behind(self.length.map_or(id == self.space, |length| stand.place + 1 == length));
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
