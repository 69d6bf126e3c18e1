//! The tokenizer: settings, the fitted scheme, and the vocabulary.

use crate::fit::check_rate;
use crate::scheme::uniform::Uniform;
use crate::scheme::{Encoded, Fitted, Rest, Scheme};
use crate::{Channels, Fit, Grammar, Result, TokenizerConfig, Vocabulary};
use kinelm_motion::Clip;
use kinelm_motion::joints::Selection;

/// Clips to words to ids, and back.
#[derive(Debug, Clone, PartialEq)]
pub struct Tokenizer {
    pub(crate) config: TokenizerConfig,
    pub(crate) fitted: Fitted,
    pub(crate) vocabulary: Vocabulary,
    channels: Channels,
}

impl Tokenizer {
    pub(crate) fn new(config: TokenizerConfig, fitted: Fitted) -> Self {
        let channels = Channels::new(config.joints.clone());
        let vocabulary = Vocabulary::new(fitted.as_scheme().symbols());
        Tokenizer { config, fitted, vocabulary, channels }
    }

    /// Learns from training clips on the 24 SMPL joints at the tokenizer's rate. For a corpus that doesn't fit into
    /// memory see [`Fit`].
    ///
    /// # Errors
    /// Those of [`Fit::new`], [`Fit::add`] and [`Fit::finish`].
    pub fn fit<'a>(clips: impl IntoIterator<Item = &'a Clip>, config: TokenizerConfig) -> Result<Self> {
        let mut fit = Fit::new(config)?;
        clips.into_iter().try_for_each(|clip| fit.add(clip))?;
        fit.finish()
    }

    /// The settings.
    pub fn config(&self) -> &TokenizerConfig {
        &self.config
    }

    /// Frames per second of every clip.
    pub fn fps(&self) -> f64 {
        self.config.fps
    }

    /// What stands at each place of a word.
    pub fn channels(&self) -> &Channels {
        &self.channels
    }

    /// C, the characters of a word without its space.
    pub fn word_length(&self) -> usize {
        self.channels.len()
    }

    /// W, the tokens of a word with its space.
    pub fn tokens_per_frame(&self) -> usize {
        self.channels.len() + 1
    }

    /// Tokens and ids.
    pub fn vocabulary(&self) -> &Vocabulary {
        &self.vocabulary
    }

    /// Tokens and ids, to append conditioning tokens; [`Tokenizer::hash`] changes with them.
    pub fn vocabulary_mut(&mut self) -> &mut Vocabulary {
        &mut self.vocabulary
    }

    /// Which ids may stand where.
    pub fn grammar(&self) -> Grammar {
        Grammar::new(self.vocabulary.characters(), self.channels.len())
    }

    /// The places of a word that hold the selected joints' characters: what a prompt forces.
    pub fn places_of(&self, selection: &Selection) -> Vec<usize> {
        self.channels.places_of(selection)
    }

    /// The uniform scheme with its fitted ranges.
    pub fn uniform(&self) -> Option<&Uniform> {
        match &self.fitted {
            Fitted::Uniform(u) => Some(u),
        }
    }

    /// The scheme.
    pub fn scheme(&self) -> &dyn Scheme {
        self.fitted.as_scheme()
    }

    /// The clip's codes (F, C), with the counts of what was clipped.
    ///
    /// # Errors
    /// [`Error::Rate`](crate::Error::Rate) and [`Error::Skeleton`](crate::Error::Skeleton) for a clip that was not
    /// resampled or retargeted, [`Error::Frame`](crate::Error::Frame) for a place that can't be.
    pub fn encode(&self, clip: &Clip) -> Result<Encoded> {
        check_rate(clip, self.config.fps)?;
        self.scheme().encode(&self.channels, clip)
    }

    /// The clip of codes (F, C) on the neutral skeleton, with `rest` for the joints that are not coded. Any codes below
    /// the number of bins give a finite clip.
    ///
    /// # Errors
    /// [`Error::Codes`](crate::Error::Codes) when they don't make whole frames or one is too large;
    /// [`Error::Skeleton`](crate::Error::Skeleton) when `rest` is a clip on another rig.
    pub fn decode(&self, codes: &[u16], rest: Rest<'_>) -> Result<Clip> {
        self.scheme().decode(&self.channels, codes, self.config.fps, rest)
    }
}
