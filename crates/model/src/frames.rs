//! The inputs of a two-level model: table rows for the trunk, frame by frame, and for the frame decoder, character by
//! character.
//!
//! Letters: W tokens of a word, C = W - 1 characters, S the most bins of a slot, R the number of steps. Windows begin with the
//! last token of the front here, without the labels before it, so token t of the words is input t + 1. Row t of the decoder
//! predicts it, in slot t mod W of frame t / W.
//!
//! In a classifier's model the n rows of the trunk after a window's last frame are *class rows*. Each is made of the last two
//! frames, as the row of the next frame would be, and has a vector of its own in place of a position.

use super::config::TokenLayout;
use crate::forecast;
use crate::sequence::Sequence;
use crate::words::{Steps, Words};
use kinelm_engine::bins::Bins;
use kinelm_engine::op::embedding::NONE;

/// The tables whose rows are added for a token of the frame decoder; the last where there is a forecast.
pub const SPELT: [&str; 5] = [
    "spell.last.weight",
    "spell.place.weight",
    "spell.character.weight",
    "spell.step.weight",
    "spell.innovation.weight",
];

/// The tables of [`SPELT`] that a model has.
pub fn spelt_tables(forecast: bool) -> &'static [&'static str] {
    &SPELT[..SPELT.len() - usize::from(!forecast)]
}

/// The number of previous frames that the trunk reads.
pub const BACK: usize = 2;

/// Reads windows whose words are frames.
#[derive(Debug, Clone)]
pub struct Frames {
    words: Words,
    pad: u32,
}

impl Frames {
    /// For windows of these tokens, whose slots are of one kind each.
    pub fn of(tokens: &TokenLayout) -> Frames {
        Frames { words: Words::new(1, tokens.bins()), pad: tokens.pad }
    }

    /// Frames of a window before the padding.
    pub fn shown(&self, inputs: &[u32]) -> usize {
        inputs.iter().skip(1).step_by(self.word()).take_while(|&&id| id != self.pad).count()
    }

    /// Reads the words that the frames are.
    pub fn words(&self) -> &Words {
        &self.words
    }

    /// W.
    pub fn word(&self) -> usize {
        self.words.length()
    }

    /// C: characters of a frame.
    pub fn characters(&self) -> usize {
        self.words.places().len()
    }

    /// S + 1: rows of a slot in the table of characters; the last stands for a missing one.
    pub fn bins(&self) -> usize {
        self.words.steps().most() + 1
    }

    /// The layout of tables of steps; row R, after all steps, stands for a missing one.
    pub fn steps(&self) -> Steps {
        self.words.steps()
    }

    /// The bins of a frame's slots.
    pub fn places(&self) -> &[Bins] {
        self.words.places()
    }

    /// The rows (2 C) of the table of characters that the trunk reads for frame `frame`: of the previous frame, then of the one
    /// before; each slot has S + 1 rows.
    pub fn seen(&self, inputs: &[u32], frame: usize, rows: &mut [u32]) {
        rows.iter_mut().zip(self.words.seen(inputs, frame)).for_each(|(to, row)| *to = row as u32);
    }

    /// The rows of [`SPELT`] for the decoder's row of input `at` of a sequence.
    pub(crate) fn spelt(&self, sequence: &Sequence, at: usize) -> [u32; 5] {
        let [last, place, character, step] = self.words.spelt(sequence.ids, at);
        let before = (!at.is_multiple_of(self.word())).then(|| sequence.forecast(at - 1));
        let innovation = self.innovation(sequence.ids, at, before);
        [last, place, character, step, innovation].map(|row| row as u32)
    }

    /// The last of them: of the *innovation* of the slot just read, its step from where its forecast `before` led; R where there
    /// is none.
    pub(crate) fn innovation(&self, ids: &[u32], at: usize, before: Option<i32>) -> usize {
        let innovation = before.and_then(|before| {
            // input `at` itself is what follows the input before it, no word back
            let ((bins, to), (_, from)) = (self.words.bin(ids, at - 1, 0)?, self.words.bin(ids, at - 1, 1)?);
            Some(self.steps().row(bins, forecast::reached(bins, from, before), to))
        });
        innovation.unwrap_or(self.steps().all())
    }

    /// Writes [`forecast::numbers`] of the slot that follows input `at` of a sequence into `out`; zeros where nothing is one
    /// frame back.
    pub(crate) fn forecast_numbers(&self, ids: &[u32], at: usize, forecast: i32, out: &mut [f32]) {
        match self.words.bin(ids, at, 1) {
            None => out.fill(0.0),
            Some((bins, from)) => {
                let last = self.words.bin(ids, at, 2).map_or(0, |(_, first)| forecast::step(bins, first, from));
                forecast::numbers(forecast, last, out);
            }
        }
    }

    /// Rows of the tables of [`SPELT`].
    pub(crate) fn spelt_rows(&self) -> [usize; 5] {
        let (steps, bins) = (self.steps().all() + 1, self.bins());
        [steps + bins - 1, self.word(), bins, steps, steps]
    }
}

/// A row of the trunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TrunkRow {
    /// It is made of the frames before this one.
    pub frame: usize,
    /// Its row of the table of positions; [`NONE`] of a class row.
    pub position: u32,
    /// Its row of the table of class rows; [`NONE`] for a frame's row.
    pub class: u32,
}

/// Row `row` of the trunk in a window of `shown` frames and `classes` class rows.
pub fn trunk_row(row: usize, shown: usize, classes: usize) -> TrunkRow {
    // rows after the class rows are padding: they are computed as frames and never scored
    match row.checked_sub(shown).filter(|class| *class < classes) {
        Some(class) => TrunkRow { frame: shown, position: NONE, class: class as u32 },
        None => TrunkRow { frame: row, position: row as u32, class: NONE },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;

    /// Two angles of 7 bins, one of 5, heights of 6 and 4: S 7, circular steps 7, clamped 11.
    fn frames() -> Frames {
        Frames::of(&TokenLayout { front: 1, ..fixtures::placed() })
    }

    /// `<bos>` and three frames of which the first has one character missing.
    const INPUTS: [u32; 19] = [1, 6, 3, 13, 18, 19, 5, 12, 7, 17, 23, 22, 5, 6, 6, 13, 18, 19, 5];

    #[test]
    fn the_trunk_reads_two_frames_back() {
        let frames = frames();
        assert_eq!((frames.characters(), frames.bins(), frames.steps().all()), (5, 8, 18));
        let seen = |f: usize| {
            let mut rows = [0; 10];
            frames.seen(&INPUTS, f, &mut rows);
            rows
        };
        let none = [7, 15, 23, 31, 39];
        assert_eq!(seen(0), [none, none].concat()[..]);
        assert_eq!(seen(1), [[0, 15, 16, 24, 32], none].concat()[..]);
        assert_eq!(seen(2), [[6, 9, 20, 29, 35], [0, 15, 16, 24, 32]].concat()[..]);
    }

    #[test]
    fn the_decoder_reads_steps_round_the_circle_and_up_to_the_ends() {
        let frames = frames();
        let spelt = |at: usize| frames.spelt(&Sequence::alone(&INPUTS, 6), at)[..4].to_vec();
        // begin; then bins of a first frame, after a missing one the beginning again
        assert_eq!(spelt(0), [18, 0, 7, 18]);
        assert_eq!(spelt(1), [19, 1, 7, 18]);
        assert_eq!(spelt(2), [18, 2, 7, 18]);
        // the second frame: 0 to 6 is 6 round a circle of 7
        assert_eq!(spelt(7), [6, 1, 7, 18]);
        // after a character that is missing in the previous frame, its bin
        assert_eq!(spelt(8), [18 + 1 + 1, 2, 0, 18]);
        // the third: a height from 5 down to 0, 11 clamped steps around 7 + 5
        assert_eq!(spelt(16), [7 + 5 - 5, 4, 3, 7 + 5 + 3]);
        // a space
        assert_eq!(spelt(17), [7 + 5 - 3, 5, 7, 18]);
    }

    #[test]
    fn padding_is_no_frame() {
        let frames = frames();
        assert_eq!(frames.shown(&INPUTS), 3);
        assert_eq!(frames.shown(&INPUTS[..8]), 2);
        assert_eq!(frames.shown(&[&INPUTS[..13], &[0; 12]].concat()), 2);
        assert_eq!((frames.shown(&[1]), frames.shown(&[])), (0, 0));
        let rows: Vec<_> = (0..5).map(|row| trunk_row(row, 2, 2)).collect();
        assert_eq!(rows.iter().map(|r| r.frame).collect::<Vec<_>>(), [0, 1, 2, 2, 4]);
        assert_eq!(rows.iter().map(|r| r.position).collect::<Vec<_>>(), [0, 1, NONE, NONE, 4]);
        assert_eq!(rows.iter().map(|r| r.class).collect::<Vec<_>>(), [NONE, NONE, 0, 1, NONE]);
    }

    #[test]
    fn nothing_ahead_is_read() {
        let frames = frames();
        for token in 0..18 {
            let mut other = INPUTS;
            other[token + 1..].fill(0);
            let spelt = |ids: &[u32]| frames.spelt(&Sequence::alone(ids, 6), token);
            assert_eq!(spelt(&other), spelt(&INPUTS), "{token}");
            let (mut a, mut b) = ([0; 10], [0; 10]);
            frames.seen(&INPUTS, token / 6, &mut a);
            frames.seen(&other, token / 6, &mut b);
            assert_eq!(a, b, "{token}");
        }
    }
}
