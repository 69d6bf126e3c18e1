//! Sequences of words of one length: the slot that follows an input, the tokens one and two words back, and their table
//! rows. All forms of a model read previous words through this.
//!
//! Letters: K tokens in front, W tokens of a word, the last of which ends it, C = W - 1 the others. Input i, counted from 0, is
//! followed by slot c = k mod W of word k div W, k = i - (K - 1). S is the most bins of any slot, Sc of circular slots, Sl of
//! the others, R = Sc + max(2 Sl - 1, 0) the number of steps.

use kinelm_engine::bins::Bins;

/// Reads sequences of words of one length.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Words {
    front: usize,
    places: Vec<Bins>,
    steps: Steps,
}

impl Words {
    /// Words of the slots `places` (C) and an end, after `front` tokens, K.
    ///
    /// # Panics
    /// If there are no slots or no front.
    pub(crate) fn new(front: usize, places: Vec<Bins>) -> Words {
        assert!(front > 0 && !places.is_empty(), "{front} tokens in front of words of {} places", places.len());
        Words { front, steps: Steps::of(&places), places }
    }

    /// (C): the bins of the slots.
    pub fn places(&self) -> &[Bins] {
        &self.places
    }

    /// W.
    pub fn length(&self) -> usize {
        self.places.len() + 1
    }

    /// The steps from a word to the next.
    pub fn steps(&self) -> Steps {
        self.steps
    }

    /// The bins of the slot that follows input `i`; `None` for the end of a word, and in the front.
    pub(crate) fn follows(&self, i: usize) -> Option<Bins> {
        let k = (i + 1).checked_sub(self.front)?;
        self.places.get(k % self.length()).copied()
    }

    /// The token of `ids` that is `words` words before the slot that follows input `i`; `None` where there is none.
    pub fn back(&self, ids: &[u32], i: usize, words: usize) -> Option<u32> {
        // what follows input i is token i + 1; a front token is no word's
        let at = (i + 1).checked_sub(words * self.length()).filter(|&at| at >= self.front)?;
        ids.get(at).copied()
    }

    /// The bins of the slot that follows input `i` of `ids`, and its bin `words` words back.
    pub(crate) fn bin(&self, ids: &[u32], i: usize, words: usize) -> Option<(Bins, usize)> {
        let bins = self.follows(i)?;
        Some((bins, bins.bin(self.back(ids, i, words)?)?))
    }

    /// The token one word before the slot that follows input `i`, and its step from two words back, mod the bins; S where there
    /// is no such step.
    pub(crate) fn previous(&self, ids: &[u32], i: usize) -> (Option<u32>, usize) {
        let step =
            self.bin(ids, i, 1).zip(self.bin(ids, i, 2)).map(|((bins, a), (_, b))| around(bins, a as i64 - b as i64));
        (self.back(ids, i, 1), step.unwrap_or(self.steps.most()))
    }

    /// The rows of a table of bins, S + 1 per slot, that a trunk reads for word `word` of a sequence whose front is one token:
    /// C of the previous word, then C of the one before; the last row of a slot stands for a missing bin.
    pub(crate) fn seen(&self, ids: &[u32], word: usize) -> impl Iterator<Item = usize> {
        debug_assert_eq!(self.front, 1, "a sequence whose front is one token");
        let rows = self.steps.most() + 1;
        let row = move |back, place| {
            let bin = self.bin(ids, word * self.length() + place, back).map_or(rows - 1, |(_, bin)| bin);
            place * rows + bin
        };
        (1..=2).flat_map(move |back| (0..self.places.len()).map(move |place| row(back, place)))
    }

    /// The rows of the four tables whose sum is a frame decoder's row for input `i` of a sequence whose front is one token: the
    /// step to the token just read (R + 1 + bin where there is no previous word; R at the beginning of a word), the slot, the
    /// bin one word back in the slot that follows (S: missing), and its step from two words back (R: none).
    pub(crate) fn spelt(&self, ids: &[u32], i: usize) -> [usize; 4] {
        debug_assert_eq!(self.front, 1, "a sequence whose front is one token");
        let (none, place) = (self.steps.all(), i % self.length());
        let (one, two) = (self.bin(ids, i, 1), self.bin(ids, i, 2));
        let step = one.zip(two).map_or(none, |((bins, a), (_, b))| self.steps.row(bins, b, a));
        // input i itself is what follows the input before it, no word back
        let read = |words| if place == 0 { None } else { self.bin(ids, i - 1, words) };
        let last = match (read(0), read(1)) {
            (Some((bins, to)), Some((_, from))) => self.steps.row(bins, from, to),
            (Some((_, to)), None) => none + 1 + to,
            (None, _) => none,
        };
        [last, place, one.map_or(self.steps.most(), |(_, bin)| bin), step]
    }
}

/// How tables of steps from bin to bin are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Steps {
    /// Sc; 0 where there are no circular slots.
    pub circular: usize,
    /// Sl; 0 where there are none.
    pub clamped: usize,
}

impl Steps {
    /// The steps of some slots.
    pub fn of(places: &[Bins]) -> Steps {
        let most = |circular: bool| {
            let counts = places.iter().filter(|bins| bins.circular == circular).map(|bins| bins.count as usize);
            counts.max().unwrap_or(0)
        };
        Steps { circular: most(true), clamped: most(false) }
    }

    /// S.
    pub fn most(self) -> usize {
        self.circular.max(self.clamped)
    }

    /// Steps of slots that aren't circular: up and down by all bins but one.
    pub fn up_and_down(self) -> usize {
        (2 * self.clamped).saturating_sub(1)
    }

    /// R.
    pub fn all(self) -> usize {
        self.circular + self.up_and_down()
    }

    /// The row of a step of `by` bins, fewer than the slot has, in the table of its kind: by mod count in the circular one,
    /// by + Sl - 1 in the other.
    pub(crate) fn column_by(self, bins: Bins, by: i64) -> usize {
        if bins.circular { around(bins, by) } else { (self.clamped as i64 - 1 + by) as usize }
    }

    /// The row of the step from bin `from` to bin `to` in the table of its kind.
    pub fn column(self, bins: Bins, from: usize, to: usize) -> usize {
        self.column_by(bins, to as i64 - from as i64)
    }

    /// The row of a step of `by` bins in a table of all steps, circular ones first.
    pub(crate) fn row_by(self, bins: Bins, by: i64) -> usize {
        self.column_by(bins, by) + if bins.circular { 0 } else { self.circular }
    }

    /// The row of the step from bin `from` to bin `to` there.
    pub(crate) fn row(self, bins: Bins, from: usize, to: usize) -> usize {
        self.row_by(bins, to as i64 - from as i64)
    }
}

fn around(bins: Bins, by: i64) -> usize {
    by.rem_euclid(bins.count.into()) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANGLE: Bins = Bins { first: 6, count: 4, circular: true };
    const HEIGHT: Bins = Bins { first: 6, count: 3, circular: false };

    #[test]
    fn places_follow_inputs_and_words_lie_back() {
        let words = Words::new(2, vec![HEIGHT, ANGLE]);
        // the front, the words 6 7 5, 8 9 5, 6 6 5
        let ids = [1, 2, 6, 7, 5, 8, 9, 5, 6, 6, 5];
        let follows: Vec<_> = (0..6).map(|i| words.follows(i)).collect();
        assert_eq!(follows, [None, Some(HEIGHT), Some(ANGLE), None, Some(HEIGHT), Some(ANGLE)]);
        let back = |words_back| (0..10).map(|i| words.back(&ids, i, words_back)).collect::<Vec<_>>();
        let (none, some) = (|n| vec![None; n], |ids: &[u32]| ids.iter().map(|id| Some(*id)).collect::<Vec<_>>());
        assert_eq!(back(1), [none(4), some(&[6, 7, 5, 8, 9, 5])].concat());
        assert_eq!(back(2), [none(7), some(&[6, 7, 5])].concat());
        assert_eq!((ANGLE.bin(5), ANGLE.bin(6), ANGLE.bin(9), ANGLE.bin(10)), (None, Some(0), Some(3), None));
        // S is 4: no step in the first two words and at ends; 8 to 6 round 3, 9 to 6 round 4
        let previous: Vec<_> = (0..10).map(|i| words.previous(&ids, i)).collect();
        assert_eq!(previous[..4], [(None, 4); 4]);
        assert_eq!(previous[4..7], [(Some(6), 4), (Some(7), 4), (Some(5), 4)]);
        assert_eq!(previous[7..], [(Some(8), 2), (Some(9), 2), (Some(5), 4)]);
    }

    #[test]
    fn columns_are_steps() {
        let steps = Steps::of(&[HEIGHT, ANGLE]);
        assert_eq!((steps.circular, steps.clamped, steps.most(), steps.up_and_down(), steps.all()), (4, 3, 4, 5, 9));
        let columns =
            |bins: Bins, from| (0..bins.count as usize).map(|to| steps.column(bins, from, to)).collect::<Vec<_>>();
        assert_eq!(columns(ANGLE, 3), [1, 2, 3, 0]);
        assert_eq!((columns(HEIGHT, 0), columns(HEIGHT, 2)), (vec![2, 3, 4], vec![0, 1, 2]));
        assert_eq!((steps.row(ANGLE, 3, 0), steps.row(HEIGHT, 0, 0)), (1, 4 + 2));
        assert_eq!(Steps::of(&[ANGLE]).up_and_down(), 0);
    }
}
