//! Generated motion spliced into its clip: on the clip's own rig, at the rate of its file.

use super::gap::{Shares, difference};
use super::mask::Mask;
use crate::Result;
use kinelm_motion::format::Changed;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::Retarget;
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Clip, Vec3};
use std::ops::Range;

/// Which SMPL joint each joint of a rig stands for.
pub(crate) struct RigJoints {
    /// (J) the SMPL joint, if any.
    pub smpl: Vec<Option<usize>>,
}

impl RigJoints {
    /// Of a retargeting between a rig and SMPL-24.
    pub fn of(retarget: &Retarget) -> RigJoints {
        let mut smpl = vec![None; retarget.rig().joints()];
        // from the last on: of SMPL joints that share a joint of the rig the one with the lowest id counts
        for id in (0..24).rev() {
            if let Some(joint) = retarget.joint(id) {
                smpl[joint] = Some(id);
            }
        }
        RigJoints { smpl }
    }

    /// Whether a joint of the rig is free in a frame: its SMPL joint is; without a coded one, every coded joint is.
    fn is_free(&self, mask: &Mask, frame: usize, joint: usize) -> bool {
        match self.smpl[joint].filter(|&j| mask.is_coded(j)) {
            Some(joint) => !mask.is_given(frame, joint),
            None => mask.is_all_free(frame),
        }
    }

    /// Joints without an SMPL joint.
    pub(crate) fn others(&self) -> Vec<usize> {
        (0..self.smpl.len()).filter(|&joint| self.smpl[joint].is_none()).collect()
    }
}

/// `clip`, F frames of a file, with `dance` where the mask, of as many frames, is free; and which numbers are new. The dance
/// is on the same rig at the model's rate. `frames` come out, those beyond the clip all new. Where free frames meet given
/// ones, the difference fades over `blend_s` seconds on the free side.
///
/// # Errors
/// None for clips of one rig.
pub(crate) fn splice(
    clip: &Clip,
    dance: &Clip,
    mask: &Mask,
    rig: &RigJoints,
    frames: usize,
    blend_s: f64,
) -> Result<(Clip, Changed)> {
    let fps = clip.fps();
    let dance = extended(&resample(dance, fps, Method::Curve)?, frames)?.slice(0..frames);
    let j = clip.joints();
    let whole = extended(clip, frames)?;
    let (mut root, mut rotations) = (whole.root().to_vec(), whole.rotations().to_vec());
    let mut changed = Changed { before: 0, root: vec![false; frames], joints: vec![false; frames * j] };
    // half a gap at most, so that the blends of both ends don't overlap
    let blend = |gap: &Range<usize>| (blend_s * fps).min(gap.len() as f64 / 2.0);
    let ends = |gap: &Range<usize>| (gap.start.checked_sub(1), Some(gap.end).filter(|&end| end < frames));
    for gap in Mask::runs(frames, |f| !mask.is_given(f, 0)) {
        let off = |f: Option<usize>| f.map_or(Vec3::ZERO, |f| whole.root()[f] - dance.root()[f]);
        let (before, after) = ends(&gap);
        for f in gap.clone() {
            let shares = Shares::of(f, &gap, frames, blend(&gap), blend(&gap));
            root[f] = dance.root()[f] + off(before) * shares.begin + off(after) * shares.end;
            changed.root[f] = true;
        }
    }
    for joint in 0..j {
        for gap in Mask::runs(frames, |f| rig.is_free(mask, f, joint)) {
            let off =
                |f: Option<usize>| f.map_or(Vec3::ZERO, |f| difference(dance.pose(f)[joint], whole.pose(f)[joint]));
            let (before, after) = ends(&gap);
            let (begin, end) = (off(before), off(after));
            for f in gap.clone() {
                let shares = Shares::of(f, &gap, frames, blend(&gap), blend(&gap));
                let by = begin * shares.begin + end * shares.end;
                rotations[f * j + joint] = dance.pose(f)[joint] * exp_map::from_vector(by);
                changed.joints[f * j + joint] = true;
            }
        }
    }
    Ok((Clip::new(clip.skeleton().clone(), fps, root, rotations)?, changed))
}

/// The clip with its last frame held up to `frames` frames.
///
/// # Errors
/// None for a valid clip.
pub fn extended(clip: &Clip, frames: usize) -> Result<Clip> {
    let (Some(last), more) = (clip.frames().checked_sub(1), frames.saturating_sub(clip.frames())) else {
        return Ok(clip.clone());
    };
    let (mut root, mut rotations) = (clip.root().to_vec(), clip.rotations().to_vec());
    root.extend(std::iter::repeat_n(clip.root()[last], more));
    (0..more).for_each(|_| rotations.extend_from_slice(clip.pose(last)));
    Ok(Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)?)
}

/// `truth`, and `dance`, of as many frames, where a joint is free. The root's position goes with joint 0.
///
/// # Errors
/// None for clips of one skeleton.
pub(crate) fn merge(truth: &Clip, dance: &Clip, is_free: impl Fn(usize, usize) -> bool) -> Result<Clip> {
    let (mut root, mut rotations) = (truth.root().to_vec(), truth.rotations().to_vec());
    let j = truth.joints();
    for (f, joint) in (0..truth.frames()).flat_map(|f| (0..j).map(move |joint| (f, joint))) {
        if is_free(f, joint) {
            rotations[f * j + joint] = dance.pose(f)[joint];
            if joint == 0 {
                root[f] = dance.root()[f];
            }
        }
    }
    Ok(Clip::new(truth.skeleton().clone(), truth.fps(), root, rotations)?)
}
