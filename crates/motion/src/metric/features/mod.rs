//! Kinetic and geometric features of a piece of dance, the basis of Fréchet distances.
//!
//! Each comes in two versions: `Compat` as published code computes it, errors included, for comparison with papers; `Fixed`
//! without these errors. docs/referee.md explains the errors.

mod geometric;
mod kinetic;

pub use geometric::{GEOMETRIC, geometric};
pub use kinetic::{KINETIC, kinetic};

use crate::{Clip, Error, Result, Vec3, smpl};

/// The rate of `Compat` features, frames per second.
pub const COMPAT_FPS: f64 = 60.0;

/// Which formulas to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Formulas {
    /// As in published code.
    Compat,
    /// Corrected.
    Fixed,
}

/// Positions of the 24 SMPL joints (F, 24), metres, y up, with the rate and the body's rest lengths.
#[derive(Debug, Clone)]
pub struct JointPositions {
    positions: Vec<Vec3>,
    fps: f64,
    lengths: Lengths,
}

/// Lengths of a body, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lengths {
    /// Shoulder to elbow.
    pub humerus: f64,
    /// From shoulder to shoulder.
    pub shoulders: f64,
    /// From hip to hip.
    pub hips: f64,
}

impl Lengths {
    /// The lengths that published code uses for everybody.
    pub(crate) const COMPAT: Lengths = Lengths { humerus: 0.256_838_1, shoulders: 0.390_848_3, hips: 0.119_247_1 };
}

impl JointPositions {
    /// The positions of a clip on SMPL-24.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) for another rig or fewer than two frames.
    pub fn of(clip: &Clip) -> Result<JointPositions> {
        if clip.skeleton().names() != smpl::NAMES || clip.frames() < 2 {
            let (joints, frames) = (clip.joints(), clip.frames());
            let found = format!("one of {frames} frames and {joints} joints");
            return Err(Error::invalid("a clip for features", found, "SMPL's 24 joints and at least two frames"));
        }
        let at_rest = crate::GlobalPose::new(clip.skeleton(), Vec3::ZERO, &[crate::Quat::IDENTITY; 24]).positions;
        let distance = |a: usize, b: usize| (at_rest[a] - at_rest[b]).length();
        let lengths = Lengths { humerus: distance(16, 18), shoulders: distance(16, 17), hips: distance(1, 2) };
        Ok(JointPositions { positions: clip.positions(), fps: clip.fps(), lengths })
    }

    /// A range of frames.
    ///
    /// # Panics
    /// If the range leaves the frames.
    pub fn slice(&self, frames: std::ops::Range<usize>) -> JointPositions {
        JointPositions { positions: self.positions[frames.start * 24..frames.end * 24].to_vec(), ..*self }
    }

    /// The frames in reverse order.
    pub fn reversed(&self) -> JointPositions {
        JointPositions { positions: self.positions.chunks(24).rev().flatten().copied().collect(), ..*self }
    }

    /// Maps every position.
    pub fn changed(&self, change: impl FnMut(Vec3) -> Vec3) -> JointPositions {
        JointPositions { positions: self.positions.iter().copied().map(change).collect(), ..*self }
    }

    /// Frames per second.
    pub fn fps(&self) -> f64 {
        self.fps
    }

    /// F, the number of frames.
    pub fn frames(&self) -> usize {
        self.positions.len() / 24
    }

    fn at(&self, frame: usize, joint: usize) -> Vec3 {
        self.positions[frame * 24 + joint]
    }
}

#[cfg(test)]
mod tests;
