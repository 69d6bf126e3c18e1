//! The frames of a dance that a segment names.

use super::fault::Fault;
use crate::request::{At, Segment};
use kinelm_motion::moment::{Moment, Timebase};
use std::ops::Range;

/// The longest timeline, seconds.
pub(super) const LONGEST_S: f64 = 3600.0;

/// The frames of the dance over which a segment, the `n`-th from 0, holds.
pub(super) fn times(n: usize, segment: &Segment, fps: f64) -> Result<Range<usize>, Fault> {
    let scale = Timebase { frames: (LONGEST_S * fps) as usize, fps, left_out: 0, model_fps: None };
    let counted = || "seconds or frames (40f) from the beginning of the dance".to_owned();
    let from = border(n, "from", segment.from, scale, counted())?;
    let to = border(n, "to", segment.to, scale, counted())?;
    if from >= to {
        let found = format!("from {} to {}", segment.from.0, segment.to.0);
        return Err(Fault::Segment(n, found, "an end after the beginning".into()));
    }
    Ok(from..to)
}

/// The frame of a moment that a key of a segment states, not counted from the end.
pub(super) fn border(n: usize, key: &str, at: At, scale: Timebase, expected: String) -> Result<usize, Fault> {
    let negative = matches!(at.0, Moment::Seconds(n) | Moment::Frames(n) | Moment::Model(n) if n.is_sign_negative());
    let frame = at.0.boundary(scale).filter(|_| !negative);
    frame.ok_or_else(|| Fault::Segment(n, format!("{key} = {}", at.0), expected))
}
