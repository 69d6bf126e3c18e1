//! A new run that goes on from a checkpoint of another one.

use super::folder::RunFolder;
use super::metrics::METRICS;
use super::run::Origin;
use crate::{Error, Result};
use kinelm_model::checkpoint::{Checkpoint, CheckpointChoice, Checkpoints};
use kinelm_model::run::{AVERAGED, OPTIMIZER, WEIGHTS};
use kinelm_store::{FileRecord, files, owned};
use std::path::{Path, PathBuf};

/// Where a run goes on from another one's checkpoint.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Branch {
    /// The checkpoint's updates.
    pub step: u64,
    /// The folder of the new run.
    pub run: PathBuf,
}

impl Branch {
    /// Refuses to end the new run before its first checkpoint.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] with both numbers.
    pub fn check_steps(&self, steps: u64) -> Result<()> {
        match steps < self.step {
            true => Err(Error::invalid_parameter("steps", steps, format!("{} or more, as `from_step` has", self.step))),
            false => Ok(()),
        }
    }

    /// Makes the folder of the new run with the checkpoint of `parent`, the best one up to it, and the metrics. Without
    /// `config.toml`, which makes it a run and is the caller's to write last. Notes what is damaged in `parent`.
    ///
    /// The parent stays as it is, and the new run needs it no more. Where the best one is gone the new run's first
    /// measurement is its best.
    ///
    /// # Errors
    /// A checkpoint that isn't there, with those that are, or is damaged; a folder that exists; what the system refuses.
    pub fn begin(&self, parent: &Path) -> Result<(RunFolder, Origin)> {
        let (own, from) = (Checkpoints::of(&self.run), Checkpoints::of(parent));
        let read = |step| from.find(CheckpointChoice::Step(step), &[WEIGHTS, OPTIMIZER], &[AVERAGED], &mut |_| ());
        let mut found = read(self.step)?;
        let earlier = found.state.best.filter(|best| best.step != self.step).map(|best| read(best.step));
        let best = earlier.and_then(|best| {
            found.state.best = found.state.best.filter(|_| best.is_ok());
            best.ok()
        });
        let sha256 = FileRecord::of(&found.files[WEIGHTS]).sha256;
        let path = std::path::absolute(parent).map_err(Error::io(parent))?;
        let folder = RunFolder::create(&self.run)?;
        for Checkpoint { state, files, .. } in best.into_iter().chain([found]) {
            let named = [WEIGHTS, OPTIMIZER, AVERAGED].into_iter();
            let files: Vec<_> = named.filter_map(|name| Some((name, files.get(name)?.clone()))).collect();
            own.write(state, &files)?;
        }
        // later lines go when the metrics are opened
        if let Some(metrics) = owned::bytes(parent, METRICS, u64::MAX)? {
            files::write_whole(&self.run.join(METRICS), &metrics)?;
        }
        Ok((folder, Origin { path, step: self.step, sha256 }))
    }
}
