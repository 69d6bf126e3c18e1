//! Weights to begin a run with: another run's, or those of a folder that was exported.

use crate::grow::{Language, grow};
use crate::run::{RunFile, origin};
use crate::{Error, Result};
use candle_core::Tensor;
use kinelm_model::{LoadedRun, ModelConfig, exchange};
use kinelm_tokenizer::Tokenizer;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A model that a run begins with.
pub struct Source {
    path: PathBuf,
    run: LoadedRun,
    /// Its tokenizer: the new run keeps its ids.
    pub tokenizer: Tokenizer,
}

impl Source {
    /// Loads a run, or a folder that was exported.
    ///
    /// # Errors
    /// As [`exchange::load`]; a tokenizer that can't be read.
    pub fn load(path: &Path) -> Result<Source> {
        let run = exchange::load(path)?;
        let path = std::path::absolute(path).map_err(Error::io(path))?;
        Ok(Source { path, tokenizer: run.load_tokenizer()?, run })
    }

    /// What was odd in it.
    pub fn notes(&self) -> &[String] {
        &self.run.notes
    }

    /// Its weights for a run of this file, which is told where they are from.
    ///
    /// # Errors
    /// Another model, with the keys that differ; other tokens or places in front of a window.
    pub fn weights(self, file: &mut RunFile) -> Result<BTreeMap<String, Tensor>> {
        let differing = differing(&file.model, &self.run.config.resolved(&self.run.tokens))?;
        if !differing.is_empty() {
            let (path, what) = (self.path.display(), differing.join(", "));
            return Err(Error::call(format!(
                "the weights of {path} are another model's: {what}; give --config its [model]"
            )));
        }
        file.from = Some(origin(&self.path, &self.run)?);
        grown(self.run, file)
    }
}

/// Keys in which the models differ, with both. Dropout is of training alone.
fn differing(asked: &ModelConfig, found: &ModelConfig) -> Result<Vec<String>> {
    let table = |config: &ModelConfig| {
        toml::Table::try_from(ModelConfig { dropout: 0.0, ..config.clone() })
            .map_err(|e| Error::call(format!("a model that can't be written: {e}")))
    };
    let (asked, found) = (table(asked)?, table(found)?);
    let say = |value: Option<&toml::Value>| value.map_or("left out".into(), toml::Value::to_string);
    let keys: std::collections::BTreeSet<&String> = asked.keys().chain(found.keys()).collect();
    let odd = keys.into_iter().filter(|key| asked.get(*key) != found.get(*key));
    Ok(odd.map(|k| format!("model.{k} is {}, theirs {}", say(asked.get(k)), say(found.get(k)))).collect())
}

/// The weights, with room for what the new run's tokens have more.
fn grown(run: LoadedRun, file: &RunFile) -> Result<BTreeMap<String, Tensor>> {
    let old = Language { tokens: &run.tokens, conditions: &run.conditions };
    let new = Language { tokens: &file.tokens, conditions: &file.train.conditions };
    grow(&run.weights, &file.model, old, new, file.train.seed)
}
