//! The codes of clips, without spaces: what the static floors are measured on.

use super::sample::{Extent, Stretch, stretches};
use crate::{Error, Result};
use kinelm_corpus::{Corpus, Split};
use kinelm_engine::bins::Bins;
use kinelm_model::TokenLayout;
use kinelm_tokenizer::WordLength;

/// Clips of codes, frame after frame: a clip is (F, C), the channel running fastest.
pub(crate) type CodeClips = Vec<Vec<u16>>;

/// What the floors are fitted and measured on.
#[derive(Debug, Clone, PartialEq)]
pub struct CodeSplits {
    /// Codes are below this; at most 65,536.
    pub bins: usize,
    /// C.
    pub channels: usize,
    /// (C) the bins of each channel, code 0 their first; empty where characters were merged.
    pub places: Vec<Bins>,
    /// Tables and weights are fitted on it.
    pub train: CodeClips,
    /// Bits are measured on it.
    pub test: CodeClips,
    /// Frames that both splits have, of which these may be a sample.
    pub of: [usize; 2],
}

impl CodeSplits {
    /// The codes of a corpus whose words are frames of C characters: without spaces, and before any characters were
    /// merged.
    /// `measured` is the split that stands for `test`; `train` is the train split of `fitted`, a corpus of the
    /// same tokenizer.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for a corpus of other words; [`kinelm_store::Error::File`] when an id is not
    /// allowed in its slot.
    pub fn of_corpora(fitted: &Corpus, corpus: &Corpus, measured: Split, extent: Extent) -> Result<Self> {
        let Some(channels) = channels(corpus) else {
            return Err(Error::unsupported(
                "static floors of channels",
                "words are tiles of frames or differ in length, so a channel has no code of its own",
            ));
        };
        let bins = corpus.tokenizer().vocabulary().characters() as usize;
        let read = |corpus: &Corpus, split| -> Result<CodeClips> {
            let codes = |of: Stretch| Ok(corpus.some_words(of.clip, of.words)?.codes().to_vec());
            stretches(corpus, split, extent).into_iter().map(codes).collect()
        };
        let code_0 = |bins: Bins| Bins { first: 0, ..bins };
        let places = TokenLayout::of(corpus.tokenizer()).bins().into_iter().map(code_0).collect();
        let (train, test) = (read(fitted, Split::Train)?, read(corpus, measured)?);
        Ok(CodeSplits {
            bins,
            channels,
            places,
            train,
            test,
            of: [frames(fitted, Split::Train), frames(corpus, measured)],
        })
    }
}

/// Frames of a split.
pub fn frames(corpus: &Corpus, split: Split) -> usize {
    corpus.split(split).map(|clip| clip.frames).sum()
}

/// C, where a word is a frame of C characters.
pub fn channels(corpus: &Corpus) -> Option<usize> {
    match corpus.tokenizer().word_length() {
        WordLength::Fixed(channels) if corpus.tokenizer().frames_per_word() == 1 => Some(channels),
        _ => None,
    }
}
