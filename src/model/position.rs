//! Which rows of the position tables tokens take where words differ in length: they are counted from the tokens.

use super::config::{ModelConfig, Positions, TokenLayout};
use super::layout::word_rows;

/// The word of the window that a token belongs to, and its place in the word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Stand {
    word: u32,
    place: u32,
}

/// Counts words, and places in them. Those behind the end of their table take its last row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Counter {
    space: u32,
    front: usize,
    words: usize,
    places: usize,
}

impl Counter {
    /// `None` where a token's place in the window tells its rows.
    pub fn of(config: &ModelConfig, tokens: &TokenLayout) -> Option<Counter> {
        let counts = tokens.varying && config.positions == Positions::FrameJoint;
        counts.then(|| Counter {
            space: tokens.space,
            front: tokens.front,
            words: word_rows(config, tokens),
            places: tokens.word,
        })
    }

    /// Tokens in front of the first word.
    pub fn front(self) -> usize {
        self.front
    }

    /// The rows of the tables of words and of places.
    pub fn rows(self, stand: Stand) -> [u32; 2] {
        let row = |number: u32, rows: usize| (number as usize).min(rows - 1) as u32;
        [row(stand.word, self.words), row(stand.place, self.places)]
    }

    /// Where the token behind `id` stands, which stands at `stand`.
    pub fn after(self, stand: Stand, id: u32) -> Stand {
        match id == self.space {
            true => Stand { word: stand.word + 1, place: 0 },
            false => Stand { place: stand.place + 1, ..stand },
        }
    }

    /// The rows of every token of `window` into `words` and `places`; the front tokens' stay as they are.
    pub fn count(self, window: &[u32], words: &mut [u32], places: &mut [u32]) {
        let mut stand = Stand::default();
        let tokens = window.iter().zip(words.iter_mut().zip(places)).skip(self.front);
        for (&id, (word, place)) in tokens {
            [*word, *place] = self.rows(stand);
            stand = self.after(stand, id);
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
        let counter = Counter::of(&config, &tokens).unwrap();
        let (mut words, mut places) = ([9; 12], [9; 12]);
        counter.count(&[1, 7, 5, 5, 8, 8, 8, 8, 5, 9, 5, 6], &mut words, &mut places);
        // three words at most, places of three
        assert_eq!(words, [9, 0, 0, 1, 2, 2, 2, 2, 2, 2, 2, 2]);
        assert_eq!(places, [9, 0, 1, 0, 0, 1, 2, 2, 2, 0, 1, 0]);
        assert!(Counter::of(&config, &TokenLayout { varying: false, ..tokens.clone() }).is_none());
        assert!(Counter::of(&ModelConfig { positions: Positions::Absolute, ..config }, &tokens).is_none());
    }
}
