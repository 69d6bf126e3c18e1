//! Where a dance is from: a file beside it, from which it can be made again.
//!
//! `dance.bvh` has `dance.bvh.kinelm.json`: the recipe, what the model, the tokenizer and the prompt were by their hashes, and
//! the hash of the dance itself.

use super::best::Best;
use super::make::Ready;
use super::recipe::Recipe;
use super::told::Recipe as _;
use crate::corpus::FileRecord;
use crate::corpus::load::hash_file;
use crate::output::Outputs;
use crate::{Error, Result, aclstm, files, music_lstm};
use kinelm_motion::format::{Format, input};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The layout that this program writes. It reads the one before too, which had no edits, plans and places: what that leaves
/// out was not done, and the hash of the dance says whether it comes out the same.
const SCHEMA: u32 = 2;
/// Those that it reads.
const READ: std::ops::RangeInclusive<u64> = 1..=SCHEMA as u64;
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
    /// SHA-256 of the dance that this one takes the place of: this file is written first, and until the dance is too the
    /// other one stands there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replaces: Option<String>,
    /// Which of the dances drawn side by side it is, from 1.
    pub variation: usize,
    /// Where it stands among them, if the best were looked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub best: Option<Best>,
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
    /// SHA-256 of the music's file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub music_sha256: Option<String>,
}

/// Music that a dance was made to.
#[derive(Debug, Clone, PartialEq)]
pub struct MadeTo {
    /// Its file.
    pub path: PathBuf,
    /// Its time when the dance begins, seconds.
    pub from_s: f64,
    /// SHA-256 of its file then, where that was kept.
    pub sha256: Option<String>,
}

impl MadeTo {
    /// Refuses a file that isn't the one that was danced to.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Call`] for one that has changed.
    pub fn check(&self) -> Result<()> {
        let now = hash_file(&self.path)?;
        match self.sha256.as_ref().is_none_or(|then| *then == now) {
            true => Ok(()),
            false => Err(Error::Call(format!("{} has changed since the dance was made", self.path.display()))),
        }
    }
}

/// The music that `dance` was made to, by the model of whose dance `told` tells, or, where nothing is told, by a music LSTM, as
/// the file beside it tells.
///
/// # Errors
/// A file beside the dance that tells of a music LSTM and isn't as it was written.
pub fn music_of(told: Option<&Provenance>, dance: &Path) -> Result<Option<MadeTo>> {
    if let Some(told) = told {
        let made_to = |music: &super::recipe::MusicRecipe| {
            let (path, sha256) = (music.path.clone(), told.music_sha256.clone());
            MadeTo { path, from_s: music.from_s, sha256 }
        };
        return Ok(told.recipe.music.as_ref().map(made_to));
    }
    let path = path_of(dance);
    if !matches!(other_model(&path), Some(Other::MusicLstm)) {
        return Ok(None);
    }
    let told = music_lstm::dance::Told::load(&path)?;
    let from_s = told.recipe.begins_s();
    let made_to = MadeTo { path: told.recipe.music, from_s, sha256: Some(told.given_sha256) };
    Ok((told.output.file == name_of(dance)).then_some(made_to))
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

/// The file that tells where `dance` is from: `dance.bvh.kinelm.json`, so that each format has its own.
pub fn path_of(dance: &Path) -> PathBuf {
    let mut path = dance.as_os_str().to_owned();
    path.push(format!(".{ENDING}"));
    path.into()
}

/// The same under the name that it had before: `dance.kinelm.json`.
fn old_path_of(dance: &Path) -> PathBuf {
    dance.with_extension(ENDING)
}

/// What is told of `dance` beside it, under the new name or the old; `None` where nothing is, or of another file, or of
/// another model than a GPT.
///
/// # Errors
/// Those of [`Provenance::load`].
pub fn find(dance: &Path) -> Result<Option<Provenance>> {
    let known = |path: &PathBuf| path.exists() && other_model(path).is_none();
    for path in [path_of(dance), old_path_of(dance)].into_iter().filter(known) {
        let told = Provenance::load(&path)?;
        if told.output.file == name_of(dance) {
            return Ok(Some(told));
        }
    }
    Ok(None)
}

/// Whether a file beside `dance` holds the hash of its bytes: whether it is a dance as generation wrote it.
///
/// # Errors
/// [`Error::Io`] when the dance can't be read.
pub fn tells_of(dance: &Path) -> Result<bool> {
    // of any version: the hashes have always stood there
    let hashes = |path: PathBuf| -> Option<Vec<String>> {
        let told: serde_json::Value = serde_json::from_slice(&input::peek_bytes(&path).ok()?).ok()?;
        let found = [&told["output"]["sha256"], &told["replaces"]].into_iter().filter_map(|hash| hash.as_str());
        (told["output"]["file"] == name_of(dance)).then(|| found.map(str::to_owned).collect())
    };
    let told: Vec<String> = [path_of(dance), old_path_of(dance)].into_iter().filter_map(hashes).flatten().collect();
    Ok(!told.is_empty() && told.contains(&hash_file(dance)?))
}

/// Whether `path` is a file that [`path_of`] names, and tells of the dance that it is named after.
pub fn is_beside_its_dance(path: &Path) -> bool {
    let Some(text) = input::peek_bytes(path).ok().and_then(|bytes| String::from_utf8(bytes).ok()) else { return false };
    let told = match other_model(path) {
        Some(Other::Aclstm) => aclstm::dance::Told::parse(path, &text).map(|told| told.output),
        Some(Other::MusicLstm) => music_lstm::dance::Told::parse(path, &text).map(|told| told.output),
        None => Provenance::parse(path, &text).map(|told| told.output),
    };
    told.is_ok_and(|output| path_of(&path.with_file_name(&output.file)) == path && files::is_plain(&output.file))
}

/// Writes what `tell` makes of the hash of the dance that is replaced, and then the dance, whose bytes have the hash
/// `sha256`.
///
/// # Errors
/// Those of [`Provenance::write`].
pub fn write_beside(
    dance: &Path,
    bytes: &[u8],
    sha256: &str,
    outputs: &Outputs,
    tell: impl FnOnce(Option<String>) -> serde_json::Result<String>,
) -> Result<()> {
    outputs.check_replaceable(dance, Some(sha256))?;
    let before = hash_file(dance).ok().filter(|hash| hash != sha256);
    let text = tell(before.filter(|_| tells_of(dance).unwrap_or(false)));
    let text = text.map_err(|e| Error::Call(format!("{}: {e}", path_of(dance).display())))?;
    outputs.write(&path_of(dance), (text + "\n").as_bytes())?;
    outputs.write(dance, bytes)?;
    Ok(())
}

/// Models that make dances besides GPTs.
#[derive(Debug, Clone, Copy)]
enum Other {
    Aclstm,
    MusicLstm,
}

impl Other {
    /// What a file beside such a dance holds, which [`Provenance`] doesn't.
    fn key(self) -> &'static str {
        match self {
            Other::Aclstm => aclstm::dance::Recipe::KEY,
            Other::MusicLstm => music_lstm::dance::Recipe::KEY,
        }
    }

    fn of(told: &serde_json::Value) -> Option<Other> {
        [Other::Aclstm, Other::MusicLstm].into_iter().find(|other| told.get(other.key()).is_some())
    }

    /// What it is, and what makes it again.
    fn says(self) -> [&'static str; 2] {
        match self {
            Other::Aclstm => ["a dance of an auto-conditioned LSTM", "kinelm aclstm generate makes it again"],
            Other::MusicLstm => ["a dance of a music LSTM", "kinelm music-lstm generate makes it again"],
        }
    }
}

/// The model that such a file tells of, where it is no GPT.
fn other_model(path: &Path) -> Option<Other> {
    let told = input::peek_bytes(path).ok().and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok());
    told.as_ref().and_then(Other::of)
}

impl Provenance {
    /// Of a dance that is to be written, by its bytes.
    ///
    /// # Errors
    /// The prompt can't be read.
    pub fn of(ready: &Ready, variation: usize, dance: &Path, bytes: &[u8]) -> Result<Provenance> {
        let recipe = Recipe { frames: Some(ready.frames), ..ready.recipe.clone() };
        let prompt = ready.prompt.as_ref().map(|prompt| prompt.clip.sha256.clone());
        Ok(Provenance {
            schema: SCHEMA,
            kinelm: env!("CARGO_PKG_VERSION").into(),
            output: FileHash { file: name_of(dance), sha256: FileRecord::of(bytes).sha256 },
            replaces: None,
            variation,
            best: None,
            recipe,
            step: ready.run.state.step,
            weights_sha256: ready.run.weights_sha256(),
            tokenizer_sha256: ready.tokenizer.hash(),
            prompt_sha256: prompt,
            music_sha256: ready.music.as_ref().map(|music| music.sha256.clone()),
        })
    }

    /// Reads such a file.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::File`] for text that is no such file or of another version.
    pub fn load(path: &Path) -> Result<Provenance> {
        Provenance::parse(path, &input::text(path).map_err(Error::io(path))?)
    }

    fn parse(path: &Path, text: &str) -> Result<Provenance> {
        let expected = "what kinelm generate wrote beside a dance";
        let mut value: serde_json::Value =
            serde_json::from_str(text).map_err(|e| Error::file(path, e.to_string(), expected, ""))?;
        if let Some(other) = Other::of(&value) {
            let [found, help] = other.says();
            return Err(Error::file(path, found, expected, help));
        }
        if !value["schema"].as_u64().is_some_and(|schema| READ.contains(&schema)) {
            let (found, expected) =
                (format!("schema {}", value["schema"]), format!("schema 1 or {SCHEMA}: {expected}"));
            return Err(Error::file(path, found, expected, "make it again with this version"));
        }
        read_with_y_up(&mut value);
        let told: Provenance =
            serde_json::from_value(value).map_err(|e| Error::file(path, e.to_string(), expected, ""))?;
        if !files::is_plain(&told.output.file) {
            let expected = "the name of a dance beside this file, without a folder";
            return Err(Error::file(path, format!("`{}`", told.output.file), expected, "it isn't as it was written"));
        }
        Ok(told)
    }

    /// Writes it beside the dance, then the dance: whenever this is cut short, what stands there is known by a hash.
    ///
    /// # Errors
    /// What [`Outputs::write`] refuses; a path that isn't UTF-8, which JSON can't hold.
    pub fn write(mut self, dance: &Path, bytes: &[u8], outputs: &Outputs) -> Result<()> {
        let sha256 = self.output.sha256.clone();
        write_beside(dance, bytes, &sha256, outputs, |before| {
            self.replaces = before;
            serde_json::to_string_pretty(&self)
        })
    }

    /// Refuses a model, a tokenizer, a prompt or music that is not the one that made the dance.
    ///
    /// # Errors
    /// [`Error::Call`] that names what has changed, with both hashes.
    pub fn check(&self, ready: &Ready) -> Result<()> {
        let prompt = ready.prompt.as_ref().map(|prompt| prompt.clip.sha256.clone());
        let (run, tokenizer) = (ready.recipe.run.display(), ready.run.tokenizer.display());
        same(&format!("{run}: the weights at step {}", self.step), &self.weights_sha256, &ready.run.weights_sha256())?;
        same(&format!("{tokenizer}: the tokenizer"), &self.tokenizer_sha256, &ready.tokenizer.hash())?;
        if let (Some(before), Some(now), Some(recipe)) = (&self.prompt_sha256, &prompt, &ready.recipe.prompt) {
            let what = match recipe.plan {
                Some(_) => "what the plan makes of its clips".into(),
                None => format!("{}: the prompt", recipe.path.display()),
            };
            same(&what, before, now)?;
        }
        if let (Some(before), Some(now), Some(recipe)) = (&self.music_sha256, &ready.music, &ready.recipe.music) {
            same(&format!("{}: the music", recipe.path.display()), before, &now.sha256)?;
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
