//! What a model of words of one length makes of the word before: inputs that tell it, and which place of it a logit is about.

use crate::arena::Floats;
use crate::bins::Bins;

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

/// [`Before`] without its tables.
#[derive(Debug, Clone)]
pub(super) struct Words {
    front: usize,
    places: Vec<Bins>,
}

impl Words {
    /// # Panics
    /// No places, no front, a place without bins or with ids outside the vocabulary.
    pub fn new(before: &Before, vocabulary: usize) -> Words {
        let Before { front, places, .. } = *before;
        assert!(front > 0 && !places.is_empty(), "{front} tokens in front of words of {} places", places.len());
        for bins in places {
            let end = u64::from(bins.first) + u64::from(bins.count);
            assert!(bins.count > 0 && end <= vocabulary as u64, "{bins:?} of {vocabulary} tokens");
        }
        Words { front, places: places.to_vec() }
    }

    pub fn places(&self) -> &[Bins] {
        &self.places
    }

    /// The bins that follow input `i`; `None` where a word ends, and in the front.
    pub fn follows(&self, i: usize) -> Option<Bins> {
        let k = (i + 1).checked_sub(self.front)?;
        self.places.get(k % (self.places.len() + 1)).copied()
    }

    /// The token of `ids` that stands so many `words` back of what follows input `i`.
    pub fn back(&self, ids: &[u32], i: usize, words: usize) -> Option<u32> {
        let at = (i + 1).checked_sub(words * (self.places.len() + 1)).filter(|&at| at >= self.front)?;
        Some(ids[at])
    }
}

/// The tables of [`Previous`] as a decoder has them.
pub(super) struct Inputs {
    character: Floats,
    missing: usize,
    step: Floats,
    steps: usize,
}

impl Inputs {
    /// # Panics
    /// Tables of other shapes.
    pub fn new(previous: &Previous, places: &[Bins], vocabulary: usize, width: usize) -> Inputs {
        let Previous { character, missing, step } = *previous;
        let steps = places.iter().map(|bins| bins.count as usize).max().unwrap_or(0);
        assert_eq!(character.len(), vocabulary * width, "numbers of tokens one word back");
        assert_eq!(step.len(), (steps + 1) * width, "numbers of steps");
        assert!((missing as usize) < vocabulary, "token {missing} of {vocabulary}");
        Inputs { character: Floats::of(character), missing: missing as usize, step: Floats::of(step), steps }
    }

    /// Adds to each of the rows `x` (n, D) what it is told of the words before; they are the last of `ids`, the first is input
    /// `first`.
    pub fn add(&self, x: &mut [f32], width: usize, words: &Words, ids: &[u32], first: usize) {
        for (x, i) in x.chunks_exact_mut(width).zip(first..) {
            let (a, b) = (words.back(ids, i, 1), words.back(ids, i, 2));
            let row = a.map_or(self.missing, |id| id as usize);
            let step = words.follows(i).and_then(|bins| {
                let (a, b) = (bins.bin(a?)?, bins.bin(b?)?);
                Some((a + bins.count as usize - b) % bins.count as usize)
            });
            let step = &self.step[step.unwrap_or(self.steps) * width..][..width];
            let character = &self.character[row * width..][..width];
            x.iter_mut().zip(character.iter().zip(step)).for_each(|(x, (c, s))| *x += c + s);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_follow_inputs_and_words_lie_back() {
        let angle = Bins { first: 6, count: 4, circular: true };
        let height = Bins { first: 6, count: 3, circular: false };
        let before = Before { front: 2, places: &[height, angle], previous: None, relative: None };
        let words = Words::new(&before, 10);
        // the front, the words 6 7 5, 8 9 5, 6 6 5
        let ids = [1, 2, 6, 7, 5, 8, 9, 5, 6, 6, 5];
        let follows: Vec<_> = (0..6).map(|i| words.follows(i)).collect();
        assert_eq!(follows, [None, Some(height), Some(angle), None, Some(height), Some(angle)]);
        let back = |words_back| (0..10).map(|i| words.back(&ids, i, words_back)).collect::<Vec<_>>();
        let (none, some) = (|n| vec![None; n], |ids: &[u32]| ids.iter().map(|id| Some(*id)).collect::<Vec<_>>());
        assert_eq!(back(1), [none(4), some(&[6, 7, 5, 8, 9, 5])].concat());
        assert_eq!(back(2), [none(7), some(&[6, 7, 5])].concat());
        assert_eq!((angle.bin(5), angle.bin(6), angle.bin(9), angle.bin(10)), (None, Some(0), Some(3), None));
    }
}
