//! Physical foot contact score (PFC): whether a body that accelerates has a foot on the ground.

use crate::resample::{Method, resample};
use crate::{Clip, Result, Vec3};

/// The rate at which it is defined, frames per second.
const FPS: f64 = 30.0;
/// The relative tolerance of a multiple of that rate.
const NEAR: f64 = 1e-6;
/// Ankle and ball of each foot, SMPL ids.
const FEET: [[usize; 2]; 2] = [[7, 10], [8, 11]];

/// PFC of clips on SMPL-24 with y up, times 10,000 as published; lower is supposed to be better.
///
/// The mean over frames of |a| / max |a| times the steps of both feet, where a is the root's acceleration without its
/// downward part, and a foot's step the smaller horizontal step of ankle and ball. Because of the division by the
/// clip's own maximum, scores of different clips are not comparable: a jump improves the rest of its clip. Source: Tseng,
/// Castellon, Liu, "EDGE: editable dance generation from music" (2023), section 4.1 and its code.
///
/// Steps a frame are multiplied, so the score falls with the square of the rate and is always taken at 30 frames per
/// second: of n times that rate, from every n-th frame, once for each of the n frames that one can begin with; of other
/// rates, from natural cubic splines ([`Method::Curve`]), since slerp has kinks, which are accelerations.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FootContact {
    /// Of each first frame the sum of the scores and their number.
    phases: Vec<(f64, usize)>,
}

impl FootContact {
    /// Measures a clip.
    ///
    /// # Errors
    /// Those of [`resample`].
    pub fn of(clip: &Clip) -> Result<FootContact> {
        let times = (clip.fps() / FPS).round();
        // film rates such as 59.94 are no multiples and go through the splines
        let is_multiple = times >= 1.0 && (clip.fps() / FPS - times).abs() <= NEAR * times;
        let curve = if is_multiple { None } else { Some(resample(clip, FPS, Method::Curve)?) };
        let clip = curve.as_ref().unwrap_or(clip);
        let step = if is_multiple { times as usize } else { 1 };
        let (positions, joints) = (clip.positions(), clip.joints());
        let phase = |first: usize| {
            let at = |frame: usize, joint: usize| positions[(first + frame * step) * joints + joint];
            score(at, (clip.frames() - first).div_ceil(step)).map_or((0.0, 0), |score| (score, 1))
        };
        Ok(FootContact { phases: (0..step.min(clip.frames())).map(phase).collect() })
    }

    /// Adds another clip, of the same rate.
    pub fn add(&mut self, other: &FootContact) {
        self.phases.resize(self.phases.len().max(other.phases.len()), (0.0, 0));
        self.phases.iter_mut().zip(&other.phases).for_each(|(a, b)| *a = (a.0 + b.0, a.1 + b.1));
    }

    /// The mean over clips and first frames; `None` of clips with fewer than three frames at 30 per second, and of roots that
    /// never accelerate.
    pub fn mean(&self) -> Option<f64> {
        let (sum, count) = self.phases.iter().fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        (count > 0).then(|| sum / count as f64)
    }

    /// The least and the greatest mean over clips that a first frame gives; `None` of rates that have one alone.
    pub fn spread(&self) -> Option<[f64; 2]> {
        let means = self.phases.iter().filter(|(_, count)| *count > 0).map(|(sum, count)| sum / *count as f64);
        let spread = means.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], mean| [a.min(mean), b.max(mean)]);
        (self.phases.len() > 1 && spread[0] <= spread[1]).then_some(spread)
    }
}

/// The definition, for `frames` frames of positions at 30 per second.
fn score(at: impl Fn(usize, usize) -> Vec3, frames: usize) -> Option<f64> {
    let frames = frames.saturating_sub(2);
    let speeding: Vec<f64> = (0..frames)
        .map(|f| {
            let a = at(f + 2, 0) - at(f + 1, 0) * 2.0 + at(f, 0);
            (a.with_y(a.y.max(0.0)) * FPS * FPS).length()
        })
        .collect();
    let most = speeding.iter().fold(0.0, |most: f64, a| most.max(*a));
    if most == 0.0 {
        return None;
    }
    let step = |f: usize, joint: usize| (at(f + 2, joint) - at(f + 1, joint)).with_y(0.0).length();
    let steps = |f: usize| FEET.iter().map(|foot| step(f, foot[0]).min(step(f, foot[1]))).product::<f64>();
    let sum: f64 = speeding.iter().enumerate().map(|(f, a)| a / most * steps(f)).sum();
    Some(1e4 * sum / frames as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::exp_map;
    use crate::{Quat, smpl};
    use serde_json::Value;

    /// Of sums and cubic splines by two programs.
    const BOUND: f64 = 1e-9;

    fn pfc(clip: &Clip) -> Option<f64> {
        FootContact::of(clip).unwrap().mean()
    }

    /// A body at rest that moves along x and y by these metres.
    fn going(path: &[(f64, f64)]) -> Clip {
        let root = path.iter().map(|&(x, y)| Vec3::new(x, y, 0.0)).collect();
        Clip::new(smpl::neutral(), FPS, root, vec![Quat::IDENTITY; 24 * path.len()]).unwrap()
    }

    /// A body that dances, by the same formulas as in the golden file's script.
    fn dancing(frames: usize, fps: f64) -> Clip {
        let (mut root, mut turns) = (Vec::new(), Vec::new());
        for f in 0..frames {
            let t = f as f64 / fps;
            root.push(Vec3::new(
                0.3 * (3.1 * t).sin(),
                0.95 + 0.05 * (7.3 * t).cos(),
                0.2 * t + 0.02 * (11.0 * t).sin(),
            ));
            for j in 0..24 {
                let j = f64::from(j);
                let part = |i: f64| {
                    0.3 * ((2.9 + 0.31 * j) * t + 1.3 * i + j).sin() + 0.05 * (17.0 * t + 0.9 * j + 2.1 * i).sin()
                };
                turns.push(exp_map::from_vector(Vec3::new(part(0.0), part(1.0), part(2.0))));
            }
        }
        Clip::new(smpl::neutral(), fps, root, turns).unwrap()
    }

    #[test]
    fn the_definition_in_numpy_gives_the_same() {
        let golden: Value = serde_json::from_str(include_str!("../../tests/golden/foot_contact.json")).unwrap();
        let number = |v: &Value| v.as_f64().unwrap();
        for case in golden["cases"].as_array().unwrap() {
            let (fps, phases) = (number(&case["fps"]), case["phases"].as_array().unwrap());
            let found = FootContact::of(&dancing(case["frames"].as_u64().unwrap() as usize, fps)).unwrap();
            assert_eq!(found.phases.len(), phases.len(), "{fps}");
            for (i, (phase, expected)) in found.phases.iter().zip(phases).enumerate() {
                let expected = number(expected);
                assert!(
                    phase.1 == 1 && (phase.0 - expected).abs() < BOUND * expected,
                    "{fps}, {i}: {phase:?} {expected}"
                );
            }
            assert!((found.mean().unwrap() - number(&case["mean"])).abs() < BOUND * number(&case["mean"]), "{fps}");
        }
    }

    #[test]
    fn a_rate_of_many_frames_says_how_far_its_first_frames_are_apart() {
        let [fast, slow] = [120.0, 20.0].map(|fps| FootContact::of(&dancing(fps as usize * 5, fps)).unwrap());
        let [least, most] = fast.spread().unwrap();
        let mean = fast.mean().unwrap();
        assert!(least < mean && mean < most && most < 1.2 * least, "{least} {mean} {most}");
        assert_eq!(slow.spread(), None);
        // a mean over clips
        let mut both = fast.clone();
        both.add(&FootContact::of(&dancing(300, 120.0)).unwrap());
        let other = pfc(&dancing(300, 120.0)).unwrap();
        assert!((both.mean().unwrap() - (mean + other) / 2.0).abs() < 1e-12);
        let mut none = FootContact::default();
        none.add(&fast);
        assert_eq!(none, fast);
        assert_eq!((FootContact::default().mean(), FootContact::default().spread()), (None, None));
    }

    #[test]
    fn few_frames_have_no_score() {
        for fps in [20.0, 30.0, 120.0, 9e9] {
            for frames in [0, 1, 2] {
                assert_eq!(
                    FootContact::of(&dancing(frames, fps)).map_or(None, |found| found.mean()),
                    None,
                    "{fps} {frames}"
                );
            }
        }
        // of 9 frames at 120 the first one alone begins three at 30
        assert_eq!(FootContact::of(&dancing(9, 120.0)).unwrap().phases.iter().map(|p| p.1).sum::<usize>(), 1);
    }

    #[test]
    fn a_statue_that_is_pushed_slides_and_one_that_is_lifted_does_not() {
        // it accelerates by 2 cm per frame: steps of 2, 4, 6 cm after the first
        let pushed = going(&[(0.0, 0.0), (0.0, 0.0), (0.02, 0.0), (0.06, 0.0), (0.12, 0.0)]);
        let found = pfc(&pushed).unwrap();
        assert!((found - 1e4 * (0.02f64.powi(2) + 0.04f64.powi(2) + 0.06f64.powi(2)) / 3.0).abs() < 1e-9, "{found}");
        let lifted = going(&[(0.0, 0.0), (0.0, 0.0), (0.0, 0.02), (0.0, 0.06)]);
        assert_eq!(pfc(&lifted), Some(0.0));
        // falling and a constant speed are no acceleration
        assert_eq!(pfc(&going(&[(0.0, 0.0), (0.0, -0.1), (0.0, -0.3)])), None);
        assert_eq!(pfc(&going(&[(0.0, 0.0), (0.5, 0.0)])), None);
    }

    #[test]
    fn the_quieter_part_of_a_foot_counts() {
        // feet rotate about their ankles while the body moves: the ball's step differs from the ankle's
        let mut clip = going(&[(0.0, 0.0), (0.0, 0.0), (0.02, 0.0), (0.06, 0.0)]);
        let whole = pfc(&clip).unwrap();
        let mut rotations = clip.rotations().to_vec();
        [7, 8].iter().for_each(|foot| rotations[3 * 24 + foot] = Quat::from_rotation_y(0.3));
        clip = Clip::new(clip.skeleton().clone(), FPS, clip.root().to_vec(), rotations).unwrap();
        assert!(pfc(&clip).unwrap() <= whole);
    }
}
