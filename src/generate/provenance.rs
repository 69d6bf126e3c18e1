//! Where a dance is from: a file beside it, from which it can be made again.
//!
//! `dance.bvh` has `dance.bvh.kinelm.json`: the recipe, what the model, the tokenizer and the prompt were by their hashes, and
//! the hash of the dance itself.

use super::best::Best;
use super::make::Ready;
use super::recipe::Recipe;
use super::told::Recipe as _;
use crate::{Error, Result, aclstm, music_lstm};
use kinelm_motion::format::ReadOptions;
use kinelm_store::FileRecord;
use kinelm_store::files;
use kinelm_store::hash;
use kinelm_store::input;
use kinelm_store::output::Outputs;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

pub use kinelm_store::sidecar::{FileHash, name_of, path_of};

/// The layout that this program writes and reads.
const SCHEMA: u32 = 3;

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
    /// How it is read.
    pub read: ReadOptions,
    /// Seconds of it, as it is read, in which something was made anew while the rest is as it was given; none where all of it
    /// was made.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub anew_s: Vec<[f64; 2]>,
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
        let now = hash::of_file(&self.path)?;
        match self.sha256.as_ref().is_none_or(|then| *then == now) {
            true => Ok(()),
            false => Err(Error::call(format!("{} has changed since the dance was made", self.path.display()))),
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

/// What is told of `dance` beside it; `None` where nothing is, or of another file, or of another model than a GPT.
///
/// # Errors
/// Those of [`Provenance::load`].
pub fn find(dance: &Path) -> Result<Option<Provenance>> {
    let path = path_of(dance);
    if !path.exists() || other_model(&path).is_some() {
        return Ok(None);
    }
    Ok(Some(Provenance::load(&path)?).filter(|told| told.output.file == name_of(dance)))
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
    let told = hashes(path_of(dance)).unwrap_or_default();
    Ok(!told.is_empty() && told.contains(&hash::of_file(dance)?))
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
    let before = hash::of_file(dance).ok().filter(|hash| hash != sha256);
    let text = tell(before.filter(|_| tells_of(dance).unwrap_or(false)));
    let text = text.map_err(|e| Error::call(format!("{}: {e}", path_of(dance).display())))?;
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
    /// Of a dance that is to be written at a rate, by its bytes.
    ///
    /// # Errors
    /// The prompt can't be read.
    pub fn of(ready: &Ready, variation: usize, (dance, fps): (&Path, f64), bytes: &[u8]) -> Result<Provenance> {
        let lead_in_from = ready.lead_in(variation.saturating_sub(1)).map(|lead_in| lead_in.from.clone());
        let recipe = Recipe { frames: Some(ready.frames), lead_in_from, ..ready.recipe.clone() };
        let prompt = ready.prompt.as_ref().map(|prompt| prompt.clip.sha256.clone());
        Ok(Provenance {
            schema: SCHEMA,
            kinelm: env!("CARGO_PKG_VERSION").into(),
            output: FileHash { file: name_of(dance), sha256: FileRecord::of(bytes).sha256 },
            read: ReadOptions { fps_source: Some(fps), ..ready.read_back(dance) },
            anew_s: ready.anew_s(),
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
        let value: serde_json::Value =
            serde_json::from_str(text).map_err(|e| Error::file(path, e.to_string(), expected, ""))?;
        if let Some(other) = Other::of(&value) {
            let [found, help] = other.says();
            return Err(Error::file(path, found, expected, help));
        }
        if value["schema"] != SCHEMA {
            let (found, expected) = (format!("schema {}", value["schema"]), format!("schema {SCHEMA}: {expected}"));
            return Err(Error::file(path, found, expected, "make it again with this version"));
        }
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
    Err(Error::call(format!("{what} has changed since the dance was made: SHA-256 {now}, then {before}")))
}
