//! The schemes whose words are frames of bins: steps of the root, then rotation vectors or components of the pose.

use super::frame::{self, Each, Poses, Vectors};
use super::line::Scale;
use super::mix::Mix;
use super::mixed::{self, Mixed};
use super::pelvis::Turns;
use super::series::open_joints;
use super::walk::Walk;
use super::{Encoded, Scheme, UncodedPose, WordLength};
use crate::channel::{Channel, Channels};
use crate::meaning::{Legend, Meaning, Series, Unit};
use crate::{Result, Words};
use kinelm_motion::rotation::Axis;
use kinelm_motion::{Clip, Quat};
use std::f64::consts::TAU;

/// The bins of a scheme whose words are frames.
pub(super) trait FrameBins: Send + Sync {
    /// Bins of one number.
    type Bins: Scale;
    /// Bins of rotation vectors.
    type RotationBins<'a>: Vectors
    where
        Self: 'a;

    /// Codes of a channel, and of the turn.
    fn codes(&self) -> u32;

    /// Bins of the translation's x, y, z.
    fn translation_bins(&self) -> &[Self::Bins; 3];

    /// The decoded root at a clip's start.
    fn walk(&self) -> Walk;

    /// The joint transform and the bins of its components, one each or one for all; `None` without a transform.
    fn component_bins(&self) -> Option<(&Mix, &[Self::Bins])>;

    /// Bins of rotation vectors.
    fn rotation_bins(&self, channels: &Channels) -> Self::RotationBins<'_>;

    /// The code of no rotation when rotation channels are bins of a full turn, of which the last is next to the first.
    fn circular_zero(&self) -> Option<u16>;

    /// Numbers of the fitted tables.
    fn table_numbers(&self) -> u64;

    /// Characters of a word.
    fn length(&self, channels: &Channels) -> usize {
        self.component_bins().map_or(channels.len(), |(mix, _)| Mixed::<Self::Bins>::length(channels, mix))
    }

    /// Codes the rotations of poses.
    fn each<'a>(&'a self, channels: &'a Channels) -> Each<'a, Self::RotationBins<'a>> {
        Each::new(channels, self.codes(), self.rotation_bins(channels))
    }

    /// Codes the components of poses.
    fn mixed<'a>(&'a self, channels: &'a Channels, mix: &'a Mix, bins: &'a [Self::Bins]) -> Mixed<'a, Self::Bins> {
        Mixed::new(channels, self.codes(), mix, bins)
    }
}

impl<T: FrameBins> Scheme for T {
    fn symbols(&self) -> u32 {
        self.codes()
    }

    fn frames_per_word(&self) -> usize {
        1
    }

    fn word_length(&self, channels: &Channels) -> WordLength {
        WordLength::Fixed(self.length(channels))
    }

    fn encode(&self, channels: &Channels, clip: &Clip) -> Result<Encoded> {
        let (length, walk, bins) = (self.length(channels), self.walk(), self.translation_bins());
        match self.component_bins() {
            Some((mix, components)) => frame::encode(clip, length, walk, bins, self.mixed(channels, mix, components)),
            None => frame::encode(clip, length, walk, bins, self.each(channels)),
        }
    }

    fn decode(&self, channels: &Channels, words: &Words, fps: f64, uncoded: UncodedPose<'_>) -> Result<Clip> {
        let (walk, bins) = (self.walk(), self.translation_bins());
        match self.component_bins() {
            Some((mix, components)) => {
                frame::decode(words, fps, uncoded, walk, bins, self.mixed(channels, mix, components))
            }
            None => frame::decode(words, fps, uncoded, walk, bins, self.each(channels)),
        }
    }

    fn neutral(&self, channels: &Channels) -> Vec<u16> {
        let mut word = vec![0; self.length(channels)];
        let (translation, rest) = word.split_at_mut(3);
        let still = [0.0, self.walk().neutral_height(), 0.0];
        for ((slot, bins), value) in translation.iter_mut().zip(self.translation_bins()).zip(still) {
            *slot = bins.code(value).0;
        }
        let (pose, mut counts) = ([Quat::IDENTITY; 24], Encoded::default());
        match (self.component_bins(), self.circular_zero()) {
            (Some((mix, bins)), _) => _ = self.mixed(channels, mix, bins).encode(&pose, rest, &mut counts),
            // also the turn's code of no step, which is the same middle bin
            (None, Some(zero)) => rest.fill(zero),
            (None, None) => _ = self.each(channels).encode(&pose, rest, &mut counts),
        }
        word
    }

    fn slot_channels(&self, channels: &Channels) -> std::result::Result<Vec<Channel>, String> {
        match self.component_bins() {
            Some(_) => Err(mixed::REASON.into()),
            None => Ok(channels.iter().collect()),
        }
    }

    fn legend(&self, channels: &Channels) -> Legend {
        let root = [Axis::X, Axis::Y, Axis::Z].into_iter().zip(self.walk().coordinates());
        let root = root.map(|(axis, (what, _))| Series::of(Channel::Translation(axis), what, Unit::Metres));
        let of_pose = |channel| Series::of(channel, if channel == Channel::Turn { "step" } else { "" }, Unit::Radians);
        let mut all: Vec<Series> = root.collect();
        match self.component_bins() {
            None => all.extend(channels.iter().skip(3).map(of_pose)),
            Some((mix, _)) => {
                all.extend(channels.has_turn().then(|| of_pose(Channel::Turn)));
                all.extend(mix.series(&open_joints(channels), Unit::Radians));
            }
        }
        Legend::of_frames(all)
    }

    fn meanings(&self, channels: &Channels, word: &[u16]) -> Vec<Meaning> {
        let origins = self.walk().coordinates().map(|(_, origin)| origin);
        let rotations = self.rotation_bins(channels);
        let components = 3 + usize::from(channels.has_turn());
        let value = |slot: usize, code: u16| match (slot, channels.at(slot), self.component_bins()) {
            (0..3, ..) => origins[slot] + self.translation_bins()[slot].value(code),
            (3, Some(Channel::Turn), _) => {
                (f64::from(code) - f64::from(Turns::neutral(self.codes()))) * TAU / f64::from(self.codes())
            }
            (_, _, Some((_, bins))) => bins[(slot - components).min(bins.len() - 1)].value(code),
            (_, Some(Channel::Tilt(axis)), None) => rotations.vector(0, [code; 3])[axis.index()],
            _ => rotations.vector(slot / 3 - 1, [code; 3])[slot % 3],
        };
        word.iter().enumerate().map(|(number, &code)| Meaning::Value { number, value: value(number, code) }).collect()
    }

    fn edges(&self, channels: &Channels, joint: usize, axis: Axis) -> Option<Vec<f64>> {
        let own = |channel: &Channel| *channel == Channel::Rotation { joint, axis };
        let slot = channels.iter().position(|channel| own(&channel)).filter(|_| self.component_bins().is_none())?;
        Some(self.rotation_bins(channels).edges(slot / 3 - 1, axis))
    }

    fn is_circular(&self, slot: usize) -> bool {
        // the translation's three slots are not angles
        slot >= 3 && self.component_bins().is_none() && self.circular_zero().is_some()
    }

    fn numbers(&self, _: &Channels, word: &[u16], out: &mut Vec<i32>) {
        out.extend(word.iter().map(|&k| i32::from(k)));
    }

    fn fitted_numbers(&self) -> u64 {
        self.table_numbers() + self.component_bins().map_or(0, |(mix, _)| mix.numbers())
    }
}
