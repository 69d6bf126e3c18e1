//! Jitter of a motion.

use crate::Clip;

/// Mean jerk of the joints: `|p(t+3) - 3 p(t+2) + 3 p(t+1) - p(t)| fps^3` over all joints and frames, m/s^3; `None` for
/// fewer than four frames.
///
/// It grows with the rate, so only clips of one rate are comparable. See docs/measures.md, "Floor and feet".
pub fn jitter(clip: &Clip) -> Option<f64> {
    jitter_of(clip, &(0..clip.joints()).collect::<Vec<_>>())
}

/// [`jitter`] of these joints only; also `None` without joints.
///
/// # Panics
/// If the clip lacks one of the joints.
pub fn jitter_of(clip: &Clip, joints: &[usize]) -> Option<f64> {
    let (positions, j) = (clip.positions(), clip.joints());
    let last = clip.frames().checked_sub(3).filter(|n| *n > 0 && !joints.is_empty())?;
    let third = |i: usize| positions[i + 3 * j] - positions[i + 2 * j] * 3.0 + positions[i + j] * 3.0 - positions[i];
    let sum: f64 =
        (0..last).flat_map(|f| joints.iter().map(move |joint| f * j + joint)).map(|i| third(i).length()).sum();
    Some(sum / (last * joints.len()) as f64 * clip.fps().powi(3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Quat, Skeleton, Vec3};
    use std::sync::Arc;

    fn path(frames: usize, at: impl Fn(f64) -> f64) -> Clip {
        let body = Skeleton::new(vec!["a".into()], vec![None], vec![Vec3::ZERO], vec![]).unwrap();
        let root = (0..frames).map(|f| Vec3::new(0.0, at(f as f64 / 30.0), 0.0)).collect();
        Clip::new(Arc::new(body), 30.0, root, vec![Quat::IDENTITY; frames]).unwrap()
    }

    #[test]
    fn by_hand() {
        // the third derivative of t^3 is 6, and the difference is exact
        assert!((jitter(&path(40, |t| t * t * t)).unwrap() - 6.0).abs() < 1e-6);
        assert!(jitter(&path(40, |t| 2.0 + t - 4.9 * t * t)).unwrap() < 1e-8, "a throw has no jerk");
        assert_eq!(jitter(&path(4, |_| 1.0)), Some(0.0));
        assert_eq!(jitter(&path(3, |_| 1.0)), None);
        assert_eq!(jitter(&path(0, |_| 1.0)), None);
        assert_eq!(jitter_of(&path(40, |t| t), &[]), None);
    }
}
