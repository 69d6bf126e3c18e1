//! The distance of the given joints of a dance from the prompt's, on the prompt's own rig.
//!
//! A given joint is only where its ancestors leave it. So it is measured in the frame of its nearest free ancestor, of the
//! pelvis where no coded joint between is free.

use crate::Result;
use crate::edit::{PreparedEdit, ResolvedSpan};
use crate::open::PreparedPrompt;
use kinelm_motion::{Clip, Skeleton, smpl};
use kinelm_tokenizer::Tokenizer;
use std::collections::BTreeSet;

/// Distances of given joints from the prompt's, over frames and joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GivenDistance {
    /// Centimetres.
    pub mean_cm: f64,
    /// Centimetres.
    pub max_cm: f64,
}

/// The given joints but the pelvis, each with the ancestor in whose frame it is measured; SMPL ids.
pub(crate) fn reference_joints(tokenizer: &Tokenizer, prompt: &PreparedPrompt) -> Vec<(usize, usize)> {
    let is_free = |j| is_coded(tokenizer, j) && !is_given(tokenizer, prompt, j);
    let given = (1..24).filter(|&j| is_given(tokenizer, prompt, j));
    given
        .map(|joint| {
            let mut ancestor = parent(joint);
            while ancestor != 0 && !is_free(ancestor) {
                ancestor = parent(ancestor);
            }
            (joint, ancestor)
        })
        .collect()
}

/// The free coded joints between the pelvis and given ones, ascending: they move what is given.
pub(crate) fn free_ancestors(tokenizer: &Tokenizer, prompt: &PreparedPrompt) -> Vec<usize> {
    ancestors(|j| is_given(tokenizer, prompt, j), |j| is_coded(tokenizer, j) && !is_given(tokenizer, prompt, j))
}

/// The same of an edit: between the pelvis and the given joints of a span, in any of its frames.
pub(crate) fn free_ancestors_of_span(edit: &PreparedEdit, span: &ResolvedSpan) -> Vec<usize> {
    let mask = &edit.spans.mask;
    let mut found: BTreeSet<usize> = BTreeSet::new();
    let mut seen = BTreeSet::new();
    for frame in span.frames.clone() {
        let is_free = |j: usize| mask.is_coded(j) && !mask.is_given(frame, j);
        // spans have few different frames: each combination is followed once
        if seen.insert((0..24).map(is_free).collect::<Vec<bool>>()) {
            found.extend(ancestors(|j| span.joints.contains(&j) && !is_free(j), is_free));
        }
    }
    found.into_iter().collect()
}

/// The free ancestors of given joints, but the pelvis, ascending.
fn ancestors(is_given: impl Fn(usize) -> bool, is_free: impl Fn(usize) -> bool) -> Vec<usize> {
    let mut is_ancestor = [false; 24];
    for joint in (1..24).filter(|&joint| is_given(joint)) {
        let mut at = parent(joint);
        while at != 0 {
            is_ancestor[at] = true;
            at = parent(at);
        }
    }
    (1..24).filter(|&joint| is_ancestor[joint] && is_free(joint)).collect()
}

fn is_coded(tokenizer: &Tokenizer, joint: usize) -> bool {
    tokenizer.channels().joints().contains(&joint)
}

fn is_given(tokenizer: &Tokenizer, prompt: &PreparedPrompt, joint: usize) -> bool {
    is_coded(tokenizer, joint) && prompt.selection.as_ref().is_some_and(|s| s.joints.contains(&joint))
}

/// The parent of an SMPL joint; of the pelvis itself.
fn parent(joint: usize) -> usize {
    usize::try_from(smpl::PARENTS[joint]).unwrap_or(0)
}

/// The distance of a dance on the prompt's own rig from the prompt at the dance's rate, frame by frame while both last. `None`
/// where there is nothing to measure: no joint but the pelvis is given or is on the rig, or the dance is on another rig.
///
/// # Errors
/// A rig that no skeleton map knows.
pub(crate) fn given_distance(
    tokenizer: &Tokenizer,
    prompt: &PreparedPrompt,
    dance: &Clip,
) -> Result<Option<GivenDistance>> {
    let (own, retarget) = (prompt.clip.at_rate()?, prompt.clip.retarget()?);
    let tree = |rig: &Skeleton| (rig.names().to_vec(), rig.parents().to_vec());
    if tree(own.skeleton()) != tree(dance.skeleton()) {
        return Ok(None);
    }
    let on_rig = |(joint, ancestor): &(usize, usize)| Some((retarget.joint(*joint)?, retarget.joint(*ancestor)?));
    let pairs: Vec<_> = reference_joints(tokenizer, prompt).iter().filter_map(on_rig).collect();
    let (mut sum, mut max, mut count) = (0.0, 0.0f64, 0u64);
    for frame in 0..own.frames().min(dance.frames()) {
        let (a, b) = (own.global_pose(frame), dance.global_pose(frame));
        for &(joint, ancestor) in &pairs {
            let [a, b] =
                [&a, &b].map(|p| p.rotations[ancestor].conjugate() * (p.positions[joint] - p.positions[ancestor]));
            let cm = 100.0 * (a - b).length();
            (sum, max, count) = (sum + cm, max.max(cm), count + 1);
        }
    }
    Ok((count > 0).then(|| GivenDistance { mean_cm: sum / count as f64, max_cm: max }))
}
