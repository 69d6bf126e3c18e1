//! The settings of a tokenizer.

use crate::scheme::SchemeConfig;
use crate::{Channels, Error, Result, RootRotation};
use kinelm_motion::joints::EIGHTEEN;
use kinelm_motion::resample::MOST_FPS;
use serde::{Deserialize, Serialize};

/// The settings of a tokenizer: which joints it encodes, at which rate, and how.
///
/// ```
/// use kinelm_tokenizer::TokenizerConfig;
///
/// let config: TokenizerConfig = serde_json::from_str(r#"{"joints": [0, 4, 5], "fps": 30}"#)?;
/// assert_eq!((config.fps, config.merges, config.validate().is_ok()), (30.0, 0, true));
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TokenizerConfig {
    /// The coded joints, SMPL ids ascending. Default: the eighteen of [`EIGHTEEN`].
    pub joints: Vec<usize>,
    /// Frames per second of every clip. Default 20.
    pub fps: f64,
    /// How the pelvis's rotation is coded. Default: its turn as steps, and its tilt.
    pub root_rotation: RootRotation,
    /// Byte-pair merges, fitted to the training words, 0 to 40000. Default 0: a token is a character.
    pub merges: u32,
    /// How numbers become codes. Default: uniform bins.
    pub scheme: SchemeConfig,
}

/// The most merged tokens: with the alphabet's 21,054 characters and the labels, ids fit 16 bits.
const MOST_MERGES: u32 = 40_000;

impl Default for TokenizerConfig {
    fn default() -> Self {
        TokenizerConfig {
            joints: EIGHTEEN.to_vec(),
            fps: 20.0,
            root_rotation: RootRotation::default(),
            merges: 0,
            scheme: SchemeConfig::default(),
        }
    }
}

impl TokenizerConfig {
    /// Uniform, centred bins for joints, in any order, at a rate; other settings by default.
    pub fn uniform(joints: &[usize], fps: f64, bins: u32) -> Self {
        let mut joints = joints.to_vec();
        joints.sort_unstable();
        joints.dedup();
        let uniform = crate::UniformConfig { bins, ..Default::default() };
        TokenizerConfig { joints, fps, scheme: SchemeConfig::Uniform(uniform), ..Default::default() }
    }

    /// The channels of a frame.
    pub fn channels(&self) -> Channels {
        Channels::new(self.joints.clone(), self.root_rotation)
    }

    /// Whether heights are coded above the clip's floor, which must then be at y = 0.
    pub fn above_floor(&self) -> bool {
        self.scheme.height() == crate::Height::Floor
    }

    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the setting, its value and its limits.
    pub fn validate(&self) -> Result<()> {
        let ascending = self.joints.windows(2).all(|w| w[0] < w[1]);
        if self.joints.is_empty() || !ascending || self.joints.iter().any(|&j| j >= 24) {
            return Err(Error::setting(
                "joints",
                format!("{:?}", self.joints),
                "SMPL joint ids 0 to 23, ascending, each once, at least one",
            ));
        }
        if !(self.fps.is_finite() && self.fps > 0.0 && self.fps <= MOST_FPS) {
            return Err(Error::setting("fps", self.fps, format!("above 0, at most {MOST_FPS} frames per second")));
        }
        if self.merges > MOST_MERGES {
            return Err(Error::setting("merges", self.merges, format!("0 to {MOST_MERGES}")));
        }
        self.scheme.validate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid_and_nonsense_is_not() {
        TokenizerConfig::default().validate().unwrap();
        let bad = |f: fn(&mut TokenizerConfig)| {
            let mut c = TokenizerConfig::default();
            f(&mut c);
            c.validate().unwrap_err().to_string()
        };
        assert!(bad(|c| c.joints.clear()).contains("joints"));
        assert!(bad(|c| c.joints = vec![1, 0]).contains("ascending"));
        assert!(bad(|c| c.joints = vec![3, 3]).contains("each once"));
        assert!(bad(|c| c.joints = vec![24]).contains("24"));
        assert!(bad(|c| c.fps = f64::NAN).contains("fps"));
        assert!(bad(|c| c.fps = 0.0).contains("fps"));
        assert!(bad(|c| c.merges = 50_000).contains("merges"));
        assert!(bad(|c| c.scheme = TokenizerConfig::uniform(&[0], 20.0, 1).scheme).contains("bins"));
        assert!(bad(|c| c.scheme = TokenizerConfig::uniform(&[0], 20.0, 30_000).scheme).contains("21054"));
    }

    #[test]
    fn settings_are_read_strictly() {
        let json = r#"{"joints":[0,4],"scheme":{"type":"uniform","bins":60}}"#;
        let c: TokenizerConfig = serde_json::from_str(json).unwrap();
        assert_eq!(c, TokenizerConfig::uniform(&[4, 0], 20.0, 60));
        assert!(serde_json::from_str::<TokenizerConfig>(r#"{"joint":[0]}"#).is_err());
        assert!(serde_json::from_str::<TokenizerConfig>(r#"{"scheme":{"type":"uniform","bin":60}}"#).is_err());
        assert!(serde_json::from_str::<TokenizerConfig>(r#"{"scheme":{"type":"magic"}}"#).is_err());
    }
}
