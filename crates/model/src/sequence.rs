//! Windows as models read them: after the frames that lie before them, with the forecasts of their slots.
//!
//! A model's rows are those of a window (B, T). What a row is made of and what its logits count from may lie before the
//! window: a model with `model.forecast` reads up to [`HISTORY`] frames there, so that frames at the beginning of a window are
//! coded as any other. Letters: K tokens in front, H frames of history, W tokens of a word.

use crate::config::{Architecture, ModelConfig, TokenLayout};
use crate::forecast::{Forecast, HISTORY, Track};
use crate::{Error, Result};
use rayon::prelude::*;

/// How a model's windows become sequences.
#[derive(Debug, Clone)]
pub(crate) struct SequenceLayout {
    /// Tokens of the front that no sequence has: all but the last of a two-level model, of a flat one none.
    skipped: usize,
    /// Tokens in front of the words of a sequence.
    front: usize,
    /// H W.
    history: usize,
    word: usize,
    pad: u32,
}

impl SequenceLayout {
    pub fn of(config: &ModelConfig, tokens: &TokenLayout) -> SequenceLayout {
        let skipped = if config.architecture == Architecture::TwoLevel { tokens.front - 1 } else { 0 };
        SequenceLayout {
            skipped,
            front: tokens.front - skipped,
            history: config.history() * tokens.word,
            word: tokens.word,
            pad: tokens.pad,
        }
    }

    /// Tokens in front of the words of a sequence.
    pub fn front(&self) -> usize {
        self.front
    }

    /// H W.
    pub fn history(&self) -> usize {
        self.history
    }

    /// Whether sequences have frames before the window.
    pub fn has_history(&self) -> bool {
        self.history > 0
    }

    /// Whether the slot that follows input `at` of a sequence has a word of the window before its own.
    pub fn has_word_before(&self, at: usize) -> bool {
        at + 1 >= self.front + self.history + self.word
    }

    /// The index in a sequence of input `i` of its window; `None` for those that no sequence has.
    pub fn at(&self, i: usize) -> Option<usize> {
        Some(i.checked_sub(self.skipped)? + self.history)
    }
}

/// A window in its sequence.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sequence<'a> {
    /// The front's last token, (H W) of the history, the words of the window; of a flat model the window.
    pub ids: &'a [u32],
    /// The first word that isn't padding, and the forecasts (F, C) of the slots from it on; empty without a forecast.
    first: usize,
    forecasts: &'a [i32],
    word: usize,
}

impl<'a> Sequence<'a> {
    /// A sequence without a forecast.
    #[cfg(test)]
    pub fn alone(ids: &'a [u32], word: usize) -> Sequence<'a> {
        Sequence { ids, first: 0, forecasts: &[], word }
    }

    /// The forecast of the slot that follows input `at` of the sequence; 0 where there is none.
    pub fn forecast(&self, at: usize) -> i32 {
        let (word, slot, slots) = (at / self.word, at % self.word, self.word - 1);
        if self.forecasts.is_empty() || slot == slots || word < self.first {
            return 0;
        }
        self.forecasts[(word - self.first) * slots + slot]
    }
}

/// The sequences of a batch. Nothing is allocated when they are filled again.
pub(crate) struct Sequences {
    pub layout: SequenceLayout,
    all: Vec<Filled>,
}

struct Filled {
    ids: Vec<u32>,
    first: usize,
    track: Option<Track>,
}

impl Sequences {
    /// Room for `batch` windows of `length` inputs.
    pub fn new(config: &ModelConfig, tokens: &TokenLayout, batch: usize, length: usize) -> Sequences {
        let layout = SequenceLayout::of(config, tokens);
        let length = layout.history + length.saturating_sub(layout.skipped);
        let track = || config.forecast().then(|| Track::new(tokens.word - 1, length.div_ceil(tokens.word)));
        let filled = || Filled { ids: vec![tokens.pad; length], first: 0, track: track() };
        Sequences { all: (0..batch).map(|_| filled()).collect(), layout }
    }

    /// Takes windows of these `inputs` (B, T) after their `history` (B, H W), which may be empty.
    pub fn fill(&mut self, inputs: &[u32], history: &[u32], forecast: Option<&Forecast>) {
        let SequenceLayout { skipped, history: before, word, pad, .. } = self.layout;
        let width = inputs.len() / self.all.len().max(1);
        self.all.par_iter_mut().enumerate().for_each(|(i, filled)| {
            let window = inputs[i * width..(i + 1) * width].get(skipped..).unwrap_or_default();
            let Some((front, words)) = window.split_first() else { return };
            filled.ids[0] = *front;
            match history.get(i * before..(i + 1) * before).filter(|history| !history.is_empty()) {
                Some(history) => filled.ids[1..=before].copy_from_slice(history),
                None => filled.ids[1..=before].fill(pad),
            }
            filled.ids[1 + before..].copy_from_slice(words);
            if let Some((track, forecast)) = filled.track.as_mut().zip(forecast) {
                let all = &filled.ids[1..];
                filled.first = all.chunks(word).take(before / word).take_while(|ids| ids[0] == pad).count();
                track.truncate(0);
                track.follow(forecast, &all[filled.first * word..]);
            }
        });
    }

    /// The sequence of a window.
    pub fn get(&self, window: usize) -> Sequence<'_> {
        let Filled { ids, first, track } = &self.all[window];
        let forecasts = track.as_ref().map_or(&[][..], Track::forecasts);
        Sequence { ids, first: *first, forecasts, word: self.layout.word }
    }

    /// All of them.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Sequence<'_>> {
        (0..self.all.len()).map(|window| self.get(window))
    }
}

impl ModelConfig {
    /// Checks the frames before `batch` windows.
    ///
    /// # Errors
    /// Another number of tokens than those of [`ModelConfig::history`] frames each, or none.
    pub(crate) fn check_history(&self, tokens: &TokenLayout, batch: usize, history: &[u32]) -> Result<()> {
        let expected = batch * self.history() * tokens.word;
        match history.is_empty() || history.len() == expected {
            true => Ok(()),
            false => {
                let expected = format!("{expected}, {} frames for each of {batch} windows, or none", self.history());
                Err(Error::invalid("the tokens before windows", history.len(), expected))
            }
        }
    }

    /// H: frames before a window that the model reads.
    pub fn history(&self) -> usize {
        if self.forecast() { HISTORY } else { 0 }
    }
}
