//! What a classifier's training keeps on disk until it is done: `NAME.training` beside the folder that it becomes.
//!
//! It holds what was asked (`call.json`), the best weights so far as a classifier's folder has them, and a run's
//! checkpoints. At the end it is renamed, so that nothing stands under the final name before.

use super::folder::{ABOUT, About, METRICS, TOKENIZER};
use super::train::{Standing, TrainOptions};
use crate::{Error, Result};
use candle_core::Tensor;
use kinelm_model::checkpoint::{CheckpointChoice, Checkpoints, State};
use kinelm_model::weights;
use kinelm_store::{FileRecord, files, input};
use kinelm_tokenizer::Tokenizer;
use kinelm_train::folder::RunFolder;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const CALL: &str = "call.json";
/// Files of a checkpoint.
const WEIGHTS: &str = "model.safetensors";
const MOMENTS: &str = "optimizer.safetensors";
const STANDING: &str = "standing.json";

/// What was asked; to go on, the same must be asked again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Asked {
    /// SHA-256 of the run's weights, of the corpus and of the tokenizer.
    pub weights: String,
    pub corpus: String,
    pub tokenizer: String,
    pub options: TrainOptions,
}

/// Tensors by name.
pub(super) type Tensors = BTreeMap<String, Tensor>;

/// Where a training that was cut stood.
pub(super) struct Saved {
    pub standing: Standing,
    /// The model's and the heads'.
    pub tensors: Tensors,
    /// The optimizer's.
    pub moments: Tensors,
}

/// The folder of a classifier that is being trained.
pub(super) struct Work {
    out: PathBuf,
    folder: RunFolder,
    checkpoints: Checkpoints,
    metrics: Vec<u8>,
    seed: u64,
}

/// `who.training` for `who`.
pub(super) fn path_of(out: &Path) -> Result<PathBuf> {
    let no_name = || Error::call(format!("{}: can't be written; expected a name to write to", out.display()));
    let mut name = out.file_name().ok_or_else(no_name)?.to_owned();
    name.push(".training");
    Ok(out.with_file_name(name))
}

impl Work {
    /// Begins a training for the new folder `out`, or finds the one that was cut, and where it stood if it came to its first
    /// measurement.
    ///
    /// # Errors
    /// A folder `out` that is there; one that is being trained, without `resume`; with it, none that is, or one that was
    /// asked for something else; checkpoints none of which is whole; another process that trains it.
    pub fn open(out: &Path, tokenizer: &Tokenizer, asked: &Asked, resume: bool) -> Result<(Work, Option<Saved>)> {
        if fs::symlink_metadata(out).is_ok() {
            let help = "give another --out, or remove it";
            return Err(Error::taken(out, format!("is there already; {help}")));
        }
        let path = path_of(out)?;
        match (fs::symlink_metadata(&path).is_ok(), resume) {
            (true, false) => {
                let help = "the same call with `resume` goes on; or remove that folder";
                return Err(Error::taken(path, format!("is a training that was cut; {help}")));
            }
            (false, true) => {
                let help = "leave `resume` out to begin one";
                return Err(Error::file(path, "nothing", "a training that was cut", help));
            }
            (true, true) => same_call(&path.join(CALL), asked)?,
            (false, false) => {
                let call = serde_json::to_vec_pretty(asked).map_err(|e| Error::call(e.to_string()))?;
                files::write_folder(&path, &[(CALL, call), (TOKENIZER, tokenizer.to_json().into_bytes())])?;
            }
        }
        let (folder, checkpoints) = (RunFolder::locked(&path)?, Checkpoints::of(&path));
        let mut work = Work { out: out.into(), folder, checkpoints, metrics: Vec::new(), seed: asked.options.seed };
        let saved = if work.checkpoints.steps()?.is_empty() { None } else { Some(work.read()?) };
        Ok((work, saved))
    }

    /// Where the training stood; `metrics.jsonl` goes back to there.
    fn read(&mut self) -> Result<Saved> {
        let found = self.checkpoints.find(CheckpointChoice::Latest, &[WEIGHTS, MOMENTS, STANDING], &[], &mut |_| ())?;
        let at = found.dir.join(STANDING);
        let standing: Standing = serde_json::from_slice(&found.files[STANDING])
            .map_err(|e| Error::file(&at, e.to_string(), "where a training stood", ""))?;
        let tensors = |name: &str| weights::from_bytes(&found.dir.join(name), &found.files[name]);
        let path = self.folder.path().join(METRICS);
        let text = match input::peek_bytes(&path) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Vec::new(),
            text => text.map_err(Error::io(&path))?,
        };
        let lines = text.split_inclusive(|&b| b == b'\n').take(standing.told);
        self.metrics = lines.flatten().copied().collect();
        Ok(Saved { standing, tensors: tensors(WEIGHTS)?, moments: tensors(MOMENTS)? })
    }

    /// Adds a line to `metrics.jsonl`.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn tell(&mut self, line: &impl Serialize) -> Result<()> {
        self.metrics.extend(serde_json::to_vec(line).map_err(|e| Error::call(e.to_string()))?);
        self.metrics.push(b'\n');
        Ok(files::write_whole(&self.folder.path().join(METRICS), &self.metrics)?)
    }

    /// Makes these weights the best so far: whole, or those before them stay.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn better(&self, mut about: About, tensors: &Tensors) -> Result<()> {
        let bytes = to_bytes(tensors)?;
        let name = format!("model-{:08}.safetensors", about.step);
        about.weights = (name.clone(), FileRecord::of(&bytes));
        let json = serde_json::to_vec_pretty(&about).map_err(|e| Error::call(e.to_string()))?;
        files::write_whole(&self.folder.path().join(&name), &bytes)?;
        files::write_whole(&self.folder.path().join(ABOUT), &json)?;
        self.remove(|other| other.starts_with("model-") && other != name)
    }

    /// Keeps where the training stands, so that it can go on from here.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn save(&self, standing: &Standing, tensors: &Tensors, moments: &Tensors) -> Result<()> {
        let json = serde_json::to_vec(standing).map_err(|e| Error::call(e.to_string()))?;
        let contents = [(WEIGHTS, to_bytes(tensors)?), (MOMENTS, to_bytes(moments)?), (STANDING, json)];
        self.checkpoints.write(State::new(standing.step, 0, 0, self.seed, None), &contents)?;
        self.checkpoints.prune(1)
    }

    /// The training is done: its folder gets the classifier's name, and loses what was for going on.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn finish(self) -> Result<()> {
        files::rename_new(self.folder.path(), &self.out)?;
        files::sync_folder(files::folder_of(&self.out))?;
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

fn to_bytes(tensors: &Tensors) -> Result<Vec<u8>> {
    weights::to_bytes(tensors.iter().map(|(name, t)| (name.as_str(), t)))
}

/// Refuses to go on with a training of something else.
fn same_call(path: &Path, asked: &Asked) -> Result<()> {
    let text = input::peek_bytes(path).map_err(Error::io(path))?;
    let begun: Asked =
        serde_json::from_slice(&text).map_err(|e| Error::file(path, e.to_string(), "what was asked", ""))?;
    let keys = |asked: &Asked| serde_json::to_value(asked).map_err(|e| Error::call(e.to_string()));
    let (now, then) = (keys(asked)?, keys(&begun)?);
    let (now, then) = (flat(&now), flat(&then));
    match now.iter().zip(&then).find(|(a, b)| a != b) {
        None => Ok(()),
        Some(((key, now), (_, then))) => {
            let help = "`resume` goes on with the very call that was begun";
            Err(Error::file(path, format!("{key} = {now} asked for"), format!("{key} = {then}, as begun"), help))
        }
    }
}

/// The keys of an object and of its options, with their values.
fn flat(asked: &serde_json::Value) -> Vec<(String, String)> {
    let mut all = Vec::new();
    for (key, value) in asked.as_object().into_iter().flatten() {
        match value.is_object() {
            true => all.extend(flat(value)),
            false => all.push((key.clone(), value.to_string())),
        }
    }
    all
}
