//! Motion files: found by name and first bytes, read into a [`Motion`], written back.

pub mod bvh;
pub mod positions;

use std::path::PathBuf;

/// What a file's bytes are to be read as; the same on every command.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadOptions {
    /// The true rate, where the file states it wrongly.
    pub fps_source: Option<f64>,
    /// The unit of a BVH.
    pub unit: Unit,
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
}

/// The length that 1 in a BVH means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unit {
    /// Judged by the leg's length.
    #[default]
    Auto,
    /// Metres.
    Metre,
    /// Centimetres.
    Centimetre,
    /// Millimetres.
    Millimetre,
    /// Inches.
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BvhPosition {
    /// A channel takes the place of its component of the OFFSET.
    #[default]
    Replace,
    /// A channel is added to its component of the OFFSET.
    Add,
}

/// What to do with a leading rest-pose frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RestFrame {
    /// Leave it.
    #[default]
    Keep,
    /// Leave it out, and say so.
    Drop,
}
