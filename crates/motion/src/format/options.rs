//! What a caller says of a file that is to be read.

use super::Up;
use crate::resample::{FEWEST_FPS, MOST_FPS};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What a file's bytes are to be read as; the same on every command.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReadOptions {
    /// The true rate, where the file states it wrongly.
    pub fps_source: Option<f64>,
    /// The unit of a BVH.
    pub unit: Unit,
    /// The axis that points up in a BVH or a JSON.
    pub up: Up,
    /// A skeleton TOML by its shipped name or its path, for a rig whose names no shipped one knows.
    pub map: Option<String>,
    /// What position channels do to a joint's OFFSET.
    pub bvh_position: BvhPosition,
    /// The ROOT to read, of several.
    pub root: Option<String>,
    /// Keep the whole rows of a cut file.
    pub lenient: bool,
    /// What to do with a leading rest-pose frame.
    pub rest: RestFrame,
    /// Source frames left out, counted from the file's first. Above 0 no rest frame is looked for.
    pub skip: usize,
    /// A body model (`SMPL_*.npz`) whose rest offsets replace the neutral skeleton's, for AMASS and AIST++.
    pub body_model: Option<PathBuf>,
    /// Where the floor is, metres, world, for what codes heights above it; `None`: found by the feet.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floor: Option<f64>,
}

/// The length that 1 in a BVH means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Unit {
    /// Judged by the leg's length.
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
    /// Metres; `None` for [`Unit::Auto`].
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

/// The two conventions of BVH position channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum BvhPosition {
    /// A channel takes the place of its component of the OFFSET.
    #[default]
    Replace,
    /// A channel is added to its component of the OFFSET.
    Add,
}

/// What to do with a leading rest-pose frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RestFrame {
    /// Leave it.
    #[default]
    Keep,
    /// Leave it out, and say so.
    Drop,
}

/// Whether a rate is one that motion is captured at: what is faster is a slip, and no rate that could be written again.
pub(crate) fn is_rate(fps: f64) -> bool {
    (FEWEST_FPS..=MOST_FPS).contains(&fps)
}

/// Fails when `skip` leaves none of `frames`.
pub(crate) fn check_skip(path: &Path, skip: usize, frames: usize) -> Result<()> {
    if skip < frames {
        return Ok(());
    }
    Err(Error::invalid("`skip`", skip, format!("fewer than the {frames} frames that there are")).in_clip(path))
}
