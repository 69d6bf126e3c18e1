//! The tokenizer: settings, the fitted scheme, and the vocabulary.

use crate::meaning::{Legend, Meaning};
use crate::merges::Merges;
use crate::scheme::quantile::Quantile;
use crate::scheme::uniform::Uniform;
use crate::scheme::{Encoded, Fitted, Scheme, UncodedPose, WordLength, check_rate, check_skeleton};
use crate::vocab::FIRST_CHARACTER;
use crate::{Channels, Error, Grammar, Result, SlotIds, TokenizerConfig, Vocabulary, Words, alphabet};
use kinelm_motion::joints::Selection;
use kinelm_motion::{Clip, Quat};

/// Heights beyond the range by less than this are rounding errors.
const ROUNDING_M: f64 = 1e-6;

/// Encodes clips as words and ids, and decodes them.
///
/// A tokenizer is fitted to training clips ([`Tokenizer::fit`]) or loaded ([`Tokenizer::load`]).
///
/// ```
/// use kinelm_motion::{Clip, Quat, Vec3, smpl};
/// use kinelm_tokenizer::{Tokenizer, TokenizerConfig};
///
/// let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y; 4], vec![Quat::IDENTITY; 96])?;
/// let tokenizer = Tokenizer::fit([&clip], TokenizerConfig::default())?;
/// let ids = tokenizer.ids_of_words(&tokenizer.encode(&clip)?.words)?;
/// assert_eq!(ids.len(), 4 * tokenizer.tokens_per_word().unwrap());
/// let back = tokenizer.decode(&tokenizer.words_of_ids(&ids).words, tokenizer.uncoded_pose())?;
/// assert_eq!(back.frames(), 4);
/// # Ok::<(), kinelm_tokenizer::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Tokenizer {
    pub(crate) config: TokenizerConfig,
    pub(crate) fitted: Fitted,
    pub(crate) vocabulary: Vocabulary,
    pub(crate) merges: Merges,
    pub(crate) longest_word: usize,
    pub(crate) mean_pose: [Quat; 24],
    /// Range of the heights above the floor, metres; `None` when heights are coded otherwise.
    pub(crate) height_range: Option<[f64; 2]>,
    pub(crate) channels: Channels,
}

impl Tokenizer {
    /// From fitted parts: `merges` are pairs of ids; `longest_word` is that of training, in tokens with the space.
    ///
    /// # Errors
    /// [`Error::Setting`] for invalid merges and for more symbols than the alphabet has characters.
    pub(crate) fn new(
        config: TokenizerConfig,
        fitted: Fitted,
        merges: &[(u32, u32)],
        longest_word: usize,
        mean_pose: [Quat; 24],
        height_range: Option<[f64; 2]>,
    ) -> Result<Self> {
        let channels = config.channels();
        let symbols = fitted.as_scheme().symbols();
        if symbols > alphabet::SIZE {
            return Err(Error::setting(
                "scheme",
                format!("{symbols} symbols"),
                format!("at most {}, as many as the alphabet has characters", alphabet::SIZE),
            ));
        }
        let vocabulary = Vocabulary::new(symbols).with_merges(merges)?;
        let merges = Merges::new(vocabulary.merge_table());
        Ok(Tokenizer { config, fitted, vocabulary, merges, longest_word, mean_pose, height_range, channels })
    }

    /// Range of the heights above the floor, metres: that of the training clips, 10 % wider on each side. `None` when heights
    /// are coded otherwise.
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

    /// The channels of a frame. Only in some schemes does each slot of a word hold one of them: see
    /// [`Scheme::slot_channels`].
    pub fn channels(&self) -> &Channels {
        &self.channels
    }

    /// L, the frames of a word: 1, or those of a tile.
    pub fn frames_per_word(&self) -> usize {
        self.scheme().frames_per_word()
    }

    /// The characters of a word without its space.
    pub fn word_length(&self) -> WordLength {
        self.scheme().word_length(&self.channels)
    }

    /// W, the tokens of a word with its space; `None` when lengths vary or characters are merged.
    pub fn tokens_per_word(&self) -> Option<usize> {
        match self.word_length() {
            WordLength::Fixed(c) if self.vocabulary.merged() == 0 => Some(c + 1),
            _ => None,
        }
    }

    /// Tokens of the longest word of training, with its space; W when all words have the same length. Models number the slots
    /// of a word up to it.
    pub fn longest_word(&self) -> usize {
        self.tokens_per_word().unwrap_or(self.longest_word)
    }

    /// The tokens and their ids.
    pub fn vocabulary(&self) -> &Vocabulary {
        &self.vocabulary
    }

    /// The vocabulary, to append conditioning tokens; they change [`Tokenizer::hash`].
    pub fn vocabulary_mut(&mut self) -> &mut Vocabulary {
        &mut self.vocabulary
    }

    /// Which ids each slot of a word allows.
    pub fn grammar(&self) -> Grammar {
        Grammar::new(&self.vocabulary, self.word_length())
    }

    /// The ids of each slot of a word, its space not counted; empty when lengths vary or characters are merged.
    pub fn slot_ids(&self) -> Vec<SlotIds> {
        let slots = self.tokens_per_word().map_or(0, |word| word - 1);
        let (first, count) = (FIRST_CHARACTER, self.vocabulary.characters());
        (0..slots).map(|slot| SlotIds { first, count, circular: self.scheme().is_circular(slot) }).collect()
    }

    /// The word of no movement: no step, no turn.
    pub fn neutral(&self) -> Vec<u16> {
        self.scheme().neutral(&self.channels)
    }

    /// The slots of a word with the selected joints' characters, ascending: those that a prompt forces. Uncoded joints have
    /// none.
    ///
    /// # Errors
    /// [`Error::Joints`] with the reason when characters don't belong to single joints.
    pub fn slots_of(&self, selection: &Selection) -> Result<Vec<usize>> {
        if self.vocabulary.merged() > 0 {
            return Err(Error::Joints("merged tokens hold characters of several joints".into()));
        }
        let slots = self.scheme().slot_channels(&self.channels).map_err(Error::Joints)?;
        Ok((0..slots.len()).filter(|&i| slots[i].is_of(selection)).collect())
    }

    /// What the numbers of every word are.
    pub fn legend(&self) -> Legend {
        self.scheme().legend(&self.channels)
    }

    /// What each character of a word of codes stands for.
    pub fn meanings(&self, word: &[u16]) -> Vec<Meaning> {
        self.scheme().meanings(&self.channels, word)
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

    /// (24) The mean rotations of the uncoded joints over the training clips; identity for coded ones.
    pub fn mean_pose(&self) -> &[Quat; 24] {
        &self.mean_pose
    }

    /// The default rotations of uncoded joints: [`Tokenizer::mean_pose`].
    pub fn uncoded_pose(&self) -> UncodedPose<'_> {
        UncodedPose::Pose(&self.mean_pose)
    }

    /// The scheme.
    pub fn scheme(&self) -> &dyn Scheme {
        self.fitted.as_scheme()
    }

    /// The clip's words, ceil(F / L) of them, and counts of clipped values. When heights are coded above the floor
    /// ([`TokenizerConfig::above_floor`]), the clip's floor must be at y = 0.
    ///
    /// # Errors
    /// [`Error::Rate`](crate::Error::Rate) and [`Error::Skeleton`](crate::Error::Skeleton) for a clip that was not
    /// resampled or retargeted, [`Error::Frame`](crate::Error::Frame) for an impossible position.
    pub fn encode(&self, clip: &Clip) -> Result<Encoded> {
        check_rate(clip, self.config.fps)?;
        check_skeleton(clip)?;
        let mut encoded = self.scheme().encode(&self.channels, clip)?;
        if let Some([low, high]) = self.height_range {
            // a clip that was written and read again may be off by rounding, which is no fault of its floor
            let outside = |y: f64| y < low - ROUNDING_M || y > high + ROUNDING_M;
            encoded.off_range = clip.root().iter().filter(|p| outside(p.y)).count() as u64;
        }
        Ok(encoded)
    }

    /// The clip of words, L frames each, on the neutral skeleton; `uncoded` gives the uncoded joints. Any codes below the
    /// number of characters give a finite clip.
    ///
    /// # Errors
    /// [`Error::Codes`](crate::Error::Codes) for a word of the wrong length or a code that is too large;
    /// [`Error::Skeleton`](crate::Error::Skeleton) when `uncoded` is a clip on another rig.
    pub fn decode(&self, words: &Words, uncoded: UncodedPose<'_>) -> Result<Clip> {
        self.check(words)?;
        if let UncodedPose::Clip(clip) = uncoded {
            check_skeleton(clip)?;
        }
        self.scheme().decode(&self.channels, words, self.config.fps, uncoded)
    }
}
