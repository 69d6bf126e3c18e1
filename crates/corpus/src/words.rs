//! Where the words of clips stand in the token file.

use super::record::{ClipRecord, Manifest};
use super::tokens::Tokens;
use crate::{Error, Result};
use kinelm_tokenizer::SPACE;
use std::path::Path;

/// Where each word of a clip begins, in tokens from the clip's first.
#[derive(Debug, Clone, Copy)]
pub enum ClipWords<'a> {
    /// Words of one length.
    Fixed {
        /// W.
        word: usize,
        /// How many.
        words: usize,
    },
    /// Words of any length.
    Varying {
        /// The first token of each.
        starts: &'a [u32],
        /// The clip's tokens.
        tokens: usize,
    },
}

impl ClipWords<'_> {
    /// How many words.
    pub fn len(self) -> usize {
        match self {
            ClipWords::Fixed { words, .. } => words,
            ClipWords::Varying { starts, .. } => starts.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// The clip's tokens.
    pub fn tokens(self) -> usize {
        match self {
            ClipWords::Fixed { word, words } => word * words,
            ClipWords::Varying { tokens, .. } => tokens,
        }
    }

    /// The first token of a word; after the last word the clip's end.
    pub fn start(self, word: usize) -> usize {
        match self {
            ClipWords::Fixed { word: length, words } => length * word.min(words),
            ClipWords::Varying { starts, tokens } => starts.get(word).map_or(tokens, |&s| s as usize),
        }
    }

    /// Words that begin before a token.
    pub fn before(self, token: usize) -> usize {
        match self {
            ClipWords::Fixed { word, words } => token.div_ceil(word).min(words),
            ClipWords::Varying { starts, .. } => starts.partition_point(|&s| (s as usize) < token),
        }
    }
}

/// The words of all clips of a corpus. Four bytes a word where they differ in length, nothing otherwise.
#[derive(Debug)]
pub(super) enum Index {
    Fixed(usize),
    Varying {
        starts: Vec<u32>,
        /// Per clip: the words before it.
        before: Vec<usize>,
    },
}

impl Index {
    /// Finds the words of clips that are known to be contiguous in the token file.
    ///
    /// # Errors
    /// Tokens that can't be read; [`kinelm_store::Error::File`] for a clip that has another number of words than its frames take, or doesn't end with a space.
    pub fn find(path: &Path, manifest: &Manifest, clips: &[ClipRecord], tokens: &Tokens) -> Result<Index> {
        if let Some(word) = manifest.tokens_per_word {
            return Ok(Index::Fixed(word));
        }
        let (mut starts, mut before) = (Vec::new(), Vec::with_capacity(clips.len()));
        for clip in clips {
            before.push(starts.len());
            // u32, by which `check_clips` bounds the tokens of a clip
            let mut start = 0;
            // from 1, because the next word begins after a space
            for (i, id) in (1..).zip(tokens.ids(clip.offset..clip.offset + clip.tokens)?) {
                if id == SPACE {
                    starts.push(start);
                    start = i;
                }
            }
            let (found, expected) = (starts.len() - before[before.len() - 1], manifest.words_of(clip.frames));
            if found != expected || start as usize != clip.tokens {
                let found = format!("{found} words of clip {}, the last one up to token {start}", clip.name);
                let expected = format!("{expected} up to token {}", clip.tokens);
                return Err(Error::file(path, found, expected, "make the corpus again"));
            }
        }
        Ok(Index::Varying { starts, before })
    }

    /// The words of the clip of this number.
    pub(crate) fn of<'a>(&'a self, number: usize, words: usize, clip: &ClipRecord) -> ClipWords<'a> {
        match self {
            Index::Fixed(word) => ClipWords::Fixed { word: *word, words },
            Index::Varying { starts, before } => {
                let starts = &starts[before[number]..][..words];
                ClipWords::Varying { starts, tokens: clip.tokens }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_one_length_are_words_of_any() {
        let starts: Vec<u32> = (0..5).map(|i| 7 * i).collect();
        let (a, b) = (ClipWords::Fixed { word: 7, words: 5 }, ClipWords::Varying { starts: &starts, tokens: 35 });
        assert_eq!((a.len(), a.tokens()), (b.len(), b.tokens()));
        for i in 0..40 {
            assert_eq!((a.start(i), a.before(i)), (b.start(i), b.before(i)), "{i}");
        }
    }
}
