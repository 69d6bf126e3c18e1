//! Feet of a dance locked in contact, as far as they were generated.

use crate::{Error, Result};
use kinelm_motion::Motion;
use kinelm_motion::feet::{FixedParts, FootLock, lock};
use kinelm_motion::joints::{LEGS, Selection};

/// The parts that foot locking must not move: the first `frames` frames, the given joints, and the root of a dance that is led
/// along a path.
pub(crate) fn fixed(given: Option<&Selection>, is_led: bool, frames: usize) -> FixedParts {
    let has = |joints: &[usize]| given.is_some_and(|given| given.joints.iter().any(|j| joints.contains(j)));
    // a body on a given path isn't lowered either: feet that stood elsewhere would draw it to the floor
    let root = is_led || given.is_some_and(|given| given.path || given.height || given.joints.contains(&0));
    FixedParts { root, path: false, legs: LEGS.map(|leg| has(&leg)), frames }
}

/// A motion with its feet locked, and what that changed. The floor is at `floor_m`, or estimated from the feet.
///
/// # Errors
/// A rig that no skeleton map knows.
pub fn lock_feet(motion: Motion, floor_m: Option<f64>, fixed: FixedParts) -> Result<(Motion, FootLock)> {
    let humanoid = motion.humanoid()?;
    let floor_m = floor_m.map_or_else(|| Ok(motion.floor()?.height_m), Ok::<_, Error>)?;
    let (clip, locked) = lock(&motion.clip, humanoid, floor_m, fixed)?;
    Ok((motion.with_clip(clip), locked))
}
