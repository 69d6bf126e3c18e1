//! What a model is: the `[model]` table of a training file, and what its tokenizer adds to it.

use super::music::features::Scale;
use super::music::{Music, conditioning};
use crate::{Error, Result};
use kinelm_corpus::music::clip_music::ClipMusic;
use kinelm_engine::bins::Bins;
use kinelm_tokenizer::{SPACE, SlotIds, Special, Tokenizer};
use serde::{Deserialize, Serialize};

/// The `[model]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelConfig {
    /// Its architecture. Default `flat`.
    #[serde(skip_serializing_if = "Architecture::is_flat")]
    pub architecture: Architecture,
    /// The tokens that a token may see. Default `causal`.
    pub kind: ModelKind,
    /// L: transformer blocks, 1..=96. Default 4.
    pub layers: usize,
    /// H: attention heads; divides `width`. Default 4.
    pub heads: usize,
    /// D: numbers a token is described by, 1..=8192. Default 128.
    pub width: usize,
    /// T: tokens of a window, the front token included; holds two words at least if all have one length. Default 256. Of a
    /// two-level model what `window` says.
    pub context: usize,
    /// How a token's position is encoded. Default `frame_joint`.
    pub positions: Positions,
    /// Every input gets the previous frame's character in the slot about to be predicted, and its last step. Left out:
    /// where that is possible, see `ModelConfig::reads_previous`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub previous_frame: Option<bool>,
    /// What the softmax is over. Left out: `relative` where that is possible, see [`ModelConfig::head_of`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub head: Option<HeadKind>,
    /// Share of embeddings, attention weights and block outputs dropped in training, 0 up to below 1. Default 0.
    pub dropout: f64,
    /// The head uses the token embedding again. Default true.
    pub tied_head: bool,
    /// F: frames of a two-level model's window, 2..=8192. Left out: 128.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub window: Option<usize>,
    /// The decoder of a two-level model. Left out: its defaults.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decoder: Option<DecoderConfig>,
    /// Whether a two-level model is conditioned on goals, frames that are given later; see [`super::goal`]. Default false.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub goal: bool,
    /// Whether a two-level model codes steps from a linear forecast, see [`super::forecast`]. Left out: it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forecast: Option<bool>,
    /// Music conditioning of a two-level model, see [`super::music`]. Default `none`.
    #[serde(skip_serializing_if = "Music::is_none")]
    pub music: Music,
    /// The scale that music features are standardised by. Not in a training file: a new run takes it from its training clips.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub music_scale: Option<Scale>,
    /// Class rows of a two-level model's trunk after a window's last frame, for a classifier (see `frames`). Not in any
    /// file: the classifier sets it.
    #[serde(skip)]
    pub classes: usize,
}

/// The architecture of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Architecture {
    /// One stack of blocks, in which every token is a row.
    #[default]
    Flat,
    /// A trunk in which every frame is a row, and a decoder inside the frame.
    TwoLevel,
}

impl Architecture {
    /// Whether it is the one that files don't name.
    pub fn is_flat(&self) -> bool {
        *self == Architecture::Flat
    }
}

/// The `[model.decoder]` table: the decoder inside the frame.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DecoderConfig {
    /// Blocks, 1..=96. Default 2.
    pub layers: usize,
    /// Attention heads; divides `width`. Default 4.
    pub heads: usize,
    /// d: numbers a character is described by, 1..=8192. Default 128.
    pub width: usize,
    /// e: numbers of each character in what the trunk reads of a frame, 1..=512. Default 24.
    pub character_width: usize,
}

impl Default for DecoderConfig {
    fn default() -> Self {
        DecoderConfig { layers: 2, heads: 4, width: 128, character_width: 24 }
    }
}

/// The tokens that a token may see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ModelKind {
    /// Itself and the tokens before it; it predicts the next one.
    Causal,
    /// Every token of the window; some are replaced by `<mask>`, and each predicts what it hides.
    Masked,
}

/// How a token's position in the window is encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Positions {
    /// One learned vector for each place of the window.
    Absolute,
    /// A learned vector for the word of the window and one for the place in the word, added. Where words differ in length,
    /// both are counted from the tokens: words up to T/2, places up to the longest word that the tokenizer was fitted on;
    /// positions after the last share its vector.
    FrameJoint,
    /// Queries and keys are rotated by the number of their word, so that attention sees how many words are between two
    /// tokens; a learned vector for the place in the word is added.
    Rope,
}

/// The choices that the softmax over the next token ranges over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadKind {
    /// All ids.
    Absolute,
    /// The steps from the id at the same place one frame back; all ids where there is none, and for spaces.
    Relative,
}

impl Default for ModelConfig {
    fn default() -> Self {
        ModelConfig {
            architecture: Architecture::Flat,
            kind: ModelKind::Causal,
            layers: 4,
            heads: 4,
            width: 128,
            context: 256,
            positions: Positions::FrameJoint,
            previous_frame: None,
            head: None,
            dropout: 0.0,
            tied_head: true,
            window: None,
            decoder: None,
            goal: false,
            forecast: None,
            music: Music::None,
            music_scale: None,
            classes: 0,
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
            false => Err(Error::invalid(format!("model.{key}"), value, format!("1 to {most}"))),
        };
        within("layers", self.layers, 96)?;
        within("heads", self.heads, 256)?;
        within("width", self.width, 8192)?;
        within("context", self.context, 1 << 20)?;
        if !self.width.is_multiple_of(self.heads) {
            let found = format!("{} and model.heads {}", self.width, self.heads);
            return Err(Error::invalid("model.width", found, "heads that divide the width"));
        }
        if !(0.0..1.0).contains(&self.dropout) {
            return Err(Error::invalid("model.dropout", self.dropout, "0 up to below 1"));
        }
        let of_head = self.width / self.heads;
        if self.positions == Positions::Rope && !of_head.is_multiple_of(2) {
            let found = format!("{} and model.heads {}, {of_head} numbers a head", self.width, self.heads);
            return Err(Error::invalid("model.width", found, "an even number, rope rotates pairs"));
        }
        self.validate_architecture()?;
        self.music_scale.as_ref().map_or(Ok(()), Scale::validate)?;
        match self.kind {
            ModelKind::Causal => Ok(()),
            ModelKind::Masked => {
                self.refuse_frame_before("model.kind is masked, and the frame before may be masked too")
            }
        }
    }

    /// Refuses keys that need the previous frame where there is none.
    fn refuse_frame_before(&self, why: &str) -> Result<()> {
        let refused = |key, value, other| {
            Err(Error::invalid(format!("model.{key}"), value, format!("{other}, or leave it out: {why}")))
        };
        match (self.previous_frame, self.head) {
            (Some(true), _) => refused("previous_frame", "true", "false"),
            (_, Some(HeadKind::Relative)) => refused("head", "relative", "absolute"),
            _ => Ok(()),
        }
    }

    /// Checks the keys, and that the context holds two words of `tokens` if all have one length.
    ///
    /// # Errors
    /// As [`Self::validate`]; a context that is too short; ids outside the vocabulary.
    pub fn validate_for(&self, tokens: &TokenLayout) -> Result<()> {
        self.validate()?;
        tokens.validate()?;
        // after the layout's own check: `front - 1` below needs a front
        self.validate_frames(tokens)?;
        if tokens.places.is_empty() {
            self.refuse_frame_before("words of this tokenizer have no places of one kind each")?;
        }
        let least = tokens.front + 1;
        if tokens.varying && self.context < least {
            let found = format!("{} tokens", self.context);
            return Err(Error::invalid("model.context", found, format!("{least} or more")));
        }
        // two words: in one alone no token has a word before it, and a relative head has nothing to count from
        let needed = 2 * tokens.word + tokens.front - 1;
        if !tokens.varying && self.context < needed {
            let found = format!("{} tokens and a word has {}", self.context, tokens.word);
            return Err(Error::invalid("model.context", found, format!("room for two words: {needed} or more")));
        }
        Ok(())
    }

    /// Whether inputs have previous-frame features: as `previous_frame` says; left out, in causal models of words whose
    /// places are of one kind each.
    pub(crate) fn reads_previous(&self, tokens: &TokenLayout) -> bool {
        self.previous_frame.unwrap_or(self.knows_frame_before(tokens))
    }

    /// What the softmax is over: as `head` says; left out, relative in causal models of words whose places are of one kind
    /// each, else absolute.
    pub fn head_of(&self, tokens: &TokenLayout) -> HeadKind {
        let unasked = if self.knows_frame_before(tokens) { HeadKind::Relative } else { HeadKind::Absolute };
        self.head.unwrap_or(unasked)
    }

    fn knows_frame_before(&self, tokens: &TokenLayout) -> bool {
        self.kind == ModelKind::Causal && !tokens.places.is_empty()
    }

    /// Music conditioning (N, M) of frames at these times of a clip; `pace` seconds of the clip pass in one second of the
    /// frames.
    pub fn music_conditioning(&self, sound: &ClipMusic<'_>, times_s: impl Iterator<Item = f64>, pace: f64) -> Vec<f32> {
        conditioning(self.music, self.music_scale.as_ref(), sound, times_s, pace)
    }

    /// Whether frames can have conditioning beside their characters.
    #[cfg(any(test, feature = "fixtures"))]
    pub(crate) fn is_conditioned(&self) -> bool {
        self.goal || !self.music.is_none()
    }

    /// The same model with every key set.
    pub fn resolved(&self, tokens: &TokenLayout) -> ModelConfig {
        if self.architecture == Architecture::TwoLevel {
            return self.two_levels(tokens);
        }
        let (previous_frame, head) = (Some(self.reads_previous(tokens)), Some(self.head_of(tokens)));
        ModelConfig { previous_frame, head, ..self.clone() }
    }
}

/// The part of a model that its tokenizer decides.
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
    /// The kinds of a word's slots up to its space, run by run; empty where words differ in them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub places: Vec<SlotRun>,
}

/// Neighbouring slots of a word that hold numbers of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlotRun {
    /// The number of places.
    pub number: usize,
    /// Their ids: ascending bins.
    pub kind: SlotIds,
}

fn one() -> usize {
    1
}

fn is_one(n: &usize) -> bool {
    *n == 1
}

impl TokenLayout {
    /// The part that a tokenizer decides of models of its tokens.
    pub fn of(tokenizer: &Tokenizer) -> TokenLayout {
        TokenLayout {
            vocabulary: tokenizer.vocabulary().len() as usize,
            word: tokenizer.longest_word(),
            varying: tokenizer.tokens_per_word().is_none(),
            front: 1,
            pad: Special::Pad.id(),
            bos: Special::Bos.id(),
            space: SPACE,
            places: stretches(&tokenizer.slot_ids()),
        }
    }

    /// Whether a model of these tokens reads words of `other`: they are built alike, and its ids are among these.
    pub fn reads(&self, other: &TokenLayout) -> bool {
        (self.word, self.varying) == (other.word, other.varying) && self.vocabulary >= other.vocabulary
    }

    /// Word tokens that a window of `context` tokens predicts: all but those of the front.
    pub fn room(&self, context: usize) -> usize {
        // + 1: the last word token is a target without being an input
        (context + 1).saturating_sub(self.front)
    }

    /// The kind of each slot of a word up to its space; nothing where words differ in them.
    pub fn slot_ids(&self) -> impl Iterator<Item = SlotIds> + '_ {
        self.places.iter().flat_map(|s| std::iter::repeat_n(s.kind, s.number))
    }

    /// The same as the engine has it.
    pub fn bins(&self) -> Vec<Bins> {
        self.slot_ids().map(|SlotIds { first, count, circular }| Bins { first, count, circular }).collect()
    }

    /// # Errors
    /// Ids outside the vocabulary, no vocabulary, a word without tokens.
    fn validate(&self) -> Result<()> {
        let named = [("pad", self.pad), ("bos", self.bos), ("space", self.space)];
        if let Some((name, id)) = named.iter().find(|(_, id)| *id as usize >= self.vocabulary) {
            let expected = format!("an id below {}", self.vocabulary);
            return Err(Error::invalid(format!("<{name}>"), format!("id {id}"), expected));
        }
        if self.word == 0 {
            return Err(Error::invalid("the length of a word", 0, "at least its space"));
        }
        if self.front == 0 {
            return Err(Error::invalid("the length of the front", 0, "at least <bos>"));
        }
        let places: usize = self.places.iter().map(|s| s.number).sum();
        let outside = |s: &SlotRun| s.kind.count == 0 || s.kind.ids().end as usize > self.vocabulary;
        // + 1 for the space, which ends every word and is no slot
        if !self.places.is_empty() && (self.varying || places + 1 != self.word || self.places.iter().any(outside)) {
            let word = self.word;
            let expected = format!("those of all {word} tokens of a word but the last");
            return Err(Error::invalid("the kinds of slots", format!("those of {places} slots"), expected));
        }
        Ok(())
    }
}

/// Equal neighbours together.
fn stretches(places: &[SlotIds]) -> Vec<SlotRun> {
    places.chunk_by(|a, b| a == b).map(|c| SlotRun { number: c.len(), kind: c[0] }).collect()
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
        assert_eq!(message, "<bos> is id 366; expected an id below 366");
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
        assert!(toml::from_str::<ModelConfig>("kind = \"both\"").is_err());
    }

    /// Words of one angle, one height, and a space.
    fn placed() -> TokenLayout {
        let kind = |first, circular| SlotIds { first, count: 10, circular };
        let places = [kind(6, true), kind(16, false)].map(|kind| SlotRun { number: 1, kind });
        TokenLayout { word: 3, places: places.to_vec(), ..TOKENS }
    }

    #[test]
    fn what_is_left_out_follows_from_the_tokens() {
        let config = ModelConfig::default();
        let read = |config: &ModelConfig, tokens: &TokenLayout| (config.reads_previous(tokens), config.head_of(tokens));
        assert_eq!(read(&config, &placed()), (true, HeadKind::Relative));
        assert_eq!(read(&config, &TOKENS), (false, HeadKind::Absolute));
        let masked = ModelConfig { kind: ModelKind::Masked, ..config.clone() };
        assert_eq!(read(&masked, &placed()), (false, HeadKind::Absolute));
        let said: ModelConfig = toml::from_str("previous_frame = false\nhead = \"absolute\"").unwrap();
        assert_eq!(read(&said, &placed()), (false, HeadKind::Absolute));
        let resolved = config.resolved(&placed());
        assert_eq!((resolved.previous_frame, resolved.head), (Some(true), Some(HeadKind::Relative)));
        resolved.validate_for(&placed()).unwrap();
        masked.resolved(&placed()).validate_for(&placed()).unwrap();
    }

    #[test]
    fn what_cannot_be_is_refused_with_the_reason() {
        let said = |text: &str, tokens: &TokenLayout| {
            toml::from_str::<ModelConfig>(text).unwrap().validate_for(tokens).unwrap_err().to_string()
        };
        assert_eq!(
            said("previous_frame = true", &TOKENS),
            "model.previous_frame is true; expected false, or leave it out: words of this tokenizer have no places of one \
             kind each"
        );
        assert!(said("head = \"relative\"", &TOKENS).contains("no places of one kind each"));
        let message = said("kind = \"masked\"\nhead = \"relative\"", &placed());
        assert!(message.contains("model.head is relative; expected absolute") && message.contains("may be masked too"));
        assert!(said("kind = \"masked\"\nprevious_frame = true", &placed()).contains("may be masked too"));
        let message = said("positions = \"rope\"\nwidth = 12\nheads = 4", &TOKENS);
        assert!(message.contains("3 numbers a head; expected an even number"), "{message}");
    }
}
