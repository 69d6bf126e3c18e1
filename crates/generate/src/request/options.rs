//! The choices of a request.

use kinelm_motion::Clip;
use kinelm_motion::rotation::heading;
use serde::{Deserialize, Serialize};

/// Length of a dance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Length {
    /// In frames at the model's rate.
    Frames(usize),
    /// In seconds.
    Seconds(f64),
}

/// The lead-in of an unprompted dance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum LeadInKind {
    /// A second of a train clip, chosen by seed and labels
    Train,
    /// A second that the model samples too
    None,
}

/// Inputs of a dance's random streams.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Seeding {
    /// The seed alone: dances of one seed share their random numbers whatever they are given, so that what an input
    /// changes can be compared.
    Seed,
    /// The seed, the bytes of prompt and music, and the labels. Without any of these as [`Seeding::Seed`].
    Inputs,
}

/// The rig that a dance is written on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Rig {
    /// SMPL-24
    Model,
    /// The prompt's own
    Prompt,
}

/// Foot locking of a dance after decoding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum FootMode {
    /// Nothing
    #[default]
    Off,
    /// The body is moved to its floor, and feet in contact are locked in place
    Lock,
}

/// Motion of the joints that the tokenizer doesn't code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum UncodedJoints {
    /// They stay in the rest pose.
    Identity,
    /// They move as in the prompt and hold its last frame after its end.
    Prompt,
    /// They hold their mean rotation over the prompt.
    Mean,
    /// They hold their mean rotation over the training clips, which the tokenizer stores.
    Training,
    /// They move as in the prompt while frames of it are given, then ease to their mean within half a second. On the
    /// prompt's own rig so do the joints that SMPL doesn't have.
    Follow,
}

/// Position and heading of a prompt's first frame, on the model's body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Placement {
    /// World x of the pelvis, metres.
    pub x: f64,
    /// World z of the pelvis, metres.
    pub z: f64,
    /// Heading of the pelvis in radians, as [`heading`]; `None` where the pelvis points straight up or down.
    pub heading: Option<f64>,
}

impl Placement {
    /// The placement of a clip's first frame; `None` without frames.
    pub fn of(clip: &Clip) -> Option<Placement> {
        let at = clip.root().first()?;
        Some(Placement { x: at.x, z: at.z, heading: heading(clip.pose(0)[0]) })
    }
}
