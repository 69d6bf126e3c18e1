//! What a model is: the `[model]` table of a training file, and what its tokenizer adds to it.

use crate::{Error, Result};
use kinelm_tokenizer::{PlaceIds, SPACE, Special, Tokenizer};
use serde::{Deserialize, Serialize};

/// The `[model]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelConfig {
    /// What a token may see. Default `causal`.
    pub kind: Kind,
    /// L: transformer blocks, 1..=96. Default 4.
    pub layers: usize,
    /// H: attention heads; divides `width`. Default 4.
    pub heads: usize,
    /// D: numbers a token is described by, 1..=8192. Default 128.
    pub width: usize,
    /// T: tokens of a window, the front token included; holds two words at least if all have one length. Default 256.
    pub context: usize,
    /// How a token's place is told. Default `frame_joint`.
    pub positions: Positions,
    /// Share of embeddings, attention weights and block outputs dropped in training, 0 up to below 1. Default 0.
    pub dropout: f64,
    /// The head uses the token embedding again. Default true.
    pub tied_head: bool,
}

/// What a token may see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Itself and the tokens before it.
    Causal,
}

/// How a token's place in the window is told to the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Positions {
    /// One learned vector for each place of the window.
    Absolute,
    /// A learned vector for the word of the window and one for the place in the word, added. Where words differ in length,
    /// both are counted from the tokens: words up to T/2, places up to the longest word that the tokenizer was fitted on;
    /// what lies behind shares the last vector.
    FrameJoint,
}

impl Default for ModelConfig {
    fn default() -> Self {
        ModelConfig {
            kind: Kind::Causal,
            layers: 4,
            heads: 4,
            width: 128,
            context: 256,
            positions: Positions::FrameJoint,
            dropout: 0.0,
            tied_head: true,
        }
    }
}

impl ModelConfig {
    /// Checks every key.
    ///
    /// # Errors
    /// The first key outside its limits, with both.
    pub fn validate(&self) -> Result<()> {
        let within = |key: &str, value: usize, most: usize| match (1..=most).contains(&value) {
            true => Ok(()),
            false => Err(Error::Call(format!("model.{key} is {value}; expected 1 to {most}"))),
        };
        within("layers", self.layers, 96)?;
        within("heads", self.heads, 256)?;
        within("width", self.width, 8192)?;
        within("context", self.context, 1 << 20)?;
        if !self.width.is_multiple_of(self.heads) {
            return Err(Error::Call(format!(
                "model.width is {} and model.heads {}; expected heads that divide the width",
                self.width, self.heads
            )));
        }
        if !(0.0..1.0).contains(&self.dropout) {
            return Err(Error::Call(format!("model.dropout is {}; expected 0 up to below 1", self.dropout)));
        }
        Ok(())
    }

    /// Checks the keys, and that the context holds two words of `tokens` if all have one length.
    ///
    /// # Errors
    /// As [`Self::validate`]; a context that is too short; ids outside the vocabulary.
    pub fn validate_for(&self, tokens: &TokenLayout) -> Result<()> {
        self.validate()?;
        tokens.validate()?;
        let least = tokens.front + 1;
        if tokens.varying && self.context < least {
            return Err(Error::Call(format!("model.context is {} tokens; expected {least} or more", self.context)));
        }
        let needed = 2 * tokens.word + tokens.front - 1;
        if !tokens.varying && self.context < needed {
            return Err(Error::Call(format!(
                "model.context is {} tokens and a word has {}; expected room for two words: {needed} or more",
                self.context, tokens.word,
            )));
        }
        Ok(())
    }
}

/// What the tokenizer decides about a model.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TokenLayout {
    /// V: ids in all.
    pub vocabulary: usize,
    /// W: tokens of a word, its space included; the longest that the tokenizer was fitted on if they differ.
    pub word: usize,
    /// Whether words differ in length.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub varying: bool,
    /// Tokens in front of a window's words: `<bos>`, and a conditioning token a field.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub front: usize,
    /// The id that fills up short windows; it is never a target.
    pub pad: u32,
    /// The id in front of every window.
    pub bos: u32,
    /// The id that ends a word.
    pub space: u32,
    /// What stands at the places of a word up to its space, stretch by stretch; empty where that isn't the same for all words.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub places: Vec<Stretch>,
}

/// Places of a word, one behind the other, that hold numbers of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stretch {
    /// How many places.
    pub number: usize,
    /// The ids that stand there: ascending bins.
    pub kind: PlaceIds,
}

fn one() -> usize {
    1
}

fn is_one(n: &usize) -> bool {
    *n == 1
}

impl TokenLayout {
    /// What a tokenizer decides about models of its tokens.
    pub fn of(tokenizer: &Tokenizer) -> TokenLayout {
        TokenLayout {
            vocabulary: tokenizer.vocabulary().len() as usize,
            word: tokenizer.longest_word(),
            varying: tokenizer.tokens_per_word().is_none(),
            front: 1,
            pad: Special::Pad.id(),
            bos: Special::Bos.id(),
            space: SPACE,
            places: stretches(&tokenizer.place_ids()),
        }
    }

    /// Whether a model of these tokens reads words of `other`: they are built alike, and its ids are among these.
    pub fn reads(&self, other: &TokenLayout) -> bool {
        (self.word, self.varying) == (other.word, other.varying) && self.vocabulary >= other.vocabulary
    }

    /// Word tokens that a window of `context` tokens is asked about: all but those of the front that nothing predicts.
    pub fn room(&self, context: usize) -> usize {
        (context + 1).saturating_sub(self.front)
    }

    /// What stands at each place of a word up to its space; nothing where that isn't the same for all words.
    pub fn place_ids(&self) -> impl Iterator<Item = PlaceIds> + '_ {
        self.places.iter().flat_map(|s| std::iter::repeat_n(s.kind, s.number))
    }

    /// # Errors
    /// Ids outside the vocabulary, no vocabulary, a word without tokens.
    fn validate(&self) -> Result<()> {
        let named = [("pad", self.pad), ("bos", self.bos), ("space", self.space)];
        if let Some((name, id)) = named.iter().find(|(_, id)| *id as usize >= self.vocabulary) {
            return Err(Error::Call(format!("<{name}> is id {id}, outside the vocabulary of {}", self.vocabulary)));
        }
        if self.word == 0 {
            return Err(Error::Call("a word has 0 tokens; expected at least its space".into()));
        }
        if self.front == 0 {
            return Err(Error::Call("0 tokens in front of a window; expected at least <bos>".into()));
        }
        let places: usize = self.places.iter().map(|s| s.number).sum();
        let outside = |s: &Stretch| s.kind.count == 0 || s.kind.ids().end as usize > self.vocabulary;
        if !self.places.is_empty() && (self.varying || places + 1 != self.word || self.places.iter().any(outside)) {
            let word = self.word;
            return Err(Error::Call(format!("kinds of {places} places don't describe words of {word} tokens")));
        }
        Ok(())
    }
}

/// Equal neighbours together.
fn stretches(places: &[PlaceIds]) -> Vec<Stretch> {
    places.chunk_by(|a, b| a == b).map(|c| Stretch { number: c.len(), kind: c[0] }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKENS: TokenLayout = TokenLayout {
        vocabulary: 366,
        word: 43,
        varying: false,
        front: 1,
        pad: 0,
        bos: 1,
        space: 5,
        places: Vec::new(),
    };

    #[test]
    fn the_first_wrong_key_is_named_with_its_limits() {
        let said = |change: &dyn Fn(&mut ModelConfig)| {
            let mut config = ModelConfig::default();
            change(&mut config);
            config.validate_for(&TOKENS).unwrap_err().to_string()
        };
        assert_eq!(said(&|c| c.layers = 0), "model.layers is 0; expected 1 to 96");
        assert!(said(&|c| c.heads = 3).contains("model.width is 128 and model.heads 3"));
        assert!(said(&|c| c.dropout = 1.0).contains("model.dropout is 1"));
        assert!(said(&|c| c.dropout = f64::NAN).contains("model.dropout is NaN"));
        assert!(said(&|c| c.context = 85).contains("86 or more"));
        ModelConfig::default().validate_for(&TOKENS).unwrap();
        let other = TokenLayout { bos: 366, ..TOKENS };
        let message = ModelConfig::default().validate_for(&other).unwrap_err().to_string();
        assert_eq!(message, "<bos> is id 366, outside the vocabulary of 366");
        // words of any length are cut where a window ends
        let long = TokenLayout { word: 900, varying: true, ..TOKENS };
        ModelConfig::default().validate_for(&long).unwrap();
        let short = ModelConfig { context: 1, ..Default::default() };
        assert_eq!(short.validate_for(&long).unwrap_err().to_string(), "model.context is 1 tokens; expected 2 or more");
    }

    #[test]
    fn toml_refuses_keys_it_does_not_know() {
        let config: ModelConfig = toml::from_str("layers = 6\npositions = \"absolute\"").unwrap();
        assert_eq!((config.layers, config.positions), (6, Positions::Absolute));
        assert!(toml::from_str::<ModelConfig>("layer = 6").unwrap_err().to_string().contains("layer"));
        assert!(toml::from_str::<ModelConfig>("kind = \"masked\"").is_err());
    }
}
