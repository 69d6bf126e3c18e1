//! Quantile bins: fine where training values are frequent, coarse elsewhere.

use super::bins::Bins;
use super::frame::{Coded, Each, LONGEST, Numbers, Vectors, sorted_columns, training_steps};
use super::frame_bins::FrameBins;
use super::line::Scale;
use super::mix::{JointTransform, Mix};
use super::mixed;
use super::walk::{Height, Travel, Walk, check_bins, check_height, one_of};
use crate::channel::Channels;
use crate::{Error, Result};
use kinelm_motion::rotation::{Axis, angle_between, exp_map};
use kinelm_motion::{Clip, Quat, Vec3};
use serde::{Deserialize, Serialize};

/// Which training values share edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pooled {
    /// Those of one channel: each channel has its own edges.
    #[default]
    Channel,
    /// Those of all rotation channels or components: one set of edges.
    Global,
}

/// Quantile bins for every channel. The translation is coded as closed-loop steps, with edges per coordinate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QuantileConfig {
    /// Bins per channel, 3 to 21054 (the size of the alphabet). Default 360. Equal edges merge, so there may be fewer. The turn
    /// of `root_rotation = heading_delta` has as many, of equal width.
    pub bins: u32,
    /// Which training values share edges. Default: those of a channel.
    pub pooled: Pooled,
    /// The numbers of a pose that are coded: its rotation vectors (default) or components of them.
    pub joint_transform: JointTransform,
    /// How the height is coded: above the clip's floor in bins of equal width (default), or as steps.
    pub height: Height,
}

impl Default for QuantileConfig {
    fn default() -> Self {
        QuantileConfig {
            bins: 360,
            pooled: Pooled::Channel,
            joint_transform: JointTransform::None {},
            height: Height::Floor,
        }
    }
}

impl QuantileConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the setting, its value and its limits.
    pub fn validate(&self) -> Result<()> {
        check_bins(self.bins, 3)?;
        one_of(self.height, &[Height::Floor, Height::Velocity])?;
        self.joint_transform.validate()
    }
}

/// Quantile bins with their fitted edges.
///
/// The error of a number has no bound: between two edges it is less than the bin's width; outside the training values it is the
/// distance to them, and the number counts as clipped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quantile {
    #[serde(skip)]
    config: QuantileConfig,
    /// Bins of the steps x, y, z, metres.
    steps: [Bins; 3],
    /// Mean height of the training clips' first frames, metres: the origin of frame 0's step.
    first_height: f64,
    /// Bins of each rotation channel (radians) or component, or one for all.
    rotations: Vec<Bins>,
    /// From rotation channels to components.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mix: Option<Mix>,
}

impl Quantile {
    /// Fits to training clips on the 24 SMPL joints.
    #[cfg(feature = "fit")]
    pub(crate) fn fit(config: &QuantileConfig, channels: &Channels, clips: &[Clip], heights: [f64; 2]) -> Result<Self> {
        let mut columns = Numbers::len(channels);
        let mut rows = Numbers::of_clips(channels, config.bins, clips);
        if rows.is_empty() {
            return Err(Error::Nothing("no training clip has a frame".into()));
        }
        let mix = mixed::fit(&config.joint_transform, &mut rows, columns)?.map(|(mix, components)| {
            (columns, rows) = (mix.components(), components);
            mix
        });
        let rotations = match config.pooled {
            Pooled::Channel => sorted_columns(&rows, columns),
            Pooled::Global => sorted_columns(&rows, 1),
        };
        let rotations: Vec<Bins> = rotations.iter().map(|sorted| Bins::fitted(sorted, config.bins)).collect();
        // the largest array; fitting the steps needs memory of its own
        drop(rows);
        let unknown = [(); 3].map(|()| Bins::at_zero());
        let mut fitted = Quantile { config: config.clone(), steps: unknown, first_height: 0.0, rotations, mix };
        let length = fitted.length(channels) - 3;
        let steps = match fitted.component_bins() {
            Some((mix, bins)) => training_steps(clips, length, || fitted.mixed(channels, mix, bins)),
            None => {
                training_steps(clips, length, || Each::pelvis(channels, config.bins, fitted.rotation_bins(channels)))
            }
        }?;
        if let Some((steps, first_height)) = steps {
            fitted.steps = steps.map(|sorted| Bins::fitted_to_steps(&sorted, config.bins));
            fitted.first_height = first_height;
            if config.height == Height::Floor {
                let [low, high] = heights.map(|y| y - first_height);
                // 0 is the neutral height, which needs a bin
                fitted.steps[1] = Bins::even(low.min(0.0), high.max(0.0), config.bins);
            }
        }
        Ok(fitted)
    }

    /// Bins after merging equal edges: the least and the most of a channel.
    pub fn bins_left(&self) -> (usize, usize) {
        let left = || self.steps.iter().chain(&self.rotations).map(Bins::len);
        (left().min().unwrap_or(0), left().max().unwrap_or(0))
    }

    pub(crate) fn with_config(self, config: QuantileConfig) -> Self {
        Quantile { config, ..self }
    }

    pub(crate) fn validate(&self, channels: &Channels) -> Result<()> {
        self.config.validate()?;
        check_height(self.first_height)?;
        self.steps.iter().try_for_each(|bins| bins.validate("translation bins", self.config.bins))?;
        self.rotations.iter().try_for_each(|bins| bins.validate("rotation bins", self.config.bins))?;
        let columns = Numbers::len(channels);
        if let Some(mix) = &self.mix {
            mix.validate(&self.config.joint_transform, columns)?;
        }
        let expected = match self.config.pooled {
            Pooled::Channel => self.mix.as_ref().map_or(columns, Mix::components),
            Pooled::Global => 1,
        };
        let mixes = self.config.joint_transform != JointTransform::None {};
        let good = self.rotations.len() == expected && self.mix.is_some() == mixes;
        good.then_some(()).ok_or_else(|| {
            Error::setting(
                "rotation bins",
                format!("bins of {} channels", self.rotations.len()),
                format!("of {expected}, for the joints and the joint transform of the settings"),
            )
        })
    }
}

impl FrameBins for Quantile {
    type Bins = Bins;
    type RotationBins<'a> = Quantiles<'a>;

    fn codes(&self) -> u32 {
        self.config.bins
    }

    fn translation_bins(&self) -> &[Bins; 3] {
        &self.steps
    }

    fn walk(&self) -> Walk {
        Walk::new(self.first_height, Travel::Velocity, self.config.height)
    }

    fn component_bins(&self) -> Option<(&Mix, &[Bins])> {
        self.mix.as_ref().map(|mix| (mix, &*self.rotations))
    }

    fn rotation_bins(&self, channels: &Channels) -> Quantiles<'_> {
        Quantiles { bins: &self.rotations, none: Bins::at_zero(), tilts: channels.has_turn() }
    }

    fn circular_zero(&self) -> Option<u16> {
        None
    }

    fn table_numbers(&self) -> u64 {
        self.steps.iter().chain(&self.rotations).map(Bins::numbers).sum::<u64>() + 1
    }
}

/// The quantile bins of rotation vectors.
pub(super) struct Quantiles<'a> {
    bins: &'a [Bins],
    /// For a tilt's y.
    none: Bins,
    /// Whether the first joint is the tilt of a pelvis.
    tilts: bool,
}

impl Quantiles<'_> {
    fn of(&self, n: usize) -> [&Bins; 3] {
        // pooled bins are one set for all channels
        let channel = |i: usize| &self.bins[i.min(self.bins.len() - 1)];
        match (self.tilts, n) {
            (true, 0) => [channel(0), &self.none, channel(1)],
            // a tilt has no y, so the channels of later joints are one place earlier
            _ => [0, 1, 2].map(|i| channel(3 * n + i - usize::from(self.tilts))),
        }
    }
}

impl Vectors for Quantiles<'_> {
    /// The codes of the canonical vector. If they decode beyond half a turn, where they would not encode to themselves, nearby
    /// codes of it or of its twin that don't.
    fn code(&self, n: usize, q: Quat) -> Coded {
        let bins = self.of(n);
        let v = exp_map::to_vector(q).to_array();
        let coded: [(u16, bool); 3] = std::array::from_fn(|i| bins[i].code(v[i]));
        let clipped = coded.iter().filter(|(_, clipped)| *clipped).count() as u64;
        let codes = coded.map(|(code, _)| code);
        if self.vector(n, codes).length() <= LONGEST {
            return Coded { codes, clipped, second: false };
        }
        let twin = exp_map::twin(Vec3::from_array(v)).unwrap_or_default().to_array();
        let twin = std::array::from_fn(|i| bins[i].code(twin[i]).0);
        let off = |codes: [u16; 3]| angle_between(q, exp_map::from_vector(self.vector(n, codes)));
        let (own, twin) = (self.shortened(n, codes), self.shortened(n, twin));
        Coded { codes: if off(twin) < off(own) { twin } else { own }, clipped, second: true }
    }

    fn vector(&self, n: usize, codes: [u16; 3]) -> Vec3 {
        let bins = self.of(n);
        Vec3::from_array(std::array::from_fn(|i| bins[i].value(codes[i])))
    }

    fn edges(&self, n: usize, axis: Axis) -> Vec<f64> {
        self.of(n)[axis.index()].edges().to_vec()
    }
}

impl Quantiles<'_> {
    /// Codes of a vector within half a turn: the largest component moves towards 0 bin by bin.
    fn shortened(&self, n: usize, mut codes: [u16; 3]) -> [u16; 3] {
        let bins = self.of(n);
        loop {
            let v = self.vector(n, codes);
            if v.length() <= LONGEST {
                return codes;
            }
            let nearer = |i: usize| {
                let next = if v[i] > 0.0 { codes[i].checked_sub(1)? } else { codes[i] + 1 };
                // strictly smaller, so the loop ends
                (bins[i].value(next).abs() < v[i].abs()).then_some((i, next))
            };
            let largest = (0..3).filter_map(nearer).max_by(|a, b| v[a.0].abs().total_cmp(&v[b.0].abs()));
            let Some((i, next)) = largest else { return codes };
            codes[i] = next;
        }
    }
}
