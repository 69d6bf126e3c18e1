//! Uniform bins: angles over a full turn, the root's translation as closed-loop steps or as positions.

use super::angle::{Angles, Form};
use super::frame::{Coded, Each, Numbers, Poses, Vectors, each_step};
use super::frame_bins::FrameBins;
use super::line::Line;
use super::mix::{JointTransform, Mix};
use super::mixed::{self, Mixed};
pub use super::walk::{Height, Travel};
use super::walk::{Walk, check_bins, check_height};
use crate::channel::Channels;
use crate::{Error, Result};
use kinelm_motion::rotation::Axis;
use kinelm_motion::{Clip, Quat, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Uniform bins for every channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UniformConfig {
    /// Bins per channel, 2 to 21054 (the size of the alphabet). Default 360: a step of 1 degree.
    pub bins: u32,
    /// Alignment of the angles' bins. Default centred on 0.
    pub form: Form,
    /// How x and z of the translation are coded. Default velocity.
    pub translation: Travel,
    /// How its y is coded. Default: above the clip's floor.
    pub height: Height,
    /// The numbers of a pose that are coded: its rotation vectors (default) or components of them, over a fitted range.
    pub joint_transform: JointTransform,
}

impl Default for UniformConfig {
    fn default() -> Self {
        UniformConfig {
            bins: 360,
            form: Form::Centred,
            translation: Travel::Velocity,
            height: Height::Floor,
            joint_transform: JointTransform::None {},
        }
    }
}

impl UniformConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the setting, its value and its limits.
    pub fn validate(&self) -> Result<()> {
        check_bins(self.bins, 2)?;
        self.joint_transform.validate()
    }

    /// Whether it is fitted clip by clip, without storing frames.
    pub(crate) fn streams(&self) -> bool {
        self.joint_transform == JointTransform::None {}
    }

    /// The bins of a position in metres.
    fn position_line(&self) -> Line {
        let width = TAU / f64::from(self.bins);
        let zero = (self.bins / 2) as u16;
        let offset = match self.form {
            Form::Centred => 0.0,
            // bin k begins at k widths above -PI, as the angles' bins do, and decodes to its middle
            Form::Edge => (0.5 + f64::from(zero)) * width - PI,
        };
        Line { width, zero, offset, bins: self.bins }
    }
}

/// Uniform bins with their fitted ranges.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Uniform {
    #[serde(skip)]
    config: UniformConfig,
    /// Bins of the translation's x, y, z.
    translation: [Line; 3],
    /// Mean height of the training clips' first frames, metres: the origin of frame 0's step.
    first_height: f64,
    /// The joint transform with its bins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    components: Option<Components>,
}

/// Components of poses and their bins.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Components {
    mix: Mix,
    /// One per component, over the range of the training poses.
    lines: Vec<Line>,
}

impl Uniform {
    /// The settings.
    pub fn config(&self) -> &UniformConfig {
        &self.config
    }

    /// The bins of the translation's x, y, z, metres.
    pub fn translation(&self) -> &[Line; 3] {
        &self.translation
    }

    /// The origin of a clip's first step in height, metres.
    pub fn first_height(&self) -> f64 {
        self.first_height
    }

    /// The bins of the rotation vectors.
    pub fn angles(&self) -> Angles {
        Angles::new(self.config.form, self.config.bins)
    }

    /// Fits a joint transform and the ranges of its components and of the steps to training clips.
    #[cfg(feature = "fit")]
    pub(crate) fn fit(config: &UniformConfig, channels: &Channels, clips: &[Clip], heights: [f64; 2]) -> Result<Self> {
        let columns = Numbers::len(channels);
        let mut rows = Numbers::of_clips(channels, config.bins, clips);
        let mut fit = UniformFit::new(config.clone());
        let Some((mix, rows)) = mixed::fit(&config.joint_transform, &mut rows, columns)? else {
            clips.iter().try_for_each(|clip| fit.add(channels, clip))?;
            return fit.finish(heights);
        };
        let line = |i: usize| {
            let column = || rows.iter().skip(i).step_by(mix.components()).copied();
            Line::fitted(column().fold(0.0, f64::min), column().fold(0.0, f64::max), config.bins)
        };
        let lines: Vec<Line> = (0..mix.components()).map(line).collect();
        // without the three characters of the step, whose bins are being fitted
        let length = Mixed::<Line>::length(channels, &mix) - 3;
        for clip in clips {
            fit.add_steps(clip, length, Mixed::new(channels, config.bins, &mix, &lines))?;
        }
        Ok(Uniform { components: Some(Components { mix, lines }), ..fit.finish(heights)? })
    }

    pub(crate) fn with_config(self, config: UniformConfig) -> Self {
        Uniform { config, ..self }
    }

    pub(crate) fn validate(&self, channels: &Channels) -> Result<()> {
        self.config.validate()?;
        for line in &self.translation {
            line.validate(self.config.bins)?;
        }
        check_height(self.first_height)?;
        let mixes = self.config.joint_transform != JointTransform::None {};
        if let Some(c) = &self.components {
            c.mix.validate(&self.config.joint_transform, Numbers::len(channels))?;
            c.lines.iter().try_for_each(|line| line.validate(self.config.bins))?;
        }
        let lines = self.components.as_ref().map(|c| (c.lines.len(), c.mix.components()));
        let good = lines.is_some() == mixes && lines.is_none_or(|(lines, components)| lines == components);
        good.then_some(()).ok_or_else(|| {
            Error::setting(
                "components",
                lines.map_or("none".to_owned(), |(lines, components)| format!("bins of {lines} of {components}")),
                if mixes { "bins of each" } else { "none without a joint transform" },
            )
        })
    }
}

impl FrameBins for Uniform {
    type Bins = Line;
    type RotationBins<'a> = Angles;

    fn codes(&self) -> u32 {
        self.config.bins
    }

    fn translation_bins(&self) -> &[Line; 3] {
        &self.translation
    }

    fn walk(&self) -> Walk {
        Walk::new(self.first_height, self.config.translation, self.config.height)
    }

    fn component_bins(&self) -> Option<(&Mix, &[Line])> {
        self.components.as_ref().map(|c| (&c.mix, &*c.lines))
    }

    fn rotation_bins(&self, _: &Channels) -> Angles {
        self.angles()
    }

    fn circular_zero(&self) -> Option<u16> {
        Some((self.config.bins / 2) as u16)
    }

    fn table_numbers(&self) -> u64 {
        // a value each; a width and a zero per coordinate or component, and the first height
        u64::from(self.config.bins) + 7 + self.components.as_ref().map_or(0, |c| 2 * c.lines.len() as u64)
    }
}

/// The same bins for every joint.
impl Vectors for Angles {
    fn code(&self, _: usize, q: Quat) -> Coded {
        let (codes, second) = Angles::code(self, q);
        Coded { codes, clipped: 0, second }
    }

    fn vector(&self, _: usize, codes: [u16; 3]) -> Vec3 {
        Angles::vector(self, codes)
    }

    fn edges(&self, _: usize, _: Axis) -> Vec<f64> {
        Angles::edges(self)
    }
}

/// Fits uniform bins to a stream of training clips, or to parts that are merged. The order doesn't matter.
#[derive(Debug, Clone, PartialEq)]
pub struct UniformFit {
    config: UniformConfig,
    /// Extremes of the steps x, y, z relative to the previous decoded heading, metres; y without the first frames.
    low: Vec3,
    high: Vec3,
    first_low: f64,
    first_high: f64,
    /// Sum of the first heights in units of 2^-40 m: integer sums don't depend on the order.
    first_sum: i128,
    clips: u64,
}

const UNITS_PER_M: f64 = (1u64 << 40) as f64;

impl UniformFit {
    pub(crate) fn new(config: UniformConfig) -> Self {
        let (low, high) = (Vec3::ZERO, Vec3::ZERO); // no movement must fit, and frame 0 has no step in x and z
        UniformFit {
            config,
            low,
            high,
            first_low: f64::INFINITY,
            first_high: f64::NEG_INFINITY,
            first_sum: 0,
            clips: 0,
        }
    }

    /// Adds a clip. A pelvis that isn't coded decodes to the identity.
    pub(crate) fn add(&mut self, channels: &Channels, clip: &Clip) -> Result<()> {
        let angles = Angles::new(self.config.form, self.config.bins);
        self.add_steps(clip, 3, Each::pelvis(channels, self.config.bins, angles))
    }

    /// Adds the steps of a clip relative to the heading that `poses` decodes from `length` characters.
    fn add_steps(&mut self, clip: &Clip, length: usize, poses: impl Poses) -> Result<()> {
        let (low, high) = (&mut self.low, &mut self.high);
        each_step(clip, length, poses, |step| (*low, *high) = (low.min(step), high.max(step)))?;
        let Some(first) = clip.root().first() else { return Ok(()) };
        self.first_low = self.first_low.min(first.y);
        self.first_high = self.first_high.max(first.y);
        self.first_sum += (first.y * UNITS_PER_M).round() as i128;
        self.clips += 1;
        Ok(())
    }

    pub(crate) fn merge(&mut self, other: &UniformFit) {
        (self.low, self.high) = (self.low.min(other.low), self.high.max(other.high));
        self.first_low = self.first_low.min(other.first_low);
        self.first_high = self.first_high.max(other.first_high);
        self.first_sum += other.first_sum;
        self.clips += other.clips;
    }

    /// `heights`: the range of heights above the floor.
    pub(crate) fn finish(self, heights: [f64; 2]) -> Result<Uniform> {
        if self.clips == 0 {
            return Err(Error::Nothing("no training clip has a frame".into()));
        }
        let first_height = self.first_sum as f64 / self.clips as f64 / UNITS_PER_M;
        let (mut low, mut high) = (self.low, self.high);
        low.y = low.y.min(self.first_low - first_height);
        high.y = high.y.max(self.first_high - first_height);
        let steps = |i: usize| Line::fitted(low[i], high[i], self.config.bins);
        let ground = |i: usize| match self.config.translation {
            Travel::Velocity => steps(i),
            Travel::Absolute => self.config.position_line(),
        };
        let height = match self.config.height {
            Height::Floor => {
                let [low, high] = heights.map(|y| y - first_height);
                Line::over(low.min(0.0), high.max(0.0), self.config.bins)
            }
            Height::Velocity => steps(1),
            Height::Absolute => self.config.position_line(),
        };
        let translation = [ground(0), height, ground(2)];
        Ok(Uniform { config: self.config, translation, first_height, components: None })
    }
}

#[cfg(test)]
#[path = "uniform_tests.rs"]
mod tests;
