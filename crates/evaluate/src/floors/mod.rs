//! The static floors that suit a corpus.

pub(crate) mod channels;
pub mod codes;
mod forecast;
mod kernels;
pub(crate) mod mixture;
mod sample;
mod tokens;

pub use channels::ChannelFloors;
pub use codes::CodeSplits;
pub use forecast::ForecastFloor;
pub use sample::Extent;
pub use tokens::TokenFloors;

use crate::{Error, Result};
use kinelm_corpus::{Corpus, Split};
use rayon::prelude::*;
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
    /// The floors of a split of a corpus, fitted on the train clips of `fitted`, which may be the same. `each`: the bits of
    /// every code are kept, for [`Floors::mixed_with`].
    ///
    /// # Errors
    /// Corpora of two tokenizers; a split without frames; ids that are not allowed in their slots.
    pub fn of_corpora(fitted: &Corpus, corpus: &Corpus, split: Split, extent: Extent, each: bool) -> Result<Floors> {
        let [found, expected] = [fitted, corpus].map(|corpus| corpus.tokenizer().base_hash());
        if found != expected {
            let help = "tokenize both with one tokenizer.json";
            let (found, expected) = (format!("a corpus of tokenizer {found}"), format!("that of {expected}"));
            return Err(Error::file(fitted.dir(), found, expected, help));
        }
        Ok(match codes::channels(corpus) {
            Some(_) => {
                let codes = CodeSplits::of_corpora(fitted, corpus, split, extent)?;
                Floors::Channels(Box::new(ChannelFloors::measure_each(&codes, each)?))
            }
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

    /// Bits a frame of a model, mixed online with the best static one and the forecast's floor. `model`: its bits of every
    /// code of the measured clips, in their order, each (F, C). `None` where the floors have no bits of every code, or of
    /// others than the model.
    pub fn mixed_with(&self, model: &[Vec<f32>]) -> Option<f64> {
        let Floors::Channels(floors) = self else { return None };
        let [last, forecast] = &floors.by_code;
        let lengths = |all: &[Vec<f32>]| all.iter().map(Vec::len).collect::<Vec<_>>();
        if last.is_empty() || lengths(last) != lengths(model) || lengths(forecast) != lengths(model) {
            return None;
        }
        let clips = model.par_iter().zip(last).zip(forecast);
        let bits = |((model, last), forecast): ((&Vec<f32>, &Vec<f32>), &Vec<f32>)| {
            mixture::mixed(&[model, last, forecast], floors.channels).into_iter().map(f64::from).sum::<f64>()
        };
        // collected first: a parallel sum's order would change its last bits
        let bits: Vec<f64> = clips.map(bits).collect();
        Some(bits.iter().sum::<f64>() / floors.test[1] as f64)
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
