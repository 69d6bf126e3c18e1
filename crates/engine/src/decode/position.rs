//! What is added to a token's vector for where it stands.

use crate::arena::Floats;
use crate::words::Stand;

/// Position tables.
#[derive(Debug, Clone, Copy)]
pub enum Positions<'a> {
    /// (T, D): a row for each place of a sequence.
    Places(&'a [f32]),
    /// Words of any length: the tokens in front have a row of their own each, every other the sum of its word's and of its place's in
    /// the word. Words and places behind the end of their table share its last row.
    Words {
        /// A row each of the tokens in front.
        front: &'a [f32],
        /// A row a word of the sequence, the first behind the front.
        word: &'a [f32],
        /// A row a place of a word.
        place: &'a [f32],
        /// The token that ends a word, its last.
        end: u32,
    },
}

/// The tables as a decoder has them.
pub(super) enum Tables {
    Places(Floats),
    Words { front: Floats, word: Floats, place: Floats, end: u32 },
}

impl Tables {
    /// # Panics
    /// Tables that have no rows, or other than T where every place has one.
    pub fn new(positions: &Positions, context: usize, width: usize) -> Tables {
        let table = |what: &str, numbers: &[f32]| {
            let rows = !numbers.is_empty() && numbers.len().is_multiple_of(width);
            assert!(rows, "{} numbers of {what}, a row has {width}", numbers.len());
            Floats::of(numbers)
        };
        match *positions {
            Positions::Places(places) => {
                assert_eq!(places.len(), context * width, "numbers of positions");
                Tables::Places(Floats::of(places))
            }
            Positions::Words { front, word, place, end } => {
                let (front, word, place) = (table("the front", front), table("words", word), table("places", place));
                Tables::Words { front, word, place, end }
            }
        }
    }

    /// Places that are kept for a stream of a context, beside its tokens.
    pub fn stands(&self, context: usize) -> usize {
        match self {
            Tables::Places(_) => 0,
            // one behind the last
            Tables::Words { .. } => context + 1,
        }
    }

    /// Adds to each of the rows `x` (n, D) the row for where its token stands, the first at place `first` of its stream, whose
    /// `stands` are known up to there and are written up to behind the last.
    pub fn add(&self, x: &mut [f32], width: usize, tokens: &[u32], first: usize, stands: &mut [Stand]) {
        let rows = x.chunks_exact_mut(width);
        match self {
            Tables::Places(table) => {
                for (x, position) in rows.zip(table[first * width..].chunks_exact(width)) {
                    x.iter_mut().zip(position).for_each(|(x, p)| *x += p);
                }
            }
            Tables::Words { front, word, place, end } => {
                for (x, (at, &id)) in rows.zip((first..).zip(tokens)) {
                    let stand = stands[at];
                    if let Some(front) = front.get(at * width..(at + 1) * width) {
                        x.iter_mut().zip(front).for_each(|(x, p)| *x += p);
                        stands[at + 1] = Stand::default();
                    } else {
                        let (word, place) = (last_or(word, width, stand.word), last_or(place, width, stand.place));
                        x.iter_mut().zip(word.iter().zip(place)).for_each(|(x, (w, p))| *x += w + p);
                        stands[at + 1] = stand.behind(id == *end);
                    }
                }
            }
        }
    }
}

/// A row of a table, or its last.
fn last_or(table: &[f32], width: usize, row: usize) -> &[f32] {
    &table[row.min(table.len() / width - 1) * width..][..width]
}
