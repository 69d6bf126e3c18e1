//! The windows of clips that a model is measured on, and what their scores sum up to.

use crate::{ModelConfig, ModelKind, Result, TokenLayout};
use kinelm_corpus::{ClipRecord, Corpus, EvalWindow, each_eval_window};
use serde::Serialize;

/// Tokens that the model scores at a time, in whole windows.
pub(super) const BATCH_TOKENS: usize = 4096;

/// What a model makes of some clips.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Likelihood {
    /// Bits of all scored tokens, spaces included, divided by their frames.
    pub bits_per_frame: f64,
    /// Nats of all scored tokens divided by their number.
    pub nats_per_token: f64,
    /// Tokens that were scored.
    pub tokens: usize,
    /// Their frames, rounded; those of a word that was scored in part are shared out over its tokens.
    pub frames: usize,
    /// Windows they stood in.
    pub windows: usize,
    /// Windows there are; more than `windows` where a limit was set.
    pub all_windows: usize,
    /// Whether the model is masked: its figures are no likelihood and don't compare with a causal model's.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub pseudo: bool,
}

/// Word tokens of a window: a masked model's last input predicts no token behind it.
pub fn room(config: &ModelConfig, tokens: &TokenLayout) -> usize {
    match config.kind {
        ModelKind::Causal => tokens.room(config.context),
        ModelKind::Masked => tokens.room(config.context).saturating_sub(1),
    }
}

/// The windows of clips that are measured: all, or some that are spread evenly. They are never held together.
pub(super) struct Taken {
    room: usize,
    /// Windows there are.
    pub(super) all: usize,
    /// Windows that are taken.
    pub(super) count: usize,
    /// Tokens of the longest of these; 1 where there is none.
    pub(super) longest: usize,
}

impl Taken {
    /// At most `most` windows of `room` tokens; 0: all.
    ///
    /// # Errors
    /// Those of [`each_eval_window`].
    pub(super) fn of(corpus: &Corpus, clips: &[&ClipRecord], room: usize, most: usize) -> Result<Taken> {
        let all = each_eval_window(clips.iter().map(|c| corpus.words(c)), room)?.count();
        let count = if most == 0 { all } else { most.min(all) };
        let mut taken = Taken { room, all, count, longest: 1 };
        taken.longest = taken.windows(corpus, clips)?.map(|w| w.tokens).max().unwrap_or(1);
        Ok(taken)
    }

    /// They, in order.
    ///
    /// # Errors
    /// As [`Taken::of`].
    pub(super) fn windows<'a>(
        &self,
        corpus: &'a Corpus,
        clips: &'a [&ClipRecord],
    ) -> Result<impl Iterator<Item = EvalWindow> + use<'a>> {
        Ok(self.numbered(corpus, clips)?.map(|(_, window)| window))
    }

    /// They, in order, each with its number among all.
    ///
    /// # Errors
    /// As [`Taken::of`].
    pub(super) fn numbered<'a>(
        &self,
        corpus: &'a Corpus,
        clips: &'a [&ClipRecord],
    ) -> Result<impl Iterator<Item = (usize, EvalWindow)> + use<'a>> {
        let (all, count, mut next) = (self.all, self.count, 0);
        let windows = each_eval_window(clips.iter().map(|c| corpus.words(c)), self.room)?;
        Ok(windows.enumerate().filter(move |(number, _)| {
            let is_taken = next < count && *number == next * all / count;
            next += usize::from(is_taken);
            is_taken
        }))
    }
}

/// Frames of a window's scored tokens. Those of a word that is scored in part are shared out over its tokens.
pub(super) fn scored_frames(corpus: &Corpus, clip: &ClipRecord, window: &EvalWindow) -> f64 {
    let words = corpus.words(clip);
    let scored = window.start + window.scored.start..window.start + window.scored.end;
    let frames = |word: usize| {
        let (start, end) = (words.start(word), words.start(word + 1));
        let tokens = end.min(scored.end) - start.max(scored.start);
        corpus.frames_of(clip, word..word + 1) as f64 * (tokens as f64 / (end - start) as f64)
    };
    (words.before(scored.start + 1) - 1..words.before(scored.end)).map(frames).sum()
}
