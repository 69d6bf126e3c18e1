//! A run's `config.toml`, and a trained network out of its folder.

use super::data::{Hashes, Recordings, Sources, check_files};
use super::form::Coder;
use super::{Config, Rig, network};
use crate::{Error, Result};
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::Shape;
use kinelm_model::checkpoint::{CheckpointChoice, Checkpoints};
use kinelm_model::run::{CONFIG, WEIGHTS};
use kinelm_model::weights;
use kinelm_store::{FileRecord, files};
use kinelm_train::parameters::numbers;
use kinelm_train::updates::Kind;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What tells such a run from others.
const KIND: Kind =
    Kind { name: "aclstm", one_of: "one of an auto-conditioned LSTM", command: "kinelm aclstm train", version: 2 };

/// `config.toml` of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// `aclstm`.
    pub kind: String,
    /// The layout's version.
    pub version: u32,
    /// One hash of the clips.
    pub clips_sha256: String,
    /// The settings.
    pub config: Config,
    /// The rig, with the order of the root's angles that the settings ask for.
    pub rig: Rig,
    /// Where the motion is, in the file from the run's folder on.
    pub sources: Sources,
    /// SHA-256 of each file of motion; runs of before don't know it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: Hashes,
}

impl RunFile {
    /// Of a new run.
    pub fn new(config: &Config, sources: &Sources, recordings: &Recordings) -> RunFile {
        let mut rig = recordings.rig.clone();
        if let (Some(order), Some(root)) = (&config.root_order, rig.orders.first_mut()) {
            root.clone_from(order);
        }
        RunFile {
            kind: KIND.name.into(),
            version: KIND.version,
            clips_sha256: recordings.sha256(),
            config: config.clone(),
            rig,
            sources: sources.clone(),
            files: recordings.files(),
        }
    }

    /// The clips that `run` has learned from and is measured on.
    ///
    /// # Errors
    /// What reading fails with; files that have changed since.
    pub fn recordings(&self, run: &Path) -> Result<Recordings> {
        let recordings = Recordings::load(&self.sources, self.config.margin, Some(&self.rig))?;
        check_files(run, [&self.clips_sha256, &recordings.sha256()], [&self.files, &recordings.files()])?;
        Ok(recordings)
    }

    /// Writes it.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn write(&self, run: &Path) -> Result<()> {
        let sources = self.sources.with_paths(|path| files::path_from(run, path));
        KIND.write(run, &RunFile { sources, ..self.clone() })
    }

    /// Reads that of a run.
    ///
    /// # Errors
    /// A folder without one, a run of another kind, another version, keys that are wrong.
    pub fn read(run: &Path) -> Result<RunFile> {
        let mut file: RunFile = KIND.read(run)?;
        file.sources = file.sources.with_paths(|path| files::path_in(run, path));
        file.config.validate().map_err(|e| Error::call(format!("{}: {e}", run.join(CONFIG).display())))?;
        Ok(file)
    }

    /// The form on the rig.
    ///
    /// # Errors
    /// Orders of angles that are none.
    pub fn coder(&self) -> Result<Coder> {
        Coder::new(self.config.form, &self.rig)
    }
}

/// A trained network.
pub struct Trained {
    /// Its run folder.
    pub run: PathBuf,
    /// What its run is.
    pub file: RunFile,
    /// Its form on its rig.
    pub coder: Coder,
    /// Its shape.
    pub shape: Shape,
    /// Its weights, in the order of [`Shape::tensors`].
    pub weights: Vec<Floats>,
    /// Updates that they had.
    pub step: u64,
    /// SHA-256 of their file.
    pub sha256: String,
    /// What the user should be told.
    pub notes: Vec<String>,
}

impl Trained {
    /// The network of a run at a checkpoint.
    ///
    /// # Errors
    /// A folder that is no run of this kind; no checkpoint that is whole; weights of another network.
    pub fn load(run: &Path, which: CheckpointChoice) -> Result<Trained> {
        let file = RunFile::read(run)?;
        let coder = file.coder()?;
        let shape = file.config.shape(coder.channels());
        let mut notes = Vec::new();
        let found = Checkpoints::of(run).find(which, &[WEIGHTS], &[], &mut |note| notes.push(note))?;
        let (path, bytes) = (found.dir.join(WEIGHTS), &found.files[WEIGHTS]);
        let weights =
            numbers(&network::list(&shape), &weights::from_bytes(&path, bytes)?, "").map_err(|e| match e {
                Error::Weights(found) => Error::file(&path, found, "the network that config.toml describes", ""),
                other => other,
            })?;
        let (step, sha256) = (found.state.step, FileRecord::of(bytes).sha256);
        Ok(Trained { run: run.into(), coder, shape, weights, step, sha256, notes, file })
    }
}
