//! How numbers become codes. Each scheme has a file of its own and a variant of [`SchemeConfig`].

pub mod angle;
pub mod bins;
pub mod dct;
mod frame;
mod frame_bins;
pub mod lapped;
pub mod line;
pub mod mix;
mod mixed;
pub mod pelvis;
pub mod quantile;
pub mod runs;
pub mod series;
pub mod uniform;
pub(crate) mod walk;

use crate::channel::{Channel, Channels};
use crate::{Error, Result, Words};
use dct::{DctConfig, DctTiles};
use kinelm_motion::{Clip, Quat, smpl};
use lapped::{Lapped, LappedConfig};
use quantile::{Quantile, QuantileConfig};
use serde::{Deserialize, Serialize};
use uniform::{Uniform, UniformConfig};
use walk::Height;

/// The settings of a scheme, tagged by `type`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum SchemeConfig {
    /// Bins of one width a channel.
    Uniform(UniformConfig),
    /// Bins of as many training values each.
    Quantile(QuantileConfig),
    /// Tiles under a discrete cosine transform.
    Dct(DctConfig),
    /// Tiles that run into each other.
    Lapped(LappedConfig),
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
            SchemeConfig::Quantile(c) => c.validate(),
            SchemeConfig::Dct(c) => c.validate(),
            SchemeConfig::Lapped(c) => c.validate(),
        }
    }

    /// How the height of the pelvis is coded.
    pub fn height(&self) -> Height {
        match self {
            SchemeConfig::Uniform(c) => c.height,
            SchemeConfig::Quantile(c) => c.height,
            SchemeConfig::Dct(c) => c.height,
            SchemeConfig::Lapped(c) => c.height,
        }
    }
}

/// A fitted scheme. A file holds what was learnt from training clips; the settings stand beside it, once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(crate) enum Fitted {
    /// Bins of one width a channel.
    Uniform(Uniform),
    /// Bins of as many training values each.
    Quantile(Quantile),
    /// Tiles under a discrete cosine transform.
    Dct(DctTiles),
    /// Tiles that run into each other.
    Lapped(Lapped),
}

impl Fitted {
    pub(crate) fn as_scheme(&self) -> &dyn Scheme {
        match self {
            Fitted::Uniform(u) => u,
            Fitted::Quantile(q) => q,
            Fitted::Dct(d) => d,
            Fitted::Lapped(l) => l,
        }
    }

    /// What a sample of training frames teaches; `heights`: the range of heights above the floor.
    #[cfg(feature = "fit")]
    pub(crate) fn fit(config: &SchemeConfig, channels: &Channels, clips: &[Clip], heights: [f64; 2]) -> Result<Self> {
        match config {
            SchemeConfig::Uniform(c) => Uniform::fit(c, channels, clips, heights).map(Fitted::Uniform),
            SchemeConfig::Quantile(c) => Quantile::fit(c, channels, clips, heights).map(Fitted::Quantile),
            SchemeConfig::Dct(c) => DctTiles::fit(c, channels, clips).map(Fitted::Dct),
            SchemeConfig::Lapped(c) => Lapped::fit(c, channels, clips).map(Fitted::Lapped),
        }
    }

    /// Puts the settings back that a file keeps apart, and checks what the file says.
    pub(crate) fn with_config(self, config: &SchemeConfig, channels: &Channels) -> Result<Self> {
        match (self, config) {
            (Fitted::Uniform(u), SchemeConfig::Uniform(c)) => {
                let u = u.with_config(c.clone());
                u.validate(channels).map(|()| Fitted::Uniform(u))
            }
            (Fitted::Quantile(q), SchemeConfig::Quantile(c)) => {
                let q = q.with_config(c.clone());
                q.validate(channels).map(|()| Fitted::Quantile(q))
            }
            (Fitted::Dct(d), SchemeConfig::Dct(c)) => {
                let d = d.with_config(c.clone());
                d.validate(channels).map(|()| Fitted::Dct(d))
            }
            (Fitted::Lapped(l), SchemeConfig::Lapped(c)) => {
                let l = l.with_config(c.clone());
                l.validate(channels).map(|()| Fitted::Lapped(l))
            }
            (fitted, config) => Err(Error::Setting {
                field: "scheme",
                found: format!("settings of one, {config:?}, and what was learnt for another, {}", fitted.name()),
                expected: "both of one scheme".into(),
            }),
        }
    }

    fn name(&self) -> &'static str {
        match self {
            Fitted::Uniform(_) => "uniform",
            Fitted::Quantile(_) => "quantile",
            Fitted::Dct(_) => "dct",
            Fitted::Lapped(_) => "lapped",
        }
    }
}

/// A clip as words, and what coding it cost.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Encoded {
    /// ceil(F / L) words of codes below the number of symbols.
    pub words: Words,
    /// How many values lay outside their bins and took the last one.
    pub clipped: u64,
    /// How many rotations, all near half a turn, took a second code, because the decoding of their first codes otherwise,
    /// and lie further than half a bin from it (never more than one).
    pub second_codes: u64,
    /// Frames that were added to fill the last tile.
    pub padded: u64,
    /// Frames whose height above the floor lay outside the range of the training clips.
    pub off_range: u64,
}

/// How many characters a word has, its space not counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WordLength {
    /// All words as many.
    Fixed(usize),
    /// Up to so many; what a shorter word lacks are zeros.
    Varying {
        /// A longer word is cut.
        most: usize,
    },
}

/// The rotations that a word doesn't hold.
#[derive(Debug, Clone, Copy, Default)]
pub enum UncodedPose<'a> {
    /// Identity.
    #[default]
    Identity,
    /// (24) local rotations, held still.
    Pose(&'a [Quat; 24]),
    /// Frame by frame those of a clip on the SMPL joints; where it has ended, its last frame's.
    Clip(&'a Clip),
}

impl UncodedPose<'_> {
    /// The whole pose (24) of a frame, before the coded joints are set.
    pub(crate) fn fill(&self, frame: usize, pose: &mut Vec<Quat>) {
        match self {
            UncodedPose::Pose(p) => pose.extend_from_slice(&p[..]),
            UncodedPose::Clip(c) if c.frames() > 0 => pose.extend_from_slice(c.pose(frame.min(c.frames() - 1))),
            UncodedPose::Identity | UncodedPose::Clip(_) => pose.extend([Quat::IDENTITY; 24]),
        }
    }
}

/// What every scheme does. Clips are on the 24 SMPL joints; a word stands for L frames.
pub trait Scheme: Send + Sync {
    /// How many codes there are: codes are `0..symbols()`.
    fn symbols(&self) -> u32;

    /// L, the frames that a word stands for.
    fn frames_per_word(&self) -> usize;

    /// The characters of a word.
    fn word_length(&self, channels: &Channels) -> WordLength;

    /// The clip's words, ceil(F / L) of them. The same whatever the clip's rate; the caller checks that, and the skeleton.
    ///
    /// # Errors
    /// [`Error::Frame`] for a frame that can't be coded.
    fn encode(&self, channels: &Channels, clip: &Clip) -> Result<Encoded>;

    /// The clip of words, L frames each, finite whatever their codes are. The caller checks that the codes are below
    /// [`Scheme::symbols`], that words have a length of [`Scheme::word_length`], and the skeleton of `rest`.
    ///
    /// # Errors
    /// When no clip can be made of it.
    fn decode(&self, channels: &Channels, words: &Words, fps: f64, rest: UncodedPose<'_>) -> Result<Clip>;

    /// The word that says nothing: no step, no turn.
    fn neutral(&self, channels: &Channels) -> Vec<u16>;

    /// What stands at each place of a word; where a character belongs to no one channel, the reason.
    ///
    /// # Errors
    /// The reason, as half a sentence for a message.
    fn slot_channels(&self, channels: &Channels) -> std::result::Result<Vec<Channel>, String>;

    /// Whether the codes at a place of words of one length go round: the last bin is the first one's neighbour.
    fn is_circular(&self, _place: usize) -> bool {
        false
    }

    /// Appends the quantised numbers that a word says: as many for every word, in one order, zeros spelled out. Order-0
    /// tables are kept for each of them. In frame words these are the codes.
    fn numbers(&self, channels: &Channels, word: &[u16], out: &mut Vec<i32>);

    /// How many fitted numbers the scheme needs to decode, the values of its bins among them: what it costs to send.
    fn fitted_numbers(&self) -> u64;

    /// Frames before and behind its own that a word's characters may change: overlapping windows.
    fn reach(&self) -> usize {
        0
    }

    /// Words at a clip's end that would read otherwise if the clip went on; a model continues the words before them.
    fn unsettled_words(&self) -> usize {
        0
    }
}

/// Refuses a clip of another rate.
pub(crate) fn check_rate(clip: &Clip, fps: f64) -> Result<()> {
    if (clip.fps() - fps).abs() > 1e-9 * fps {
        return Err(Error::Rate { found: clip.fps(), expected: fps });
    }
    Ok(())
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

#[cfg(test)]
#[path = "frame_tests.rs"]
mod frame_tests;
