//! Where a dance is from: a file beside it, from which it can be made again.
//!
//! `dance.bvh` has `dance.bvh.kinelm.json`: the recipe, what the model, the tokenizer and the prompt were by their hashes, and
//! the hash of the dance itself.

use super::best::Best;
use super::open::OpenRequest;
use super::request::Resolved;
use crate::{Error, Result};
use kinelm_motion::format::ReadOptions;
use kinelm_store::output::Outputs;
use kinelm_store::sidecar::{self, FileHash, name_of, path_of};
use kinelm_store::{FileRecord, files, hash, input};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

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
    pub recipe: Resolved,
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
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::Call`] for one that has changed.
    pub fn check(&self) -> Result<()> {
        let now = hash::of_file(&self.path)?;
        match self.sha256.as_ref().is_none_or(|then| *then == now) {
            true => Ok(()),
            false => Err(Error::call(format!("{} has changed since the dance was made", self.path.display()))),
        }
    }
}

/// What is told of `dance` beside it; `None` where nothing is, or of another file, or of another model than a GPT.
///
/// # Errors
/// Those of [`Provenance::load`].
pub fn find(dance: &Path) -> Result<Option<Provenance>> {
    let path = path_of(dance);
    if !path.exists() || sidecar::is_of_kind(&path, &OTHERS.map(|[key, ..]| key)) {
        return Ok(None);
    }
    Ok(Some(Provenance::load(&path)?).filter(|told| told.output.file == name_of(dance)))
}

/// Models besides GPTs whose dances have sidecars: the key that tells, what the dance is, and what makes it again.
const OTHERS: [[&str; 3]; 2] = [
    ["aclstm", "a dance of an auto-conditioned LSTM", "kinelm aclstm generate makes it again"],
    ["music_lstm", "a dance of a music LSTM", "kinelm music-lstm generate makes it again"],
];

impl Provenance {
    /// Of a dance that is to be written at a rate, by its bytes.
    ///
    /// # Errors
    /// The prompt can't be read.
    pub fn of(ready: &OpenRequest, variation: usize, (dance, fps): (&Path, f64), bytes: &[u8]) -> Result<Provenance> {
        let lead_in_from = ready.lead_in(variation.saturating_sub(1)).map(|lead_in| lead_in.from.clone());
        let recipe = Resolved { frames: Some(ready.frames), lead_in_from, ..ready.recipe.clone() };
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

    /// The music that the dance was made to, if it was.
    pub fn music(&self) -> Option<MadeTo> {
        let music = self.recipe.music.as_ref()?;
        Some(MadeTo { path: music.path.clone(), from_s: music.from_s, sha256: self.music_sha256.clone() })
    }

    /// Reads such a file.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`], [`kinelm_store::Error::File`] for text that is no such file or of another version.
    pub fn load(path: &Path) -> Result<Provenance> {
        Provenance::parse(path, &input::text(path).map_err(Error::io(path))?)
    }

    fn parse(path: &Path, text: &str) -> Result<Provenance> {
        let expected = "what kinelm generate wrote beside a dance";
        let value: serde_json::Value =
            serde_json::from_str(text).map_err(|e| Error::file(path, e.to_string(), expected, ""))?;
        if let Some([_, found, help]) = OTHERS.iter().find(|[key, ..]| value.get(key).is_some()) {
            return Err(Error::file(path, *found, expected, *help));
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
        Ok(sidecar::write_beside(dance, bytes, &sha256, outputs, |before| {
            self.replaces = before;
            serde_json::to_string_pretty(&self)
        })?)
    }

    /// Refuses a model, a tokenizer, a prompt or music that is not the one that made the dance.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] that names what has changed, with both hashes.
    pub fn check(&self, ready: &OpenRequest) -> Result<()> {
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
