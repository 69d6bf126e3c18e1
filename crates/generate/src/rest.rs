//! What the joints that the model doesn't know do in a new dance.

use crate::Result;
use kinelm_motion::rotation::{nearest_sign, slerp};
use kinelm_motion::{Clip, Quat};
use serde::{Deserialize, Serialize};

/// What the joints that the model doesn't know do in a new dance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum RestJoints {
    /// They stand at rest.
    #[default]
    Identity,
    /// They move as in the prompt; where it has ended, they hold its last frame.
    Prompt,
    /// They hold their mean over the prompt.
    Mean,
    /// They hold the mean of the training clips, which the tokenizer keeps; at rest where it is too old to.
    Training,
    /// They move as in the prompt while frames of it are followed, then go to their mean over half a second; on the
    /// prompt's own rig so do the joints that SMPL doesn't have.
    Follow,
}

/// How long the joints take to their mean, seconds.
const SETTLING_S: f64 = 0.5;

/// The first `frames` frames of a clip that has them, then its joints on their way to their mean over these frames; the last
/// frame is the mean.
///
/// # Errors
/// None that such a clip brings about.
pub fn settling(clip: &Clip, frames: usize) -> Result<Clip> {
    let kept = clip.slice(0..frames.min(clip.frames()));
    let (Some(last), way) = (kept.frames().checked_sub(1), (SETTLING_S * clip.fps()).ceil().max(1.0)) else {
        return Ok(kept);
    };
    let mean = mean_pose(&kept);
    let (mut root, mut rotations) = (kept.root().to_vec(), kept.rotations().to_vec());
    for i in 1..=way as usize {
        let t = i as f64 / way;
        // starts and ends slowly: no joint is jerked
        let t = t * t * (3.0 - 2.0 * t);
        root.push(root[last]);
        rotations.extend(kept.pose(last).iter().zip(&mean).map(|(&from, &to)| slerp(from, to, t)));
    }
    Ok(Clip::new(kept.skeleton().clone(), kept.fps(), root, rotations)?)
}

/// (J) the mean of every joint's rotation over a clip that has frames, the signs made one.
pub fn mean_pose(clip: &Clip) -> Vec<Quat> {
    let mean = |j: usize| {
        let first = clip.pose(0)[j];
        let zero = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        let near = |f: usize| nearest_sign(clip.pose(f)[j], first);
        let sum = (0..clip.frames()).fold(zero, |sum, f| sum + near(f));
        if sum.length_squared() > 1e-12 { sum.normalize() } else { first }
    };
    (0..clip.joints()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::rotation::angle_between;
    use kinelm_motion::{smpl, synth};

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
        let settled = settling(&clip, 30).unwrap();
        assert_eq!((settled.frames(), &settled.rotations()[..30 * 24]), (40, &clip.rotations()[..30 * 24]));
        let mean = mean_pose(&clip.slice(0..30));
        for (j, mean) in mean.into_iter().enumerate() {
            assert!(angle_between(settled.pose(39)[j], mean) < 1e-9);
            let whole = angle_between(clip.pose(29)[j], mean);
            let steps = (29..39).map(|f| angle_between(settled.pose(f)[j], settled.pose(f + 1)[j]));
            assert!(steps.clone().all(|step| step <= 0.16 * whole + 1e-9), "{j}: {:?}", steps.collect::<Vec<_>>());
        }
        assert_eq!(settling(&clip, 999).unwrap().frames(), clip.frames() + 10);
        assert_eq!(settling(&clip.slice(0..0), 3).unwrap().frames(), 0);
    }
}
