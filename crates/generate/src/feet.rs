//! Feet of a dance held where they stand, as far as they were invented.

use super::followed::Followed;
use crate::Result;
use kinelm_motion::Motion;
use kinelm_motion::feet::{FixedParts, FootLock, lock};
use kinelm_motion::joints::LEGS;
use kinelm_motion::rig::{floor, map_for};

/// What was given of a dance: the first `frames` frames whole, and the followed joints throughout.
pub fn fixed(prompt: Option<&Followed>, frames: usize) -> FixedParts {
    let selection = prompt.and_then(|prompt| prompt.selection.as_ref());
    let has = |joints: &[usize]| selection.is_some_and(|s| s.joints.iter().any(|j| joints.contains(j)));
    let root = selection.is_some_and(|s| s.translation || s.joints.contains(&0));
    FixedParts { root, path: false, legs: LEGS.map(|leg| has(&leg)), frames }
}

/// A dance with its feet held, and what that did. Its floor is at `floor_m`, or where its feet say.
///
/// # Errors
/// A rig that no skeleton map knows.
pub fn held(motion: Motion, map: Option<&str>, floor_m: Option<f64>, fixed: FixedParts) -> Result<(Motion, FootLock)> {
    let map = map_for(motion.clip.skeleton(), map)?;
    let floor_m = match floor_m {
        Some(floor_m) => floor_m,
        None => floor(&motion.clip, &map)?.height_m,
    };
    let (clip, locked) = lock(&motion.clip, &map, floor_m, fixed)?;
    Ok((Motion { clip, ..motion }, locked))
}
