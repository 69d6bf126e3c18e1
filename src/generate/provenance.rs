//! Where a dance is from: a file beside it, from which it can be made again.
//!
//! `dance.bvh` has `dance.kinelm.json`: the recipe, what the model, the tokenizer and the prompt were by their hashes, and
//! the hash of the dance itself.

use super::make::Ready;
use super::recipe::Recipe;
use crate::corpus::load::hash_file;
use crate::{Error, Result, files};
use kinelm_motion::format::Format;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The layout that this program writes and reads.
const SCHEMA: u32 = 1;
/// What the name of such a file ends in.
const ENDING: &str = "kinelm.json";

/// What the file holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The layout's version.
    pub schema: u32,
    /// The program's version.
    pub kinelm: String,
    /// The dance.
    pub output: FileHash,
    /// Which of the dances drawn side by side it is, from 1.
    pub variation: usize,
    /// What decides it. Its frames are never left out.
    pub recipe: Recipe,
    /// Updates that the model's checkpoint had.
    pub step: u64,
    /// SHA-256 of the weights' file.
    pub weights_sha256: String,
    /// The tokenizer's hash.
    pub tokenizer_sha256: String,
    /// SHA-256 of the prompt's file.
    pub prompt_sha256: Option<String>,
}

/// A file of the same folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileHash {
    /// Its name.
    pub file: String,
    /// SHA-256 of its bytes.
    pub sha256: String,
}

/// The file that tells where `dance` is from.
pub fn path_of(dance: &Path) -> PathBuf {
    dance.with_extension(ENDING)
}

/// What is told of `dance` beside it; `None` where nothing is, or of another file.
///
/// # Errors
/// Those of [`Provenance::load`].
pub fn find(dance: &Path) -> Result<Option<Provenance>> {
    let path = path_of(dance);
    let told = path.exists().then(|| Provenance::load(&path)).transpose()?;
    Ok(told.filter(|told| told.output.file == name_of(dance)))
}

/// Refuses to write the file beside `dance` where one stands that tells of something else.
///
/// # Errors
/// [`Error::File`] with what stands there.
pub fn check_free(dance: &Path) -> Result<()> {
    let path = path_of(dance);
    let expected = "no file, or one that tells of this dance";
    match path.try_exists().map_err(Error::io(&path))? {
        false => Ok(()),
        true => match Provenance::load(&path) {
            Ok(found) if found.output.file == name_of(dance) => Ok(()),
            Ok(found) if !path.with_file_name(&found.output.file).exists() => Ok(()),
            Ok(found) => {
                let found = format!("where {} is from", found.output.file);
                Err(Error::file(path, found, expected, "give the dance another name"))
            }
            Err(_) => {
                Err(Error::file(path, "a file that is not of kinelm generate", expected, "give the dance another name"))
            }
        },
    }
}

impl Provenance {
    /// Of a dance that was written.
    ///
    /// # Errors
    /// The dance or the prompt can't be read.
    pub fn of(ready: &Ready, variation: usize, dance: &Path) -> Result<Provenance> {
        let recipe = Recipe { frames: Some(ready.frames), ..ready.recipe.clone() };
        let prompt = ready.prompt.as_ref().map(|prompt| prompt.clip.sha256.clone());
        Ok(Provenance {
            schema: SCHEMA,
            kinelm: env!("CARGO_PKG_VERSION").into(),
            output: FileHash { file: name_of(dance), sha256: hash_file(dance)? },
            variation,
            recipe,
            step: ready.run.state.step,
            weights_sha256: ready.run.weights_sha256(),
            tokenizer_sha256: ready.tokenizer.hash(),
            prompt_sha256: prompt,
        })
    }

    /// Reads such a file.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::File`] for text that is no such file or of another version.
    pub fn load(path: &Path) -> Result<Provenance> {
        let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
        let expected = "what kinelm generate wrote beside a dance";
        let mut value: serde_json::Value =
            serde_json::from_str(&text).map_err(|e| Error::file(path, e.to_string(), expected, ""))?;
        if value["schema"] != SCHEMA {
            let (found, expected) = (format!("schema {}", value["schema"]), format!("schema {SCHEMA}: {expected}"));
            return Err(Error::file(path, found, expected, "make it again with this version"));
        }
        read_with_y_up(&mut value);
        serde_json::from_value(value).map_err(|e| Error::file(path, e.to_string(), expected, ""))
    }

    /// Writes it beside the dance.
    ///
    /// # Errors
    /// [`Error::Motion`] with the path at which the system refused.
    pub fn save(&self, dance: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self).expect("plain data with text keys is JSON") + "\n";
        files::write_whole(&path_of(dance), text.as_bytes())
    }

    /// Refuses a model, a tokenizer or a prompt that is not the one that made the dance.
    ///
    /// # Errors
    /// [`Error::Call`] that names what has changed, with both hashes.
    pub fn check(&self, ready: &Ready) -> Result<()> {
        let prompt = ready.prompt.as_ref().map(|prompt| prompt.clip.sha256.clone());
        let (run, tokenizer) = (ready.recipe.run.display(), ready.run.tokenizer.display());
        same(&format!("{run}: the weights at step {}", self.step), &self.weights_sha256, &ready.run.weights_sha256())?;
        same(&format!("{tokenizer}: the tokenizer"), &self.tokenizer_sha256, &ready.tokenizer.hash())?;
        if let (Some(before), Some(now), Some(recipe)) = (&self.prompt_sha256, &prompt, &ready.recipe.prompt) {
            same(&format!("{}: the prompt", recipe.path.display()), before, now)?;
        }
        Ok(())
    }
}

fn same(what: &str, before: &str, now: &str) -> Result<()> {
    if before == now {
        return Ok(());
    }
    Err(Error::Call(format!("{what} has changed since the dance was made: SHA-256 {now}, then {before}")))
}

/// A file's name without its folder.
pub fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
/// Files of before `--up` took every prompt to have y up; its dance is made again as it was.
fn read_with_y_up(value: &mut serde_json::Value) {
    let Some(prompt) = value.pointer_mut("/recipe/prompt") else { return };
    let format = prompt["path"].as_str().and_then(|path| Format::of_name(Path::new(path)));
    let Some(read) = prompt.get_mut("read").and_then(serde_json::Value::as_object_mut) else { return };
    if matches!(format, Some(Format::Bvh | Format::Json)) && !read.contains_key("up") {
        read.insert("up".into(), "y".into());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prompts_of_before_have_y_up() {
        let read = |path: &str, read: serde_json::Value| {
            let mut value = serde_json::json!({"recipe": {"prompt": {"path": path, "read": read}}});
            read_with_y_up(&mut value);
            value["recipe"]["prompt"]["read"]["up"].clone()
        };
        assert_eq!(read("a.BVH", serde_json::json!({"unit": "auto"})), "y");
        assert_eq!(read("a.bvh", serde_json::json!({"up": "auto"})), "auto");
        assert!(read("a.npz", serde_json::json!({})).is_null(), "it has no axis to choose");
        let mut none = serde_json::json!({"recipe": {"prompt": null}});
        read_with_y_up(&mut none);
    }
}
