//! Fits a tokenizer to a stream of training clips, without holding them all in memory.

use crate::mean_pose::PoseSum;
use crate::sample::Sample;
use crate::scheme::uniform::UniformFit;
use crate::scheme::walk::check_positions;
use crate::scheme::{Fitted, SchemeConfig, WordLength, check_rate, check_skeleton};
use crate::{Channels, Error, Result, Tokenizer, TokenizerConfig, Words};
use kinelm_motion::Clip;

/// Margin of the height range on each side, as a fraction of the training clips' range.
const MARGIN: f64 = 0.1;

/// The least margin, metres.
const LEAST_MARGIN_M: f64 = 0.005;

/// A tokenizer being fitted. Clips may be added in any order, and parts of a corpus fitted separately and merged: the
/// tokenizer is the same to the bit.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    config: TokenizerConfig,
    channels: Channels,
    scheme: SchemeFit,
    /// Frames from which tables, matrices and merges are fitted, which can't be streamed.
    sample: Option<Sample>,
    /// Of the uncoded joints.
    poses: PoseSum,
    /// The least and the greatest height, metres.
    heights: [f64; 2],
    clips: u64,
    frames: u64,
}

#[derive(Debug, Clone, PartialEq)]
enum SchemeFit {
    /// Ranges of every clip.
    Uniform(UniformFit),
    /// From the sample.
    Sampled,
}

impl Fit {
    /// No clips yet.
    ///
    /// # Errors
    /// [`Error::Setting`] for a setting outside its limits.
    pub fn new(config: TokenizerConfig) -> Result<Self> {
        config.validate()?;
        #[cfg(not(feature = "merges"))]
        if config.merges > 0 {
            let expected = "0: this build leaves out kinelm-tokenizer's feature `merges`";
            return Err(Error::setting("merges", config.merges, expected));
        }
        let channels = config.channels();
        let scheme = match &config.scheme {
            SchemeConfig::Uniform(c) if c.streams() => SchemeFit::Uniform(UniformFit::new(c.clone())),
            _ => SchemeFit::Sampled,
        };
        let samples = config.merges > 0 || scheme == SchemeFit::Sampled;
        Ok(Fit {
            config,
            channels,
            scheme,
            sample: samples.then(Sample::new),
            poses: PoseSum::new(),
            heights: [f64::INFINITY, f64::NEG_INFINITY],
            clips: 0,
            frames: 0,
        })
    }

    /// Adds a clip on the 24 SMPL joints at the tokenizer's rate. A clip with an error changes nothing.
    ///
    /// # Errors
    /// [`Error::Rate`], [`Error::Skeleton`], [`Error::Frame`].
    pub fn add(&mut self, clip: &Clip) -> Result<()> {
        // all that can fail comes before the first change, so a refused clip leaves the fit as it was
        check_rate(clip, self.config.fps)?;
        check_skeleton(clip)?;
        match &mut self.scheme {
            SchemeFit::Uniform(u) => u.add(&self.channels, clip)?,
            SchemeFit::Sampled => check_positions(clip)?,
        }
        if let Some(sample) = &mut self.sample {
            sample.add(clip);
        }
        self.poses.add(clip);
        clip.root().iter().for_each(|p| self.reach([p.y; 2]));
        self.clips += 1;
        self.frames += clip.frames() as u64;
        Ok(())
    }

    /// Adds the fit of another part of the corpus.
    ///
    /// # Errors
    /// [`Error::Nothing`] when the two have different settings.
    pub fn merge(&mut self, other: &Fit) -> Result<()> {
        if self.config != other.config {
            return Err(Error::Nothing("two parts with different settings can't be merged".into()));
        }
        if let (SchemeFit::Uniform(a), SchemeFit::Uniform(b)) = (&mut self.scheme, &other.scheme) {
            a.merge(b);
        }
        if let (Some(own), Some(other)) = (&mut self.sample, &other.sample) {
            own.merge(other);
        }
        self.poses.merge(&other.poses);
        self.reach(other.heights);
        self.clips += other.clips;
        self.frames += other.frames;
        Ok(())
    }

    fn reach(&mut self, [low, high]: [f64; 2]) {
        self.heights = [self.heights[0].min(low), self.heights[1].max(high)];
    }

    /// Clips added.
    pub fn clips(&self) -> u64 {
        self.clips
    }

    /// Frames added.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// The tokenizer.
    ///
    /// # Errors
    /// [`Error::Nothing`] when no clip had a frame.
    pub fn finish(self) -> Result<Tokenizer> {
        let sample = self.sample.map(Sample::into_clips).unwrap_or_default();
        let [low, high] = if self.frames > 0 { self.heights } else { [0.0; 2] };
        // a least margin, because a clip of standing has no range at all
        let margin = (MARGIN * (high - low)).max(LEAST_MARGIN_M);
        let heights = [low - margin, high + margin];
        let fitted = match self.scheme {
            SchemeFit::Uniform(u) => Fitted::Uniform(u.finish(heights)?),
            SchemeFit::Sampled => Fitted::fit(&self.config.scheme, &self.channels, &sample, heights)?,
        };
        let merges = self.config.merges;
        let mean_pose = self.poses.mean(&self.config.joints);
        let height_range = self.config.above_floor().then_some(heights);
        let tokenizer = Tokenizer::new(self.config, fitted, &[], 0, mean_pose, height_range)?;
        if merges == 0 && matches!(tokenizer.word_length(), WordLength::Fixed(_)) {
            return Ok(tokenizer);
        }
        learn_from_words(tokenizer, &sample, merges)
    }
}

impl Tokenizer {
    /// Fits a tokenizer to training clips on the 24 SMPL joints at the tokenizer's rate. [`Fit`] takes a corpus that doesn't
    /// fit into memory.
    ///
    /// # Errors
    /// Those of [`Fit::new`], [`Fit::add`] and [`Fit::finish`].
    pub fn fit<'a>(clips: impl IntoIterator<Item = &'a Clip>, config: TokenizerConfig) -> Result<Self> {
        let mut fit = Fit::new(config)?;
        clips.into_iter().try_for_each(|clip| fit.add(clip))?;
        fit.finish()
    }
}

/// Adds the merges, and the longest word of the training clips.
fn learn_from_words(tokenizer: Tokenizer, sample: &[Clip], merges: u32) -> Result<Tokenizer> {
    let mut words = Words::new();
    for clip in sample {
        tokenizer.encode(clip)?.words.iter().for_each(|word| words.push(word));
    }
    let merges = match merges {
        0 => Vec::new(),
        #[cfg(not(feature = "merges"))]
        _ => Vec::new(), // refused by `Fit::new`
        #[cfg(feature = "merges")]
        n => crate::merges::learn(&tokenizer.vocabulary, &words, n)?,
    };
    let Tokenizer { config, fitted, mean_pose, height_range, .. } = tokenizer;
    let tokenizer = Tokenizer::new(config, fitted, &merges, 0, mean_pose, height_range)?;
    let ids = tokenizer.ids_of_words(&words)?;
    // with merges applied, because models count tokens, not characters
    let longest = ids.split(|&id| id == crate::SPACE).map(<[u32]>::len).max().unwrap_or(0) + 1;
    Ok(Tokenizer { longest_word: longest, ..tokenizer })
}
