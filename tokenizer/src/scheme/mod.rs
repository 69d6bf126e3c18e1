//! How numbers become codes. Each scheme has a file of its own and a variant of [`SchemeConfig`].

pub mod angle;
pub mod line;
pub mod uniform;

use crate::channel::Channels;
use crate::{Error, Result};
use kinelm_motion::{Clip, Quat, smpl};
use serde::{Deserialize, Serialize};
use uniform::{Uniform, UniformConfig};

/// The settings of a scheme, tagged by `type`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum SchemeConfig {
    /// Bins of one width a channel.
    Uniform(UniformConfig),
}

impl Default for SchemeConfig {
    fn default() -> Self {
        SchemeConfig::Uniform(UniformConfig::default())
    }
}

impl SchemeConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the setting, its value and its limits.
    pub fn validate(&self) -> Result<()> {
        match self {
            SchemeConfig::Uniform(c) => c.validate(),
        }
    }
}

/// A fitted scheme. A file holds what was learnt from training clips; the settings stand beside it, once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(crate) enum Fitted {
    /// Bins of one width a channel.
    Uniform(Uniform),
}

impl Fitted {
    pub(crate) fn as_scheme(&self) -> &dyn Scheme {
        match self {
            Fitted::Uniform(u) => u,
        }
    }

    /// Puts the settings back that a file keeps apart.
    pub(crate) fn with_config(self, config: &SchemeConfig) -> Self {
        match (self, config) {
            (Fitted::Uniform(u), SchemeConfig::Uniform(c)) => Fitted::Uniform(u.with_config(c.clone())),
        }
    }

    /// Checks what a file says.
    pub(crate) fn validate(&self) -> Result<()> {
        match self {
            Fitted::Uniform(u) => u.validate(),
        }
    }
}

/// A clip as codes, and what coding it cost.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Encoded {
    /// (F, C) codes, each below the number of symbols.
    pub codes: Vec<u16>,
    /// (C) how many values lay outside their bins and took the last one.
    pub clipped: Vec<u64>,
    /// How many rotations, all near half a turn, took a second code, because the decoding of their first codes otherwise,
    /// and lie further than half a bin from it (never more than one).
    pub second_codes: u64,
}

/// The rotations that a word doesn't hold.
#[derive(Debug, Clone, Copy, Default)]
pub enum Rest<'a> {
    /// Identity.
    #[default]
    Identity,
    /// (24) local rotations, held still.
    Pose(&'a [Quat; 24]),
    /// Frame by frame those of a clip on the SMPL joints; where it has ended, its last frame's.
    Clip(&'a Clip),
}

impl Rest<'_> {
    /// The whole pose (24) of a frame, before the coded joints are set.
    pub(crate) fn fill(&self, frame: usize, pose: &mut Vec<Quat>) {
        match self {
            Rest::Pose(p) => pose.extend_from_slice(&p[..]),
            Rest::Clip(c) if c.frames() > 0 => pose.extend_from_slice(c.pose(frame.min(c.frames() - 1))),
            Rest::Identity | Rest::Clip(_) => pose.extend([Quat::IDENTITY; 24]),
        }
    }
}

/// What every scheme does. Clips are on the 24 SMPL joints; codes are (F, C), C the number of channels.
pub trait Scheme {
    /// How many codes there are: codes are `0..symbols()`.
    fn symbols(&self) -> u32;

    /// The clip's codes. The same whatever the clip's rate; the caller checks that.
    ///
    /// # Errors
    /// [`Error::Frame`] for a frame that can't be coded.
    fn encode(&self, channels: &Channels, clip: &Clip) -> Result<Encoded>;

    /// The clip of any codes below [`Scheme::symbols`], finite whatever they are.
    ///
    /// # Errors
    /// [`Error::Codes`] when they don't make whole frames or one is too large.
    fn decode(&self, channels: &Channels, codes: &[u16], fps: f64, rest: Rest<'_>) -> Result<Clip>;

    /// (C) the code that says nothing in each channel: no step, no turn.
    fn neutral(&self, channels: &Channels) -> Vec<u16>;
}

/// Refuses a clip that isn't on the 24 SMPL joints.
pub(crate) fn check_skeleton(clip: &Clip) -> Result<()> {
    let s = clip.skeleton();
    if s.joints() != 24 {
        return Err(Error::Skeleton { found: format!("{} joints", s.joints()) });
    }
    for j in 0..24 {
        if s.names()[j] != smpl::NAMES[j] {
            return Err(Error::Skeleton {
                found: format!("joint {j} is {:?}, not {:?}", s.names()[j], smpl::NAMES[j]),
            });
        }
        if s.parents()[j] != usize::try_from(smpl::PARENTS[j]).ok() {
            return Err(Error::Skeleton { found: format!("the parent of {} is another", smpl::NAMES[j]) });
        }
    }
    Ok(())
}

/// Refuses codes that don't make whole frames or are too large; returns F.
pub(crate) fn check_codes(channels: &Channels, symbols: u32, codes: &[u16]) -> Result<usize> {
    let c = channels.len();
    if !codes.len().is_multiple_of(c) {
        let n = codes.len();
        return Err(Error::Codes(format!("{n} codes are no whole frames of {c}; cut {} off the end", n % c)));
    }
    if let Some(at) = codes.iter().position(|&k| u32::from(k) >= symbols) {
        let channel = channels.at(at % c).map(|c| c.to_string()).unwrap_or_default();
        return Err(Error::Codes(format!(
            "frame {}, {channel}: code {}, expected one below {symbols}",
            at / c,
            codes[at]
        )));
    }
    Ok(codes.len() / c)
}
