//! Options of reading motion files.

use super::{MirrorAxis, Up};
use crate::resample::{FEWEST_FPS, MOST_FPS};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// How a motion file is to be read; the same for all commands.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReadOptions {
    /// The true rate, if the file states a wrong one.
    pub fps_source: Option<f64>,
    /// The unit of a BVH.
    pub unit: Unit,
    /// The up axis of a BVH or JSON file.
    pub up: Up,
    /// A skeleton map by its built-in name or its path, or its TOML, for rigs that no built-in map fits.
    pub map: Option<String>,
    /// What position channels do to a joint's OFFSET.
    pub bvh_position: BvhPosition,
    /// The ROOT to read, if there are several.
    pub root: Option<String>,
    /// Read the whole rows of a truncated file.
    pub lenient: bool,
    /// What to do with a leading rest-pose frame.
    pub rest: RestFrame,
    /// Frames to drop at the start. Above 0, no rest-pose frame is looked for.
    pub skip: usize,
    /// A body model (`SMPL_*.npz`) whose rest offsets replace the neutral skeleton's in AMASS and AIST++ files.
    pub body_model: Option<PathBuf>,
    /// The height of the floor, metres, world; `None` detects it from the feet.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floor: Option<f64>,
    /// The axis of the file's world along which its bodies are mirrored; writing the file back mirrors them again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirror_axis: Option<MirrorAxis>,
}

/// The unit of length of a BVH.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Unit {
    /// Inferred from the leg length.
    #[default]
    Auto,
    /// Metres.
    #[serde(alias = "m")]
    #[cfg_attr(feature = "clap", value(name = "m"))]
    Metre,
    /// Centimetres.
    #[serde(alias = "cm")]
    #[cfg_attr(feature = "clap", value(name = "cm"))]
    Centimetre,
    /// Millimetres.
    #[serde(alias = "mm")]
    #[cfg_attr(feature = "clap", value(name = "mm"))]
    Millimetre,
    /// Inches.
    #[serde(alias = "in")]
    #[cfg_attr(feature = "clap", value(name = "in"))]
    Inch,
    /// 0.0564444 m, the unit of CMU's ASF/AMC files.
    Cmu,
}

impl Unit {
    /// The unit in metres; `None` for [`Unit::Auto`].
    pub fn metres(self) -> Option<f64> {
        Some(match self {
            Unit::Auto => return None,
            Unit::Metre => 1.0,
            Unit::Centimetre => 0.01,
            Unit::Millimetre => 0.001,
            Unit::Inch => 0.0254,
            Unit::Cmu => 0.0564444,
        })
    }
}

/// The two meanings of BVH position channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum BvhPosition {
    /// A channel replaces its component of the OFFSET.
    #[default]
    Replace,
    /// A channel is added to its component of the OFFSET.
    Add,
}

/// What to do with a leading rest-pose frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RestFrame {
    /// Keep it.
    #[default]
    Keep,
    /// Drop it and report that.
    Drop,
}

/// Whether a rate is plausible and can be written again.
pub(crate) fn is_rate(fps: f64) -> bool {
    (FEWEST_FPS..=MOST_FPS).contains(&fps)
}

/// Fails if `skip` leaves no frame.
pub(crate) fn check_skip(path: &Path, skip: usize, frames: usize) -> Result<()> {
    if skip < frames {
        return Ok(());
    }
    Err(Error::invalid("`skip`", skip, format!("fewer than all frames; there are {frames}")).in_clip(path))
}
