//! The static floors that suit a corpus.

pub(crate) mod channels;
pub mod codes;
mod forecast;
mod kernels;
mod sample;
mod tokens;

pub use channels::ChannelFloors;
pub use codes::CodeSplits;
pub use forecast::ForecastFloor;
pub use sample::Extent;
pub use tokens::TokenFloors;

use crate::{Error, Result};
use kinelm_corpus::{Corpus, Split};
use serde_json::Value;
use std::fmt;

/// Bits a frame of models without a network.
#[derive(Debug, Clone, PartialEq)]
pub enum Floors {
    /// Where a word is a frame: models of every channel, of the characters as they are before any are merged.
    Channels(Box<ChannelFloors>),
    /// Of any other words: models of the tokens.
    Tokens(TokenFloors),
}

impl Floors {
    /// The floors of a split of a corpus, fitted on the train clips of `fitted`, which may be the same.
    ///
    /// # Errors
    /// Corpora of two tokenizers; a split without frames; ids that are not allowed in their slots.
    pub fn of_corpora(fitted: &Corpus, corpus: &Corpus, split: Split, extent: Extent) -> Result<Floors> {
        let [found, expected] = [fitted, corpus].map(|corpus| corpus.tokenizer().base_hash());
        if found != expected {
            let help = "tokenize both with one tokenizer.json";
            let (found, expected) = (format!("a corpus of tokenizer {found}"), format!("that of {expected}"));
            return Err(Error::file(fitted.dir(), found, expected, help));
        }
        Ok(match codes::channels(corpus) {
            Some(_) => Floors::Channels(Box::new(ChannelFloors::measure(&CodeSplits::of_corpora(
                fitted, corpus, split, extent,
            )?)?)),
            None => Floors::Tokens(TokenFloors::measure(fitted, corpus, split, extent)?),
        })
    }

    /// The lowest of the static models.
    pub(crate) fn best(&self) -> f64 {
        match self {
            Floors::Channels(floors) => floors.best(),
            Floors::Tokens(floors) => floors.best(),
        }
    }

    /// Bits a frame of order 0: every character by its frequency.
    pub(crate) fn order0(&self) -> f64 {
        match self {
            Floors::Channels(floors) => floors.bits_per_frame[0],
            Floors::Tokens(floors) => floors.bits_per_frame[0],
        }
    }

    /// One object; `of` says what the models are of.
    pub fn to_json(&self) -> Value {
        let (of, mut all) = match self {
            Floors::Channels(floors) => ("channels", floors.to_json()),
            Floors::Tokens(floors) => ("tokens", floors.to_json()),
        };
        all["of"] = of.into();
        all
    }
}

impl fmt::Display for Floors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Floors::Channels(floors) => floors.fmt(f),
            Floors::Tokens(floors) => floors.fmt(f),
        }
    }
}
