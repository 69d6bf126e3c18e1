//! What is wrong with a timeline, and where; times of segments.

use crate::Error;
use crate::request::{At, Segment};
use kinelm_motion::moment::{Moment, Timebase};
use std::ops::Range;

/// The longest timeline, seconds.
pub(super) const LONGEST_S: f64 = 3600.0;

/// What is wrong with a timeline, and where.
pub(super) enum Fault {
    /// A segment, counted from 0: found, expected.
    Segment(usize, String, String),
    /// A clip, by its name.
    Clip(String, String, String),
    /// The clip that lends its rig.
    Rig(String, String),
    /// The whole.
    Timeline(String, String),
    /// A file that can't be read.
    Read(Error),
}

impl From<Error> for Fault {
    fn from(e: Error) -> Fault {
        Fault::Read(e)
    }
}

impl From<kinelm_motion::Error> for Fault {
    fn from(e: kinelm_motion::Error) -> Fault {
        Fault::Read(e.into())
    }
}

impl From<Fault> for Error {
    fn from(fault: Fault) -> Error {
        match fault {
            Fault::Segment(n, found, expected) => {
                Error::invalid(format!("segment {} of the timeline", n + 1), found, expected)
            }
            Fault::Clip(name, found, expected) => {
                Error::invalid(format!("clip {name} of the timeline"), found, expected)
            }
            Fault::Rig(found, expected) => Error::invalid("the timeline's rig", found, expected),
            Fault::Timeline(found, expected) => Error::invalid("the timeline", found, expected),
            Fault::Read(e) => e,
        }
    }
}

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
