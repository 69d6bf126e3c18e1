//! What is done to the feet of a dance.

use serde::{Deserialize, Serialize};

/// What is done to the feet of a dance when it is decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum FootMode {
    /// Nothing
    #[default]
    Off,
    /// The body is settled on its floor, and feet in contact are locked in place
    Lock,
}

impl FootMode {
    /// Whether it is what files don't name.
    pub fn is_off(&self) -> bool {
        *self == FootMode::Off
    }
}
