//! What is where on the page of a study.

use super::Ask;
use crate::{Error, Result};
use kinelm_store::input;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The key of a study, a file of its maker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// 1.
    pub schema: u32,
    /// What is asked.
    pub ask: Ask,
    /// SHA-256 that the page and its votes name.
    pub page: String,
    /// The seed of pairs, order and sides.
    pub seed: u64,
    /// The length of every clip, seconds.
    pub seconds: f64,
    /// Their frames per second.
    pub fps: f64,
    /// The folders A, B and, with an X, C.
    pub folders: Vec<PathBuf>,
    /// In the order of the page.
    pub trials: Vec<Trial>,
}

/// A trial as the page has it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trial {
    /// The clip on the left, 1.
    pub left: Source,
    /// The clip on the right, 2.
    pub right: Source,
    /// The clip in the middle, X.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x: Option<PathBuf>,
}

/// A clip of a pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// 0: of A, 1: of B.
    pub folder: usize,
    /// The file.
    pub clip: PathBuf,
}

impl Key {
    /// Version of the file.
    pub const SCHEMA: u32 = 1;

    /// Reads a key.
    ///
    /// # Errors
    /// I/O errors; [`kinelm_store::Error::File`] for anything but a key of this version.
    pub fn load(path: &Path) -> Result<Key> {
        let bytes = input::bytes(path).map_err(Error::io(path))?;
        let wrong = |found: String| {
            let help = "give the .key.json that `evaluate blind make` wrote beside the page";
            Error::file(path, found, "the key of a study", help)
        };
        let key: Key = serde_json::from_slice(&bytes).map_err(|e| wrong(e.to_string()))?;
        let is_whole = |trial: &Trial| trial.left.folder + trial.right.folder == 1;
        if key.schema != Key::SCHEMA || key.trials.is_empty() || !key.trials.iter().all(is_whole) {
            return Err(wrong(format!("version {} with {} trials", key.schema, key.trials.len())));
        }
        Ok(key)
    }
}
