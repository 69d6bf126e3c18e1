//! How far given joints of a dance stand from the prompt's, on the prompt's own rig.
//!
//! A given joint is only where the joints above it leave it. So it is measured in the frame of the joint that it hangs on
//! by given and uncoded joints alone: of the pelvis, where no coded joint between is free.

use super::edit::Edited;
use super::edit::mask::Understood;
use super::followed::Followed;
use crate::Result;
use kinelm_motion::{Clip, Skeleton, smpl};
use kinelm_tokenizer::Tokenizer;
use std::collections::BTreeSet;

/// Distances of given joints from the prompt's, over frames and joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Apart {
    /// Centimetres.
    pub mean_cm: f64,
    /// Centimetres.
    pub most_cm: f64,
}

/// The given joints but the pelvis, each with the joint whose frame it is measured in; SMPL ids.
pub fn held_to(tokenizer: &Tokenizer, prompt: &Followed) -> Vec<(usize, usize)> {
    let is_free = |j| is_coded(tokenizer, j) && !is_given(tokenizer, prompt, j);
    let given = (1..24).filter(|&j| is_given(tokenizer, prompt, j));
    given
        .map(|joint| {
            let mut above = parent(joint);
            while above != 0 && !is_free(above) {
                above = parent(above);
            }
            (joint, above)
        })
        .collect()
}

/// The free coded joints between the pelvis and followed ones, ascending: they move what is given.
pub fn free_between(tokenizer: &Tokenizer, prompt: &Followed) -> Vec<usize> {
    above(|j| is_given(tokenizer, prompt, j), |j| is_coded(tokenizer, j) && !is_given(tokenizer, prompt, j))
}

/// The same of an edit, of the given joints of a span in any of its frames.
pub fn free_between_of(edited: &Edited, span: &Understood) -> Vec<usize> {
    let mask = &edited.read.mask;
    let mut found: Vec<usize> = Vec::new();
    let mut seen = BTreeSet::new();
    for frame in span.frames.clone() {
        let is_free = |j: usize| mask.is_coded(j) && !mask.is_given(frame, j);
        if seen.insert((0..24).map(is_free).collect::<Vec<bool>>()) {
            found.extend(above(|j| span.joints.contains(&j) && !is_free(j), is_free));
        }
    }
    found.sort_unstable();
    found.dedup();
    found
}

/// The free joints above given ones, but the pelvis, ascending.
fn above(is_given: impl Fn(usize) -> bool, is_free: impl Fn(usize) -> bool) -> Vec<usize> {
    let mut above = [false; 24];
    for joint in (1..24).filter(|&joint| is_given(joint)) {
        let mut at = parent(joint);
        while at != 0 {
            above[at] = true;
            at = parent(at);
        }
    }
    (1..24).filter(|&joint| above[joint] && is_free(joint)).collect()
}

fn is_coded(tokenizer: &Tokenizer, joint: usize) -> bool {
    tokenizer.channels().joints().contains(&joint)
}

fn is_given(tokenizer: &Tokenizer, prompt: &Followed, joint: usize) -> bool {
    is_coded(tokenizer, joint) && prompt.selection.as_ref().is_some_and(|s| s.joints.contains(&joint))
}

/// The parent of an SMPL joint; of the pelvis itself.
fn parent(joint: usize) -> usize {
    usize::try_from(smpl::PARENTS[joint]).unwrap_or(0)
}

/// Holds a dance on the prompt's own rig to the prompt at the dance's rate, frame by frame while both last. `None` where
/// nothing can be held: no joint but the pelvis is given or stands on the rig, or the dance is on another rig.
///
/// # Errors
/// A rig that no skeleton map knows.
pub fn apart(tokenizer: &Tokenizer, prompt: &Followed, map: Option<&str>, dance: &Clip) -> Result<Option<Apart>> {
    let (own, way) = (prompt.clip.at_rate()?, prompt.clip.way(map)?);
    let tree = |rig: &Skeleton| (rig.names().to_vec(), rig.parents().to_vec());
    if tree(own.skeleton()) != tree(dance.skeleton()) {
        return Ok(None);
    }
    let on_rig = |(joint, above): &(usize, usize)| Some((way.joint(*joint)?, way.joint(*above)?));
    let held: Vec<_> = held_to(tokenizer, prompt).iter().filter_map(on_rig).collect();
    let (mut sum, mut most, mut count) = (0.0, 0.0f64, 0u64);
    for frame in 0..own.frames().min(dance.frames()) {
        let (a, b) = (own.global_pose(frame), dance.global_pose(frame));
        for &(joint, above) in &held {
            let [a, b] = [&a, &b].map(|p| p.rotations[above].conjugate() * (p.positions[joint] - p.positions[above]));
            let cm = 100.0 * (a - b).length();
            (sum, most, count) = (sum + cm, most.max(cm), count + 1);
        }
    }
    Ok((count > 0).then(|| Apart { mean_cm: sum / count as f64, most_cm: most }))
}
