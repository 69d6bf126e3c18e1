//! Which part of a clip stays, and which is generated.

use super::span::Span;
use serde::{Deserialize, Serialize};

/// Which part of a clip stays, and which is generated.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Edit {
    /// Joints and times that are given. Empty: everything is given but `free`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub given: Vec<Span>,
    /// Joints and times that are generated, even where `given` names them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub free: Vec<Span>,
    /// Seconds over which the difference between generated and given frames fades, on the generated side. `None`:
    /// [`Edit::BLEND_S`].
    pub blend_s: Option<f64>,
    /// Ways through the gaps that are sampled; the one that ends nearest to where the clip continues is chosen.
    /// `None`: [`Edit::TRIES`].
    pub tries: Option<usize>,
    /// The end is generated so that it leads into the beginning, instead of `given` and `free`.
    #[serde(default, rename = "loop", skip_serializing_if = "Option::is_none")]
    pub looping: Option<Loop>,
}

impl Edit {
    /// [`Edit::blend_s`] where it is left open.
    pub const BLEND_S: f64 = 0.2;
    /// [`Edit::tries`] where it is left open.
    pub const TRIES: u8 = 8;

    /// Everything is given but these joints and times.
    pub fn of(free: Vec<Span>) -> Edit {
        Edit { free, ..Edit::default() }
    }
}

/// The parts that return to the beginning at the end of a loop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum LoopKind {
    /// Pose, position and heading
    #[default]
    Back,
    /// The pose; position and heading continue from where the clip ends
    Pose,
}

/// A clip that can be played over and over.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Loop {
    /// The parts that return to the beginning.
    pub kind: LoopKind,
    /// Seconds at the end that are generated. `None`: [`Loop::OVER_S`].
    pub over_s: Option<f64>,
}

impl Loop {
    /// [`Loop::over_s`] where it is left open.
    pub const OVER_S: f64 = 2.0;
}
