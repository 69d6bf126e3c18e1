//! The windows of clips that a model is measured on, and what their scores sum up to.

use crate::goal::Conditioning;
use crate::{Error, ModelConfig, ModelKind, Result, Scores, TokenLayout, TokenWindows};
use kinelm_corpus::{ClipRecord, Conditions, Corpus, EvalWindow, each_eval_window};
use serde::Serialize;

/// Tokens that the model scores at a time, in whole windows.
const BATCH_TOKENS: usize = 4096;

/// The likelihood of some clips under a model.
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
    /// Windows that were scored.
    pub windows: usize,
    /// Windows there are; more than `windows` where a limit was set.
    pub all_windows: usize,
    /// Whether the model is masked: its figures are no likelihood and don't compare with a causal model's.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub pseudo: bool,
}

/// Word tokens of a window: a masked model's last input predicts itself and no token after it.
pub fn room(config: &ModelConfig, tokens: &TokenLayout) -> usize {
    match config.kind {
        ModelKind::Causal => tokens.room(config.context),
        ModelKind::Masked => tokens.room(config.context).saturating_sub(1),
    }
}

/// The windows of clips that are measured: all, or some that are spread evenly. They are never in memory together.
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
        taken.longest = taken.numbered(corpus, clips)?.map(|(_, window)| window.tokens).max().unwrap_or(1);
        Ok(taken)
    }

    /// These windows in order, each with its number among all.
    ///
    /// # Errors
    /// As [`Taken::of`].
    fn numbered<'a>(
        &self,
        corpus: &'a Corpus,
        clips: &'a [&ClipRecord],
    ) -> Result<impl Iterator<Item = (usize, EvalWindow)> + use<'a>> {
        let (all, count, mut next) = (self.all, self.count, 0);
        let windows = each_eval_window(clips.iter().map(|c| corpus.words(c)), self.room)?;
        Ok(windows.enumerate().filter(move |(number, _)| {
            // the floors of even steps: they rise by 1 or more, as count is at most all
            let is_taken = next < count && *number == next * all / count;
            next += usize::from(is_taken);
            is_taken
        }))
    }
}

/// Frames of a window's scored tokens. Those of a word that is scored in part are shared out over its tokens.
fn scored_frames(corpus: &Corpus, clip: &ClipRecord, window: &EvalWindow) -> f64 {
    let words = corpus.words(clip);
    let scored = window.start + window.scored.start..window.start + window.scored.end;
    let frames = |word: usize| {
        let (start, end) = (words.start(word), words.start(word + 1));
        let tokens = end.min(scored.end) - start.max(scored.start);
        corpus.frames_of(clip, word..word + 1) as f64 * (tokens as f64 / (end - start) as f64)
    };
    (words.before(scored.start + 1) - 1..words.before(scored.end)).map(frames).sum()
}

/// The frames (H W) of a clip that a model reads before its token `start`, the first of a word.
///
/// # Errors
/// A corpus that can no longer be read.
pub fn history_of(model: &dyn Scores, corpus: &Corpus, clip: &ClipRecord, start: usize) -> Result<Vec<u32>> {
    let most = model.config().history() * model.tokens().word;
    let ids = corpus.ids(clip, start.saturating_sub(most)..start)?;
    Ok(history(&ids, most, model.tokens().pad))
}

/// The last `length` tokens of `ids`, after padding where there are fewer.
pub fn history(ids: &[u32], length: usize, pad: u32) -> Vec<u32> {
    let ids = &ids[ids.len().saturating_sub(length)..];
    std::iter::repeat_n(pad, length - ids.len()).chain(ids.iter().copied()).collect()
}

/// Clips that a model is measured on, in windows that begin with their labels.
pub(super) struct MeasuredClips<'a> {
    pub corpus: &'a Corpus,
    pub clips: &'a [&'a ClipRecord],
    pub conditions: &'a Conditions,
    pub taken: Taken,
    /// T, at least the tokens of the longest window and its front.
    pub length: usize,
}

/// Sums over the windows.
#[derive(Default)]
pub(super) struct Score {
    pub nats: f64,
    /// Targets that count.
    pub tokens: usize,
    /// Frames of the scored tokens.
    pub frames: f64,
}

impl MeasuredClips<'_> {
    /// Scores all windows, some at a time. `fill` writes inputs and targets (T) of the window of a number from its tokens and
    /// its front; `each` gets the nats (T) of every window.
    ///
    /// # Errors
    /// A corpus that can no longer be read; a model whose probabilities are not finite, with the clip named.
    pub fn score(
        &self,
        model: &mut dyn Scores,
        mut fill: impl FnMut(u64, &EvalWindow, &[u32], &[u32], &mut [u32], &mut [u32]),
        mut each: impl FnMut(&EvalWindow, &[f32]),
    ) -> Result<Score> {
        let (pad, length) = (model.tokens().pad, self.length);
        let mut score = Score::default();
        let mut windows = self.taken.numbered(self.corpus, self.clips)?;
        loop {
            let windows: Vec<(usize, EvalWindow)> = windows.by_ref().take((BATCH_TOKENS / length).max(1)).collect();
            if windows.is_empty() {
                return Ok(score);
            }
            let (mut inputs, mut targets) = (vec![pad; windows.len() * length], vec![pad; windows.len() * length]);
            let mut history = Vec::new();
            let places = inputs.chunks_mut(length).zip(targets.chunks_mut(length));
            for ((number, window), (input, target)) in windows.iter().zip(places) {
                let clip = self.clips[window.clip];
                let ids = self.corpus.ids(clip, window.start..window.start + window.tokens)?;
                fill(*number as u64, window, &ids, &self.conditions.front(&clip.labels), input, target);
                history.extend(history_of(model, self.corpus, clip, window.start)?);
                score.frames += scored_frames(self.corpus, clip, window);
            }
            score.tokens += targets.iter().filter(|&&id| id != pad).count();
            let mut nats = vec![0.0; targets.len()];
            let music = self.music(model.config(), &windows)?;
            let batch = TokenWindows {
                inputs: &inputs,
                targets: &targets,
                length,
                history: &history,
                conditioning: music.as_ref(),
            };
            model.nats(batch, &mut nats)?;
            for ((_, window), nats) in windows.iter().zip(nats.chunks(length)) {
                let sum: f64 = nats.iter().map(|&x| f64::from(x)).sum();
                // a NaN in a mean would name no clip
                if !sum.is_finite() {
                    let clip = &self.clips[window.clip].name;
                    return Err(Error::NotFinite(format!("{clip} from token {}: {sum} nats", window.start)));
                }
                score.nats += sum;
                each(window, nats);
            }
        }
    }

    /// The music conditioning of windows, if the model has one and conditions aren't hidden.
    fn music(&self, config: &ModelConfig, windows: &[(usize, EvalWindow)]) -> Result<Option<Conditioning>> {
        let MeasuredClips { corpus, clips, conditions, length, .. } = self;
        let (manifest, is_used) = (corpus.manifest(), !config.music.is_none() && !conditions.are_hidden());
        let Some(word) = manifest.tokens_per_word.filter(|_| is_used) else { return Ok(None) };
        let frames = (length + 1 - conditions.len()) / word;
        let of_window = |(_, window): &(usize, EvalWindow)| {
            let first = window.start / word;
            let times = (first..first + frames).map(|frame| frame as f64 / manifest.fps);
            Ok(config.music_conditioning(&corpus.music(clips[window.clip])?, times, 1.0))
        };
        let all: Vec<Vec<f32>> = windows.iter().map(of_window).collect::<Result<_>>()?;
        Ok(Some(Conditioning { music: all.concat(), ..Conditioning::default() }))
    }
}
