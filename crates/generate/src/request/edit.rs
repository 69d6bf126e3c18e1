//! What is kept of a prompt and what is invented.

use super::span::Span;
use serde::{Deserialize, Serialize};

/// What is kept of a prompt and what is invented.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Edit {
    /// These joints at these times are given; none: all are, but the free ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub given: Vec<Span>,
    /// These are free, even where they are given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub free: Vec<Span>,
    /// What differs where free frames meet given ones fades over so many seconds.
    pub blend_s: f64,
    /// Ways that are drawn, of which the one is kept that ends nearest to where the clip goes on.
    pub tries: usize,
    /// The end is invented so that it goes over into the beginning, instead of all that is given and free.
    #[serde(default, rename = "loop", skip_serializing_if = "Option::is_none")]
    pub round: Option<Round>,
}

/// What comes back to its beginning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Comes {
    /// Pose, place and heading
    Back,
    /// The pose: place and heading go on from where the clip has come to
    Pose,
}

/// How a clip goes round.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Round {
    /// What comes back.
    pub comes: Comes,
    /// Seconds at the end that are invented.
    pub over_s: f64,
}
