//! The schemes whose words are frames of bins: steps of the root, then rotation vectors or components of the pose.

use super::frame::{self, Each, Poses, Vectors};
use super::line::Scale;
use super::mix::Mix;
use super::mixed::{self, Mixed};
use super::walk::Walk;
use super::{Encoded, Scheme, UncodedPose, WordLength};
use crate::channel::{Channel, Channels};
use crate::{Result, Words};
use kinelm_motion::{Clip, Quat};

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
