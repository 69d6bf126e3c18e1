//! A classifier's folder: `classifier.json`, the weights it names, `tokenizer.json`, `metrics.jsonl`.

use super::class_scores::{ClassScores, of_clips};
use super::features::{self, Motion};
use super::fields::Fields;
use super::fusion::{Fusion, fuse};
use super::learner::heads;
use super::scores::{Source, read_windows};
use crate::{Error, Result};
use kinelm_corpus::labels::LabelFilter;
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_engine::arena::Floats;
use kinelm_model::class_windows::{Layout, Window};
use kinelm_model::fast::Fast;
use kinelm_model::{Architecture, ModelConfig, TokenLayout, weights};
use kinelm_store::{FileRecord, files, input};
use kinelm_tokenizer::{Tokenizer, Words};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

pub(super) const MANIFEST: &str = "classifier.json";
pub(super) const TOKENIZER: &str = "tokenizer.json";
pub(super) const METRICS: &str = "metrics.jsonl";

/// The layout that this program writes and reads.
pub(super) const SCHEMA: u32 = 3;

/// `classifier.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The version of this file, `SCHEMA`.
    pub schema: u32,
    /// The program that wrote it.
    pub kinelm: String,
    /// The shape of the model.
    pub model: ModelConfig,
    /// Its tokens without the class tokens, which in a flat model are the ids after them.
    pub tokens: TokenLayout,
    /// The fields and their classes.
    pub fields: Fields,
    /// Whether class tokens attend to those before them.
    pub compat: bool,
    /// Labels that the training clips had.
    pub only: Vec<LabelFilter>,
    /// The corpus that it was trained on.
    pub corpus: PathBuf,
    /// The run that it began with; `None` for random weights.
    pub from: Option<PathBuf>,
    /// The share of the training clips that were used.
    pub share: f64,
    /// The seed that chose them, and of all random numbers.
    pub seed: u64,
    /// Updates done.
    pub step: u64,
    /// Mean -ln p of the class on the validation windows, summed over the fields; `None` without validation clips.
    pub valid_nats: Option<f64>,
    /// The hash of its tokenizer without conditioning tokens.
    pub tokenizer: String,
    /// The weights' file, with its length and hash.
    pub weights: (String, FileRecord),
}

/// A trained classifier.
pub struct Classifier {
    /// What it is.
    pub manifest: Manifest,
    /// Its tokenizer.
    pub tokenizer: Tokenizer,
    pub(super) model: Fast,
    pub(super) heads: Vec<Floats>,
    pub(super) fusions: Vec<Fusion>,
    pub(super) layout: Layout,
}

impl Classifier {
    /// Reads a classifier's folder.
    ///
    /// # Errors
    /// A folder that is none; another version; files that are missing, cut short or of something else: each is named.
    pub fn load(folder: &Path) -> Result<Classifier> {
        let path = folder.join(MANIFEST);
        let help = "a classifier is a folder that `kinelm classify train --out FOLDER` wrote";
        let text = input::text(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => {
                Error::file(folder, format!("no {MANIFEST}"), "a classifier's folder", help)
            }
            _ => Error::io(&path)(e),
        })?;
        // the version first: another one's keys would be reported as unknown
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
        let manifest: Manifest = serde_json::from_str(&text)
            .map_err(|e| Error::file(&path, e.to_string(), "the manifest of a classifier", help))?;
        let (name, record) = &manifest.weights;
        // a name with folders in it would be read from outside of the classifier's
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
        let mut weights = weights::from_bytes(&at, &bytes)?;
        let tokenizer = Tokenizer::load(folder.join(TOKENIZER))?;
        if tokenizer.base_hash() != manifest.tokenizer {
            // a tokenizer of the same shape would decode other motion, unnoticed
            let (found, expected) = (tokenizer.base_hash(), &manifest.tokenizer);
            let help = "put back the tokenizer.json that the classifier was trained with, or train it again";
            let at = folder.join(TOKENIZER);
            return Err(Error::file(at, format!("tokenizer {found}"), format!("the classifier's, {expected}"), help));
        }
        let layout = Layout::new(&manifest.model, &manifest.tokens, manifest.fields.len())?;
        let parameters = heads(&manifest.fields, manifest.model.width);
        let heads = weights::floats("classifier", &parameters, &weights, |p| p.name.clone())?;
        weights.retain(|name, _| parameters.iter().all(|p| p.name != *name));
        let fusions = Fusion::take(&manifest.fields, features::count(&tokenizer), &mut weights)?;
        let (config, tokens) = extended(&manifest.model, &manifest.tokens, &manifest.fields);
        let model = Fast::from_weights(&config, &tokens, &weights)?;
        Ok(Classifier { manifest, tokenizer, model, heads, fusions, layout })
    }

    fn read(&mut self, source: &Source) -> Result<Vec<ClassScores>> {
        read_windows(&mut self.model, &self.heads, &self.layout, self.manifest.compat, source)
    }

    /// The classes of every window of these clips of a corpus, in their order, by class tokens alone.
    ///
    /// # Errors
    /// A corpus of another tokenizer.
    pub(crate) fn classify_windows(&mut self, corpus: &Corpus, clips: &[&ClipRecord]) -> Result<Vec<ClassScores>> {
        same_tokenizer(&self.manifest.tokenizer, corpus)?;
        self.read(&Source::of(corpus, clips))
    }

    /// The classes of clips of a corpus by the scores of their windows together with the discriminants.
    ///
    /// # Errors
    /// A corpus that doesn't hold together.
    pub(crate) fn classify_clips(
        &self,
        corpus: &Corpus,
        clips: &[&ClipRecord],
        windows: &[ClassScores],
    ) -> Result<Vec<ClassScores>> {
        let one = |s: &ClassScores| Ok(fuse(&self.fusions, s, &Motion::of(corpus, clips[s.clip])?));
        of_clips(windows).par_iter().map(one).collect()
    }

    /// The classes of every window of a clip in words of its tokenizer, all of one length, by class tokens alone, and of the
    /// clip, together with the discriminants; none of a clip without a word.
    ///
    /// # Errors
    /// What the model refuses.
    pub(crate) fn classify_words(&mut self, words: &Words) -> Result<(Vec<ClassScores>, Option<ClassScores>)> {
        let ids = self.tokenizer.ids_of_words(words)?;
        let word = self.manifest.tokens.word;
        let ids_of = |w: &Window| Ok(ids[w.word * word..(w.word + w.words) * word].to_vec());
        let source = Source { most: 0, stop: None, words: vec![ids.len() / word], ids: Box::new(ids_of) };
        let windows = self.read(&source)?;
        let Some(tokens) = of_clips(&windows).pop() else { return Ok((windows, None)) };
        let clip = fuse(&self.fusions, &tokens, &Motion::of_words(&self.tokenizer, words)?);
        Ok((windows, Some(clip)))
    }
}

/// A model with a class token per field after its tokens, or with as many class rows.
pub(super) fn extended(config: &ModelConfig, tokens: &TokenLayout, fields: &Fields) -> (ModelConfig, TokenLayout) {
    match config.architecture {
        Architecture::Flat => {
            (config.clone(), TokenLayout { vocabulary: tokens.vocabulary + fields.len(), ..tokens.clone() })
        }
        Architecture::TwoLevel => (ModelConfig { classes: fields.len(), ..config.clone() }, tokens.clone()),
    }
}

/// Refuses a corpus of another tokenizer.
pub(super) fn same_tokenizer(expected: &str, corpus: &Corpus) -> Result<()> {
    let found = corpus.tokenizer().base_hash();
    if found == expected {
        return Ok(());
    }
    let help = "make the corpus with the model's tokenizer.json: kinelm tokenize DATA --tokenizer FILE";
    let (found, expected) = (format!("a corpus of tokenizer {found}"), format!("that of the model, {expected}"));
    Err(Error::file(corpus.dir(), found, expected, help))
}
