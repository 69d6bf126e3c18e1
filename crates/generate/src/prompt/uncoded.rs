//! Uncoded joints: what the joints do that the tokenizer doesn't code.

use crate::Result;
use crate::request::UncodedJoints;
use kinelm_motion::rotation::{nearest_sign, slerp};
use kinelm_motion::{Clip, Quat, Vec3, smpl};
use kinelm_tokenizer::Tokenizer;
use std::ops::Range;

/// The time in which the joints reach their mean, seconds.
const SETTLING_S: f64 = 0.5;

/// What the joints do that the tokenizer doesn't code: as in this clip on SMPL-24, frame by frame, after its end as in its last
/// frame. Of the `prompt` as many frames are given as [`UncodedJoints::Follow`] follows.
pub(crate) fn rest(tokenizer: &Tokenizer, uncoded: UncodedJoints, prompt: Option<(&Clip, usize)>) -> Result<Clip> {
    let constant = |pose: Vec<Quat>| Ok(Clip::new(smpl::neutral(), tokenizer.fps(), vec![Vec3::ZERO], pose)?);
    match (uncoded, prompt) {
        (UncodedJoints::Training, _) => constant(tokenizer.mean_pose().to_vec()),
        (UncodedJoints::Prompt, Some((clip, _))) => Ok(clip.clone()),
        (UncodedJoints::Mean, Some((clip, _))) => constant(mean_pose(clip)),
        (UncodedJoints::Follow, Some((clip, given))) => settle(clip, given),
        _ => constant(vec![Quat::IDENTITY; 24]),
    }
}

/// The first `frames` frames of a clip, then its joints easing to their mean over these frames; the last frame is the mean.
///
/// # Errors
/// None for a valid clip.
pub(crate) fn settle(clip: &Clip, frames: usize) -> Result<Clip> {
    let given = clip.slice(0..frames.min(clip.frames()));
    let (Some(last), steps) = (given.frames().checked_sub(1), (SETTLING_S * clip.fps()).ceil().max(1.0)) else {
        return Ok(given);
    };
    let mean = mean_pose(&given);
    let (mut root, mut rotations) = (given.root().to_vec(), given.rotations().to_vec());
    for i in 1..=steps as usize {
        let t = i as f64 / steps;
        // a smooth step: no joint is jerked
        let t = t * t * (3.0 - 2.0 * t);
        root.push(root[last]);
        rotations.extend(given.pose(last).iter().zip(&mean).map(|(&from, &to)| slerp(from, to, t)));
    }
    Ok(Clip::new(given.skeleton().clone(), given.fps(), root, rotations)?)
}

/// Some frames of a clip of uncoded joints: at least one, which decoding holds to the end.
pub(crate) fn held(clip: &Clip, frames: Range<usize>) -> Clip {
    clip.slice(frames.start.min(clip.frames().saturating_sub(1))..clip.frames().min(frames.end))
}

/// (J) the mean rotation of every joint over a clip that has frames, signs aligned.
pub(crate) fn mean_pose(clip: &Clip) -> Vec<Quat> {
    let mean = |j: usize| {
        let first = clip.pose(0)[j];
        let zero = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        let near = |f: usize| nearest_sign(clip.pose(f)[j], first);
        let sum = (0..clip.frames()).fold(zero, |sum, f| sum + near(f));
        // rotations that cancel have no mean
        if sum.length_squared() > 1e-12 { sum.normalize() } else { first }
    };
    (0..clip.joints()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::rotation::angle_between;
    use kinelm_motion::synth;

    #[test]
    fn the_mean_of_two_turns_is_between_them() {
        let turn = |a: f64| Quat::from_rotation_y(a);
        let pose = |q: Quat| vec![q; 24];
        let rotations = [pose(turn(0.2)), pose(-turn(0.6))].concat();
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Default::default(); 2], rotations).unwrap();
        assert!(angle_between(mean_pose(&clip)[5], turn(0.4)) < 1e-9);
    }

    #[test]
    fn joints_settle_over_half_a_second_without_a_jerk() {
        let clip = synth::corpus(4, 1, 3.0, 20.0).unwrap().remove(0).clip;
        let settled = settle(&clip, 30).unwrap();
        assert_eq!((settled.frames(), &settled.rotations()[..30 * 24]), (40, &clip.rotations()[..30 * 24]));
        let mean = mean_pose(&clip.slice(0..30));
        for (j, mean) in mean.into_iter().enumerate() {
            assert!(angle_between(settled.pose(39)[j], mean) < 1e-9);
            let whole = angle_between(clip.pose(29)[j], mean);
            let steps = (29..39).map(|f| angle_between(settled.pose(f)[j], settled.pose(f + 1)[j]));
            assert!(steps.clone().all(|step| step <= 0.16 * whole + 1e-9), "{j}: {:?}", steps.collect::<Vec<_>>());
        }
        assert_eq!(settle(&clip, 999).unwrap().frames(), clip.frames() + 10);
        assert_eq!(settle(&clip.slice(0..0), 3).unwrap().frames(), 0);
    }
}
