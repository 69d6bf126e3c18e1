//! The run folder: configuration, tokenizer and corpus description of a training run.

use super::config::TrainConfig;
use crate::corpus::Corpus;
use crate::model::run::{CONFIG, TOKENIZER};
use crate::model::{ModelConfig, TokenLayout};
use crate::{Error, Result, files};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// The layout of `config.toml` that this program writes and reads.
const VERSION: u32 = 1;

/// `config.toml` of a run folder: every option resolved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// The layout's version.
    pub version: u32,
    /// The version of kinelm that began the run.
    pub kinelm: String,
    /// The corpus folder.
    pub corpus: PathBuf,
    /// The corpus's hash.
    pub corpus_sha256: String,
    /// The tokenizer's hash.
    pub tokenizer_sha256: String,
    /// The model.
    pub model: ModelConfig,
    /// How it is trained.
    pub train: TrainConfig,
    /// What the tokenizer decided.
    pub tokens: TokenLayout,
}

impl RunFile {
    /// The configuration of a new run on `corpus`.
    ///
    /// # Errors
    /// Keys outside their limits, a context too short for the corpus's words, a corpus path that can't be made absolute.
    pub fn new(model: &ModelConfig, train: &TrainConfig, corpus: &Corpus) -> Result<RunFile> {
        let tokens = TokenLayout::of(corpus.tokenizer());
        model.validate_for(&tokens)?;
        train.validate()?;
        Ok(RunFile {
            version: VERSION,
            kinelm: env!("CARGO_PKG_VERSION").into(),
            corpus: std::path::absolute(corpus.dir()).map_err(Error::io(corpus.dir()))?,
            corpus_sha256: corpus.hash().into(),
            tokenizer_sha256: corpus.manifest().tokenizer.clone(),
            model: model.clone(),
            train: train.clone(),
            tokens,
        })
    }

    /// Puts the tokenizer and the corpus's description into the run folder.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn put_beside(&self, run: &Path, corpus: &Corpus) -> Result<()> {
        let from = corpus.dir().join("corpus.json");
        let description = fs::read(&from).map_err(Error::io(&from))?;
        files::write_whole(&run.join("corpus.json"), &description)?;
        files::write_whole(&run.join(TOKENIZER), corpus.tokenizer().to_json().as_bytes())
    }

    /// Writes `config.toml`.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn write(&self, run: &Path) -> Result<()> {
        let text = toml::to_string(self).map_err(|e| Error::Call(format!("{CONFIG} can't be written: {e}")))?;
        files::write_whole(&run.join(CONFIG), text.as_bytes())
    }

    /// Reads the configuration of a run.
    ///
    /// # Errors
    /// No run there, another version, wrong keys.
    pub fn read(run: &Path) -> Result<RunFile> {
        let path = run.join(CONFIG);
        let text = fs::read_to_string(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => {
                Error::file(run, "no config.toml", "a run folder", "leave --resume out to begin a run")
            }
            _ => Error::io(&path)(e),
        })?;
        let file: RunFile = toml::from_str(&text)
            .map_err(|e| Error::file(&path, e.message().to_string(), "the configuration of a run", ""))?;
        match file.version {
            VERSION => Ok(file),
            other => Err(Error::file(&path, format!("version {other}"), format!("version {VERSION}"), "")),
        }
    }

    /// Whether `corpus` is the one the run was begun on.
    ///
    /// # Errors
    /// Another corpus: both hashes.
    pub fn check_corpus(&self, corpus: &Corpus) -> Result<()> {
        match self.corpus_sha256 == corpus.hash() {
            true => Ok(()),
            false => Err(Error::file(
                corpus.dir(),
                format!("a corpus with hash {}", corpus.hash()),
                format!("the run's, {}", self.corpus_sha256),
                "begin a new run on another corpus",
            )),
        }
    }
}
