//! Learning a tokenizer from training clips, without holding them all.

use crate::scheme::uniform::UniformFit;
use crate::scheme::{Fitted, SchemeConfig, check_skeleton};
use crate::{Channels, Error, Result, Tokenizer, TokenizerConfig};
use kinelm_motion::Clip;

/// What has been learnt so far. Clips may be added in any order, and parts of a corpus fitted apart and merged: the
/// tokenizer is the same to the bit.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    config: TokenizerConfig,
    channels: Channels,
    scheme: SchemeFit,
    clips: u64,
    frames: u64,
}

#[derive(Debug, Clone, PartialEq)]
enum SchemeFit {
    Uniform(UniformFit),
}

impl Fit {
    /// Nothing learnt yet.
    ///
    /// # Errors
    /// [`Error::Setting`] for a setting outside its limits.
    pub fn new(config: TokenizerConfig) -> Result<Self> {
        config.validate()?;
        let channels = Channels::new(config.joints.clone());
        let scheme = match &config.scheme {
            SchemeConfig::Uniform(c) => SchemeFit::Uniform(UniformFit::new(c.clone())),
        };
        Ok(Fit { config, channels, scheme, clips: 0, frames: 0 })
    }

    /// Learns from a clip on the 24 SMPL joints at the tokenizer's rate. After an error nothing is learnt of it.
    ///
    /// # Errors
    /// [`Error::Rate`], [`Error::Skeleton`], [`Error::Frame`].
    pub fn add(&mut self, clip: &Clip) -> Result<()> {
        check_rate(clip, self.config.fps)?;
        check_skeleton(clip)?;
        match &mut self.scheme {
            SchemeFit::Uniform(u) => u.add(&self.channels, clip)?,
        }
        self.clips += 1;
        self.frames += clip.frames() as u64;
        Ok(())
    }

    /// Adds what another part of the corpus taught.
    ///
    /// # Errors
    /// [`Error::Nothing`] when the two have different settings.
    pub fn merge(&mut self, other: &Fit) -> Result<()> {
        if self.config != other.config {
            return Err(Error::Nothing("two parts with different settings can't be merged".into()));
        }
        match (&mut self.scheme, &other.scheme) {
            (SchemeFit::Uniform(a), SchemeFit::Uniform(b)) => a.merge(b),
        }
        self.clips += other.clips;
        self.frames += other.frames;
        Ok(())
    }

    /// Clips learnt from.
    pub fn clips(&self) -> u64 {
        self.clips
    }

    /// Frames learnt from.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// The tokenizer.
    ///
    /// # Errors
    /// [`Error::Nothing`] when there was no frame to learn from.
    pub fn finish(self) -> Result<Tokenizer> {
        let fitted = match self.scheme {
            SchemeFit::Uniform(u) => Fitted::Uniform(u.finish()?),
        };
        Ok(Tokenizer::new(self.config, fitted))
    }
}

/// Refuses a clip of another rate.
pub(crate) fn check_rate(clip: &Clip, fps: f64) -> Result<()> {
    if (clip.fps() - fps).abs() > 1e-9 * fps {
        return Err(Error::Rate { found: clip.fps(), expected: fps });
    }
    Ok(())
}
