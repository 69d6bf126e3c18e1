//! A classifier's folder: `classifier.json`, the weights it names, `tokenizer.json`, `metrics.jsonl`.

use super::fields::{Fields, Only};
use super::learner::head_name;
use super::windows::Layout;
use crate::corpus::FileRecord;
use crate::model::fast::Fast;
use crate::model::{ModelConfig, TokenLayout, weights};
use crate::{Error, Result, files};
use candle_core::Tensor;
use kinelm_engine::arena::Floats;
use kinelm_tokenizer::Tokenizer;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const ABOUT: &str = "classifier.json";
const TOKENIZER: &str = "tokenizer.json";
const METRICS: &str = "metrics.jsonl";

/// `classifier.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// The version of this file: 1.
    pub schema: u32,
    /// The program that wrote it.
    pub kinelm: String,
    /// The shape of the model.
    pub model: ModelConfig,
    /// Its tokens without the class tokens, which are the ids behind them.
    pub tokens: TokenLayout,
    /// What it tells.
    pub fields: Fields,
    /// Whether a class token sees those before it.
    pub compat: bool,
    /// The clips it learned from met these.
    pub only: Vec<Only>,
    /// The run that it began with; none where it began with nothing.
    pub from: Option<PathBuf>,
    /// The share of the training clips whose labels it saw.
    pub share: f64,
    /// The seed that chose them, and drew all else.
    pub seed: u64,
    /// Updates done.
    pub step: u64,
    /// Mean -ln p of the class on the validation windows, summed over the fields; none without validation clips.
    pub valid_nats: Option<f64>,
    /// The hash of its tokenizer without conditioning tokens.
    pub tokenizer: String,
    /// The weights' file and what it holds.
    pub weights: (String, FileRecord),
}

/// A trained classifier.
pub struct Classifier {
    /// What it is.
    pub about: About,
    /// Its tokenizer.
    pub tokenizer: Tokenizer,
    pub(super) model: Fast,
    pub(super) heads: Vec<Floats>,
    pub(super) layout: Layout,
}

impl Classifier {
    /// Reads a classifier's folder.
    ///
    /// # Errors
    /// A folder that is none; another version; files that are missing, cut short or of something else: each is named.
    pub fn load(folder: &Path) -> Result<Classifier> {
        let path = folder.join(ABOUT);
        let help = "a classifier is a folder that `kinelm classify train --out FOLDER` wrote";
        let text = fs::read_to_string(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => Error::file(folder, format!("no {ABOUT}"), "a classifier's folder", help),
            _ => Error::io(&path)(e),
        })?;
        let found = serde_json::from_str::<serde_json::Value>(&text).ok().and_then(|v| v["schema"].as_u64());
        if found != Some(1) {
            let found = found.map_or("no schema".into(), |n| format!("schema {n}"));
            return Err(Error::file(&path, found, "schema 1", "train it again, or take the kinelm that wrote it"));
        }
        let about: About = serde_json::from_str(&text)
            .map_err(|e| Error::file(&path, e.to_string(), "what tells of a classifier", help))?;
        let (name, record) = &about.weights;
        let at = folder.join(name);
        let bytes = fs::read(&at).map_err(Error::io(&at))?;
        if FileRecord::of(&bytes) != *record {
            let say = |r: &FileRecord| format!("{} bytes with SHA-256 {}", r.bytes, r.sha256);
            let help = "the file was cut or changed after it was written: train the classifier again";
            return Err(Error::file(&at, say(&FileRecord::of(&bytes)), say(record), help));
        }
        let mut tensors = weights::from_bytes(&at, &bytes)?;
        let tokenizer = Tokenizer::load(folder.join(TOKENIZER))?;
        if tokenizer.base_hash() != about.tokenizer {
            // one of the same shape would read other motion into the codes, and nothing else would tell
            let (found, expected) = (tokenizer.base_hash(), &about.tokenizer);
            let help = "put back the tokenizer.json that the classifier was trained with, or train it again";
            let at = folder.join(TOKENIZER);
            return Err(Error::file(at, format!("tokenizer {found}"), format!("the classifier's, {expected}"), help));
        }
        let layout = Layout::new(&about.model, &about.tokens, about.fields.len())?;
        let heads = heads(&at, &about, &mut tensors)?;
        let model = Fast::from_tensors(&about.model, &grown(&about.tokens, &about.fields), tensors)?;
        Ok(Classifier { about, tokenizer, model, heads, layout })
    }
}

/// The tokens with a class token a field behind them.
pub(super) fn grown(tokens: &TokenLayout, fields: &Fields) -> TokenLayout {
    TokenLayout { vocabulary: tokens.vocabulary + fields.len(), ..tokens.clone() }
}

fn heads(path: &Path, about: &About, tensors: &mut BTreeMap<String, Tensor>) -> Result<Vec<Floats>> {
    let one = |field: &super::Field| {
        let (name, shape) = (head_name(&field.name), [field.classes.len(), about.model.width]);
        let tensor = tensors.remove(&name).filter(|t| t.dims() == shape);
        let tensor = tensor.ok_or_else(|| {
            Error::file(
                path,
                format!("no tensor {name} of shape {shape:?}"),
                "the heads of all fields",
                "train it again",
            )
        })?;
        Ok(Floats::of(&tensor.flatten_all()?.to_vec1::<f32>()?))
    };
    about.fields.0.iter().map(one).collect()
}

/// The folder of a classifier that is being trained: it comes to be with the first weights, whole.
pub(super) struct Writer {
    folder: PathBuf,
    tokenizer: Vec<u8>,
    metrics: Vec<u8>,
    is_there: bool,
}

impl Writer {
    /// For a new folder.
    ///
    /// # Errors
    /// A folder that is there.
    pub fn new(folder: &Path, tokenizer: &Tokenizer) -> Result<Writer> {
        if fs::symlink_metadata(folder).is_ok() {
            let help = "give another --out, or remove it";
            return Err(Error::file(folder, "something is there", "no such folder", help));
        }
        let tokenizer = tokenizer.to_json().into_bytes();
        Ok(Writer { folder: folder.into(), tokenizer, metrics: Vec::new(), is_there: false })
    }

    /// Adds a line to `metrics.jsonl`, which is written with the first weights, then at every line.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn tell(&mut self, line: &impl Serialize) -> Result<()> {
        self.metrics.extend(serde_json::to_vec(line).map_err(|e| Error::Call(e.to_string()))?);
        self.metrics.push(b'\n');
        match self.is_there {
            true => files::write_whole(&self.folder.join(METRICS), &self.metrics),
            false => Ok(()),
        }
    }

    /// Makes these weights the classifier: whole, or those before them stay.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn write(&mut self, mut about: About, tensors: &BTreeMap<String, Tensor>) -> Result<()> {
        let bytes = weights::to_bytes(tensors.iter().map(|(name, t)| (name.as_str(), t)))?;
        let name = format!("model-{:08}.safetensors", about.step);
        about.weights = (name.clone(), FileRecord::of(&bytes));
        let json = serde_json::to_vec_pretty(&about).map_err(|e| Error::Call(e.to_string()))?;
        if !self.is_there {
            let (tokenizer, metrics) = (self.tokenizer.clone(), self.metrics.clone());
            let all = [(TOKENIZER, tokenizer), (METRICS, metrics), (name.as_str(), bytes), (ABOUT, json)];
            files::write_folder(&self.folder, &all)?;
            self.is_there = true;
            return Ok(());
        }
        files::write_whole(&self.folder.join(&name), &bytes)?;
        files::write_whole(&self.folder.join(ABOUT), &json)?;
        for entry in fs::read_dir(&self.folder).map_err(Error::io(&self.folder))?.flatten() {
            let other = entry.file_name();
            let other = other.to_string_lossy();
            if other.starts_with("model-") && *other != *name {
                // nothing names it any more
                let _ = fs::remove_file(entry.path());
            }
        }
        Ok(())
    }
}
