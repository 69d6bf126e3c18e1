//! What a model of words of one length makes of the word before: inputs that tell it, and which place of it a logit is about.

use crate::arena::Floats;
use crate::bins::Bins;
use crate::words::{Steps, Words};

/// What a model of words of one length W makes of the word before. Input i of a sequence, counted from 0, is followed by
/// place c = k mod W of word k div W, k = i - (K - 1); c = W - 1 is the end of the word.
#[derive(Debug, Clone, Copy)]
pub struct Before<'a> {
    /// K: tokens in front of the first word, 1 or more.
    pub front: usize,
    /// (W - 1) what stands at the places of a word up to its end.
    pub places: &'a [Bins],
    /// Inputs that tell the token one word back and its last step.
    pub previous: Option<Previous<'a>>,
    /// Logits over differences to the token one word back.
    pub relative: Option<Relative<'a>>,
}

/// Added to every input: the row of a = the token one word back at the place that follows, and that of its step from the token
/// b two words back.
#[derive(Debug, Clone, Copy)]
pub struct Previous<'a> {
    /// (V, D), a row a token.
    pub character: &'a [f32],
    /// The row where there is no word back.
    pub missing: u32,
    /// (S + 1, D), S the largest count of bins: row (bin(a) - bin(b)) mod count; the last where one of them is missing or no bin.
    pub step: &'a [f32],
}

/// Logits of a place whose token one word back is bin p: of all ids the bins j of the place alone can come. The logits of the
/// first word, of ends of words and behind tokens that are no bin are the head's.
#[derive(Debug, Clone, Copy)]
pub struct Relative<'a> {
    /// (the largest count of circular places, D): bin j takes row (j - p) mod count.
    pub circular: &'a [f32],
    /// (2 m - 1, D), m the largest count of the other places: bin j takes row j - p + m - 1.
    pub clamped: &'a [f32],
}

impl Before<'_> {
    /// It without its tables.
    ///
    /// # Panics
    /// No places, no front, a place without bins or with ids outside the vocabulary.
    pub(super) fn words(&self, vocabulary: usize) -> Words {
        for bins in self.places {
            let end = u64::from(bins.first) + u64::from(bins.count);
            assert!(bins.count > 0 && end <= vocabulary as u64, "{bins:?} of {vocabulary} tokens");
        }
        Words::new(self.front, self.places.to_vec())
    }
}

/// The tables of [`Previous`] as a decoder has them.
pub(super) struct Inputs {
    character: Floats,
    missing: usize,
    step: Floats,
}

impl Inputs {
    /// # Panics
    /// Tables of other shapes.
    pub fn new(previous: &Previous, places: &[Bins], vocabulary: usize, width: usize) -> Inputs {
        let Previous { character, missing, step } = *previous;
        assert_eq!(character.len(), vocabulary * width, "numbers of tokens one word back");
        assert_eq!(step.len(), (Steps::of(places).most() + 1) * width, "numbers of steps");
        assert!((missing as usize) < vocabulary, "token {missing} of {vocabulary}");
        Inputs { character: Floats::of(character), missing: missing as usize, step: Floats::of(step) }
    }

    /// Adds to each of the rows `x` (n, D) what it is told of the words before; they are the last of `ids`, the first is input
    /// `first`.
    pub fn add(&self, x: &mut [f32], width: usize, words: &Words, ids: &[u32], first: usize) {
        for (x, i) in x.chunks_exact_mut(width).zip(first..) {
            let (back, step) = words.previous(ids, i);
            let row = back.map_or(self.missing, |id| id as usize);
            let step = &self.step[step * width..][..width];
            let character = &self.character[row * width..][..width];
            x.iter_mut().zip(character.iter().zip(step)).for_each(|(x, (c, s))| *x += c + s);
        }
    }
}
