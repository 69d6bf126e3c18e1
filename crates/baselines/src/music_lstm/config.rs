//! The settings of a run, and the shape of a network.

use super::SPECTRUM;
use crate::run::{Settings, keep, positive, weight, within};
use crate::{Error, PartWeights, Result};
use kinelm_model::Keep;
use kinelm_music::stft::Form;
use kinelm_store::presets::Presets;
use serde::{Deserialize, Serialize};

/// Settings of music LSTMs.
pub const MUSIC_LSTM: &Presets = &[
    ("small", include_str!("../../configs/music_lstm/small.toml")),
    ("dissertation", include_str!("../../configs/music_lstm/dissertation.toml")),
];

/// The spectrum of a frame of music.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Audio {
    /// Six windows around the frame's time, logarithms, each number standardised over the training music.
    #[default]
    Fixed,
    /// As printed: a piece of the signal, mirrored, and plain magnitudes.
    Compat,
}

impl Audio {
    /// The form of the spectra.
    pub fn form(self) -> Form {
        match self {
            Audio::Fixed => Form::Fixed,
            Audio::Compat => Form::Compat,
        }
    }
}

/// The loss of poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pose {
    /// The mean square error of the quaternions' components, true ones with the nearer sign.
    #[default]
    Aligned,
    /// The same with the signs as they are.
    Compat,
    /// No loss.
    None,
}

/// The loss of Laban's weight effort.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Effort {
    /// By angular speeds (`super::effort`).
    Corrected,
    /// As printed, where it depends on orientations.
    Compat,
    /// No loss.
    #[default]
    None,
}

/// The settings of a run. `configs/music_lstm/` has examples with every key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The spectra of the music.
    pub audio: Audio,
    /// Widths of the linear layers between a frame of music and four numbers per joint.
    pub encoder: Vec<usize>,
    /// D, units of a layer of LSTM.
    pub width: usize,
    /// L, LSTM layers before the one whose units are the joints'.
    pub layers: usize,
    /// Dropout between layers, 0 to below 1.
    pub dropout: f64,
    /// Teacher forcing: the share of training steps in which the last layer reads the true previous frame, 0 to 1.
    pub teacher: f64,
    /// The loss of poses.
    pub pose: Pose,
    /// The loss of effort, which is added.
    pub effort: Effort,
    /// It is added in every n-th update; 1: in all.
    pub effort_every: u64,
    /// T, steps of a sequence.
    pub length: usize,
    /// B.
    pub batch: usize,
    /// Adam's learning rate.
    pub learning_rate: f64,
    /// The largest norm of gradients; 0: no limit.
    pub clip: f64,
    /// Updates in all.
    pub steps: u64,
    /// Frames at both ends of a file that are not used.
    pub margin: usize,
    /// The seed of all random numbers.
    pub seed: u64,
    /// Weight of the root's part of the loss, 0 or more.
    pub root_weight: f64,
    /// Weight of the rotations' part, 0 or more.
    pub rotations_weight: f64,
    /// Updates between measurements on the validation clips; 0: none.
    pub eval_every: u64,
    /// Updates between dances that are generated into the run's `samples/`; 0: none.
    pub sample_every: u64,
    /// Updates between checkpoints; 0: only at the end.
    pub checkpoint_every: u64,
    /// Checkpoints that stay beside the best, 1 or more, or `"all"`.
    pub keep: Keep,
}

impl Default for Config {
    fn default() -> Config {
        Config {
            audio: Audio::Fixed,
            encoder: vec![256, 128],
            width: 128,
            layers: 2,
            dropout: 0.25,
            teacher: 0.3,
            pose: Pose::Aligned,
            effort: Effort::None,
            effort_every: 4,
            length: 100,
            batch: 16,
            learning_rate: 1e-3,
            clip: 1.0,
            steps: 3000,
            margin: 10,
            seed: 1,
            root_weight: 1.0,
            rotations_weight: 1.0,
            eval_every: 0,
            sample_every: 0,
            checkpoint_every: 200,
            keep: Keep::Last(1),
        }
    }
}

impl Settings for Config {
    const PRESETS: &'static Presets = MUSIC_LSTM;
    const FOLDER: (&'static str, &'static str) = ("music_lstm", "settings of a music LSTM");
    const RESUMABLE: &'static [&'static str] =
        &["steps", "learning_rate", "clip", "eval_every", "sample_every", "checkpoint_every", "keep"];

    fn validate(&self) -> Result<()> {
        within("encoder's layers", self.encoder.len(), 1..=8)?;
        self.encoder.iter().try_for_each(|width| within("encoder", *width, 1..=8192))?;
        within("width", self.width, 1..=8192)?;
        within("layers", self.layers, 1..=16)?;
        within("effort_every", self.effort_every, 1..=1 << 20)?;
        within("length", self.length, 2..=4096)?;
        within("batch", self.batch, 1..=4096)?;
        within("steps", self.steps, 1..=1 << 40)?;
        within("margin", self.margin, 0..=65_536)?;
        keep(self.keep)?;
        weight("root_weight", self.root_weight)?;
        weight("rotations_weight", self.rotations_weight)?;
        // TOML has no larger integers
        within("seed", self.seed, 0..=i64::MAX as u64)?;
        if !(0.0..1.0).contains(&self.dropout) {
            return Err(Error::invalid("dropout", self.dropout, "0 to below 1"));
        }
        within("teacher", self.teacher, 0.0..=1.0)?;
        positive("learning_rate", self.learning_rate)?;
        if !(self.clip >= 0.0 && self.clip.is_finite()) {
            return Err(Error::invalid("clip", self.clip, "0 or a number above it"));
        }
        match (self.pose, self.effort, self.effort_every) {
            (Pose::None, Effort::None, _) => {
                Err(Error::invalid("pose", "\"none\"", "a loss, as effort is \"none\" too"))
            }
            (Pose::None, _, every @ 2..) => {
                Err(Error::invalid("effort_every", every, "1, as pose is \"none\": other updates have no loss"))
            }
            _ => Ok(()),
        }
    }
}

impl Config {
    /// The weights of the loss's parts.
    pub fn parts(&self) -> PartWeights {
        PartWeights { root: self.root_weight, rotations: self.rotations_weight }
    }

    /// The network's shape for a rig of this number of joints.
    pub fn shape(&self, joints: usize) -> Shape {
        Shape { encoder: self.encoder.clone(), width: self.width, layers: self.layers, joints }
    }

    /// The effort's loss of update `step`, counted from 0.
    pub(crate) fn effort_of(&self, step: u64) -> Effort {
        // counted from 1: the n-th update is the first with effort
        if (step + 1).is_multiple_of(self.effort_every) { self.effort } else { Effort::None }
    }
}

/// The shape of a network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shape {
    /// Widths of the linear layers except the last, which has 4J.
    pub encoder: Vec<usize>,
    /// D.
    pub width: usize,
    /// L.
    pub layers: usize,
    /// J.
    pub joints: usize,
}

impl Shape {
    /// 4J.
    pub fn channels(&self) -> usize {
        4 * self.joints
    }

    /// Inputs and outputs of the linear layers.
    pub fn linear(&self) -> Vec<[usize; 2]> {
        let widths: Vec<usize> =
            [SPECTRUM].into_iter().chain(self.encoder.iter().copied()).chain([self.channels()]).collect();
        widths.windows(2).map(|pair| [pair[0], pair[1]]).collect()
    }

    /// Inputs and units of the LSTM layers, the joints' last.
    pub(crate) fn recurrent(&self) -> Vec<[usize; 2]> {
        let below = |l: usize| if l == 0 { self.channels() } else { self.width };
        (0..self.layers).map(|l| [below(l), self.width]).chain([[self.width, self.channels()]]).collect()
    }

    /// The number of parameters.
    #[cfg(test)]
    pub fn parameters(&self) -> usize {
        let linear: usize = self.linear().iter().map(|[k, m]| (k + 1) * m).sum();
        let sizes = self
            .recurrent()
            .into_iter()
            .flat_map(|[inputs, width]| kinelm_engine::lstm::Single::tensors(inputs, width));
        linear + sizes.map(|[rows, columns]| rows * columns).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn the_published_network_has_twelve_million_parameters() {
        let published = Config::find(Path::new("dissertation")).unwrap();
        assert_eq!(published.shape(43).parameters(), 12_020_884);
        let small = Config::find(Path::new("small")).unwrap();
        assert_eq!((small.shape(43).parameters(), &small), (2_124_236, &Config::default()));
    }

    #[test]
    fn wrong_keys_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        let said = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Config::find(&path).unwrap_err().to_string()
        };
        assert!(said("width = 8\nwidht = 9\n").contains("a.toml:2:1: found unknown field `widht`"));
        assert!(said("encoder = []").contains("encoder's layers is 0; expected 1 to 8"));
        assert!(said("teacher = 1.5").contains("teacher is 1.5; expected 0 to 1"));
        assert!(said("dropout = 1.0").contains("dropout is 1; expected 0 to below 1"));
        assert!(said("pose = \"none\"").contains("pose is \"none\""));
        assert!(said("pose = \"none\"\neffort = \"compat\"").contains("effort_every is 4; expected 1"));
        assert!(said("effort = \"laban\"").contains("a.toml:1:"));
    }
}
