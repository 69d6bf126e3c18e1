//! The frames of a dance that a segment names.

use crate::request::{At, Segment};
use kinelm_motion::moment::{Moment, Timebase};
use std::ops::Range;

/// The longest timeline, seconds.
pub(super) const LONGEST_S: f64 = 3600.0;

/// The frames of the dance over which a segment holds; found and expected where there are none.
pub(super) fn times(segment: &Segment, fps: f64) -> Result<Range<usize>, (String, String)> {
    let scale = Timebase { frames: (LONGEST_S * fps) as usize, fps, left_out: 0, model_fps: None };
    let counted = || "seconds or frames (40f) from the beginning of the dance".to_owned();
    let (from, to) = (border("from", segment.from, scale, counted())?, border("to", segment.to, scale, counted())?);
    if from >= to {
        return Err((format!("from {} to {}", segment.from.0, segment.to.0), "an end after the beginning".into()));
    }
    Ok(from..to)
}

/// The frame of a moment that a key states, not counted from the end.
pub(super) fn border(key: &str, at: At, scale: Timebase, expected: String) -> Result<usize, (String, String)> {
    let negative = matches!(at.0, Moment::Seconds(n) | Moment::Frames(n) | Moment::Model(n) if n.is_sign_negative());
    at.0.boundary(scale).filter(|_| !negative).ok_or_else(|| (format!("{key} = {}", at.0), expected))
}
