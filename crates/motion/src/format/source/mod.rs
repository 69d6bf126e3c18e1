//! A motion as it came from a file: its clip, and what the file said beside it.
//!
//! These are data alone. Readers make them, writers use them, and neither knows the other.

pub mod bvh;

use super::{Axes, Up};
use crate::{Clip, Vec3, Warning};
use bvh::BvhSource;
use std::ops::Range;
use std::path::PathBuf;

/// A clip as it came from a file.
#[derive(Debug, Clone)]
pub struct Motion {
    /// The file, as the user named it.
    pub path: PathBuf,
    /// What moves.
    pub clip: Clip,
    /// What the file said beside it.
    pub source: Source,
    /// What was odd.
    pub warnings: Vec<Warning>,
}

impl Motion {
    /// The frames of a range, of the clip and of the file's own numbers beside it.
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

/// What a file said that a clip has no place for.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A BVH: its whole header and its numbers.
    Bvh(Box<BvhSource>),
    /// AMASS: what `inspect` tells beside the motion.
    Amass {
        /// `SMPL`, `SMPL+H` or `SMPL-X`.
        model: String,
        /// As the file has it; empty where it has none.
        gender: String,
        /// How many shape numbers the file holds.
        betas: usize,
        /// Where the pelvis lies at rest, metres, in the file's own axes: what was added to `trans`.
        rest_pelvis: Vec3,
        /// Whether a user's body model supplied that and the offsets; if not, they are the neutral skeleton's.
        body_model: bool,
    },
    /// AIST++.
    Aist {
        /// `smpl_scaling`: the divisor of `smpl_trans`.
        scaling: f64,
        /// Where the pelvis lies at rest, metres: what was added to the scaled `smpl_trans`.
        rest_pelvis: Vec3,
        /// Whether a user's body model supplied that and the offsets; if not, they are the neutral skeleton's.
        body_model: bool,
    },
    /// Our own JSON whose world was read with another axis than y up.
    Json(Axes),
    /// A motion that was put on another body.
    Retargeted {
        /// Where its floor was found before that, metres: it still is there.
        floor_m: f64,
    },
    /// Our own JSON, or made by a program: nothing beside the clip.
    Plain,
}

impl Source {
    /// The axes of the file, as it was read.
    pub fn axes(&self) -> Axes {
        match self {
            Source::Bvh(bvh) => bvh.rig.axes,
            Source::Json(axes) => *axes,
            Source::Amass { .. } => Axes { up: Up::Z, ..Axes::OWN },
            Source::Aist { .. } | Source::Retargeted { .. } | Source::Plain => Axes::OWN,
        }
    }
}
