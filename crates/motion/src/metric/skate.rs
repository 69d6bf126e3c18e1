//! Foot skating.

use crate::rig::Feet;
use crate::{Clip, GlobalPose, Vec3};

/// A point of a foot with at most this clearance is on the floor, metres.
const LOW_M: f64 = 0.05;
/// A faster step slides, metres per second.
const FAST_M_S: f64 = 0.1;

/// Foot skating: the mean horizontal speed of ankles, balls and ends of toes near the floor. Real recordings skate too.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Skate {
    metres_per_s: f64,
    steps: u64,
    fast: u64,
}

impl Skate {
    /// Measures a clip with its floor at y = 0: all steps of [points of feet](Feet::points) with less than 5 cm clearance in
    /// both frames. Source: docs/measures.md, "Floor and feet".
    ///
    /// # Panics
    /// If the clip is not on the rig of these feet.
    pub fn of(feet: &Feet, clip: &Clip) -> Skate {
        let (mut pose, mut before) = (GlobalPose::default(), Vec::<Vec3>::new());
        let mut skate = Skate::default();
        for f in 0..clip.frames() {
            pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
            let now: Vec<Vec3> = feet.points().map(|(point, _)| pose.point(clip.skeleton(), point)).collect();
            for ((a, b), (_, rest_m)) in before.iter().zip(&now).zip(feet.points()) {
                if a.y - rest_m < LOW_M && b.y - rest_m < LOW_M {
                    let metres_per_s = (b.x - a.x).hypot(b.z - a.z) * clip.fps();
                    skate.metres_per_s += metres_per_s;
                    skate.steps += 1;
                    skate.fast += u64::from(metres_per_s > FAST_M_S);
                }
            }
            before = now;
        }
        skate
    }

    /// Adds another clip.
    pub fn add(&mut self, other: &Skate) {
        self.metres_per_s += other.metres_per_s;
        self.steps += other.steps;
        self.fast += other.fast;
    }

    /// The fraction of steps faster than 10 cm/s; `None` without contact.
    pub fn share(&self) -> Option<f64> {
        (self.steps > 0).then(|| self.fast as f64 / self.steps as f64)
    }

    /// Mean speed, cm/s; `None` without contact.
    pub fn cm_s(&self) -> Option<f64> {
        (self.steps > 0).then(|| 100.0 * self.metres_per_s / self.steps as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{Humanoid, SkeletonMap};
    use crate::{Quat, smpl};

    /// A body at rest with its pelvis at these heights above standing, moving by 3 and 4 cm per frame along x and z.
    fn gliding(heights: &[f64]) -> (Feet, Clip) {
        let feet = Humanoid::with_map(&smpl::neutral(), &SkeletonMap::builtin("smpl").unwrap()).feet().unwrap();
        let root =
            heights.iter().zip(0..).map(|(y, f)| Vec3::new(0.03, 0.0, 0.04) * f as f64 + Vec3::Y * (feet.pelvis_m + y));
        let clip = Clip::new(smpl::neutral(), 20.0, root.collect(), vec![Quat::IDENTITY; 24 * heights.len()]).unwrap();
        (feet, clip)
    }

    #[test]
    fn a_body_that_glides_skates_and_one_in_the_air_does_not() {
        let of = |heights: &[f64]| {
            let (feet, clip) = gliding(heights);
            Skate::of(&feet, &clip)
        };
        assert!((of(&[0.0; 5]).cm_s().unwrap() - 100.0).abs() < 1e-9);
        assert_eq!((of(&[0.0; 5]).share(), of(&[0.2; 5]).share()), (Some(1.0), None));
        assert_eq!(of(&[0.2; 5]).cm_s(), None);
        // the step from the air onto the floor is no contact
        let mut landing = of(&[0.2, 0.0, 0.0]);
        assert_eq!(landing.steps, 4);
        landing.add(&of(&[0.0; 2]));
        assert_eq!((landing.steps, landing.cm_s().map(|x| (x * 1e6).round() / 1e6)), (8, Some(100.0)));
        assert_eq!(of(&[]).cm_s(), None);
    }
}
