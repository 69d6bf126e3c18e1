//! The tokenizer: settings, the fitted scheme, and the vocabulary.

#[cfg(feature = "fit")]
use crate::Fit;
use crate::merges::Merges;
use crate::scheme::quantile::Quantile;
use crate::scheme::uniform::Uniform;
use crate::scheme::{Encoded, Fitted, Scheme, UncodedPose, WordLength, check_rate, check_skeleton};
use crate::vocab::FIRST_CHARACTER;
use crate::{Channels, Error, Grammar, Result, SlotIds, TokenizerConfig, Vocabulary, Words, alphabet};
use kinelm_motion::joints::Selection;
use kinelm_motion::{Clip, Quat};

/// A decoded height at the range's end is not beyond it.
const ROUNDING_M: f64 = 1e-6;

/// Clips to words to ids, and back.
#[derive(Debug, Clone, PartialEq)]
pub struct Tokenizer {
    pub(crate) config: TokenizerConfig,
    pub(crate) fitted: Fitted,
    pub(crate) vocabulary: Vocabulary,
    pub(crate) merges: Merges,
    pub(crate) longest_word: usize,
    /// What joints do that are not coded; `None` in tokenizers that learnt none.
    pub(crate) mean_pose: Option<[Quat; 24]>,
    /// Where heights above the floor lie, metres; `None` where they are coded otherwise.
    pub(crate) height_range: Option<[f64; 2]>,
    pub(crate) channels: Channels,
}

impl Tokenizer {
    /// `merges` are pairs of ids; `longest_word` is what the training words taught, in tokens with the space.
    ///
    /// # Errors
    /// [`Error::Setting`] for merges that can't be, and for more symbols than the alphabet has characters.
    pub(crate) fn new(
        config: TokenizerConfig,
        fitted: Fitted,
        merges: &[(u32, u32)],
        longest_word: usize,
    ) -> Result<Self> {
        let channels = config.channels();
        let symbols = fitted.as_scheme().symbols();
        if symbols > alphabet::SIZE {
            return Err(Error::Setting {
                field: "scheme",
                found: format!("{symbols} symbols"),
                expected: format!("at most {}, as many as the alphabet has characters", alphabet::SIZE),
            });
        }
        let vocabulary = Vocabulary::new(symbols).with_merges(merges)?;
        let merges = Merges::new(vocabulary.merge_table());
        Ok(Tokenizer {
            config,
            fitted,
            vocabulary,
            merges,
            longest_word,
            mean_pose: None,
            height_range: None,
            channels,
        })
    }

    /// Learns from training clips on the 24 SMPL joints at the tokenizer's rate. For a corpus that doesn't fit into
    /// memory see [`Fit`].
    ///
    /// # Errors
    /// Those of [`Fit::new`], [`Fit::add`] and [`Fit::finish`].
    #[cfg(feature = "fit")]
    pub fn fit<'a>(clips: impl IntoIterator<Item = &'a Clip>, config: TokenizerConfig) -> Result<Self> {
        let mut fit = Fit::new(config)?;
        clips.into_iter().try_for_each(|clip| fit.add(clip))?;
        fit.finish()
    }

    /// Where heights above the floor lie, metres: the range of the training clips, a tenth wider on each side. `None` where
    /// heights are coded otherwise.
    pub fn height_range(&self) -> Option<[f64; 2]> {
        self.height_range
    }

    /// The settings.
    pub fn config(&self) -> &TokenizerConfig {
        &self.config
    }

    /// Frames per second of every clip.
    pub fn fps(&self) -> f64 {
        self.config.fps
    }

    /// What is coded of a frame. The places of a word hold these, one after the other, only in some schemes: see
    /// [`Scheme::slot_channels`].
    pub fn channels(&self) -> &Channels {
        &self.channels
    }

    /// L, the frames that a word stands for: 1, or those of a tile.
    pub fn frames_per_word(&self) -> usize {
        self.scheme().frames_per_word()
    }

    /// The characters of a word without its space.
    pub fn word_length(&self) -> WordLength {
        self.scheme().word_length(&self.channels)
    }

    /// W, the tokens of a word with its space; `None` where words vary or characters are merged.
    pub fn tokens_per_word(&self) -> Option<usize> {
        match self.word_length() {
            WordLength::Fixed(c) if self.vocabulary.merged() == 0 => Some(c + 1),
            _ => None,
        }
    }

    /// Tokens of the longest word in training, with its space: W where all words have as many. What a model counts
    /// places in a word up to.
    pub fn longest_word(&self) -> usize {
        self.tokens_per_word().unwrap_or(self.longest_word)
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
        Grammar::new(&self.vocabulary, self.word_length())
    }

    /// What stands at each place of a word up to its space; nothing where words vary or characters are merged.
    pub fn slot_ids(&self) -> Vec<SlotIds> {
        let places = self.tokens_per_word().map_or(0, |word| word - 1);
        let (first, count) = (FIRST_CHARACTER, self.vocabulary.characters());
        (0..places).map(|place| SlotIds { first, count, circular: self.scheme().is_circular(place) }).collect()
    }

    /// A word that says nothing: no step, no turn.
    pub fn neutral(&self) -> Vec<u16> {
        self.scheme().neutral(&self.channels)
    }

    /// The places of a word that hold the selected joints' characters, ascending: what a prompt forces. Joints that are not
    /// coded have none.
    ///
    /// # Errors
    /// [`Error::Joints`] with the reason, where a character doesn't belong to one joint.
    pub fn slots_of(&self, selection: &Selection) -> Result<Vec<usize>> {
        if self.vocabulary.merged() > 0 {
            return Err(Error::Joints("merged tokens hold characters of several joints".into()));
        }
        let places = self.scheme().slot_channels(&self.channels).map_err(Error::Joints)?;
        Ok((0..places.len()).filter(|&i| places[i].is_of(selection)).collect())
    }

    /// The uniform scheme with its fitted ranges.
    pub fn uniform(&self) -> Option<&Uniform> {
        match &self.fitted {
            Fitted::Uniform(u) => Some(u),
            _ => None,
        }
    }

    /// The quantile scheme with its fitted edges.
    pub fn quantile(&self) -> Option<&Quantile> {
        match &self.fitted {
            Fitted::Quantile(q) => Some(q),
            _ => None,
        }
    }

    /// (24) The mean rotations of the joints that are not coded, over the training clips; identity for coded ones. `None`
    /// of tokenizers of version 2, which learnt none.
    pub fn mean_pose(&self) -> Option<&[Quat; 24]> {
        self.mean_pose.as_ref()
    }

    /// What the joints that are not coded do where nobody knows better: [`Tokenizer::mean_pose`], else identity.
    pub fn uncoded_pose(&self) -> UncodedPose<'_> {
        self.mean_pose().map_or(UncodedPose::Identity, UncodedPose::Pose)
    }

    /// The scheme.
    pub fn scheme(&self) -> &dyn Scheme {
        self.fitted.as_scheme()
    }

    /// The clip's words, ceil(F / L) of them, with the counts of what was clipped. Where heights are coded above the floor
    /// ([`TokenizerConfig::above_floor`]), the clip's floor is at y = 0.
    ///
    /// # Errors
    /// [`Error::Rate`](crate::Error::Rate) and [`Error::Skeleton`](crate::Error::Skeleton) for a clip that was not
    /// resampled or retargeted, [`Error::Frame`](crate::Error::Frame) for a place that can't be.
    pub fn encode(&self, clip: &Clip) -> Result<Encoded> {
        check_rate(clip, self.config.fps)?;
        check_skeleton(clip)?;
        let mut encoded = self.scheme().encode(&self.channels, clip)?;
        if let Some([low, high]) = self.height_range {
            let outside = |y: f64| y < low - ROUNDING_M || y > high + ROUNDING_M;
            encoded.off_range = clip.root().iter().filter(|p| outside(p.y)).count() as u64;
        }
        Ok(encoded)
    }

    /// The clip of words, L frames each, on the neutral skeleton, with `rest` for the joints that are not coded. Any codes
    /// below the number of characters give a finite clip.
    ///
    /// # Errors
    /// [`Error::Codes`](crate::Error::Codes) for a word of a length that the scheme doesn't have or a code that is too
    /// large; [`Error::Skeleton`](crate::Error::Skeleton) when `rest` is a clip on another rig.
    pub fn decode(&self, words: &Words, rest: UncodedPose<'_>) -> Result<Clip> {
        self.check(words)?;
        if let UncodedPose::Clip(clip) = rest {
            check_skeleton(clip)?;
        }
        self.scheme().decode(&self.channels, words, self.config.fps, rest)
    }
}
