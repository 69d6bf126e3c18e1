//! Mean per-joint position error (MPJPE).

use super::{Tally, check_pair};
use crate::{Clip, Error, Result, Vec3};

/// Mean per-joint position error: distances of joint positions after forward kinematics, over all joints and frames,
/// millimetres. End sites don't count.
///
/// In two versions: `global` in the world, and `root` relative to each root joint.
///
/// Source: Ionescu et al., "Human3.6M" (2014).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mpjpe {
    global: Tally,
    root: Tally,
}

impl Mpjpe {
    /// Adds two clips with the same number of frames and joints, each on its own skeleton.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when frames or joints differ.
    pub fn add(&mut self, a: &Clip, b: &Clip) -> Result<()> {
        check_pair(a, b)?;
        self.add_positions(&a.positions(), &b.positions(), a.joints())
    }

    /// Adds positions (F, J), metres; joint 0 is the root.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the numbers of positions differ, or they make no whole frames.
    pub fn add_positions(&mut self, a: &[Vec3], b: &[Vec3], joints: usize) -> Result<()> {
        check_places(a, b, joints)?;
        for (a, b) in a.chunks_exact(joints).zip(b.chunks_exact(joints)) {
            for (p, q) in a.iter().zip(b) {
                self.global.add((*p - *q).length());
                self.root.add(((*p - a[0]) - (*q - b[0])).length());
            }
        }
        Ok(())
    }

    /// Adds the values of another accumulator.
    pub fn merge(&mut self, other: &Mpjpe) {
        self.global.merge(&other.global);
        self.root.merge(&other.root);
    }

    /// Mean distance in the world, mm.
    pub fn global_mm(&self) -> f64 {
        1000.0 * self.global.mean()
    }

    /// Mean distance relative to the root, mm.
    pub fn root_mm(&self) -> f64 {
        1000.0 * self.root.mean()
    }

    /// The largest distance in the world, mm.
    pub fn max_mm(&self) -> f64 {
        1000.0 * self.global.max
    }
}

/// Refuses different numbers of positions, and those that make no whole frames.
pub(super) fn check_places(a: &[Vec3], b: &[Vec3], joints: usize) -> Result<()> {
    if joints == 0 || a.len() != b.len() || !a.len().is_multiple_of(joints) {
        let (m, n) = (a.len(), b.len());
        let found = format!("{m} and {n}, of {joints} joints");
        return Err(Error::invalid("the number of positions", found, "as many of both, in whole frames"));
    }
    Ok(())
}
