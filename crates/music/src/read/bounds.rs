//! The part of the decoded samples that is the sound.

use std::ops::Range;

/// The statements of a file about its sound, in samples per channel.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct Bounds {
    /// Length of the sound, if it is stated.
    pub samples: Option<u64>,
    /// Silence before the decoded samples.
    pub silence: u64,
    /// Decoded samples that are no sound: the encoder's delay, and its padding.
    pub dropped: [Range<u64>; 2],
}

impl Bounds {
    /// Whether the decoded sample `i` is sound.
    pub fn keep(&self, i: u64) -> bool {
        !self.dropped.iter().any(|range| range.contains(&i))
    }
}
