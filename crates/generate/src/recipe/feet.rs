//! What is done to the feet of a dance.

use serde::{Deserialize, Serialize};

/// What is done to the feet of a dance when it is decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Care {
    /// Nothing. What files of dances mean that don't say.
    #[default]
    Off,
    /// The body is settled on its floor, and feet that stand are held: [`kinelm_motion::feet::lock`].
    Lock,
}

impl Care {
    /// Whether it is what files don't name.
    pub fn is_off(&self) -> bool {
        *self == Care::Off
    }
}
