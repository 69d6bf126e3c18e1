//! How far the joints' places are apart.

use super::{Tally, check_pair};
use crate::{Clip, Error, Result, Vec3};

/// Mean per-joint position error: distances between joints' places after forward kinematics, over all joints and frames,
/// millimetres. End sites are left out.
///
/// Two figures: `global`, as the clips stand, and `root`, both root joints moved to 0.
///
/// Source: Ionescu et al., "Human3.6M" (2014).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mpjpe {
    global: Tally,
    root: Tally,
}

impl Mpjpe {
    /// Adds two clips of as many frames and joints, each on its own skeleton.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when frames or joints differ.
    pub fn add(&mut self, a: &Clip, b: &Clip) -> Result<()> {
        check_pair(a, b)?;
        self.add_positions(&a.positions(), &b.positions(), a.joints())
    }

    /// Adds places (F, J), metres, joint 0 the root.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when there are not as many of both, or no whole frames.
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

    /// Adds what was measured apart.
    pub fn merge(&mut self, other: &Mpjpe) {
        self.global.merge(&other.global);
        self.root.merge(&other.root);
    }

    /// Mean distance of the places as they stand, mm.
    pub fn global_mm(&self) -> f64 {
        1000.0 * self.global.mean()
    }

    /// Mean distance with both roots at 0, mm.
    pub fn root_mm(&self) -> f64 {
        1000.0 * self.root.mean()
    }

    /// The largest distance of a joint's places as they stand, mm.
    pub fn max_mm(&self) -> f64 {
        1000.0 * self.global.max
    }
}

/// Refuses places that don't make as many whole frames.
pub(super) fn check_places(a: &[Vec3], b: &[Vec3], joints: usize) -> Result<()> {
    if joints == 0 || a.len() != b.len() || !a.len().is_multiple_of(joints) {
        let (m, n) = (a.len(), b.len());
        let found = format!("{m} and {n}, of {joints} joints");
        return Err(Error::invalid("the number of positions", found, "as many of both, in whole frames"));
    }
    Ok(())
}
