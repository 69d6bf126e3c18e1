//! Plausibility of a frame rate: nobody falls faster than gravity allows.

use super::Motion;
use super::bvh::USUAL_FPS;
use crate::series::nearest_quantile as quantile;
use crate::series::root_jumps;
use crate::{Clip, Warning};
use serde::{Deserialize, Serialize};
use std::fmt;

/// The rate is doubted if the pelvis falls with more than this, in g.
pub(crate) const FALL_LIMIT_G: f64 = 1.8;
/// The kind of the warning.
const KIND: &str = "rate_doubted";

const GRAVITY: f64 = 9.81;

/// A doubted frame rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RateDoubt {
    /// The acceleration of the body's fall at that rate, in g.
    pub fall_g: f64,
    /// The rate, frames per second.
    pub fps: f64,
}

impl RateDoubt {
    /// Checks the rate of a clip by its fastest fall.
    pub fn of(clip: &Clip) -> Option<RateDoubt> {
        RateDoubt::of_fall(fall_g(clip, &root_jumps(clip)), clip.fps())
    }

    pub(crate) fn of_fall(fall_g: f64, fps: f64) -> Option<RateDoubt> {
        (fall_g > FALL_LIMIT_G).then_some(RateDoubt { fall_g, fps })
    }

    /// The doubt that reading a motion reported, if any. A rate that was given is not doubted.
    pub fn in_reading(motion: &Motion) -> Option<RateDoubt> {
        let warned = motion.warnings.iter().any(RateDoubt::is_warning);
        warned.then(|| RateDoubt::of(&motion.clip)).flatten()
    }

    /// Whether a warning is a rate doubt.
    pub fn is_warning(warning: &Warning) -> bool {
        warning.kind == KIND
    }

    /// The rate at which the fall would be a free fall.
    pub(crate) fn free_fall_fps(&self) -> f64 {
        self.fps / self.fall_g.sqrt()
    }

    /// The highest usual rate at which it falls with at most 1 g; below all usual rates a whole number.
    pub fn likely_fps(&self) -> f64 {
        // the measured fall is accurate to a percent
        let free = 1.005 * self.free_fall_fps();
        let mut usual = USUAL_FPS.iter().map(|&fps| fps as f64).filter(|fps| *fps <= free);
        usual.next_back().unwrap_or_else(|| free.floor().max(1.0))
    }

    /// The doubt as a warning.
    pub fn warning(&self) -> Warning {
        Warning { kind: KIND, what: self.to_string() }
    }
}

impl fmt::Display for RateDoubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (g, fps, likely) = (self.fall_g, in_short(self.fps), self.likely_fps());
        let limit = FALL_LIMIT_G;
        write!(
            f,
            "the body falls at {g:.1} g (more than {limit}): {fps} fps is too fast; if it is wrong, `--fps-source {likely}` may \
             be right"
        )
    }
}

/// A rate rounded to three decimals.
fn in_short(fps: f64) -> f64 {
    (fps * 1e3).round() / 1e3
}

/// The fastest fall of the root, in g, without the frames around `jumps` ([`root_jumps`]).
///
/// It is the second difference of the root's height over steps of 0.05 s; noise of 1 mm then adds 0.1 g.
pub(crate) fn fall_g(clip: &Clip, jumps: &[(usize, f64)]) -> f64 {
    let h = (0.05 * clip.fps()).round().max(1.0) as usize;
    let seconds = h as f64 / clip.fps();
    let y = clip.root();
    let mut upcoming = jumps.iter().map(|&(at, _)| at).peekable();
    // jumps are ascending: the first one that isn't more than h frames ago decides
    let mut near_jump = |f: usize| {
        while upcoming.next_if(|at| at + h < f).is_some() {}
        upcoming.peek().is_some_and(|&at| at <= f + h)
    };
    let falls: Vec<f64> = (h..y.len().saturating_sub(h))
        .filter(|&f| !near_jump(f))
        .map(|f| -(y[f + h].y - 2.0 * y[f].y + y[f - h].y) / (seconds * seconds * GRAVITY))
        .collect();
    // not the maximum: one bad frame in 500 must not doubt a rate
    quantile(falls, 0.998).max(0.0)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::format::{self, ReadOptions};
    use crate::{Quat, Vec3, smpl};

    /// Suspended for half the time, then in free fall.
    pub(crate) fn height(t: f64) -> f64 {
        if t < 1.5 { 20.0 } else { 20.0 - 0.5 * GRAVITY * (t - 1.5) * (t - 1.5) }
    }

    pub(crate) fn falling(fps: f64, height: impl Fn(f64) -> f64) -> Clip {
        let n = 3 * fps as usize;
        let root = (0..n).map(|f| Vec3::new(0.0, height(f as f64 / fps), 0.0)).collect();
        Clip::new(smpl::neutral(), fps, root, vec![Quat::IDENTITY; n * 24]).unwrap()
    }

    #[test]
    fn the_likely_rate_is_a_usual_one() {
        let likely = |fall_g, fps| RateDoubt { fall_g, fps }.likely_fps();
        assert_eq!([likely(3.2, 120.0), likely(1.81, 120.0), likely(4.01, 240.0)], [60.0, 60.0, 120.0]);
        assert_eq!([likely(3.2, 60.0), likely(1.9, 25.0), likely(1e9, 1.0)], [30.0, 18.0, 1.0]);
    }

    #[test]
    fn reading_doubts_a_rate_that_nobody_states() {
        let clip = falling(60.0, height).with_fps(120.0).unwrap();
        let motion = Motion::new("a.bvh", clip);
        let bytes = format::bvh::to_bytes(&motion).unwrap();
        let read = |fps_source| {
            let options = ReadOptions { fps_source, ..ReadOptions::default() };
            format::parse(&motion.path, &bytes, &options).unwrap()
        };
        let doubt = RateDoubt::in_reading(&read(None)).unwrap();
        assert!((doubt.fall_g - 4.0).abs() < 0.05 && doubt.fps == 120.0, "{doubt:?}");
        for stated in [60.0, 120.0] {
            assert_eq!(RateDoubt::in_reading(&read(Some(stated))), None, "who says it is not doubted");
        }
    }
}
