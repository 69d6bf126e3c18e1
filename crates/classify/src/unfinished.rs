//! The folder of a classifier whose training isn't done: `NAME.training` beside the folder that it becomes.
//!
//! It holds the call (`call.json`), the best weights so far in the form of a classifier's folder, and a run's checkpoints. It
//! is renamed at the end, so that nothing has the final name before.

use super::folder::{MANIFEST, METRICS, Manifest, TOKENIZER};
use super::options::TrainOptions;
use super::state::TrainState;
use crate::{Error, Result};
use kinelm_model::checkpoint::{Checkpoints, refuse_links};
use kinelm_model::weights::{self, Weights, to_bytes};
use kinelm_store::{FileRecord, files, input, part};
use kinelm_tokenizer::Tokenizer;
use kinelm_train::folder::RunFolder;
use kinelm_train::trainer::{Files, last_checkpoint};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

const CALL: &str = "call.json";
/// Files of a checkpoint.
const WEIGHTS: &str = "model.safetensors";
const MOMENTS: &str = "optimizer.safetensors";
const STATE: &str = "standing.json";

/// The call of a training; it is resumed by the same call.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Call {
    /// SHA-256 of the run's weights, of the corpus and of the tokenizer.
    pub weights: String,
    pub corpus: String,
    pub tokenizer: String,
    pub options: TrainOptions,
}

/// A checkpoint of a training.
pub(super) struct Saved {
    pub state: TrainState,
    /// The model's and the heads'.
    pub weights: Weights,
    /// The optimizer's.
    pub moments: Weights,
}

/// The folder of a classifier that is being trained.
pub(super) struct Unfinished {
    out: PathBuf,
    folder: RunFolder,
    metrics: Vec<u8>,
}

/// `NAME.training` for `NAME`.
pub(super) fn path_of(out: &Path) -> Result<PathBuf> {
    let no_name = || Error::invalid_parameter("out", out.display(), "the path of a new folder");
    let mut name = out.file_name().ok_or_else(no_name)?.to_owned();
    name.push(".training");
    Ok(out.with_file_name(name))
}

impl Unfinished {
    /// Begins a training for the new folder `out`, or opens one that was interrupted, with its last checkpoint if there is
    /// one.
    ///
    /// # Errors
    /// A folder `out` that exists; one that is being trained, without `resume`; with it, none that is, or one of another
    /// call; checkpoints none of which is whole; another process that trains it.
    pub fn open(out: &Path, tokenizer: &Tokenizer, call: &Call, resume: bool) -> Result<(Unfinished, Option<Saved>)> {
        if fs::symlink_metadata(out).is_ok() {
            return Err(Error::taken(out, "is there already; give another `out`, or remove it"));
        }
        let path = path_of(out)?;
        match (fs::symlink_metadata(&path).is_ok(), resume) {
            (true, false) => {
                let help = "the same call with `resume` continues it; or remove that folder";
                return Err(Error::taken(path, format!("is an interrupted training; {help}")));
            }
            (false, true) => {
                let help = "leave `resume` out to begin one";
                return Err(Error::file(path, "nothing", "an interrupted training", help));
            }
            (true, true) => {
                refuse_links(&path)?;
                check_call(&path.join(CALL), call)?;
            }
            (false, false) => {
                let call = serde_json::to_vec_pretty(call).expect("a call is JSON");
                files::write_folder(&path, &[(CALL, call), (TOKENIZER, tokenizer.to_json().into_bytes())])?;
            }
        }
        let folder = RunFolder::locked(&path)?;
        let mut unfinished = Unfinished { out: out.into(), folder, metrics: Vec::new() };
        let saved = unfinished.last()?;
        Ok((unfinished, saved))
    }

    /// The training's checkpoints.
    pub fn checkpoints(&self) -> Checkpoints {
        Checkpoints::of(self.folder.path())
    }

    /// The last checkpoint; lines of `metrics.jsonl` after it are dropped.
    fn last(&mut self) -> Result<Option<Saved>> {
        let found = last_checkpoint(&self.checkpoints(), &[WEIGHTS, MOMENTS, STATE], &mut |_| ())?;
        let Some(found) = found else { return Ok(None) };
        let at = found.dir.join(STATE);
        let state: TrainState = serde_json::from_slice(&found.files[STATE])
            .map_err(|e| Error::file(&at, e.to_string(), "the state of a training", ""))?;
        let tensors = |name: &str| weights::from_bytes(&found.dir.join(name), &found.files[name]);
        let path = self.folder.path().join(METRICS);
        let text = match input::peek_bytes(&path) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Vec::new(),
            text => text.map_err(Error::io(&path))?,
        };
        // later lines are written again by the updates that are repeated
        let lines = text.split_inclusive(|&b| b == b'\n').take(state.lines);
        self.metrics = lines.flatten().copied().collect();
        Ok(Some(Saved { state, weights: tensors(WEIGHTS)?, moments: tensors(MOMENTS)? }))
    }

    /// Adds a line to `metrics.jsonl`.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn log(&mut self, line: &impl Serialize) -> Result<()> {
        self.metrics.extend(serde_json::to_vec(line).expect("metrics are JSON"));
        self.metrics.push(b'\n');
        Ok(files::write_whole(&self.folder.path().join(METRICS), &self.metrics)?)
    }

    /// Stores these weights as the best so far: whole, or the earlier ones stay.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn save_best(&self, mut manifest: Manifest, weights: &Weights) -> Result<()> {
        let bytes = to_bytes(weights)?;
        let name = format!("model-{:08}.safetensors", manifest.step);
        manifest.weights = (name.clone(), FileRecord::of(&bytes));
        let json = serde_json::to_vec_pretty(&manifest).expect("a manifest is JSON");
        // the manifest comes last: it must never name weights that aren't whole
        files::write_whole(&self.folder.path().join(&name), &bytes)?;
        files::write_whole(&self.folder.path().join(MANIFEST), &json)?;
        self.remove(|other| other.starts_with("model-") && other != name)
    }

    /// The files of a checkpoint.
    ///
    /// # Errors
    /// None in practice.
    pub fn files(state: &TrainState, weights: &Weights, moments: &Weights) -> Result<Files> {
        let json = serde_json::to_vec(state).expect("the state of a training is JSON");
        Ok(vec![(WEIGHTS, to_bytes(weights)?), (MOMENTS, to_bytes(moments)?), (STATE, json)])
    }

    /// Ends a training: its folder gets the classifier's name, and loses what resuming needs.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn finish(&self) -> Result<()> {
        // renamed first: a kill after it leaves a whole classifier, and some files to spare
        files::rename_new(self.folder.path(), &self.out)?;
        part::sync_folder(part::folder_of(&self.out))?;
        let dir = self.out.join("checkpoints");
        fs::remove_dir_all(&dir).map_err(Error::io(&dir))?;
        for name in [CALL, "latest", ".lock"] {
            let path = self.out.join(name);
            fs::remove_file(&path).map_err(Error::io(&path))?;
        }
        Ok(())
    }

    fn remove(&self, is_done: impl Fn(&str) -> bool) -> Result<()> {
        let folder = self.folder.path();
        for entry in fs::read_dir(folder).map_err(Error::io(folder))?.flatten() {
            if is_done(&entry.file_name().to_string_lossy()) {
                // nothing names it any more
                let _ = fs::remove_file(entry.path());
            }
        }
        Ok(())
    }
}

/// Refuses to resume another call's training.
fn check_call(path: &Path, call: &Call) -> Result<()> {
    let text = input::peek_bytes(path).map_err(Error::io(path))?;
    let begun: Call =
        serde_json::from_slice(&text).map_err(|e| Error::file(path, e.to_string(), "the call of a training", ""))?;
    let [now, then] = [call, &begun].map(|call| flat(&serde_json::to_value(call).expect("a call is JSON")));
    match now.iter().zip(&then).find(|(a, b)| a != b) {
        None => Ok(()),
        Some(((key, now), (_, then))) => {
            let help = "resume by the same call";
            Err(Error::file(path, format!("{key} = {now} requested"), format!("{key} = {then}, as begun"), help))
        }
    }
}

/// The keys of an object and of its options, with their values.
fn flat(call: &serde_json::Value) -> Vec<(String, String)> {
    let mut all = Vec::new();
    for (key, value) in call.as_object().into_iter().flatten() {
        match value.is_object() {
            true => all.extend(flat(value)),
            false => all.push((key.clone(), value.to_string())),
        }
    }
    all
}
