//! A trained model out of its run folder.

use super::checkpoint::{CheckpointChoice, Checkpoints, State};
use super::config::{ModelConfig, TokenLayout};
use super::decode::{Reader, ReaderOptions};
use super::device::{Compute, DeviceName};
use super::fast::Fast;
use super::gpt::Gpt;
use super::likelihood::likelihood;
use super::scored_windows::Likelihood;
use super::scores::Scores;
use super::weights::{self, Weights};
use crate::{Error, Result};
use kinelm_corpus::conditions::{Conditions, in_order};
use kinelm_corpus::{Corpus, Split};
use kinelm_store::input;
use kinelm_tokenizer::Tokenizer;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// The weights' file in a checkpoint.
pub const WEIGHTS: &str = "model.safetensors";
/// The moving average of the weights; where a checkpoint has it, it is the model.
pub const AVERAGED: &str = "ema.safetensors";
/// The optimizer's file in a checkpoint.
pub const OPTIMIZER: &str = "optimizer.safetensors";
/// The run's configuration.
pub const CONFIG: &str = "config.toml";
/// The bits per frame of the run's held-out clips, where it stores them.
pub const HELD_OUT: &str = "held_out.json";
/// How the run's train clips move, by which dances are chosen.
pub const LIMITS: &str = "limits.json";
/// The run's tokenizer.
pub const TOKENIZER: &str = "tokenizer.json";

/// A model's weights and settings, in no form yet.
pub struct LoadedRun {
    /// The model's shape.
    pub config: ModelConfig,
    /// The layout of its tokens.
    pub tokens: TokenLayout,
    /// The label fields that condition it, in the order of their tokens after `<bos>`.
    pub conditions: Vec<String>,
    /// The share of the labels that were hidden in its training, where that is known.
    pub label_dropout: Option<f64>,
    /// Its weights: their moving average if the checkpoint has it.
    pub weights: Weights,
    /// Path of the tokenizer that it was trained with; [`LoadedRun::load_tokenizer`] checks its hash.
    pub tokenizer: PathBuf,
    /// The hash of that tokenizer.
    pub tokenizer_sha256: String,
    /// The checkpoint's folder.
    pub checkpoint: PathBuf,
    /// The run's state at that checkpoint.
    pub state: State,
    /// Notes for the user: checkpoints that were passed over, and why.
    pub notes: Vec<String>,
}

impl LoadedRun {
    /// The tokenizer it was trained with.
    ///
    /// # Errors
    /// As [`load_tokenizer`].
    pub fn load_tokenizer(&self) -> Result<Tokenizer> {
        load_tokenizer(&self.tokenizer, &self.tokenizer_sha256)
    }

    /// Its conditions with the ids of their values, from its tokenizer.
    ///
    /// # Errors
    /// A tokenizer that can't be read, is another or has other ids than the model.
    pub fn load_conditions(&self) -> Result<Conditions> {
        let tokenizer = self.load_tokenizer()?;
        let conditions = Conditions::new(&self.conditions, tokenizer.vocabulary());
        let (found, ids) = (tokenizer.vocabulary().len() as usize, self.tokens.vocabulary);
        if found != ids || conditions.len() != self.tokens.front {
            let (k, front) = (conditions.len(), self.tokens.front);
            let found = format!("{found} ids and {k} tokens in front of a window");
            let expected = format!("{ids} ids and {front} tokens, as config.toml says");
            return Err(Error::file(&self.tokenizer, found, expected, "put back the files that the run was made with"));
        }
        Ok(conditions)
    }

    /// SHA-256 of its weights file, from the checkpoint.
    pub fn weights_sha256(&self) -> String {
        let files = &self.state.files;
        files.get(AVERAGED).or(files.get(WEIGHTS)).map(|file| file.sha256.clone()).unwrap_or_default()
    }

    /// The plain model on `device`.
    ///
    /// # Errors
    /// Weights that don't fit the configuration, each named; what the device refuses.
    pub fn plain(&self, device: DeviceName) -> Result<Gpt> {
        Gpt::from_weights(&self.config, &self.tokens, &self.weights, device)
    }

    /// The model on the CPU, ready to read.
    ///
    /// # Errors
    /// As [`LoadedRun::plain`]; no sequences.
    pub fn reader(&self, reading: ReaderOptions) -> Result<Reader> {
        Reader::new(&self.plain(DeviceName::Cpu)?, reading)
    }

    /// The same for sequences of which every `each` belong together, as [`Reader::side_by_side`] groups them.
    ///
    /// # Errors
    /// As [`LoadedRun::reader`].
    pub fn readers(&self, reading: ReaderOptions, each: usize) -> Result<Vec<Reader>> {
        Reader::side_by_side(&self.plain(DeviceName::Cpu)?, reading, each)
    }

    /// The likelihood of a split's clips under their labels, each token scored once; `None` where they have no frame.
    ///
    /// # Errors
    /// Those of [`LoadedRun::scores`] and [`likelihood`].
    pub fn likelihood(&self, corpus: &Corpus, split: Split, compute: Compute) -> Result<Option<Likelihood>> {
        let clips: Vec<_> = corpus.split(split).collect();
        likelihood(&mut *self.scores(compute)?, corpus, &clips, 0, &self.load_conditions()?)
    }

    /// The model in the requested form, to measure with.
    ///
    /// # Errors
    /// As [`LoadedRun::plain`]; a device that isn't there.
    pub fn scores(&self, compute: Compute) -> Result<Box<dyn Scores>> {
        if compute.is_fast() {
            return Ok(Box::new(Fast::from_weights(&self.config, &self.tokens, &self.weights)?));
        }
        Ok(Box::new(self.plain(compute.device)?))
    }
}

/// The tokenizer at `path`, which must be the one that a model was made with: one of the same shape would turn its codes into
/// other motion, and nothing else would tell.
///
/// # Errors
/// A tokenizer that can't be read, or has another hash than `expected`.
pub fn load_tokenizer(path: &Path, expected: &str) -> Result<Tokenizer> {
    let tokenizer = Tokenizer::load(path)?;
    match tokenizer.hash() {
        found if found == expected => Ok(tokenizer),
        found => Err(Error::file(
            path,
            format!("tokenizer {found}"),
            format!("the run's, {expected}"),
            "put back the tokenizer.json that the run was begun with",
        )),
    }
}

/// The keys of `config.toml` that are read; the others are for training.
#[derive(Deserialize)]
struct Needed {
    tokenizer_sha256: String,
    model: ModelConfig,
    tokens: TokenLayout,
    #[serde(default)]
    train: TrainKeys,
}

/// Refuses a model with sound conditioning that doesn't say how the sound is standardised.
fn scaled(model: ModelConfig, path: &Path) -> Result<ModelConfig> {
    if model.music.has_features() && model.music_scale.is_none() {
        let help = "it is written when a run begins: put back the file that the run was made with";
        return Err(Error::file(path, "no model.music_scale", "that of the run's training clips", help));
    }
    Ok(model)
}

/// The keys of its `[train]` table that are read.
#[derive(Default, Deserialize)]
#[serde(default)]
struct TrainKeys {
    conditions: Vec<String>,
    label_dropout: Option<f64>,
}

/// Refuses the configuration of a run that is no GPT's: it has a `kind`.
///
/// # Errors
/// [`kinelm_store::Error::File`] with the kind, and who reads it.
pub fn check_kind(path: &Path, text: &str) -> Result<()> {
    let table: Option<toml::Table> = toml::from_str(text).ok();
    match table.as_ref().and_then(|table| table.get("kind")?.as_str()) {
        None => Ok(()),
        Some(kind) => {
            let help = format!("kinelm {kind} has commands of its own for it");
            Err(Error::file(path, format!("a run of kind {kind:?}"), "one of a GPT", help))
        }
    }
}

/// Loads a model from a run folder; by default the best on the validation clips, or the latest where there were none.
///
/// A checkpoint that is damaged is passed over for the one before it, with a note.
///
/// # Errors
/// No run folder, no checkpoint that is whole.
pub fn load_run(run: &Path, which: CheckpointChoice) -> Result<LoadedRun> {
    let path = run.join(CONFIG);
    let text = input::text(&path).map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound => {
            let help = "a run is a folder that `kinelm pretrain --run RUN` wrote";
            Error::file(run, "no config.toml", "a run folder", help)
        }
        _ => Error::io(&path)(e),
    })?;
    check_kind(&path, &text)?;
    let needed: Needed = toml::from_str(&text)
        .map_err(|e| Error::file(&path, e.message().to_string(), "the configuration of a run", ""))?;
    let mut notes = Vec::new();
    let found = Checkpoints::of(run).find(which, &[WEIGHTS], &[AVERAGED], &mut |n| notes.push(n))?;
    // the validation figures, by which the best was chosen, are the average's too
    let file = if found.files.contains_key(AVERAGED) { AVERAGED } else { WEIGHTS };
    let weights = weights::from_bytes(&found.dir.join(file), &found.files[file])?;
    Ok(LoadedRun {
        config: scaled(needed.model, &path)?,
        tokens: needed.tokens,
        conditions: in_order(&needed.train.conditions),
        label_dropout: needed.train.label_dropout,
        weights,
        tokenizer: run.join(TOKENIZER),
        tokenizer_sha256: needed.tokenizer_sha256,
        checkpoint: found.dir,
        state: found.state,
        notes,
    })
}
