//! What a run is to be like.

use super::form::Form;
use super::rig;
use crate::{Error, Result};
use kinelm_engine::lstm::{Shape, Wiring};
use kinelm_store::presets;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Settings of auto-conditioned LSTMs.
pub const ACLSTM: &kinelm_store::presets::Presets = &[
    ("256", include_str!("../../configs/aclstm/256.toml")),
    ("published", include_str!("../../configs/aclstm/published.toml")),
];

/// The settings of a run. `configs/aclstm/` has examples with every key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// How a pose is written.
    pub form: Form,
    /// The order of the root's angles, such as `YXZ`, instead of its file's; for [`Form::Euler`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub root_order: Option<String>,
    /// D, units of a layer.
    pub width: usize,
    /// L.
    pub layers: usize,
    /// How layers are joined.
    #[serde(with = "WiringName")]
    pub wiring: Wiring,
    /// True frames of a sequence that follow each other; at least 1.
    pub groundtruth: usize,
    /// The network's own that come behind them, by turns; 0: it is never fed its own.
    pub condition: usize,
    /// T, steps of a sequence.
    pub length: usize,
    /// B.
    pub batch: usize,
    /// Adam's.
    pub learning_rate: f64,
    /// Updates in all.
    pub steps: u64,
    /// Whether every sequence is turned about the vertical by any angle.
    pub turn: bool,
    /// Frames of a file, at both its ends, that are not used.
    pub margin: usize,
    /// Of all that is drawn.
    pub seed: u64,
    /// Updates between checkpoints; 0: only at the end.
    pub checkpoint_every: u64,
    /// Checkpoints that stay.
    pub keep: usize,
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
            checkpoint_every: 100,
            keep: 1,
        }
    }
}

impl Config {
    /// The settings of a name that is built in ([`ACLSTM`]), else those of a TOML.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] when it is neither; a file that can't be read; keys that are unknown or outside their limits.
    pub fn find(name_or_path: &Path) -> Result<Config> {
        let config: Config = presets::read(ACLSTM, name_or_path, ("aclstm", "settings of an auto-conditioned LSTM"))?;
        config.validate().map_err(|e| Error::call(format!("{}: {e}", name_or_path.display())))?;
        Ok(config)
    }

    /// Checks every key.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] with the first key outside its limits, and both.
    pub fn validate(&self) -> Result<()> {
        let whole = |key: &str, found: u64, least: u64, most: u64| match (least..=most).contains(&found) {
            true => Ok(()),
            false => Err(Error::call(format!("{key} is {found}; expected {least} to {most}"))),
        };
        whole("width", self.width as u64, 1, 8192)?;
        whole("layers", self.layers as u64, 1, 16)?;
        whole("groundtruth", self.groundtruth as u64, 1, 65_536)?;
        whole("condition", self.condition as u64, 0, 65_536)?;
        whole("length", self.length as u64, 1, 4096)?;
        whole("batch", self.batch as u64, 1, 4096)?;
        whole("steps", self.steps, 1, 1 << 40)?;
        whole("margin", self.margin as u64, 0, 65_536)?;
        whole("keep", self.keep as u64, 1, 65_536)?;
        // TOML has no larger integers
        whole("seed", self.seed, 0, i64::MAX as u64)?;
        if !(self.learning_rate > 0.0 && self.learning_rate.is_finite()) {
            return Err(Error::call(format!("learning_rate is {}; expected a number above 0", self.learning_rate)));
        }
        self.root_order.as_deref().map_or(Ok(()), |letters| rig::order(letters).map(|_| ()))
    }

    /// The network's shape for so many channels.
    pub fn shape(&self, channels: usize) -> Shape {
        Shape { channels, width: self.width, layers: self.layers, wiring: self.wiring }
    }

    /// (T) which steps see true frames: some true, some the network's own, by turns.
    pub fn given(&self) -> Vec<bool> {
        (0..self.length).map(|t| t % (self.groundtruth + self.condition) < self.groundtruth).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn true_frames_and_own_ones_by_turns() {
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
        assert!(said("root_order = \"ZZX\"").contains("an order of angles \"ZZX\""));
        assert!(said("wiring = \"new\"").contains("a.toml:1:"));
        assert_eq!(Config::find(Path::new("256")).unwrap(), Config::default());
        assert_eq!(Config::find(Path::new("published")).unwrap().shape(171).parameters(), 21_871_787);
    }
}
