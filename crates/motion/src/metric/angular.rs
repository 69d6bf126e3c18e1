//! How fast joints rotate.

use crate::rotation::{angle_between, exp_map};
use crate::{Clip, Quat, Vec3};

/// (T - 1) sums over the joints of their angular speeds, each times its weight (J), of frames (T, J) of unit quaternions at
/// `fps`, rad/s: the dissertation's form of Laban's weight effort.
pub fn angular_effort(frames: &[Quat], weights: &[f64], fps: f64) -> Vec<f64> {
    let j = weights.len();
    let steps = frames.chunks_exact(j).zip(frames.chunks_exact(j).skip(1));
    steps.map(|(a, b)| (0..j).map(|i| weights[i] * fps * angle_between(a[i], b[i])).sum()).collect()
}

/// Lengths of a joint's angular velocity (F - 1), rad/s, of its change (F - 2), rad/s², and of the change of that (F - 3),
/// rad/s³: differences of neighbours, in the frame of its parent.
///
/// # Panics
/// If the clip lacks the joint.
pub fn angular_motion(clip: &Clip, joint: usize) -> [Vec<f64>; 3] {
    let fps = clip.fps();
    let velocity = |f: usize| exp_map::to_vector(clip.pose(f)[joint] * clip.pose(f - 1)[joint].conjugate()) * fps;
    let velocity: Vec<Vec3> = (1..clip.frames()).map(velocity).collect();
    let change = |of: &[Vec3]| of.windows(2).map(|pair| (pair[1] - pair[0]) * fps).collect::<Vec<Vec3>>();
    let acceleration = change(&velocity);
    let jerk = change(&acceleration);
    [velocity, acceleration, jerk].map(|vectors| vectors.iter().map(|v| v.length()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Skeleton;
    use std::sync::Arc;

    #[test]
    fn by_hand() {
        let body = Skeleton::new(vec!["a".into()], vec![None], vec![Vec3::ZERO], vec![]).unwrap();
        // an angle of t^3: 6 rad/s^3; of either sign of the quaternion
        let turned =
            |f: usize| Quat::from_rotation_z((f as f64 / 10.0).powi(3)) * if f.is_multiple_of(2) { 1.0 } else { -1.0 };
        let clip = Clip::new(Arc::new(body), 10.0, vec![Vec3::ZERO; 8], (0..8).map(turned).collect()).unwrap();
        let [velocity, acceleration, jerk] = angular_motion(&clip, 0);
        assert!(velocity.iter().zip([0.01, 0.07, 0.19, 0.37, 0.61, 0.91, 1.27]).all(|(a, b)| (a - b).abs() < 1e-9));
        assert!(acceleration.iter().zip([0.6, 1.2, 1.8, 2.4, 3.0, 3.6]).all(|(a, b)| (a - b).abs() < 1e-8));
        assert!(jerk.len() == 5 && jerk.iter().all(|x| (x - 6.0).abs() < 1e-6), "{jerk:?}");
        assert!(
            angular_motion(&clip.slice(0..0), 0)[0].is_empty() && angular_motion(&clip.slice(0..1), 0)[0].is_empty()
        );
        assert_eq!(angular_effort(&[Quat::IDENTITY; 4], &[1.0, 1.0], 30.0), [0.0]);
    }
}
