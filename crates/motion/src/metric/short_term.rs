//! Metrics of short-term motion prediction, as in published tables.

use super::{check_joints, check_pair};
use crate::rotation::angle_between;
use crate::{Clip, Error, GlobalPose, Quat, Result, Skeleton, Vec3, smpl};
use glam::DMat3;
use std::f64::consts::{PI, TAU};

/// The 15 joints of the protocol, by SMPL id: without root, ankles and wrists.
pub const MAJOR: [usize; 15] = [1, 2, 3, 4, 5, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19];

/// Thresholds of the percentage of correct keypoints (PCK), in thigh lengths.
pub(crate) const RADII: [f64; 9] = [0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3];

/// The protocol's rate, frames per second, to which sums are scaled.
const PROTOCOL_FPS: f64 = 60.0;
/// Euler angles with a smaller standard deviation over all targets are ignored.
const STILL_RAD: f64 = 1e-4;

/// Predicted against true poses: Euler angles, global rotations, positions, and the area under the PCK curve.
///
/// All other joints and the root have the identity rotation in both poses, the pelvis is at 0, and bones are the neutral
/// body's in units of the left thigh. Windows are added one by one with equal weights.
///
/// Source: Aksan, Kaufmann, Hilliges, "Structured Prediction Helps 3D Human Motion Modelling" (2019);
/// docs/measures.md, "Short-term prediction".
#[derive(Debug, Clone)]
pub struct ShortTerm {
    joints: Vec<usize>,
    fps: f64,
    frames: usize,
    body: Skeleton,
    /// Per window and frame.
    angle: Vec<f64>,
    position: Vec<f64>,
    correct: Vec<[f64; 9]>,
    /// Euler angles per window, frame and component: of the target and the prediction.
    euler: [Vec<f64>; 2],
}

/// Metrics up to a prediction horizon.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct HorizonMetrics {
    /// The horizon, milliseconds.
    pub ms: u32,
    /// The number of frames up to it.
    pub frames: usize,
    /// Sum over frames of the Euclidean norm of the Euler angle differences, radians; as published, differences are not
    /// wrapped.
    pub euler: f64,
    /// The same with differences wrapped to `-PI..=PI`.
    pub euler_fixed: f64,
    /// Sum over frames of the mean geodesic distance of global rotations, radians.
    pub angle: f64,
    /// Sum over frames of the mean distance of positions, thigh lengths.
    pub position: f64,
    /// Area under the PCK curve, 0 to 1.
    pub auc: f64,
}

impl ShortTerm {
    /// Measures those of the 15 joints that are among `joints`, over `frames` target frames at `fps`. Sums are scaled to 60
    /// frames per second.
    ///
    /// # Errors
    /// [`Unsupported`](kinelm_store::Error::Unsupported) when none of the 15 is among them.
    pub fn new(joints: &[usize], fps: f64, frames: usize) -> Result<ShortTerm> {
        let joints: Vec<usize> = MAJOR.into_iter().filter(|j| joints.contains(j)).collect();
        if joints.is_empty() {
            let why = format!("none of the joints {MAJOR:?} that it is measured on is there");
            return Err(Error::unsupported("short-term prediction", why));
        }
        let neutral = smpl::neutral();
        let thigh = neutral.offsets()[4].length();
        let offsets = neutral.offsets().iter().map(|o| *o / thigh).collect();
        let body = Skeleton::new(neutral.names().to_vec(), neutral.parents().to_vec(), offsets, vec![])?;
        let (angle, position, correct, euler) = Default::default();
        Ok(ShortTerm { joints, fps, frames, body, angle, position, correct, euler })
    }

    /// The joints that are measured.
    pub fn joints(&self) -> &[usize] {
        &self.joints
    }

    /// The number of windows added.
    pub fn windows(&self) -> usize {
        self.angle.len() / self.frames.max(1)
    }

    /// Adds a window: target and predicted frames on SMPL-24.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when frames or joints differ between them or from what was announced.
    pub fn add(&mut self, target: &Clip, predicted: &Clip) -> Result<()> {
        check_pair(target, predicted)?;
        check_joints(&[23], target)?;
        if target.frames() != self.frames {
            return Err(Error::invalid("the number of target frames", target.frames(), self.frames.to_string()));
        }
        for f in 0..self.frames {
            let [a, b] = [target, predicted].map(|clip| self.masked(clip.pose(f)));
            for (angles, pose) in self.euler.iter_mut().zip([&a, &b]) {
                angles.extend(self.joints.iter().flat_map(|&j| euler(pose[j])));
            }
            let [a, b] = [a, b].map(|pose| GlobalPose::new(&self.body, Vec3::ZERO, &pose));
            let n = self.joints.len() as f64;
            let mean = |of: &dyn Fn(usize) -> f64| self.joints.iter().map(|&j| of(j)).sum::<f64>() / n;
            let distance = |j: usize| (a.positions[j] - b.positions[j]).length();
            self.angle.push(mean(&|j| angle_between(a.rotations[j], b.rotations[j])));
            self.position.push(mean(&distance));
            self.correct.push(RADII.map(|r| mean(&|j| f64::from(u8::from(distance(j) <= r)))));
        }
        Ok(())
    }

    /// A pose with the identity for joints that are not measured.
    fn masked(&self, pose: &[Quat]) -> Vec<Quat> {
        (0..pose.len()).map(|j| if self.joints.contains(&j) { pose[j] } else { Quat::IDENTITY }).collect()
    }

    /// The summed angle of each window up to a horizon, to choose the best of several predictions.
    pub fn angles(&self, ms: u32) -> Vec<f64> {
        let frames = self.frames_to(ms);
        self.angle.chunks(self.frames.max(1)).map(|window| window[..frames].iter().sum()).collect()
    }

    fn frames_to(&self, ms: u32) -> usize {
        ((f64::from(ms) / 1000.0 * self.fps).round() as usize).clamp(1, self.frames.max(1))
    }

    /// The metrics up to each of these horizons; `None` without windows.
    pub fn figures(&self, times_ms: &[u32]) -> Option<Vec<HorizonMetrics>> {
        (self.windows() > 0).then(|| times_ms.iter().map(|&ms| self.up_to(ms)).collect())
    }

    fn up_to(&self, ms: u32) -> HorizonMetrics {
        let frames = self.frames_to(ms);
        let scale = PROTOCOL_FPS / self.fps;
        let (n, each) = (self.windows() as f64, self.frames);
        let sum = |of: &[f64]| of.chunks(each).map(|window| window[..frames].iter().sum::<f64>()).sum::<f64>() / n;
        let [euler, euler_fixed] = [false, true].map(|around| sum(&self.euler_norms(around)));
        let windows = self.correct.chunks(each).flat_map(|window| &window[..frames]);
        let mut correct = [0.0; 9];
        windows.for_each(|c| correct.iter_mut().zip(c).for_each(|(sum, c)| *sum += c / (n * frames as f64)));
        // the published code narrows the thresholds for short horizons: 6 of 9 below 100 ms, and so on
        let used = match (f64::from(ms) / 1000.0 * PROTOCOL_FPS).round() as u32 {
            ..6 => 6,
            6..12 => 7,
            12..18 => 8,
            _ => 9,
        };
        let auc: f64 = (1..used).map(|i| (RADII[i] - RADII[i - 1]) * (correct[i] + correct[i - 1]) / 2.0).sum();
        HorizonMetrics {
            ms,
            frames,
            euler: scale * euler,
            euler_fixed: scale * euler_fixed,
            angle: scale * sum(&self.angle),
            position: scale * sum(&self.position),
            auc: auc / (RADII[used - 1] - RADII[0]),
        }
    }

    /// Per window and frame the norm of the Euler angle differences, over the components that move.
    fn euler_norms(&self, around: bool) -> Vec<f64> {
        let c = 3 * self.joints.len();
        let rows = (self.euler[0].len() / c) as f64;
        let moves = |i: usize| {
            let all = || self.euler[0].iter().skip(i).step_by(c);
            let mean = all().sum::<f64>() / rows;
            (all().map(|x| (x - mean) * (x - mean)).sum::<f64>() / rows).sqrt() >= STILL_RAD
        };
        let moving: Vec<bool> = (0..c).map(moves).collect();
        let norm = |(a, b): (&[f64], &[f64])| {
            let parts = a.iter().zip(b).zip(&moving).filter(|(_, moving)| **moving).map(|((a, b), _)| {
                let difference = a - b;
                if around { (difference + PI).rem_euclid(TAU) - PI } else { difference }
            });
            parts.map(|x| x * x).sum::<f64>().sqrt()
        };
        self.euler[0].chunks(c).zip(self.euler[1].chunks(c)).map(norm).collect()
    }
}

/// Euler angles e1, e2, e3 by the formulas of the published code.
fn euler(q: Quat) -> [f64; 3] {
    let m = DMat3::from_quat(q);
    // element of row i, column j
    let r = |i: usize, j: usize| m.col(j)[i];
    // clamped: rounding can take an element of a rotation matrix beyond 1, where asin is NaN
    let e2 = -r(0, 2).clamp(-1.0, 1.0).asin();
    let c = e2.cos();
    [(r(1, 2) / c).atan2(r(2, 2) / c), e2, (r(0, 1) / c).atan2(r(0, 0) / c)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::exp_map;

    /// A window as in `scripts/reference/prediction.py`.
    fn swinging(window: usize, frames: usize, error: f64, fps: f64) -> Clip {
        let mut turns = Vec::new();
        for t in (0..frames).map(|f| (50 * window + f) as f64) {
            for j in 0..24 {
                let swing = |i: f64| {
                    if j == 6 {
                        0.0
                    } else {
                        1.5 * (0.21 * t * (1.0 + 0.05 * f64::from(j)) + 1.3 * i + f64::from(j)).sin()
                    }
                };
                let part = |i: f64| swing(i) + error * (0.9 * t + 0.9 * f64::from(j) + 2.1 * i).sin();
                turns.push(exp_map::from_vector(Vec3::new(part(0.0), part(1.0), part(2.0))));
            }
        }
        let root = (0..frames).map(|f| Vec3::X * f as f64).collect();
        Clip::new(smpl::neutral(), fps, root, turns).unwrap()
    }

    /// Both programs compute in f64 in different ways; near an angle of 0 the script's arc cosine loses half the digits.
    const AS_NUMPY: f64 = 1e-8;

    #[test]
    fn as_numpy_has_it() {
        let golden: serde_json::Value =
            serde_json::from_str(include_str!("../../tests/golden/prediction.json")).unwrap();
        for case in golden["cases"].as_array().unwrap() {
            let number = |key: &str| case[key].as_f64().unwrap();
            let coded: Vec<usize> = serde_json::from_value(case["coded"].clone()).unwrap();
            let (fps, frames) = (number("fps"), number("frames") as usize);
            let mut found = ShortTerm::new(&coded, fps, frames).unwrap();
            for window in 0..number("windows") as usize {
                let clip = |error: f64| swinging(window, frames, error, fps);
                found.add(&clip(0.0), &clip(number("error"))).unwrap();
            }
            for (expected, found) in
                case["figures"].as_array().unwrap().iter().zip(found.figures(&[100, 200, 300, 400]).unwrap())
            {
                let expected: [f64; 7] = ["ms", "frames", "euler", "euler_fixed", "angle", "position", "auc"]
                    .map(|key| expected[key].as_f64().unwrap());
                let all = [
                    found.ms.into(),
                    found.frames as f64,
                    found.euler,
                    found.euler_fixed,
                    found.angle,
                    found.position,
                    found.auc,
                ];
                for (a, b) in all.iter().zip(expected) {
                    assert!((a - b).abs() <= AS_NUMPY * b.abs().max(1.0), "{all:?} {expected:?}");
                }
            }
        }
    }

    #[test]
    fn a_right_prediction_has_no_error_and_every_place_correct() {
        let mut s = ShortTerm::new(&MAJOR, 20.0, 8).unwrap();
        assert_eq!(s.figures(&[400]), None);
        let clip = swinging(0, 8, 0.0, 20.0);
        s.add(&clip, &clip).unwrap();
        let found = s.figures(&[100, 400]).unwrap()[1];
        assert!(found.euler < 1e-12 && found.angle < 1e-12 && found.position < 1e-12, "{found:?}");
        assert!((found.auc - 1.0).abs() < 1e-12 && found.frames == 8 && s.windows() == 1);
        assert!(s.add(&clip, &clip.slice(0..7)).is_err() && s.add(&clip.slice(0..7), &clip.slice(0..7)).is_err());
        assert!(ShortTerm::new(&[0, 7, 8], 20.0, 8).is_err());
    }

    #[test]
    fn a_difference_of_a_full_turn_is_none_in_the_fixed_form() {
        // joint 4 about x: 3 rad against -3 rad
        let clip = |angle: f64, other: f64| {
            let mut pose = vec![Quat::IDENTITY; 48];
            (pose[4], pose[28]) = (Quat::from_rotation_x(angle), Quat::from_rotation_x(other));
            Clip::new(smpl::neutral(), 60.0, vec![Vec3::ZERO; 2], pose).unwrap()
        };
        let mut s = ShortTerm::new(&[4], 60.0, 2).unwrap();
        s.add(&clip(3.0, 0.0), &clip(-3.0, 0.0)).unwrap();
        let found = s.figures(&[33]).unwrap()[0];
        assert!((found.euler - 6.0).abs() < 1e-12 && (found.euler_fixed - (TAU - 6.0)).abs() < 1e-12, "{found:?}");
        assert!((found.angle - (TAU - 6.0)).abs() < 1e-12 && found.position == 0.0, "the knee itself does not move");
    }
}
