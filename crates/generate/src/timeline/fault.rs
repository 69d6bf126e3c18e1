//! Faults of a timeline.

use crate::Error;

/// A fault of a timeline, and where it is.
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
