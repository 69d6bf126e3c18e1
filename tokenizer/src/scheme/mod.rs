//! Schemes: how motion becomes codes. Each scheme has its own file and a variant of [`SchemeConfig`].

pub(crate) mod angle;
mod bins;
pub(crate) mod dct;
mod frame;
mod frame_bins;
pub(crate) mod lapped;
pub(crate) mod line;
pub(crate) mod mix;
mod mixed;
pub mod pelvis;
pub mod quantile;
pub mod runs;
pub(crate) mod series;
pub(crate) mod uniform;
pub(crate) mod walk;

use crate::channel::{Channel, Channels};
use crate::meaning::{Legend, Meaning};
use crate::{Error, Result, Words};
use dct::{DctConfig, DctTiles};
use kinelm_motion::rotation::Axis;
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
    /// Bins of equal width.
    Uniform(UniformConfig),
    /// Bins with equal numbers of training values.
    Quantile(QuantileConfig),
    /// Tiles of a discrete cosine transform.
    Dct(DctConfig),
    /// Tiles of a lapped transform.
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

/// A fitted scheme. In a file, the fitted tables are separate from the settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(crate) enum Fitted {
    /// Bins of equal width.
    Uniform(Uniform),
    /// Bins with equal numbers of training values.
    Quantile(Quantile),
    /// Tiles of a discrete cosine transform.
    Dct(DctTiles),
    /// Tiles of a lapped transform.
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

    /// Fits a scheme to a sample of training clips; `heights`: the range of heights above the floor.
    #[cfg(feature = "fit")]
    pub(crate) fn fit(config: &SchemeConfig, channels: &Channels, clips: &[Clip], heights: [f64; 2]) -> Result<Self> {
        match config {
            SchemeConfig::Uniform(c) => Uniform::fit(c, channels, clips, heights).map(Fitted::Uniform),
            SchemeConfig::Quantile(c) => Quantile::fit(c, channels, clips, heights).map(Fitted::Quantile),
            SchemeConfig::Dct(c) => DctTiles::fit(c, channels, clips).map(Fitted::Dct),
            SchemeConfig::Lapped(c) => Lapped::fit(c, channels, clips).map(Fitted::Lapped),
        }
    }

    /// Joins the tables of a file with its settings, and checks them.
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
            (fitted, config) => Err(Error::setting(
                "scheme",
                format!("the settings {config:?}, and tables of the scheme {}", fitted.name()),
                "settings and tables of one scheme",
            )),
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

/// The words of a clip, and counts of coding errors.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Encoded {
    /// ceil(F / L) words of codes below the number of symbols.
    pub words: Words,
    /// Values outside the bins, clipped to the last one.
    pub clipped: u64,
    /// Rotations near half a turn whose nearest codes would not encode to themselves after decoding; their codes are more than
    /// half a bin off, at most one.
    pub second_codes: u64,
    /// Frames of padding in the last tile.
    pub padded: u64,
    /// Frames whose height above the floor is outside the range of the training clips.
    pub off_range: u64,
}

/// The characters of a word, its space not counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WordLength {
    /// All words have this length.
    Fixed(usize),
    /// Up to a length; shorter words end in zeros.
    Varying {
        /// Longer words are truncated.
        most: usize,
    },
}

/// The rotations of uncoded joints.
#[derive(Debug, Clone, Copy, Default)]
pub enum UncodedPose<'a> {
    /// Identity.
    #[default]
    Identity,
    /// (24) constant local rotations.
    Pose(&'a [Quat; 24]),
    /// Those of a clip on the SMPL joints, frame by frame; after its end, those of its last frame.
    Clip(&'a Clip),
}

impl UncodedPose<'_> {
    /// Appends the pose (24) of a frame, before the coded joints are set.
    pub(crate) fn fill(&self, frame: usize, pose: &mut Vec<Quat>) {
        match self {
            UncodedPose::Pose(p) => pose.extend_from_slice(&p[..]),
            UncodedPose::Clip(c) if c.frames() > 0 => pose.extend_from_slice(c.pose(frame.min(c.frames() - 1))),
            UncodedPose::Identity | UncodedPose::Clip(_) => pose.extend([Quat::IDENTITY; 24]),
        }
    }
}

/// A fitted scheme. Clips are on the 24 SMPL joints; a word is L frames.
pub trait Scheme: Send + Sync {
    /// The number of codes, which are `0..symbols()`.
    fn symbols(&self) -> u32;

    /// L, the frames of a word.
    fn frames_per_word(&self) -> usize;

    /// The characters of a word.
    fn word_length(&self, channels: &Channels) -> WordLength;

    /// The clip's words, ceil(F / L) of them. The caller checks the clip's rate and skeleton.
    ///
    /// # Errors
    /// [`Error::Frame`] for a frame that can't be encoded.
    fn encode(&self, channels: &Channels, clip: &Clip) -> Result<Encoded>;

    /// The clip of words, L frames each, finite for any codes. The caller checks that codes are below [`Scheme::symbols`], that
    /// lengths are those of [`Scheme::word_length`], and the skeleton of `uncoded`.
    ///
    /// # Errors
    /// [`Error::Motion`] when the clip can't be built.
    fn decode(&self, channels: &Channels, words: &Words, fps: f64, uncoded: UncodedPose<'_>) -> Result<Clip>;

    /// The word of no movement: no step, no turn.
    fn neutral(&self, channels: &Channels) -> Vec<u16>;

    /// The channel of each slot of a word.
    ///
    /// # Errors
    /// The reason, for a message, when characters don't belong to single channels.
    fn slot_channels(&self, channels: &Channels) -> std::result::Result<Vec<Channel>, String>;

    /// What the numbers of every word are.
    fn legend(&self, channels: &Channels) -> Legend;

    /// What each character of a word stands for.
    fn meanings(&self, channels: &Channels, word: &[u16]) -> Vec<Meaning>;

    /// The edges between the bins of a component of a joint's rotation vector, ascending, radians; `None` when
    /// characters don't belong to single joints, and for joints that aren't coded so.
    fn edges(&self, _: &Channels, _joint: usize, _axis: Axis) -> Option<Vec<f64>> {
        None
    }

    /// Whether the last bin of a slot is next to the first, in words of one length.
    fn is_circular(&self, _place: usize) -> bool {
        false
    }

    /// Appends the quantised numbers of a word: the same count and order for every word, zeros included. Each has its own
    /// order-0 table. In frame words they are the codes.
    fn numbers(&self, channels: &Channels, word: &[u16], out: &mut Vec<i32>);

    /// Fitted numbers that decoding needs, values of bins included: the cost of transmitting the scheme.
    fn fitted_numbers(&self) -> u64;

    /// Frames before and after a word's own that its characters affect, with overlapping windows.
    fn reach(&self) -> usize {
        0
    }

    /// Words at a clip's end that depend on how it continues; a model continues the words before them.
    fn unsettled_words(&self) -> usize {
        0
    }
}

/// Refuses a clip of another rate.
pub(crate) fn check_rate(clip: &Clip, fps: f64) -> Result<()> {
    // relative, because the rounding of a rate grows with it
    if (clip.fps() - fps).abs() > 1e-9 * fps {
        return Err(Error::Rate { found: clip.fps(), expected: fps });
    }
    Ok(())
}

/// Refuses a clip on other joints than the 24 of SMPL.
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
            return Err(Error::Skeleton { found: format!("{} has another parent", smpl::NAMES[j]) });
        }
    }
    Ok(())
}

#[cfg(test)]
#[path = "frame_tests.rs"]
mod frame_tests;
