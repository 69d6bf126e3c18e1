//! Statistics of a clip, including suspicious values.

use crate::format::rate::{RateDoubt, fall_g};
use crate::rotation::{angle_between, exp_map};
use crate::series::nearest_quantile as quantile;
use crate::series::{jumps, root_jumps};
use crate::{Clip, GlobalPose, Vec3};
use std::f64::consts::PI;

/// A rotation of a joint is a jump if it is larger than this and stands out like a jump of the root, radians.
pub(crate) const JOINT_JUMP_RAD: f64 = 25.0 * PI / 180.0;
/// Statistics of a clip.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ClipStats {
    /// Median over frames of the height from the lowest to the highest point (joints and end sites), metres.
    pub height_m: f64,
    /// Minimum and maximum of the root position, metres.
    pub root_range: [Vec3; 2],
    /// Speed of the fastest joint (99.9th percentile over frames), metres per second.
    pub speed_m_s: f64,
    /// Root jumps: frame `f` and the length in metres of the step from `f - 1`.
    pub root_jumps: Vec<(usize, f64)>,
    /// Joint jumps: frame, joint, angle in radians.
    pub joint_jumps: Vec<(usize, usize, f64)>,
    /// How often the root's canonical rotation vector changes sign because its angle passes PI.
    pub root_vector_flips: usize,
    /// The fastest fall of the root, in g: 99.8th percentile of the downward acceleration over steps of 0.05 s, without jumps.
    pub fall_g: f64,
    /// The rate at which that fall would be a free fall, if the clip's rate is doubted.
    pub fps_for_free_fall: Option<f64>,
    /// Joints that never rotate by more than 1e-6 radians.
    pub still_joints: Vec<usize>,
}

/// Computes the statistics; all zero and empty for a clip without frames.
pub(crate) fn clip_stats(clip: &Clip) -> ClipStats {
    let heights = heights(clip);
    let root_jumps = root_jumps(clip);
    let fall_g = fall_g(clip, &root_jumps);
    let doubt = RateDoubt::of_fall(fall_g, clip.fps());
    let (mut low, mut high) = (Vec3::ZERO, Vec3::ZERO);
    if let Some(&first) = clip.root().first() {
        (low, high) = clip.root().iter().fold((first, first), |(l, h), &p| (l.min(p), h.max(p)));
    }
    ClipStats {
        height_m: quantile(heights, 0.5),
        root_range: [low, high],
        // not the maximum, which one glitch would set
        speed_m_s: quantile(top_speeds(clip), 0.999),
        joint_jumps: joint_jumps(clip),
        root_vector_flips: root_vector_flips(clip),
        fps_for_free_fall: doubt.map(|doubt| doubt.free_fall_fps()),
        fall_g,
        root_jumps,
        still_joints: (0..clip.joints()).filter(|&j| still(clip, j)).collect(),
    }
}

fn heights(clip: &Clip) -> Vec<f64> {
    let mut pose = GlobalPose::default();
    (0..clip.frames())
        .map(|f| {
            pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
            let ends = pose.ends(clip.skeleton());
            let ys = pose.positions.iter().copied().chain(ends).map(|p| p.y);
            let (low, high) = ys.fold((f64::MAX, f64::MIN), |(l, h), y| (l.min(y), h.max(y)));
            high - low
        })
        .collect()
}

fn top_speeds(clip: &Clip) -> Vec<f64> {
    let (p, j) = (clip.positions(), clip.joints());
    let step = |f: usize| (0..j).map(|i| p[f * j + i].distance(p[(f - 1) * j + i])).fold(0.0, f64::max);
    (1..clip.frames()).map(|f| step(f) * clip.fps()).collect()
}

fn joint_jumps(clip: &Clip) -> Vec<(usize, usize, f64)> {
    let mut all = Vec::new();
    for j in 0..clip.joints() {
        let step = |f: usize| angle_between(clip.pose(f - 1)[j], clip.pose(f)[j]);
        let steps = (1..clip.frames()).map(step).collect();
        all.extend(jumps(steps, JOINT_JUMP_RAD).map(|(f, s)| (f, j, s)));
    }
    all.sort_by_key(|&(f, j, _)| (f, j));
    all
}

fn root_vector_flips(clip: &Clip) -> usize {
    let vectors: Vec<Vec3> = (0..clip.frames()).map(|f| exp_map::to_vector(clip.pose(f)[0])).collect();
    // canonical vectors are at most PI long: a step beyond PI is a jump to the other end of the ball
    vectors.windows(2).filter(|w| w[0].distance(w[1]) > PI).count()
}

fn still(clip: &Clip, j: usize) -> bool {
    clip.frames() > 0 && (1..clip.frames()).all(|f| angle_between(clip.pose(0)[j], clip.pose(f)[j]) < 1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::rate::tests::{falling, height};
    use crate::{Quat, smpl};

    #[test]
    fn a_wrong_rate_is_seen_in_a_fall() {
        let right = clip_stats(&falling(60.0, height));
        assert!((right.fall_g - 1.0).abs() < 0.01, "{}", right.fall_g);
        assert_eq!(right.fps_for_free_fall, None);
        let wrong = clip_stats(&falling(60.0, height).with_fps(120.0).unwrap());
        assert!((wrong.fps_for_free_fall.unwrap() - 60.0).abs() < 1.0);
    }

    #[test]
    fn jumps_and_flips_are_named() {
        let clip = falling(60.0, |t| if t < 1.0 { 1.0 } else { 1.2 });
        let f = clip_stats(&clip);
        assert_eq!(f.root_jumps.len(), 1);
        assert_eq!(f.root_jumps[0].0, 60);
        assert!((f.height_m - 1.64).abs() < 0.2, "{}", f.height_m);
        assert_eq!(f.still_joints.len(), 24);
        let turn = |f: usize| Quat::from_rotation_y(PI - 0.05 + 0.01 * f as f64);
        let rotations =
            (0..10).flat_map(|f| (0..24).map(move |j| if j == 0 { turn(f) } else { Quat::IDENTITY })).collect();
        let spinning = Clip::new(smpl::neutral(), 60.0, vec![Vec3::Y; 10], rotations).unwrap();
        assert_eq!(clip_stats(&spinning).root_vector_flips, 1);
    }

    #[test]
    fn a_clip_without_frames_has_no_figures() {
        let f = clip_stats(&Clip::new(smpl::neutral(), 60.0, vec![], vec![]).unwrap());
        assert_eq!((f.height_m, f.speed_m_s, f.fall_g), (0.0, 0.0, 0.0));
        assert!(f.still_joints.is_empty());
    }
}
