//! Feet of a dance locked in contact, as far as they were generated.

use crate::Result;
use kinelm_motion::Motion;
use kinelm_motion::feet::{FixedParts, FootLock, lock};
use kinelm_motion::joints::{LEGS, Selection};
use kinelm_motion::rig::{floor, map_of};

/// What foot locking must not move: the first `frames` frames, and the given joints.
pub(super) fn fixed(given: Option<&Selection>, frames: usize) -> FixedParts {
    let has = |joints: &[usize]| given.is_some_and(|given| given.joints.iter().any(|j| joints.contains(j)));
    let root = given.is_some_and(|given| given.translation || given.joints.contains(&0));
    FixedParts { root, path: false, legs: LEGS.map(|leg| has(&leg)), frames }
}

/// A motion with its feet locked, and what that changed. The floor is at `floor_m`, or estimated from the feet.
///
/// # Errors
/// A rig that no skeleton map knows.
pub fn lock_feet(
    motion: Motion,
    map: Option<&str>,
    floor_m: Option<f64>,
    fixed: FixedParts,
) -> Result<(Motion, FootLock)> {
    let map = map_of(&motion.clip, map)?;
    let floor_m = match floor_m {
        Some(floor_m) => floor_m,
        None => floor(&motion.clip, &map)?.height_m,
    };
    let (clip, locked) = lock(&motion.clip, &map, floor_m, fixed)?;
    Ok((Motion { clip, ..motion }, locked))
}
