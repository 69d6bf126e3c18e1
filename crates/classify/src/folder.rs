//! A classifier's folder: `classifier.json`, the weights it names, `tokenizer.json`, `metrics.jsonl`.

use super::fields::{Fields, Only};
use super::learner::head_name;
use crate::{Error, Result};
use candle_core::Tensor;
use kinelm_engine::arena::Floats;
use kinelm_model::class_windows::Layout;
use kinelm_model::fast::Fast;
use kinelm_model::{Architecture, ModelConfig, TokenLayout, weights};
use kinelm_store::{FileRecord, files, input};
use kinelm_tokenizer::Tokenizer;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub(super) const ABOUT: &str = "classifier.json";
pub(super) const TOKENIZER: &str = "tokenizer.json";
pub(super) const METRICS: &str = "metrics.jsonl";

/// The layout that this program writes and reads.
pub(super) const SCHEMA: u32 = 2;

/// `classifier.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// The version of this file, `SCHEMA`.
    pub schema: u32,
    /// The program that wrote it.
    pub kinelm: String,
    /// The shape of the model.
    pub model: ModelConfig,
    /// Its tokens without the class tokens, which in a flat model are the ids behind them.
    pub tokens: TokenLayout,
    /// What it tells.
    pub fields: Fields,
    /// Whether a class token sees those before it.
    pub compat: bool,
    /// The clips it learned from met these.
    pub only: Vec<Only>,
    /// The corpus that it learned from.
    pub corpus: PathBuf,
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
        let text = input::text(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => Error::file(folder, format!("no {ABOUT}"), "a classifier's folder", help),
            _ => Error::io(&path)(e),
        })?;
        let found = serde_json::from_str::<serde_json::Value>(&text).ok().and_then(|v| v["schema"].as_u64());
        if found != Some(SCHEMA.into()) {
            let found = found.map_or("no schema".into(), |n| format!("schema {n}"));
            return Err(Error::file(
                &path,
                found,
                format!("schema {SCHEMA}"),
                "train it again, or take the kinelm that wrote it",
            ));
        }
        let about: About = serde_json::from_str(&text)
            .map_err(|e| Error::file(&path, e.to_string(), "what tells of a classifier", help))?;
        let (name, record) = &about.weights;
        if !files::is_plain(name) {
            let expected = "the name of a file in the classifier's folder";
            return Err(Error::file(&path, format!("weights in `{name}`"), expected, help));
        }
        let at = folder.join(name);
        let bytes = input::bytes(&at).map_err(Error::io(&at))?;
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
        let heads = heads(&at, &about.fields, about.model.width, &mut tensors)?;
        let (config, tokens) = grown(&about.model, &about.tokens, &about.fields);
        let model = Fast::from_tensors(&config, &tokens, tensors)?;
        Ok(Classifier { about, tokenizer, model, heads, layout })
    }
}

/// A model with a class token a field behind its tokens, or with as many class rows.
pub(super) fn grown(config: &ModelConfig, tokens: &TokenLayout, fields: &Fields) -> (ModelConfig, TokenLayout) {
    match config.architecture {
        Architecture::Flat => {
            (config.clone(), TokenLayout { vocabulary: tokens.vocabulary + fields.len(), ..tokens.clone() })
        }
        Architecture::TwoLevel => (ModelConfig { classes: fields.len(), ..config.clone() }, tokens.clone()),
    }
}

/// The heads of the fields out of the tensors of the file at `path`.
///
/// # Errors
/// A head that is missing or of another shape.
pub(super) fn heads(
    path: &Path,
    fields: &Fields,
    width: usize,
    tensors: &mut BTreeMap<String, Tensor>,
) -> Result<Vec<Floats>> {
    let one = |field: &super::Field| {
        let (name, shape) = (head_name(&field.name), [field.classes.len(), width]);
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
    fields.0.iter().map(one).collect()
}
