//! Windows of tokens, aligned to words: what a model trains on and what it is measured on.
//!
//! T tokens of context, K of them in front: `<bos>`, and a conditioning token per field. A sequence is input
//! `front t0 t1 ..`, target `t0 t1 ..` from the last token of the front on, where t0 is the first token of a word. Every
//! window has the front, also in the middle of a clip, because generation's sliding window does the same. Where a clip
//! ends early, both are filled with `<pad>`, which no loss counts. A word longer than a window is cut; only then does a
//! window begin inside one.

use super::words::ClipWords;
use crate::{Error, Result};
use std::ops::Range;

/// Whole words of `word` tokens in a context of `context` tokens.
///
/// # Errors
/// Not one word fits.
pub fn whole_words(context: usize, word: usize) -> Result<usize> {
    match context.checked_div(word) {
        Some(n) if n > 0 => Ok(n),
        _ => Err(Error::invalid_parameter(
            "context",
            format!("{context} tokens"),
            format!("at least the {word} tokens of one word, better three times that"),
        )),
    }
}

/// A measuring sequence: it shows `tokens` tokens of a clip and scores the targets in `scored`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EvalWindow {
    /// Index into the clips that the windows were made of.
    pub clip: usize,
    /// The token of the clip at which it starts.
    pub start: usize,
    /// Tokens it shows, at most T.
    pub tokens: usize,
    /// Places of the targets that count, in tokens from the window's first.
    pub scored: Range<usize>,
}

/// The measuring windows of clips: as many whole words as T tokens hold, a hop to the last word that begins in the first
/// half of them, and only what the window before has not scored counts (of a clip's first window all), so that every
/// token of every clip is scored exactly once and, but for a clip's beginning, after at least half a window wherever
/// words leave room for it. Of words of one length, n in a window, the hop is n/2 words.
///
/// # Errors
/// Words have one length and T doesn't hold one, or T is 0.
pub fn eval_windows<'a>(clips: impl IntoIterator<Item = ClipWords<'a>>, context: usize) -> Result<Vec<EvalWindow>> {
    let clips: Vec<ClipWords> = clips.into_iter().collect();
    Ok(each_eval_window(clips.into_iter(), context)?.collect())
}

/// The [`eval_windows`] one by one: of clips that have too many to be held.
///
/// # Errors
/// As [`eval_windows`].
pub fn each_eval_window<'a>(
    clips: impl Iterator<Item = ClipWords<'a>> + Clone,
    context: usize,
) -> Result<impl Iterator<Item = EvalWindow>> {
    whole_words(context, 1)?;
    for words in clips.clone() {
        if let ClipWords::Fixed { word, .. } = words {
            whole_words(context, word)?;
        }
    }
    Ok(clips.enumerate().flat_map(move |(clip, words)| of_clip(clip, words, context)))
}

fn of_clip(clip: usize, words: ClipWords<'_>, context: usize) -> impl Iterator<Item = EvalWindow> {
    let (mut start, mut done, total) = (0, 0, words.tokens());
    std::iter::from_fn(move || {
        if done >= total {
            return None;
        }
        let end = shown_up_to(words, start, done, context);
        let window = EvalWindow { clip, start, tokens: end - start, scored: done - start..end - start };
        done = end;
        start = next_start(words, start, end, context);
        Some(window)
    })
}

/// Where a window ends: after its last whole word, or where it is full if no word ends after `done`.
fn shown_up_to(words: ClipWords, start: usize, done: usize, context: usize) -> usize {
    let full = words.tokens().min(start + context);
    // the last word that begins at or before there ends the one before it
    let end = words.start(words.before(full + 1).saturating_sub(1));
    if full < words.tokens() && end > done { end } else { full }
}

/// Where the window after one of `start..end` starts.
fn next_start(words: ClipWords, start: usize, end: usize, context: usize) -> usize {
    let half = words.before(start + (end - start) / 2 + 1).saturating_sub(1);
    // the last word that begins in the first half, else the one after the window's first
    let later = [half, words.before(start + 1)].map(|word| words.start(word));
    match later.into_iter().find(|&next| next > start && next <= end) {
        Some(next) => next,
        // inside a word longer than the window: at least one token on, so that the windows end
        None => start + (context / 2).max(1),
    }
}

/// Writes a sequence of T places from the tokens that follow a window's start: `front` (K, at least 1) and as many tokens
/// as are left to `input`; the tokens to `target` from the last of the front on; `pad` where they end, and before.
///
/// # Panics
/// If `input` and `target` differ in length, there is no front, or there are more tokens than T + 1 - K.
pub fn fill_sequence(tokens: &[u32], front: &[u32], pad: u32, input: &mut [u32], target: &mut [u32]) {
    assert_eq!(input.len(), target.len(), "input and target of one length");
    assert!(!front.is_empty() && front.len() <= input.len(), "{} tokens in front of {}", front.len(), input.len());
    let targets = &mut target[front.len() - 1..];
    assert!(tokens.len() <= targets.len(), "{} tokens for {} places", tokens.len(), targets.len());
    targets[..tokens.len()].copy_from_slice(tokens);
    targets[tokens.len()..].fill(pad);
    input[..front.len()].copy_from_slice(front);
    // the input lags by one: each target is predicted from the tokens before it
    input[front.len()..].copy_from_slice(&targets[..targets.len() - 1]);
    target[..front.len() - 1].fill(pad);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_sequence_is_shifted_by_one_behind_its_front() {
        let (mut input, mut target) = ([9; 5], [9; 5]);
        fill_sequence(&[10, 11, 12], &[1], 0, &mut input, &mut target);
        assert_eq!((input, target), ([1, 10, 11, 12, 0], [10, 11, 12, 0, 0]));
        fill_sequence(&[10, 11, 12, 13, 14], &[1], 0, &mut input, &mut target);
        assert_eq!((input, target), ([1, 10, 11, 12, 13], [10, 11, 12, 13, 14]));
        fill_sequence(&[10, 11, 12], &[1, 7, 8], 0, &mut input, &mut target);
        assert_eq!((input, target), ([1, 7, 8, 10, 11], [0, 0, 10, 11, 12]));
    }

    #[test]
    fn a_context_below_a_word_is_refused() {
        let word = ClipWords::Fixed { word: 43, words: 5 };
        assert!(eval_windows([word], 42).unwrap_err().to_string().contains("the 43 tokens of one word"));
        assert!(eval_windows([word], 0).is_err());
        assert!(whole_words(10, 0).is_err());
    }

    #[test]
    fn windows_of_43_tokens_in_1024() {
        // 23 whole words and 35 tokens of a 24th
        let e = eval_windows([ClipWords::Fixed { word: 43, words: 40 }], 1024).unwrap();
        let words: Vec<_> =
            e.iter().map(|w| (w.start / 43, w.tokens / 43, w.scored.start / 43..w.scored.end / 43)).collect();
        assert_eq!(words, [(0, 23, 0..23), (11, 23, 12..23), (22, 18, 12..18)]);
    }

    #[test]
    fn windows_of_words_of_any_length() {
        let windows = |lengths: &[usize], context| {
            let (starts, tokens) = starts(lengths);
            let e = eval_windows([ClipWords::Varying { starts: &starts, tokens }], context).unwrap();
            e.into_iter().map(|w| (w.start, w.tokens, w.scored)).collect::<Vec<_>>()
        };
        // half of the 9 tokens shown is in the second word, half of the 8 that follow in the third
        assert_eq!(windows(&[4, 3, 2, 3, 3, 4], 10), [(0, 9, 0..9), (4, 8, 5..8), (7, 8, 5..8), (9, 10, 6..10)]);
        // words that don't fit are cut, and what is short before them is seen again
        assert_eq!(
            windows(&[2, 9, 2], 4),
            [(0, 2, 0..2), (2, 4, 0..4), (4, 4, 2..4), (6, 4, 2..4), (8, 3, 2..3), (11, 2, 0..2)]
        );
    }

    fn starts(lengths: &[usize]) -> (Vec<u32>, usize) {
        let mut end = 0;
        let starts = lengths.iter().map(|n| {
            end += n;
            (end - n) as u32
        });
        (starts.collect(), end)
    }

    proptest! {
        #[test]
        fn every_token_is_scored_once(
            clips in prop::collection::vec(prop::collection::vec(1usize..12, 0..30), 0..4),
            context in 1usize..40,
        ) {
            let clips: Vec<(Vec<u32>, usize)> = clips.iter().map(|c| starts(c)).collect();
            let words = || clips.iter().map(|(starts, tokens)| ClipWords::Varying { starts, tokens: *tokens });
            let mut seen: Vec<Vec<u32>> = clips.iter().map(|c| vec![0; c.1]).collect();
            for e in eval_windows(words(), context).unwrap() {
                prop_assert!(e.tokens <= context && e.scored.end == e.tokens && e.start + e.tokens <= seen[e.clip].len());
                let aligned = clips[e.clip].0.contains(&(e.start as u32));
                // only words longer than the window are begun inside
                let word = clips[e.clip].0.iter().rev().find(|&&s| s as usize <= e.start).map_or(0, |&s| s as usize);
                let next = clips[e.clip].0.iter().find(|&&s| s as usize > e.start).map_or(seen[e.clip].len(), |&s| s as usize);
                prop_assert!(aligned || next - word > context, "{e:?}");
                e.scored.for_each(|t| seen[e.clip][e.start + t] += 1);
            }
            prop_assert!(seen.iter().flatten().all(|&n| n == 1));
        }

        #[test]
        fn words_of_one_length_move_by_half_the_words(words in 0usize..60, word in 1usize..6, context in 1usize..40) {
            prop_assume!(context >= word);
            let n = context / word;
            let found = eval_windows([ClipWords::Fixed { word, words }], context).unwrap();
            let (mut start, mut done) = (0, 0);
            for e in &found {
                let shown = n.min(words - start);
                let expected = (start * word, shown * word, (done - start) * word..shown * word);
                prop_assert_eq!((e.start, e.tokens, e.scored.clone()), expected);
                done = start + shown;
                start += (n / 2).max(1);
            }
            prop_assert_eq!(done, words);
        }
    }
}
