//! A run's `config.toml`, and a trained network out of its folder.

use super::{Config, network};
use crate::Result;
use crate::data::{Hashes, Recordings, Sources, check_files};
use crate::form::Coder;
use crate::rig::Rig;
use crate::run::{self, Checkpoint, Kind, RunConfig};
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::Shape;
use kinelm_model::checkpoint::CheckpointChoice;
use kinelm_train::run::Origin;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

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
    /// The rig, with the order of the root's angles that the settings give.
    pub rig: Rig,
    /// Where the motion is; in the file, relative to the run's folder.
    pub sources: Sources,
    /// SHA-256 of each motion file.
    pub files: Hashes,
    /// The run that it goes on from, and its checkpoint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<Origin>,
}

impl RunFile {
    /// The configuration of a new run.
    pub fn new(config: &Config, sources: &Sources, recordings: &Recordings) -> RunFile {
        let mut rig = recordings.rig.clone();
        if let (Some(order), Some(root)) = (&config.root_order, rig.orders.first_mut()) {
            root.clone_from(order);
        }
        RunFile {
            kind: Self::KIND.name.into(),
            version: Self::KIND.version,
            clips_sha256: recordings.sha256(),
            config: config.clone(),
            rig,
            sources: sources.clone(),
            files: recordings.files(),
            from: None,
        }
    }

    /// The clips that `run` learns from and is measured on.
    ///
    /// # Errors
    /// What reading fails with; files that have changed since it was begun.
    pub(crate) fn recordings(&self, run: &Path) -> Result<Recordings> {
        let recordings = Recordings::load(&self.sources, self.config.margin, Some(&self.rig))?;
        check_files(run, [&self.clips_sha256, &recordings.sha256()], [&self.files, &recordings.files()])?;
        Ok(recordings)
    }

    /// The form on the rig.
    ///
    /// # Errors
    /// Orders of angles that are none.
    pub(crate) fn coder(&self) -> Result<Coder> {
        Coder::new(self.config.form, &self.rig)
    }
}

impl RunConfig for RunFile {
    type Config = Config;

    const KIND: Kind =
        Kind { name: "aclstm", one_of: "one of an auto-conditioned LSTM", command: "kinelm aclstm train", version: 3 };

    fn with_paths(&self, path: &dyn Fn(&Path) -> PathBuf) -> RunFile {
        let from = self.from.clone().map(|from| Origin { path: path(&from.path), ..from });
        RunFile { sources: self.sources.with_paths(path), from, ..self.clone() }
    }

    fn config(&mut self) -> &mut Config {
        &mut self.config
    }

    fn from(&mut self) -> &mut Option<Origin> {
        &mut self.from
    }

    fn steps(config: &mut Config) -> &mut u64 {
        &mut config.steps
    }
}

/// A trained network.
pub struct Trained {
    /// Its run folder.
    pub run: PathBuf,
    /// The configuration of its run.
    pub file: RunFile,
    /// Its form on its rig.
    pub coder: Coder,
    /// Its shape.
    pub shape: Shape,
    /// Its weights, in the order of [`Shape::tensors`].
    pub weights: Vec<Floats>,
    /// Updates done.
    pub step: u64,
    /// SHA-256 of the file of the weights.
    pub sha256: String,
    /// What the user should know.
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
        let Checkpoint { weights, step, sha256, notes } = run::load(run, which, &network::list(&shape))?;
        Ok(Trained { run: run.into(), coder, shape, weights, step, sha256, notes, file })
    }
}
