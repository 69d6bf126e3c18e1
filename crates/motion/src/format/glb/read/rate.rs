//! The frames of an animation: those of its keys, else of a rate at which it is sampled.

use super::{FPS, Take};
use crate::Warning;
use crate::format::{ReadOptions, keys};

/// How an animation becomes frames.
pub(super) struct Frames {
    /// Frames per second of the animation's own time.
    pub step_fps: f64,
    /// Frames per second of the clip.
    pub fps: f64,
    /// The number of frames.
    pub count: f64,
}

impl Frames {
    /// The frames of a take: one at each key where keys are even, at their rate or the one that replaces it; where they
    /// are not, samples at the rate that is given, since their seconds are all that the file states of them.
    pub fn of(take: &Take, options: &ReadOptions, warnings: &mut Vec<Warning>) -> Frames {
        let times = keys::times(take.tracks.values().flatten().flatten().map(|track| &track.times));
        let (step_fps, fps) = match (keys::rate(times), options.fps_source) {
            (Some(keys), given) => (keys, given.unwrap_or(keys)),
            (None, Some(given)) => (given, given),
            (None, None) => {
                let what =
                    format!("keys at no even rate: sampled at {FPS} frames per second; `fps_source` gives another");
                warnings.push(Warning { kind: "rate_assumed", what });
                (FPS, FPS)
            }
        };
        Frames { step_fps, fps, count: (take.length() * step_fps).round() + 1.0 }
    }
}
