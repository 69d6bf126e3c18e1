//! Whether the free joints respond to the given ones: docs/measures.md, "The prompt".
//!
//! The correlation over time of the angular speeds of the given and the free joints, less the mean of the same with the
//! given part shifted in time, is the effect. Speeds are each joint's in its parent's frame: positions in the world
//! would be bound to one another by the body itself.
//!
//! Limits: angular speeds of the same step; a response that comes later, or in direction alone, is not seen.

use kinelm_motion::Clip;
use kinelm_motion::rotation::angle_between;
use kinelm_store::random;
use rand_chacha::rand_core::RngCore;
use serde::Serialize;

/// Random shifts that estimate the correlation by chance.
const SHIFTS: usize = 200;

/// A correlation and what it would be by chance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Coordination {
    /// Of the given and the free joints' speeds.
    pub correlation: f64,
    /// Mean of the same over random circular shifts of the given joints' speeds.
    pub shifted: f64,
    /// Their difference.
    pub effect: f64,
}

/// The coordination of a dance's given and free joints; `None` where either set is empty or stands still, or the
/// dance is shorter than four frames.
///
/// # Panics
/// If the clip lacks one of the joints.
pub fn coordination(clip: &Clip, given: &[usize], free: &[usize]) -> Option<Coordination> {
    let (given, free) = (turning(clip, given)?, turning(clip, free)?);
    let correlation = pearson(given.iter().copied(), &free)?;
    let mut rng = random::stream(1, "coordination", given.len() as u64, 0);
    let mut sum = 0.0;
    for _ in 0..SHIFTS {
        // 1 to len - 1: a circular shift by 0 or by the length is none
        let by = 1 + rng.next_u64() as usize % (given.len() - 1);
        sum += pearson(given.iter().cycle().skip(by).take(given.len()).copied(), &free)?;
    }
    let shifted = sum / SHIFTS as f64;
    Some(Coordination { correlation, shifted, effect: correlation - shifted })
}

/// Mean turning of joints from frame to frame, rad a step.
fn turning(clip: &Clip, joints: &[usize]) -> Option<Vec<f64>> {
    let step = |f: usize| {
        let (a, b) = (clip.pose(f - 1), clip.pose(f));
        joints.iter().map(|&j| angle_between(a[j], b[j])).sum::<f64>() / joints.len() as f64
    };
    (!joints.is_empty() && clip.frames() >= 4).then(|| (1..clip.frames()).map(step).collect())
}

/// Pearson's correlation; `None` where one of both doesn't change.
fn pearson(a: impl Iterator<Item = f64> + Clone, b: &[f64]) -> Option<f64> {
    let n = b.len() as f64;
    let (ma, mb) = (a.clone().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in a.zip(b) {
        ab += (x - ma) * (y - mb);
        aa += (x - ma) * (x - ma);
        bb += (y - mb) * (y - mb);
    }
    // below this the sums are rounding: joints at rest
    (aa > 1e-18 && bb > 1e-18).then(|| ab / (aa * bb).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::{Quat, Vec3, smpl};

    /// Joints 4 and 18 turn by these steps.
    fn clip(steps: &[(f64, f64)]) -> Clip {
        let mut at = (0.0, 0.0);
        let mut rotations = vec![Quat::IDENTITY; 24];
        for step in steps {
            at = (at.0 + step.0, at.1 + step.1);
            let mut pose = vec![Quat::IDENTITY; 24];
            (pose[4], pose[18]) = (Quat::from_rotation_x(at.0), Quat::from_rotation_z(at.1));
            rotations.extend(pose);
        }
        Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y; steps.len() + 1], rotations).unwrap()
    }

    #[test]
    fn what_moves_together_is_coordinated() {
        let wild = |i: usize| 0.05 + 0.001 * ((i * i * 7 + 3 * i) % 31) as f64;
        let together = clip(&(0..200).map(|i| (wild(i), 2.0 * wild(i))).collect::<Vec<_>>());
        let found = coordination(&together, &[4], &[18]).unwrap();
        assert!((found.correlation - 1.0).abs() < 1e-6 && found.effect > 0.8, "{found:?}");
        assert_eq!(coordination(&together, &[4], &[18]), Some(found));
        let apart = clip(&(0..200).map(|i| (wild(i), wild(i * 37 + 11))).collect::<Vec<_>>());
        assert!(coordination(&apart, &[4], &[18]).unwrap().effect.abs() < 0.3);
        assert_eq!(coordination(&together, &[4], &[]), None);
        assert_eq!(coordination(&together, &[4], &[5]), None, "one that stands still");
        assert_eq!(coordination(&together.slice(0..3), &[4], &[18]), None);
    }
}
