//! Which ids each slot of a word allows.

use crate::scheme::WordLength;
use crate::vocab::{FIRST_CHARACTER, SPACE, Vocabulary};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The ids that may follow one another in a word: characters (and merged tokens) up to the word's length, then the space; in
/// words of varying length the space at any slot. Every stream of ids that the grammar allows decodes.
///
/// ```
/// use kinelm_tokenizer::{Grammar, Slot, SPACE, Vocabulary, WordLength};
///
/// // words of two characters of four
/// let grammar = Grammar::new(&Vocabulary::new(4), WordLength::Fixed(2));
/// let first = Slot::default();
/// assert!(grammar.allows(first, 6) && !grammar.allows(first, SPACE));
/// let end = grammar.advance(grammar.advance(first, 6), 9);
/// assert_eq!(grammar.only(end), Some(SPACE));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grammar {
    length: WordLength,
    characters: u32,
    /// Characters of each merged token, by id.
    merged: Vec<u16>,
    vocabulary: u32,
}

/// The ids of a slot of words of one length, as ascending bins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlotIds {
    /// The id of the first bin.
    pub first: u32,
    /// The number of bins.
    pub count: u32,
    /// Whether the last bin is next to the first, as for angles.
    pub circular: bool,
}

impl SlotIds {
    /// The ids.
    pub fn ids(self) -> Range<u32> {
        self.first..self.first + self.count
    }

    /// The bin of an id; `None` for other ids.
    pub fn bin(self, id: u32) -> Option<u32> {
        id.checked_sub(self.first).filter(|&bin| bin < self.count)
    }
}

/// A slot of a word: the position of the next token.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub struct Slot {
    /// Characters of the word before it.
    pub characters: usize,
    /// Tokens of the word before it; as many as characters without merges.
    pub tokens: usize,
}

impl Grammar {
    /// The grammar of words of a length in characters.
    pub fn new(vocabulary: &Vocabulary, length: WordLength) -> Self {
        // not one per pair: two pairs may give one token
        let merged = (0..vocabulary.merged())
            .map(|i| vocabulary.length_of_id(FIRST_CHARACTER + vocabulary.characters() + i) as u16);
        Grammar { length, characters: vocabulary.characters(), merged: merged.collect(), vocabulary: vocabulary.len() }
    }

    /// V, the number of ids, including those that no word contains.
    pub fn vocabulary(&self) -> u32 {
        self.vocabulary
    }

    /// W, the tokens of a word with its space; `None` when lengths vary or characters are merged.
    pub fn tokens_per_word(&self) -> Option<usize> {
        match self.length {
            WordLength::Fixed(c) if self.merged.is_empty() => Some(c + 1),
            _ => None,
        }
    }

    /// The ids of single characters.
    pub fn characters(&self) -> Range<u32> {
        FIRST_CHARACTER..FIRST_CHARACTER + self.characters
    }

    /// The ids of characters and merged tokens.
    fn of_words(&self) -> Range<u32> {
        FIRST_CHARACTER..FIRST_CHARACTER + self.characters + self.merged.len() as u32
    }

    /// The characters of an id; 0 for the space and for ids that no word contains.
    fn length_of(&self, id: u32) -> usize {
        if self.characters().contains(&id) {
            return 1;
        }
        let first = self.characters().end;
        id.checked_sub(first).and_then(|i| self.merged.get(i as usize)).map_or(0, |&n| n.into())
    }

    /// The most characters of a word.
    fn most(&self) -> usize {
        match self.length {
            WordLength::Fixed(c) => c,
            WordLength::Varying { most } => most,
        }
    }

    /// Whether a slot allows an id.
    pub fn allows(&self, slot: Slot, id: u32) -> bool {
        match id {
            SPACE => self.may_end(slot),
            // a merged token is refused where it is longer than the rest of the word, even if its start would fit
            _ => self.of_words().contains(&id) && slot.characters + self.length_of(id) <= self.most(),
        }
    }

    fn may_end(&self, slot: Slot) -> bool {
        match self.length {
            WordLength::Fixed(c) => slot.characters >= c,
            WordLength::Varying { .. } => true,
        }
    }

    /// The slot after an id; ids that no word contains don't advance.
    pub fn advance(&self, slot: Slot, id: u32) -> Slot {
        match self.length_of(id) {
            _ if id == SPACE => Slot::default(),
            0 => slot,
            n => Slot { characters: slot.characters + n, tokens: slot.tokens + 1 },
        }
    }

    /// The space, if the slot allows nothing else.
    pub fn only(&self, slot: Slot) -> Option<u32> {
        (slot.characters >= self.most()).then_some(SPACE)
    }

    /// The ids that a slot allows, as ascending ranges; merged tokens that are too long for the rest of the word are left out.
    pub fn allowed(&self, slot: Slot) -> Vec<Range<u32>> {
        let mut ranges: Vec<Range<u32>> = Vec::new();
        let mut add = |range: Range<u32>| match ranges.last_mut() {
            // ids that follow one another become one range: a mask is then a few slices
            Some(last) if last.end == range.start => last.end = range.end,
            _ => ranges.push(range),
        };
        if self.may_end(slot) {
            add(SPACE..SPACE + 1);
        }
        if slot.characters < self.most() {
            add(self.characters());
            let room = self.most() - slot.characters;
            for (id, &n) in (self.characters().end..).zip(&self.merged) {
                if usize::from(n) <= room {
                    add(id..id + 1);
                }
            }
        }
        ranges
    }
}

#[cfg(test)]
#[allow(clippy::single_range_in_vec_init, reason = "the ids of a slot are often one range")]
mod tests {
    use super::*;

    fn walk(g: &Grammar, ids: &[u32]) -> Slot {
        ids.iter().fold(Slot::default(), |p, &id| {
            assert!(g.allows(p, id), "{p:?} {id}");
            g.advance(p, id)
        })
    }

    #[test]
    fn characters_then_a_space() {
        let g = Grammar::new(&Vocabulary::new(360), WordLength::Fixed(3));
        assert_eq!(g.tokens_per_word(), Some(4));
        assert_eq!(g.allowed(Slot::default()), [6..366]);
        let full = walk(&g, &[6, 365, 7]);
        assert_eq!((g.allowed(full), g.only(full)), (vec![5..6], Some(SPACE)));
        assert!(!g.allows(full, 6) && !g.allows(Slot::default(), 5) && !g.allows(Slot::default(), 366));
        assert_eq!(walk(&g, &[6, 7, 8, 5]), Slot::default());
        assert_eq!(g.advance(full, 1), full);
    }

    #[test]
    fn a_varying_word_may_end_anywhere() {
        let g = Grammar::new(&Vocabulary::new(60), WordLength::Varying { most: 2 });
        assert_eq!(g.tokens_per_word(), None);
        assert_eq!(g.allowed(Slot::default()), [5..66]);
        assert_eq!(g.only(walk(&g, &[6, 7])), Some(SPACE));
        assert_eq!(walk(&g, &[5, 6, 5, 6, 7, 5]), Slot::default());
    }

    #[test]
    fn merged_tokens_must_fit() {
        let v = Vocabulary::new(60).with_merges(&[(6, 7), (66, 6)]).unwrap();
        let g = Grammar::new(&v, WordLength::Fixed(3));
        assert_eq!(g.tokens_per_word(), None);
        assert_eq!(g.allowed(Slot::default()), [6..68]);
        let one = walk(&g, &[6]);
        assert_eq!(g.allowed(one), [6..67]);
        assert_eq!(g.allowed(walk(&g, &[6, 6])), [6..66]);
        assert_eq!(walk(&g, &[67]), Slot { characters: 3, tokens: 1 });
        assert_eq!(g.only(walk(&g, &[6, 66])), Some(SPACE));
    }

    #[test]
    fn two_pairs_of_one_token_allow_no_other_id() {
        // ab = 66, ab c = 67, bc = 68, and a bc is 67 again, so 69 is the first conditioning token
        let mut v = Vocabulary::new(60).with_merges(&[(6, 7), (66, 8), (7, 8), (6, 68)]).unwrap();
        assert_eq!(v.add_conditioning("genre", "salsa").unwrap(), 69);
        let g = Grammar::new(&v, WordLength::Fixed(3));
        assert_eq!(g.allowed(Slot::default()), [6..69]);
        assert!(!g.allows(Slot::default(), 69));
    }
}
