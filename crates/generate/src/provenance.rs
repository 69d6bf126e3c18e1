//! The sidecar of a dance: a file beside it, from which it can be made again.
//!
//! `dance.bvh` has `dance.bvh.kinelm.json`: the resolved request, the hashes of model, tokenizer, prompt and music, and the hash
//! of the dance itself.

use crate::best::Best;
use crate::open::OpenRequest;
use crate::request::{Resolved, Timeline};
use crate::sampler::variation_seed;
use crate::{Error, Result};
use kinelm_model::CheckpointChoice;
use kinelm_model::run::LIMITS;
use kinelm_motion::format::ReadOptions;
use kinelm_store::Subject;
use kinelm_store::output::Outputs;
use kinelm_store::sidecar::{self, FileHash, name_of, path_of};
use kinelm_store::{FileRecord, files, hash, input};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The version of the layout.
const SCHEMA: u32 = 5;

/// The contents of a sidecar.
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
    /// The parts of it, in seconds as it is read, that are generated while the rest is given; empty where all of it is
    /// generated.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub generated_s: Vec<[f64; 2]>,
    /// SHA-256 of the dance that this one replaces: the sidecar is written first, and until the dance is written too the other
    /// one is there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replaces: Option<String>,
    /// Its number among the dances sampled side by side, from 1.
    pub variation: usize,
    /// Its rank among them, where the best was chosen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub best: Option<Best>,
    /// The request that makes it.
    pub request: Resolved,
    /// Training updates of the model's checkpoint.
    pub step: u64,
    /// SHA-256 of the weights' file.
    pub weights_sha256: String,
    /// The tokenizer's hash.
    pub tokenizer_sha256: String,
    /// SHA-256 of the limits that its blocks were chosen by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits_sha256: Option<String>,
    /// SHA-256 of the prompt's file.
    pub prompt_sha256: Option<String>,
    /// SHA-256 of the music's file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub music_sha256: Option<String>,
}

/// The music that a dance was made to.
#[derive(Debug, Clone, PartialEq)]
pub struct DanceMusic {
    /// Its file.
    pub path: PathBuf,
    /// Its time when the dance begins, seconds.
    pub from_s: f64,
    /// SHA-256 of its file when the dance was made, if known.
    pub sha256: Option<String>,
}

impl DanceMusic {
    /// Refuses a file that has changed since the dance was made.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::Invalid`] with both hashes.
    pub fn check(&self) -> Result<()> {
        let found = hash::of_file(&self.path)?;
        match &self.sha256 {
            Some(expected) => check_hash(&format!("{}: the music", self.path.display()), expected, &found),
            None => Ok(()),
        }
    }
}

/// The sidecar of `dance`; `None` where there is none, or it belongs to another file or to a dance of another kind of model.
///
/// # Errors
/// Those of [`Provenance::load`].
pub fn find(dance: &Path) -> Result<Option<Provenance>> {
    let path = path_of(dance);
    if !path.exists() || sidecar::is_of_kind(&path, &OTHERS.map(|[key, ..]| key)) {
        return Ok(None);
    }
    Ok(Some(Provenance::load(&path)?).filter(|found| found.output.file == name_of(dance)))
}

/// Models besides GPTs whose dances have sidecars: the key that identifies them, and what the dance is.
const OTHERS: [[&str; 2]; 2] =
    [["aclstm", "a dance of an auto-conditioned LSTM"], ["music_lstm", "a dance of a music LSTM"]];

/// Where the files of a dance are, if they have moved since it was made.
#[derive(Debug, Clone, Default)]
pub struct Moved {
    /// The run folder.
    pub run: Option<PathBuf>,
    /// The prompt.
    pub prompt: Option<PathBuf>,
    /// A timeline of the same clips.
    pub timeline: Option<PathBuf>,
    /// The music.
    pub music: Option<PathBuf>,
}

impl Provenance {
    /// The sidecar of a variation that is to be written to `dance` at a rate, with these bytes.
    pub fn of(open: &OpenRequest, variation: usize, dance: &Path, fps: f64, bytes: &[u8]) -> Provenance {
        let lead_in_from = open.lead_in(variation.saturating_sub(1)).map(|lead_in| lead_in.from.clone());
        let request = Resolved { lead_in_from, ..open.resolved.clone() };
        Provenance {
            schema: SCHEMA,
            kinelm: env!("CARGO_PKG_VERSION").into(),
            output: FileHash { file: name_of(dance), sha256: FileRecord::of(bytes).sha256 },
            read: ReadOptions { fps_source: Some(fps), ..open.read_back(dance) },
            generated_s: open.generated_s(),
            replaces: None,
            variation,
            best: None,
            request,
            step: open.run.state.step,
            weights_sha256: open.run.weights_sha256(),
            tokenizer_sha256: open.tokenizer.hash(),
            limits_sha256: open.limits_sha256(),
            prompt_sha256: open.prompt.as_ref().map(|prompt| prompt.clip.sha256.clone()),
            music_sha256: open.music.as_ref().map(|music| music.sha256.clone()),
        }
    }

    /// The music that the dance was made to, if any.
    pub fn music(&self) -> Option<DanceMusic> {
        let music = self.request.music.as_ref()?;
        Some(DanceMusic { path: music.path.clone(), from_s: music.from_s, sha256: self.music_sha256.clone() })
    }

    /// Reads a sidecar.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for text that is no sidecar, or of another version.
    pub fn load(path: &Path) -> Result<Provenance> {
        Provenance::parse(path, &input::text(path).map_err(Error::io(path))?)
    }

    fn parse(path: &Path, text: &str) -> Result<Provenance> {
        let expected = "what kinelm generate wrote beside a dance";
        let value: serde_json::Value =
            serde_json::from_str(text).map_err(|e| Error::file(path, e.to_string(), expected, ""))?;
        if let Some([_, found]) = OTHERS.iter().find(|[key, ..]| value.get(key).is_some()) {
            return Err(Error::file(path, *found, expected, "`kinelm again` makes it again"));
        }
        if value["schema"] != SCHEMA {
            let (found, expected) = (format!("schema {}", value["schema"]), format!("schema {SCHEMA}: {expected}"));
            return Err(Error::file(path, found, expected, "make it again with this version"));
        }
        let parsed: Provenance =
            serde_json::from_value(value).map_err(|e| Error::file(path, e.to_string(), expected, ""))?;
        // a sidecar may come from anywhere: its name must not lead out of the folder
        if !files::is_plain(&parsed.output.file) {
            let expected = "the name of a dance beside this file, without a folder";
            let help = "it isn't as it was written";
            return Err(Error::file(path, format!("`{}`", parsed.output.file), expected, help));
        }
        Ok(parsed)
    }

    /// Writes the sidecar, then the dance: wherever this is interrupted, the file that is there is known by its hash.
    ///
    /// # Errors
    /// Errors of [`Outputs::write`]; a path that isn't UTF-8, which JSON can't hold.
    pub fn write(mut self, dance: &Path, bytes: &[u8], outputs: &Outputs) -> Result<()> {
        let sha256 = self.output.sha256.clone();
        Ok(sidecar::write_beside(dance, bytes, &sha256, outputs, |replaced| {
            self.replaces = replaced;
            serde_json::to_string_pretty(&self)
        })?)
    }

    /// The request that makes this dance, its variation's seed in place, with its files where they are now.
    ///
    /// # Errors
    /// A file that has moved and that the dance doesn't have; a timeline that can't be read or has other labels.
    pub fn request_at(&self, moved: &Moved) -> Result<Resolved> {
        let mut request = self.request.clone();
        // a single dance again: the variation's seed becomes its own
        request.seed = variation_seed(request.seed, self.variation.saturating_sub(1));
        if let Some(run) = &moved.run {
            request.run.clone_from(run);
        }
        let none = |name: &str, why: &str| Err(Error::unsupported(Subject::of_parameter(name), why));
        match (&moved.prompt, &moved.timeline, request.prompt.as_mut()) {
            (None, None, _) => {}
            (Some(path), None, Some(prompt)) if prompt.timeline.is_none() => prompt.path.clone_from(path),
            (None, Some(path), Some(prompt)) if prompt.timeline.is_some() => {
                let (timeline, layout) = Timeline::load(path)?;
                if let Some(other) = layout.labels.iter().find(|label| !request.timed_labels.contains(label)) {
                    let found = format!("{} with {other}", path.display());
                    return Err(Error::invalid_parameter("timeline", found, "the labels that the dance was made with"));
                }
                prompt.path = layout.path().to_owned();
                prompt.timeline = Some(timeline);
            }
            (Some(_), _, Some(_)) => {
                return none("prompt", "the dance has a timeline instead; name one of the same clips");
            }
            (Some(_), _, None) => return none("prompt", "the dance has none; leave it out"),
            (None, Some(_), _) => return none("timeline", "the dance has none; leave it out"),
        }
        match (&moved.music, &mut request.music) {
            (Some(path), Some(music)) => music.path.clone_from(path),
            (Some(_), None) => return none("music", "the dance has none; leave it out"),
            (None, _) => {}
        }
        Ok(request)
    }

    /// Opens a request of [`Provenance::request_at`] with the checkpoint that made the dance.
    ///
    /// # Errors
    /// Those of [`OpenRequest::load`]; weights, a tokenizer, a prompt or music that have changed since, with both hashes.
    pub fn open(&self, request: Resolved) -> Result<OpenRequest> {
        let open = OpenRequest::load(request, CheckpointChoice::Step(self.step))?;
        let (run, tokenizer) = (open.resolved.run.display(), open.run.tokenizer.display());
        let weights = format!("{run}: the weights at step {}", self.step);
        check_hash(&weights, &self.weights_sha256, &open.run.weights_sha256())?;
        check_hash(&format!("{tokenizer}: the tokenizer"), &self.tokenizer_sha256, &open.tokenizer.hash())?;
        if let Some((expected, found)) = self.limits_sha256.as_ref().zip(open.limits_sha256()) {
            check_hash(&format!("{run}: the limits of {LIMITS}"), expected, &found)?;
        }
        if let (Some(expected), Some(prompt), Some(request)) =
            (&self.prompt_sha256, &open.prompt, &open.resolved.prompt)
        {
            let what = match request.timeline {
                Some(_) => "the clip that the timeline is composed into".into(),
                None => format!("{}: the prompt", request.path.display()),
            };
            check_hash(&what, expected, &prompt.clip.sha256)?;
        }
        if let (Some(expected), Some(music), Some(request)) = (&self.music_sha256, &open.music, &open.resolved.music) {
            check_hash(&format!("{}: the music", request.path.display()), expected, &music.sha256)?;
        }
        Ok(open)
    }

    /// Refuses the bytes of a dance that was made again and came out different, as other processors or devices may give them.
    ///
    /// # Errors
    /// Both hashes.
    pub fn check_bytes(&self, bytes: &[u8]) -> Result<()> {
        let found = FileRecord::of(bytes).sha256;
        if found == self.output.sha256 {
            return Ok(());
        }
        let (then, now) = (&self.request.computing.kernels, kinelm_engine::dispatch::name());
        let (version, this) = (&self.kinelm, env!("CARGO_PKG_VERSION"));
        let what = format!(
            "the dance came out different: SHA-256 {found}, then {}; it was made by kinelm {version} with the kernels {then}, \
             this is {this} with {now}. Nothing was written",
            self.output.sha256,
        );
        Err(Error::Failed(what))
    }

    /// The sidecar of the same dance at `out`, written at a rate.
    pub fn copied_to(self, out: &Path, open: &OpenRequest, fps: f64) -> Provenance {
        // by its first name, which an animation of a GLB keeps
        let read = ReadOptions { fps_source: Some(fps), ..open.read_back(Path::new(&self.output.file)) };
        let output = FileHash { file: name_of(out), ..self.output };
        let request = Resolved { seed: self.request.seed, ..open.resolved.clone() };
        Provenance { output, read, request, kinelm: env!("CARGO_PKG_VERSION").into(), ..self }
    }
}

/// Refuses an input that has changed since the dance was made.
fn check_hash(what: &str, expected: &str, found: &str) -> Result<()> {
    if expected == found {
        return Ok(());
    }
    let expected = format!("{expected}: it has changed since the dance was made");
    Err(Error::invalid(what.to_string(), format!("SHA-256 {found}"), expected))
}
