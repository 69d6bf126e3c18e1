//! Feet locked in the gaps where they are free, before the gaps are closed.

use super::mask::Mask;
use super::splice::merge;
use crate::Result;
use kinelm_motion::Clip;
use kinelm_motion::feet::{FixedParts, FootLock, lock};
use kinelm_motion::joints::LEGS;
use kinelm_motion::rig::Humanoid;
use std::ops::Range;

/// The gaps in which a leg or the root is free, each once, in order.
fn gaps(mask: &Mask) -> Vec<Range<usize>> {
    let joints = LEGS.iter().flatten().filter(|&&joint| mask.is_coded(joint)).chain(&[0]);
    let mut gaps: Vec<Range<usize>> = joints.flat_map(|&joint| mask.free_runs(joint)).collect();
    // both legs and the root often share a gap, which is locked once for all
    gaps.sort_by_key(|gap| (gap.start, gap.end));
    gaps.dedup();
    gaps
}

/// The parts that foot locking must not move in a gap.
fn fixed(mask: &Mask, gap: &Range<usize>) -> FixedParts {
    let given = |joint: usize| mask.is_coded(joint) && gap.clone().any(|frame| mask.is_given(frame, joint));
    let legs = LEGS.map(|leg| leg.into_iter().any(given));
    // a path that has to meet the gap's end isn't moved away from it, only to be pulled back
    FixedParts { root: given(0), path: gap.end < mask.frames(), legs, frames: gap.start }
}

/// `dance`, on SMPL-24, with its feet locked in every gap in which a leg is free, and what that changed, gap by gap. Given
/// joints are those of `truth`, of as many frames.
///
/// # Errors
/// None for clips on SMPL-24.
pub fn lock_gaps(dance: &Clip, truth: &Clip, mask: &Mask, floor_m: f64) -> Result<(Clip, Vec<FootLock>)> {
    let (mut dance, mut done) = (dance.clone(), Vec::new());
    for gap in gaps(mask) {
        let fixed = fixed(mask, &gap);
        if fixed.legs == [true; 2] {
            continue;
        }
        // the look-ahead frame after the gap, where the clip continues
        let end = (gap.end + 1).min(dance.frames());
        // given joints as in the truth: feet are locked against what the clip will show
        let before = merge(truth, &dance, |frame, joint| {
            !mask.is_given(frame.min(gap.end - 1), joint) || !mask.is_given(frame, joint)
        })?
        .slice(0..end);
        let (after, locked) = lock(&before, Humanoid::neutral(), floor_m, fixed)?;
        let (mut root, mut rotations) = (dance.root().to_vec(), dance.rotations().to_vec());
        for f in gap.start..end {
            if !fixed.root {
                root[f] = after.root()[f];
            }
            for leg in LEGS.iter().zip(fixed.legs).filter(|(_, fixed)| !fixed).flat_map(|(leg, _)| leg) {
                rotations[f * 24 + leg] = after.pose(f)[*leg];
            }
        }
        dance = Clip::new(dance.skeleton().clone(), dance.fps(), root, rotations)?;
        done.push(locked);
    }
    Ok((dance, done))
}
