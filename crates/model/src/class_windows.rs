//! The windows of a clip as a classifier reads them.
//!
//! One row of the model after the window's last word classifies each field. In a flat model the row is a class token's;
//! in a two-level model the trunk has class rows there, which belong to no token.

use crate::{Error, ModelConfig, Result, TokenLayout};
use kinelm_corpus::fill_sequence;
use kinelm_engine::op::attention::Mask;
use kinelm_tokenizer::Special;
use std::ops::Range;

/// The layout that all windows of a classifier share.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// K ids: `<bos>`, and `<unk>` for every condition the model knows.
    front: Vec<u32>,
    /// W.
    word: usize,
    /// Words of a window, at most.
    words: usize,
    /// The first class token; those of the other fields follow. None where rows are frames.
    class_token: Option<u32>,
    /// n.
    fields: usize,
    pad: u32,
}

/// Some words of a clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Index into the clips.
    pub clip: usize,
    /// The first word.
    pub word: usize,
    /// m.
    pub words: usize,
}

/// Ranges of `most` words that advance by half of that, the last one to the end of `all`; one for a shorter clip.
pub fn half_apart(most: usize, all: usize) -> impl Iterator<Item = Range<usize>> {
    let words = most.min(all);
    // the last window ends with the clip rather than half-way, so no word is left out and none is padding
    let last = all - words;
    (0..last).step_by((most / 2).max(1)).chain([last]).map(move |word| word..word + words)
}

impl Layout {
    /// For a model of this shape, whose `tokens` don't hold the class tokens yet.
    ///
    /// # Errors
    /// A masked model, words of varying length, a context that doesn't hold a word and the class tokens.
    pub fn new(config: &ModelConfig, tokens: &TokenLayout, fields: usize) -> Result<Layout> {
        if config.kind != crate::ModelKind::Causal {
            let why = "classifiers go on from causal ones: train with [model] kind = \"causal\"";
            return Err(Error::unsupported("a masked model", why));
        }
        if tokens.varying {
            let why = "classifiers need a tokenizer whose words have one length, such as uniform";
            return Err(Error::unsupported("words of varying length", why));
        }
        let front = (0..tokens.front).map(|i| if i == 0 { tokens.bos } else { Special::Unk.id() }).collect();
        let (word, pad) = (tokens.word, tokens.pad);
        if !config.architecture.is_flat() {
            // the row after the last frame is the first that has read it: needed even without a field
            let (frames, class_rows) = (config.frames(tokens), fields.max(1));
            if frames <= class_rows {
                let found = format!("{frames} frames and {fields} class rows");
                return Err(Error::invalid("a window", found, "room for a frame and the class rows"));
            }
            return Ok(Layout { front, word, words: frames - class_rows, class_token: None, fields, pad });
        }
        // with W fields the last class token predicts into a second word, whose previous frame is class tokens
        let room = config.context.saturating_sub(tokens.front + fields);
        if room < tokens.word || fields >= tokens.word {
            let (context, word) = (config.context, tokens.word);
            let found = format!("{context} tokens, for words of {word} and {fields} class tokens");
            let expected = "room for a word, and fewer class tokens than a word has tokens";
            return Err(Error::invalid("the context", found, expected));
        }
        // class tokens take the ids after the vocabulary, in rows that a classifier's table has and the model's lacks
        let class_token = Some(tokens.vocabulary as u32);
        Ok(Layout { front, word, words: room / word, class_token, fields, pad })
    }

    /// Words of a window, at most.
    pub fn words(&self) -> usize {
        self.words
    }

    /// T.
    pub fn length(&self) -> usize {
        match self.class_token {
            Some(_) => self.front.len() + self.words * self.word + self.fields,
            None => self.front.len() - 1 + self.places() * self.word,
        }
    }

    /// Rows of a window among which [`Layout::rows`] are: T, or frames.
    pub fn places(&self) -> usize {
        match self.class_token {
            Some(_) => self.length(),
            None => self.words + self.fields.max(1),
        }
    }

    /// The first row after `words` words.
    fn row_after(&self, words: usize) -> usize {
        self.class_token.map_or(words, |_| self.front.len() + words * self.word)
    }

    /// The windows of a clip of `all` words, [`half_apart`].
    pub fn windows(&self, clip: usize, all: usize) -> Vec<Window> {
        half_apart(self.words, all).map(|w| Window { clip, word: w.start, words: w.len() }).collect()
    }

    /// Writes a window's `ids` of whole words to `input` and `target` (T), then the class tokens and `<pad>`.
    pub fn fill(&self, ids: &[u32], input: &mut [u32], target: &mut [u32]) {
        fill_sequence(ids, &self.front, self.pad, input, target);
        let first = self.front.len() + ids.len();
        for (input, class_token) in
            input[first..].iter_mut().take(self.fields).zip(self.class_token.into_iter().flat_map(|t| t..))
        {
            *input = class_token;
        }
    }

    /// The rows that classify a window of m words.
    pub fn rows(&self, words: usize) -> Range<usize> {
        let first = self.row_after(words);
        first..first + self.fields
    }

    /// The rows that have read the window's motion: its tokens, or in a two-level model the row after each frame.
    pub fn motion_rows(&self, words: usize) -> std::ops::Range<usize> {
        match self.class_token {
            Some(_) => self.row_after(0)..self.row_after(words),
            None => 1..words + 1,
        }
    }

    /// The mask that hides class tokens from each other in windows of these `words`, (B, T, T) or (B, F, F); none where
    /// there is one field, or where `compat` lets them see earlier ones as a causal mask does.
    pub fn hiding(&self, words: &[usize], compat: bool) -> Option<Vec<f32>> {
        if self.fields < 2 || compat {
            return None;
        }
        let t = self.places();
        let mut mask = vec![0.0; words.len() * t * t];
        for (square, &words) in mask.chunks_exact_mut(t * t).zip(words) {
            for (query, row) in square.chunks_exact_mut(t).enumerate() {
                // the causal part too: the plain form's additive mask has none of its own
                row[query + 1..].fill(f32::NEG_INFINITY);
                let rows = self.rows(words);
                if rows.contains(&query) {
                    row[rows.start..query].fill(f32::NEG_INFINITY);
                }
            }
        }
        Some(mask)
    }
}

/// The mask of a pass.
pub fn mask(hiding: Option<&[f32]>) -> Mask<'_> {
    hiding.map_or(Mask::Causal, Mask::CausalAdditive)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::TOKENS;

    fn layout(fields: usize) -> Layout {
        // K 1, words of 3
        let config = ModelConfig { layers: 1, heads: 1, width: 4, context: 12, ..Default::default() };
        Layout::new(&config, &TOKENS, fields).unwrap()
    }

    #[test]
    fn class_tokens_stand_behind_the_last_word() {
        let l = layout(2);
        let word = TOKENS.word;
        let (words, length) = (l.words(), l.length());
        assert_eq!((words, length), ((12 - 3) / word, 1 + words * word + 2));
        let ids: Vec<u32> = (0..word as u32).map(|i| 5 + i).collect();
        let (mut input, mut target) = (vec![9; length], vec![9; length]);
        l.fill(&ids, &mut input, &mut target);
        let class = TOKENS.vocabulary as u32;
        assert_eq!(input[..1 + word], [&[1], &ids[..]].concat());
        assert_eq!(l.rows(1), 1 + word..3 + word);
        assert_eq!(input[l.rows(1)], [class, class + 1]);
        assert!(input[3 + word..].iter().all(|&id| id == 0));
        assert_eq!(target[..word], ids[..]);
        assert!(target[word..].iter().all(|&id| id == 0), "class tokens are asked nothing: {target:?}");
    }

    #[test]
    fn class_tokens_see_motion_and_themselves() {
        let l = layout(2);
        let t = l.length();
        let mask = l.hiding(&[1], false).unwrap();
        let seen = |query: usize| (0..t).filter(|&key| mask[query * t + key] == 0.0).collect::<Vec<_>>();
        let rows = l.rows(1);
        assert_eq!(seen(rows.start), (0..=rows.start).collect::<Vec<_>>());
        assert_eq!(seen(rows.start + 1), (0..rows.start).chain([rows.start + 1]).collect::<Vec<_>>());
        assert_eq!(seen(2), [0, 1, 2]);
        assert_eq!((l.hiding(&[1], true), layout(1).hiding(&[1], false)), (None, None));
    }
}
