//! The windows of a clip.

use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// The longest window, frames: 68 seconds at 60 frames per second.
pub const MAX_FRAMES: usize = 4096;
/// A window has no fewer frames.
pub const MIN_FRAMES: usize = 16;

/// How series are cut into windows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindowSpec {
    /// N, frames of a window, 16 to 4,096. Default 128: 2.133 seconds, the thesis's.
    pub frames: usize,
    /// Frames from a window's start to the next one's, at least 1. Default 64.
    pub hop: usize,
    /// Frames per second. Default 60.
    pub fps: f64,
}

impl Default for WindowSpec {
    fn default() -> Self {
        WindowSpec { frames: 128, hop: 64, fps: 60.0 }
    }
}

impl WindowSpec {
    /// Holds the numbers to their limits.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] with the number that is out of its limits.
    pub fn validate(&self) -> Result<()> {
        let WindowSpec { frames, hop, fps } = *self;
        if !(MIN_FRAMES..=MAX_FRAMES).contains(&frames) {
            return Err(Error::invalid_parameter("window", frames, format!("{MIN_FRAMES} to {MAX_FRAMES} frames")));
        }
        if hop == 0 {
            return Err(Error::invalid_parameter("hop", hop, "at least 1 frame"));
        }
        if !(fps.is_finite() && fps > 0.0) {
            return Err(Error::invalid_parameter("fps", fps, "a positive number"));
        }
        Ok(())
    }

    /// The starts of the windows that are wholly in a clip of `frames` frames, from frame `phase` on.
    pub fn starts(&self, frames: usize, phase: usize) -> impl Iterator<Item = usize> + use<> {
        // `None`: a clip shorter than a window has none
        let last = frames.checked_sub(self.frames);
        last.into_iter().flat_map(move |last| phase..=last).step_by(self.hop)
    }

    /// The length of a window.
    pub fn seconds(&self) -> f64 {
        self.frames as f64 / self.fps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_lie_inside() {
        let spec = WindowSpec::default();
        let starts = |frames, phase| spec.starts(frames, phase).collect::<Vec<_>>();
        assert!(starts(127, 0).is_empty() && starts(128, 1).is_empty());
        assert_eq!(starts(128, 0), [0]);
        assert_eq!(starts(256, 0), [0, 64, 128]);
        assert_eq!(starts(256, 32), [32, 96]);
        assert!((spec.seconds() - 2.133).abs() < 1e-3);
    }

    #[test]
    fn limits() {
        let spec = WindowSpec::default();
        assert!(spec.validate().is_ok());
        let error = |spec: WindowSpec| spec.validate().unwrap_err().to_string();
        assert!(error(WindowSpec { frames: 15, ..spec }).contains("expected 16 to 4096"));
        assert!(error(WindowSpec { hop: 0, ..spec }).contains("at least 1"));
        assert!(error(WindowSpec { fps: f64::NAN, ..spec }).contains("positive"));
    }
}
