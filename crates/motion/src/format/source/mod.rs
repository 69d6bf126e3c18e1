//! A motion as it came from a file: its clip, and what the file contains beyond it.
//!
//! These types are data only. Readers make them and writers use them, without knowing each other.

pub mod bvh;

use super::{Axes, Up};
use crate::{Clip, Vec3, Warning};
use bvh::BvhSource;
use std::ops::Range;
use std::path::PathBuf;

/// A clip with its source.
#[derive(Debug, Clone)]
pub struct Motion {
    /// The file, as the user named it.
    pub path: PathBuf,
    /// The motion itself.
    pub clip: Clip,
    /// What the file contains beyond the clip.
    pub source: Source,
    /// What was odd in the file.
    pub warnings: Vec<Warning>,
}

impl Motion {
    /// The frames of a range, of clip and source.
    ///
    /// # Panics
    /// If the range leaves the clip.
    pub fn slice(&self, frames: Range<usize>) -> Motion {
        let source = match &self.source {
            Source::Bvh(s) if s.frames == self.clip.frames() => Source::Bvh(Box::new(s.slice(frames.clone()))),
            other => other.clone(),
        };
        Motion { path: self.path.clone(), clip: self.clip.slice(frames), source, warnings: self.warnings.clone() }
    }
}

/// What a file contains beyond its clip.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A BVH: its header and numbers.
    Bvh(Box<BvhSource>),
    /// An AMASS file.
    Amass {
        /// `SMPL`, `SMPL+H` or `SMPL-X`.
        model: String,
        /// The gender in the file; empty if it has none.
        gender: String,
        /// The number of shape coefficients in the file.
        betas: usize,
        /// The rest pelvis, metres, in the file's axes: what was added to `trans`.
        rest_pelvis: Vec3,
        /// Whether rest pelvis and offsets come from a body model; otherwise they are the neutral skeleton's.
        body_model: bool,
        /// How the file's axes are rotated to the clip's.
        axes: Axes,
    },
    /// An AIST++ file.
    Aist {
        /// `smpl_scaling`: the divisor of `smpl_trans`.
        scaling: f64,
        /// The rest pelvis, metres: what was added to the scaled `smpl_trans`.
        rest_pelvis: Vec3,
        /// Whether rest pelvis and offsets come from a body model; otherwise they are the neutral skeleton's.
        body_model: bool,
        /// How the file's axes are rotated to the clip's.
        axes: Axes,
    },
    /// A JSON clip whose up axis is not y, or that is mirrored.
    Json(Axes),
    /// A clip of another format without a source of its own, whose up axis is not y.
    Turned(Axes),
    /// A motion that was put on another body.
    Retargeted {
        /// The floor found before that, metres; retargeting doesn't move it.
        floor_m: f64,
    },
    /// Nothing beyond the clip: a JSON clip, or one made by a program.
    Plain,
}

impl Source {
    /// The axes of the file.
    pub fn axes(&self) -> Axes {
        match self {
            Source::Bvh(bvh) => bvh.rig.axes,
            Source::Json(axes) | Source::Turned(axes) => *axes,
            Source::Amass { axes, .. } | Source::Aist { axes, .. } => *axes,
            Source::Retargeted { .. } | Source::Plain => Axes::OWN,
        }
    }

    /// The source of a format that has none of its own, with these axes.
    pub(crate) fn plain(axes: Axes) -> Source {
        if axes.up == Up::Y { Source::Plain } else { Source::Turned(axes) }
    }
}
