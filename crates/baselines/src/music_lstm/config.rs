//! What a run is to be like.

use super::HEARD;
use crate::{Error, Result};
use kinelm_engine::lstm::Single;
use kinelm_music::stft::Form;
use kinelm_store::presets;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Settings of music LSTMs.
pub const MUSIC_LSTM: &kinelm_store::presets::Presets = &[
    ("small", include_str!("../../configs/music_lstm/small.toml")),
    ("dissertation", include_str!("../../configs/music_lstm/dissertation.toml")),
];

/// How a frame of music is heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Audio {
    /// Six windows around the frame's time, logarithms, each number standardised over the training music.
    #[default]
    Fixed,
    /// As printed: a piece cut out and mirrored, magnitudes as they are.
    Compat,
}

impl Audio {
    /// As the spectra have it.
    pub fn form(self) -> Form {
        match self {
            Audio::Fixed => Form::Fixed,
            Audio::Compat => Form::Compat,
        }
    }
}

/// How far poses are from true ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Pose {
    /// The mean square of the quaternions' numbers, each true one with the sign that lies nearer.
    #[default]
    Aligned,
    /// The same with the signs as they are.
    Compat,
    /// It isn't asked.
    None,
}

/// How far the effort of a dance is from the true one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Effort {
    /// By angular speeds ([`super::effort`]).
    Corrected,
    /// As printed, where it tells orientations.
    Compat,
    /// It isn't asked.
    #[default]
    None,
}

/// The settings of a run. `configs/music_lstm/` has examples with every key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// How music is heard.
    pub audio: Audio,
    /// Widths of the linear layers between a frame of music and four numbers a joint.
    pub encoder: Vec<usize>,
    /// D, units of a layer of LSTM.
    pub width: usize,
    /// L, layers of LSTM before the one whose units are the joints'.
    pub layers: usize,
    /// Share of the numbers between layers that are dropped in training, 0 to below 1.
    pub dropout: f64,
    /// How often the last layer sees the true frame before, in place of its own, in training: 0 to 1.
    pub teacher: f64,
    /// The loss of poses.
    pub pose: Pose,
    /// The loss of effort, added to it.
    pub effort: Effort,
    /// It is added in every so manieth update; 1: in all.
    pub effort_every: u64,
    /// T, steps of a sequence.
    pub length: usize,
    /// B.
    pub batch: usize,
    /// Adam's.
    pub learning_rate: f64,
    /// The longest that gradients may be; 0: as they are.
    pub clip: f64,
    /// Updates in all.
    pub steps: u64,
    /// Frames of a file, at both its ends, that are not used.
    pub margin: usize,
    /// Of all that is drawn.
    pub seed: u64,
    /// Updates between checkpoints; 0: only at the end.
    pub checkpoint_every: u64,
    /// Checkpoints that stay.
    pub keep: usize,
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
            checkpoint_every: 200,
            keep: 1,
        }
    }
}

impl Config {
    /// The settings of a name that is built in ([`MUSIC_LSTM`]), else those of a TOML.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] when it is neither; a file that can't be read; keys that are unknown or outside their limits.
    pub fn find(name_or_path: &Path) -> Result<Config> {
        let config: Config = presets::read(MUSIC_LSTM, name_or_path, ("music_lstm", "settings of a music LSTM"))?;
        config.validate().map_err(|e| Error::call(format!("{}: {e}", name_or_path.display())))?;
        Ok(config)
    }

    /// Checks every key.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] with the first key outside its limits, and both.
    pub fn validate(&self) -> Result<()> {
        let wrong = |text: String| Err(Error::call(text));
        let whole = |key: &str, found: u64, least: u64, most: u64| match (least..=most).contains(&found) {
            true => Ok(()),
            false => wrong(format!("{key} is {found}; expected {least} to {most}")),
        };
        whole("encoder's layers", self.encoder.len() as u64, 1, 8)?;
        self.encoder.iter().try_for_each(|width| whole("encoder", *width as u64, 1, 8192))?;
        whole("width", self.width as u64, 1, 8192)?;
        whole("layers", self.layers as u64, 1, 16)?;
        whole("effort_every", self.effort_every, 1, 1 << 20)?;
        whole("length", self.length as u64, 2, 4096)?;
        whole("batch", self.batch as u64, 1, 4096)?;
        whole("steps", self.steps, 1, 1 << 40)?;
        whole("margin", self.margin as u64, 0, 65_536)?;
        whole("keep", self.keep as u64, 1, 65_536)?;
        // TOML has no larger integers
        whole("seed", self.seed, 0, i64::MAX as u64)?;
        if !(0.0..1.0).contains(&self.dropout) {
            return wrong(format!("dropout is {}; expected 0 to below 1", self.dropout));
        }
        if !(0.0..=1.0).contains(&self.teacher) {
            return wrong(format!("teacher is {}; expected 0 to 1", self.teacher));
        }
        if !(self.learning_rate > 0.0 && self.learning_rate.is_finite()) {
            return wrong(format!("learning_rate is {}; expected a number above 0", self.learning_rate));
        }
        if !(self.clip >= 0.0 && self.clip.is_finite()) {
            return wrong(format!("clip is {}; expected 0 or a number above it", self.clip));
        }
        match (self.pose, self.effort, self.effort_every) {
            (Pose::None, Effort::None, _) => wrong("pose and effort are both \"none\"; ask for one of them".into()),
            (Pose::None, _, every @ 2..) => {
                wrong(format!("effort_every is {every}, and pose \"none\": most updates would ask nothing; expected 1"))
            }
            _ => Ok(()),
        }
    }

    /// The network's shape for a rig of so many joints.
    pub fn shape(&self, joints: usize) -> Shape {
        Shape { encoder: self.encoder.clone(), width: self.width, layers: self.layers, joints }
    }

    /// The effort's loss of update `step`, counted from 0.
    pub fn effort_of(&self, step: u64) -> Effort {
        if (step + 1).is_multiple_of(self.effort_every) { self.effort } else { Effort::None }
    }
}

/// What a network is like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shape {
    /// Widths of the linear layers but the last, which has 4J.
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
            [HEARD].into_iter().chain(self.encoder.iter().copied()).chain([self.channels()]).collect();
        widths.windows(2).map(|pair| [pair[0], pair[1]]).collect()
    }

    /// Inputs and units of the layers of LSTM, the joints' last.
    pub fn recurrent(&self) -> Vec<[usize; 2]> {
        let below = |l: usize| if l == 0 { self.channels() } else { self.width };
        (0..self.layers).map(|l| [below(l), self.width]).chain([[self.width, self.channels()]]).collect()
    }

    /// Numbers that learn.
    pub fn parameters(&self) -> usize {
        let linear: usize = self.linear().iter().map(|[k, m]| (k + 1) * m).sum();
        let sizes = self.recurrent().into_iter().flat_map(|[inputs, width]| Single::tensors(inputs, width));
        linear + sizes.map(|[rows, columns]| rows * columns).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_network_has_twelve_million_numbers() {
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
        assert!(said("pose = \"none\"").contains("both \"none\""));
        assert!(said("pose = \"none\"\neffort = \"compat\"").contains("effort_every is 4, and pose \"none\""));
        assert!(said("effort = \"laban\"").contains("a.toml:1:"));
    }
}
