//! Our own form: `model.safetensors` under the names of [`crate::layout`], `tokenizer.json`, and `kinelm.json`, which
//! says what they are.

use super::{check_tokenizer, loaded};
use crate::run::{LoadedRun, TOKENIZER, WEIGHTS};
use crate::{Error, ModelConfig, Result, TokenLayout, weights};
use kinelm_store::{hash, input};
use kinelm_tokenizer::Tokenizer;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Our description of a folder's model.
pub const ABOUT: &str = "kinelm.json";
/// Its layout's version.
const SCHEMA: u32 = 2;

/// `kinelm.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct About {
    pub schema: u32,
    /// The version of the program.
    pub kinelm: String,
    /// Every key, defaults included.
    pub model: ModelConfig,
    pub tokens: TokenLayout,
    /// The label fields whose tokens begin a window after `<bos>`, in order.
    pub conditions: Vec<String>,
    pub tokenizer_sha256: String,
    /// Updates that the weights have seen.
    pub step: u64,
    /// SHA-256 of the weights' file, of a folder in our own form: a weight with a flipped bit is still a weight.
    /// Left out of folders that other programs may train on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights_sha256: Option<String>,
}

impl About {
    /// Of a model of unknown age, without conditions.
    pub fn new(model: ModelConfig, tokens: TokenLayout, tokenizer: &Tokenizer) -> About {
        About {
            schema: SCHEMA,
            kinelm: env!("CARGO_PKG_VERSION").into(),
            model,
            tokens,
            conditions: Vec::new(),
            tokenizer_sha256: tokenizer.hash(),
            step: 0,
            weights_sha256: None,
        }
    }

    pub fn of(run: &LoadedRun, tokenizer: &Tokenizer) -> About {
        let about = About::new(run.config.resolved(&run.tokens), run.tokens.clone(), tokenizer);
        About { step: run.state.step, conditions: run.conditions.clone(), ..about }
    }

    pub fn to_json(&self) -> Vec<u8> {
        let text = serde_json::to_string_pretty(self).expect("plain data");
        (text + "\n").into_bytes()
    }

    /// # Errors
    /// No `kinelm.json` that holds, a tokenizer that isn't the one it names.
    pub fn read(folder: &Path) -> Result<About> {
        let path = folder.join(ABOUT);
        let text = input::text(&path).map_err(Error::io(&path))?;
        let wrong = |found: String, expected: &str| Error::file(&path, found, expected, "");
        #[derive(Deserialize)]
        // read by itself first: another schema has keys that `About` would refuse with a worse message
        struct Schema {
            schema: u32,
        }
        let no_json = |e: serde_json::Error| wrong(e.to_string(), "the description of an exported model");
        let Schema { schema } = serde_json::from_str(&text).map_err(no_json)?;
        if schema != SCHEMA {
            return Err(Error::file(&path, format!("schema {schema}"), format!("schema {SCHEMA}"), "use its kinelm"));
        }
        let about: About = serde_json::from_str(&text).map_err(no_json)?;
        about.model.validate_for(&about.tokens).map_err(|e| wrong(e.to_string(), "a model that can be"))?;
        if about.tokens.front != 1 + about.conditions.len() {
            let (front, fields) = (about.tokens.front, about.conditions.len());
            return Err(wrong(
                format!("{front} tokens in front and {fields} conditions"),
                "one token more than conditions",
            ));
        }
        let path = folder.join(TOKENIZER);
        let tokenizer = Tokenizer::load(&path)?;
        check_tokenizer(&about.tokens, &tokenizer, &path)?;
        let (hash, named) = (tokenizer.hash(), &about.tokenizer_sha256);
        match hash == *named {
            true => Ok(about),
            false => Err(Error::file(
                &path,
                format!("a tokenizer with hash {hash}"),
                format!("that of {ABOUT}, {named}"),
                "",
            )),
        }
    }
}

/// The files besides description and tokenizer.
pub(super) fn contents(run: &LoadedRun) -> Result<Vec<(&'static str, Vec<u8>)>> {
    Ok(vec![(WEIGHTS, weights::to_bytes(&run.weights)?)])
}

/// Loads a folder of this form.
///
/// # Errors
/// As [`super::load`].
pub fn load(folder: &Path) -> Result<LoadedRun> {
    let (about, path) = (About::read(folder)?, folder.join(WEIGHTS));
    // a file that is cut short or something else says so itself
    let weights = super::read(&path)?;
    if let Some(named) = &about.weights_sha256 {
        let found = hash::of_file(&path)?;
        if found != *named {
            let (found, expected) = (format!("SHA-256 {found}"), format!("that of {ABOUT}, {named}"));
            let help = "the file was changed after it was written: export the model again, or copy the folder again";
            return Err(Error::file(&path, found, expected, help));
        }
    }
    loaded(folder, about, weights, Vec::new())
}
