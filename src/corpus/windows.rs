//! Windows of tokens, aligned to words: what a model trains on and what it is measured on.
//!
//! T tokens of context, W tokens a word. A sequence is input `<bos> t0 t1 .. t(T-2)`, target `t0 .. t(T-1)`, and t0 is
//! the first character of a frame. `<bos>` stands at the front of every window, also in the middle of a clip, because
//! generation's sliding window does the same. Where a clip ends early, both are filled up with `<pad>`, which no loss
//! counts.

use crate::{Error, Result};
use std::ops::Range;

/// Whole words in a context of `context` tokens: T div W.
///
/// # Errors
/// [`Error::Call`] when not one word fits.
pub fn context_frames(context: usize, tokens_per_frame: usize) -> Result<usize> {
    match context.checked_div(tokens_per_frame) {
        Some(n) if n > 0 => Ok(n),
        _ => Err(Error::Call(format!(
            "a context of {context} tokens doesn't hold one frame of {tokens_per_frame}; give at least {tokens_per_frame}, \
             better three times that"
        ))),
    }
}

/// A training sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Index into the clips that the windows were made of.
    pub clip: usize,
    /// The frame of the clip at which it starts.
    pub frame: usize,
    /// Targets that are the clip's, 1..=T; the rest is padding.
    pub tokens: usize,
}

/// All training windows of some clips: one at every frame from which a context's whole words fit, so that each token
/// of a clip stands in at least one; a shorter clip has one, padded. Listed clip by clip without being stored.
#[derive(Debug, Clone)]
pub struct TrainWindows {
    ends: Vec<usize>,   // per clip: windows up to and with it
    frames: Vec<usize>, // per clip: F
    context: usize,
    tokens_per_frame: usize,
}

impl TrainWindows {
    /// The windows of clips of these `frames`.
    ///
    /// # Errors
    /// [`Error::Call`] when not one word fits into `context` tokens.
    pub fn new(frames: impl IntoIterator<Item = usize>, context: usize, tokens_per_frame: usize) -> Result<Self> {
        let n = context_frames(context, tokens_per_frame)?;
        let frames: Vec<usize> = frames.into_iter().collect();
        let mut total = 0;
        let ends = frames.iter().map(|&f| {
            total += if f == 0 { 0 } else { f.saturating_sub(n) + 1 };
            total
        });
        Ok(TrainWindows { ends: ends.collect(), frames, context, tokens_per_frame })
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.ends.last().copied().unwrap_or(0)
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The window of this index.
    ///
    /// # Panics
    /// If `index` is not below [`TrainWindows::len`].
    pub fn get(&self, index: usize) -> Window {
        assert!(index < self.len(), "window {index} of {}", self.len());
        let clip = self.ends.partition_point(|&end| end <= index);
        let frame = index - if clip == 0 { 0 } else { self.ends[clip - 1] };
        let tokens = ((self.frames[clip] - frame) * self.tokens_per_frame).min(self.context);
        Window { clip, frame, tokens }
    }
}

/// A measuring sequence: it shows `frames` frames of a clip and scores the targets in `scored`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EvalWindow {
    /// Index into the clips that the windows were made of.
    pub clip: usize,
    /// The frame of the clip at which it starts.
    pub frame: usize,
    /// Frames it shows, at most T div W.
    pub frames: usize,
    /// Places of the targets that count, in tokens from the window's first.
    pub scored: Range<usize>,
}

/// The measuring windows of clips of these `frames`: T div W frames each, a hop of half of them, and only what the
/// window before has not scored counts (of a clip's first window all), so that every token of every clip is scored
/// exactly once and, but for a clip's beginning, after at least half a window.
///
/// # Errors
/// [`Error::Call`] when not one word fits into `context` tokens.
pub fn eval_windows(
    frames: impl IntoIterator<Item = usize>,
    context: usize,
    tokens_per_frame: usize,
) -> Result<Vec<EvalWindow>> {
    let n = context_frames(context, tokens_per_frame)?;
    let hop = (n / 2).max(1);
    let mut windows = Vec::new();
    for (clip, total) in frames.into_iter().enumerate() {
        let (mut start, mut done) = (0, 0);
        while done < total {
            let shown = n.min(total - start);
            let scored = (done - start) * tokens_per_frame..shown * tokens_per_frame;
            windows.push(EvalWindow { clip, frame: start, frames: shown, scored });
            done = start + shown;
            start += hop;
        }
    }
    Ok(windows)
}

/// Writes a sequence of `input.len()` places from the tokens that follow a window's start: `<bos>` and all but the
/// last to `input`, all to `target`, `pad` where they end.
///
/// # Panics
/// If `input` and `target` differ in length, or there are more tokens than places.
pub fn fill_sequence(tokens: &[u32], bos: u32, pad: u32, input: &mut [u32], target: &mut [u32]) {
    assert_eq!(input.len(), target.len(), "input and target of one length");
    assert!(tokens.len() <= target.len(), "{} tokens for {} places", tokens.len(), target.len());
    target[..tokens.len()].copy_from_slice(tokens);
    target[tokens.len()..].fill(pad);
    if let Some((first, rest)) = input.split_first_mut() {
        *first = bos;
        rest.copy_from_slice(&target[..target.len() - 1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_sequence_is_shifted_by_one_behind_bos() {
        let (mut input, mut target) = ([9; 5], [9; 5]);
        fill_sequence(&[10, 11, 12], 1, 0, &mut input, &mut target);
        assert_eq!((input, target), ([1, 10, 11, 12, 0], [10, 11, 12, 0, 0]));
        fill_sequence(&[10, 11, 12, 13, 14], 1, 0, &mut input, &mut target);
        assert_eq!((input, target), ([1, 10, 11, 12, 13], [10, 11, 12, 13, 14]));
    }

    #[test]
    fn a_context_below_a_word_is_refused() {
        assert!(TrainWindows::new([5], 42, 43).unwrap_err().to_string().contains("one frame of 43"));
        assert!(eval_windows([5], 42, 43).is_err());
        assert!(context_frames(10, 0).is_err());
    }

    #[test]
    fn windows_of_43_tokens_in_1024() {
        // 23 whole words and 35 tokens of a 24th
        let w = TrainWindows::new([30, 10, 0, 23], 1024, 43).unwrap();
        assert_eq!(w.len(), 8 + 1 + 1);
        assert_eq!(w.get(0), Window { clip: 0, frame: 0, tokens: 1024 });
        assert_eq!(w.get(7), Window { clip: 0, frame: 7, tokens: 989 });
        assert_eq!(w.get(8), Window { clip: 1, frame: 0, tokens: 430 });
        assert_eq!(w.get(9), Window { clip: 3, frame: 0, tokens: 989 });
        let e = eval_windows([40], 1024, 43).unwrap();
        let scored: Vec<_> = e.iter().map(|w| (w.frame, w.frames, w.scored.start / 43..w.scored.end / 43)).collect();
        assert_eq!(scored, [(0, 23, 0..23), (11, 23, 12..23), (22, 18, 12..18)]);
    }

    proptest! {
        #[test]
        fn every_token_is_scored_once(frames in prop::collection::vec(0usize..60, 0..5), w in 1usize..6, context in 1usize..40) {
            prop_assume!(context >= w);
            let n = context / w;
            let mut seen: Vec<Vec<u32>> = frames.iter().map(|f| vec![0; f * w]).collect();
            for e in eval_windows(frames.clone(), context, w).unwrap() {
                prop_assert!(e.frames * w <= context && e.scored.end <= e.frames * w);
                prop_assert!(e.frame == 0 || e.scored.start >= (n / 2) * w);
                e.scored.for_each(|t| seen[e.clip][e.frame * w + t] += 1);
            }
            prop_assert!(seen.iter().flatten().all(|&n| n == 1));
        }

        #[test]
        fn every_token_is_in_a_training_window(frames in prop::collection::vec(0usize..60, 0..5), w in 1usize..6, context in 1usize..40) {
            prop_assume!(context >= w);
            let mut seen: Vec<Vec<bool>> = frames.iter().map(|f| vec![false; f * w]).collect();
            let all = TrainWindows::new(frames.clone(), context, w).unwrap();
            for i in 0..all.len() {
                let x = all.get(i);
                prop_assert!(x.tokens >= 1 && x.tokens <= context);
                seen[x.clip][x.frame * w..x.frame * w + x.tokens].fill(true);
            }
            prop_assert!(seen.iter().flatten().all(|&s| s));
        }
    }
}
