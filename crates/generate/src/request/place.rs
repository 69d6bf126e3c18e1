//! Where the prompt of a dance stands.

use kinelm_motion::Clip;
use kinelm_motion::rotation::heading;
use serde::{Deserialize, Serialize};

/// Where and how the first frame of a prompt stands, on the model's body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Metres, world.
    pub x: f64,
    /// Metres, world.
    pub z: f64,
    /// Of the pelvis, radians, as [`heading`]; `None` where it points straight up or down.
    pub heading: Option<f64>,
}

impl Place {
    /// Of a clip's first frame; `None` without frames.
    pub fn of(clip: &Clip) -> Option<Place> {
        let at = clip.root().first()?;
        Some(Place { x: at.x, z: at.z, heading: heading(clip.pose(0)[0]) })
    }
}
