//! The settings of a run.

use crate::form::Form;
use crate::rig;
use crate::run::{Settings, keep, positive, weight, within};
use crate::{PartWeights, Result};
use kinelm_engine::lstm::{Shape, Wiring};
use kinelm_model::Keep;
use kinelm_store::presets::Presets;
use serde::{Deserialize, Serialize};

/// Settings of auto-conditioned LSTMs.
pub const ACLSTM: &Presets = &[
    ("256", include_str!("../../configs/aclstm/256.toml")),
    ("published", include_str!("../../configs/aclstm/published.toml")),
];

/// The settings of a run. `configs/aclstm/` has examples with every key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The representation of a pose.
    pub form: Form,
    /// The order of the root's angles, such as `YXZ`, instead of its file's; for [`Form::Euler`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub root_order: Option<String>,
    /// D, units of a layer.
    pub width: usize,
    /// L.
    pub layers: usize,
    /// How layers are connected.
    #[serde(with = "WiringName")]
    pub wiring: Wiring,
    /// Consecutive ground-truth inputs; at least 1.
    pub groundtruth: usize,
    /// The network's own outputs that follow them as inputs, alternating; 0: none.
    pub condition: usize,
    /// T, steps of a sequence.
    pub length: usize,
    /// B.
    pub batch: usize,
    /// Adam's learning rate.
    pub learning_rate: f64,
    /// Updates in all.
    pub steps: u64,
    /// Whether every sequence is turned about the vertical by a random angle.
    pub turn: bool,
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

/// [`Wiring`] by its name: the engine knows no files.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Wiring", rename_all = "lowercase")]
enum WiringName {
    Fixed,
    Compat,
}

impl Default for Config {
    fn default() -> Config {
        Config {
            form: Form::Quaternion,
            root_order: None,
            width: 256,
            layers: 3,
            wiring: Wiring::Fixed,
            groundtruth: 5,
            condition: 5,
            length: 100,
            batch: 32,
            learning_rate: 1e-3,
            steps: 6000,
            turn: true,
            margin: 10,
            seed: 1,
            root_weight: 1.0,
            rotations_weight: 1.0,
            eval_every: 0,
            sample_every: 0,
            checkpoint_every: 100,
            keep: Keep::Last(1),
        }
    }
}

impl Settings for Config {
    const PRESETS: &'static Presets = ACLSTM;
    const FOLDER: (&'static str, &'static str) = ("aclstm", "settings of an auto-conditioned LSTM");
    const RESUMABLE: &'static [&'static str] =
        &["steps", "learning_rate", "eval_every", "sample_every", "checkpoint_every", "keep"];

    fn validate(&self) -> Result<()> {
        within("width", self.width, 1..=8192)?;
        within("layers", self.layers, 1..=16)?;
        within("groundtruth", self.groundtruth, 1..=65_536)?;
        within("condition", self.condition, 0..=65_536)?;
        within("length", self.length, 1..=4096)?;
        within("batch", self.batch, 1..=4096)?;
        within("steps", self.steps, 1..=1 << 40)?;
        within("margin", self.margin, 0..=65_536)?;
        keep(self.keep)?;
        weight("root_weight", self.root_weight)?;
        weight("rotations_weight", self.rotations_weight)?;
        // TOML has no larger integers
        within("seed", self.seed, 0..=i64::MAX as u64)?;
        positive("learning_rate", self.learning_rate)?;
        self.root_order.as_deref().map_or(Ok(()), |letters| rig::order(letters).map(|_| ()))
    }
}

impl Config {
    /// The weights of the loss's parts.
    pub fn parts(&self) -> PartWeights {
        PartWeights { root: self.root_weight, rotations: self.rotations_weight }
    }

    /// The network's shape for this number of channels.
    pub fn shape(&self, channels: usize) -> Shape {
        Shape { channels, width: self.width, layers: self.layers, wiring: self.wiring }
    }

    /// (T) which steps have ground-truth input; the others have the network's own output.
    pub fn given(&self) -> Vec<bool> {
        (0..self.length).map(|t| t % (self.groundtruth + self.condition) < self.groundtruth).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn ground_truth_and_own_frames_alternate() {
        let count = |condition| Config { condition, ..Config::default() }.given().iter().filter(|g| **g).count();
        assert_eq!([0, 5, 30, 45].map(count), [100, 50, 15, 10]);
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
        assert!(said("groundtruth = 0").contains("groundtruth is 0; expected 1 to 65536"));
        assert!(said("learning_rate = nan").contains("learning_rate is NaN"));
        assert!(said("root_order = \"ZZX\"").contains("the order of a joint's angles is \"ZZX\""));
        assert!(said("wiring = \"new\"").contains("a.toml:1:"));
        assert_eq!(Config::find(Path::new("256")).unwrap(), Config::default());
        assert_eq!(Config::find(Path::new("published")).unwrap().shape(171).parameters(), 21_871_787);
    }
}
