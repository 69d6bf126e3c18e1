//! Settings of the tiles.

use crate::channel::Channels;
use crate::scheme::mix::JointTransform;
use crate::scheme::runs::Runs;
use crate::scheme::series::{self, Anchor};
use crate::scheme::walk::{Height, one_of};
use crate::{Error, Result, alphabet};
use serde::{Deserialize, Serialize};

/// How kept coefficients become codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantizer {
    /// Bins of one width.
    Uniform,
    /// Bins with equal numbers of training coefficients.
    #[default]
    Quantile,
}

/// Weights of the joints' rotation vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Steps {
    /// 1 for every joint.
    #[default]
    Equal,
    /// The joint's lever arm in metres: bins are narrower for joints that move more of the body, and a joint
    /// transform works on displacements instead of angles.
    LeverArm,
}

/// Settings of the tiles of a discrete cosine transform.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DctConfig {
    /// L, frames of a tile, 15 to 120. Default 60.
    pub tile: u32,
    /// The transform over the joints. Default PCA to 24 components.
    pub joint_transform: JointTransform,
    /// The share of coefficients that is kept, above 0, at most 1. Default 0.1. It applies separately to the components, the path
    /// and the turn, with at least one coefficient each.
    pub keep: f64,
    /// Bins, from 2; with `longest_run` at most 21054, the size of the alphabet. Default 360.
    pub bins: u32,
    /// How kept coefficients become codes. Default quantile. Bins are fitted to the kept coefficients of training tiles: one set
    /// for all components, one for the path, one for the turn.
    pub quantizer: Quantizer,
    /// Weights of the joints' rotation vectors. Default equal.
    pub steps: Steps,
    /// Width of the uniform bins, 1e-6 to 10: radians, with lever arms metres; for the path metres. Coefficients beyond the bins
    /// are clipped. Default none: the bins span the training coefficients.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// The longest run of zeros of one character, from 1. Default 256.
    pub longest_run: u32,
    /// How the height is coded: above the clip's floor (default) or relative to the end of the previous tile.
    pub height: Height,
}

impl Default for DctConfig {
    fn default() -> Self {
        DctConfig {
            tile: 60,
            joint_transform: JointTransform::Pca { components: 24 },
            keep: 0.1,
            bins: 360,
            quantizer: Quantizer::Quantile,
            steps: Steps::Equal,
            step: None,
            longest_run: 256,
            height: Height::Floor,
        }
    }
}

/// The longest tile.
pub(super) const LONGEST: usize = 120;

impl DctConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the setting, its value and its limits.
    pub fn validate(&self) -> Result<()> {
        let refuse = |field, found: String, expected: String| Err(Error::setting(field, found, expected));
        if !(15..=LONGEST as u32).contains(&self.tile) {
            return refuse("tile", self.tile.to_string(), format!("15 to {LONGEST} frames"));
        }
        if !(self.keep > 0.0 && self.keep <= 1.0) {
            return refuse("keep", self.keep.to_string(), "a share above 0, at most 1".into());
        }
        let size = alphabet::SIZE;
        if self.bins < 2 || self.longest_run < 1 || self.bins.saturating_add(self.longest_run) > size {
            let found = format!("{} bins and runs of {}", self.bins, self.longest_run);
            return refuse("bins", found, format!("from 2 bins and runs of 1, together at most {size}"));
        }
        match (self.step, self.quantizer) {
            (Some(step), Quantizer::Uniform) if !(1e-6..=10.0).contains(&step) => {
                return refuse("step", step.to_string(), "1e-6 to 10".into());
            }
            (Some(step), Quantizer::Quantile) => {
                return refuse(
                    "step",
                    step.to_string(),
                    "none with quantizer = \"quantile\", which fits its bins".into(),
                );
            }
            _ => {}
        }
        one_of(self.height, &[Height::Floor, Height::Velocity])?;
        self.joint_transform.validate()
    }

    pub(super) fn anchor(&self, height: f64) -> Anchor {
        match self.height {
            Height::Velocity => Anchor::new(height),
            _ => Anchor::above_floor(height),
        }
    }

    pub(super) fn runs(&self) -> Runs {
        Runs::new(self.bins, self.longest_run)
    }

    /// The weight of each open series.
    pub(super) fn weights(&self, channels: &Channels) -> Option<Vec<f64>> {
        let arms = series::lever_arms();
        let of = |joints: Vec<usize>| joints.into_iter().map(|j| arms[j]).collect();
        (self.steps == Steps::LeverArm).then(|| of(series::open_joints(channels)))
    }

    /// The weight of the turn.
    pub(super) fn turn_weight(&self) -> f64 {
        if self.steps == Steps::LeverArm { series::lever_arms()[0] } else { 1.0 }
    }
}
