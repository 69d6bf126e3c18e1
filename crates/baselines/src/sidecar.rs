//! The sidecar of an LSTM's dance: `dance.bvh.kinelm.json`, as beside any dance ([`kinelm_generate::provenance`]). The key of
//! its request names the model: `aclstm`, `music_lstm`.

use crate::{Error, Result};
use kinelm_motion::format::ReadOptions;
use kinelm_store::output::Outputs;
use kinelm_store::sidecar::{self, FileHash};
use kinelm_store::{FileRecord, files, input};
use serde::de::DeserializeOwned;
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::Value;
use std::path::Path;

/// The layout that this program writes and reads.
const SCHEMA: u32 = 3;

/// A dance to generate. With the bytes of the network and of its input it decides the dance.
pub trait Request: Clone + Serialize + DeserializeOwned {
    /// The key of the request.
    const KEY: &'static str;
    /// The network's input, and the key of its hash.
    const INPUT: [&'static str; 2];
    /// The command that generates such dances.
    const COMMAND: &'static str;
    /// The run folder.
    fn run(&self) -> &Path;
    /// How a dance that is written to the file `dance` is read.
    fn read_back(&self, dance: &Path) -> ReadOptions;
}

/// The sidecar of a dance.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sidecar<R> {
    /// The layout's version, `SCHEMA`.
    pub schema: u32,
    /// The program's version.
    pub kinelm: String,
    /// The dance.
    pub output: FileHash,
    /// How it is read.
    pub read: ReadOptions,
    /// SHA-256 of the dance that this one replaces.
    #[serde(default)]
    pub replaces: Option<String>,
    /// What was requested.
    pub request: R,
    /// Updates of the network.
    pub step: u64,
    /// SHA-256 of its weights' file.
    pub weights_sha256: String,
    /// SHA-256 of the input.
    pub input_sha256: String,
    /// The processor instructions that the engine used.
    pub kernels: String,
}

impl<R: Request> Serialize for Sidecar<R> {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("schema", &self.schema)?;
        map.serialize_entry("kinelm", &self.kinelm)?;
        map.serialize_entry("output", &self.output)?;
        map.serialize_entry("read", &self.read)?;
        if let Some(replaces) = &self.replaces {
            map.serialize_entry("replaces", replaces)?;
        }
        map.serialize_entry(R::KEY, &self.request)?;
        map.serialize_entry("step", &self.step)?;
        map.serialize_entry("weights_sha256", &self.weights_sha256)?;
        map.serialize_entry(R::INPUT[1], &self.input_sha256)?;
        map.serialize_entry("kernels", &self.kernels)?;
        map.end()
    }
}

impl<R: Request> Sidecar<R> {
    /// Of a dance with these bytes and rate; `weights`: their updates, and their hash.
    pub fn of(
        request: &R,
        step: u64,
        weights: &str,
        input_sha256: &str,
        dance: &Path,
        fps: f64,
        bytes: &[u8],
    ) -> Sidecar<R> {
        Sidecar {
            schema: SCHEMA,
            kinelm: env!("CARGO_PKG_VERSION").into(),
            output: FileHash { file: sidecar::name_of(dance), sha256: FileRecord::of(bytes).sha256 },
            read: ReadOptions { fps_source: Some(fps), ..request.read_back(dance) },
            replaces: None,
            request: request.clone(),
            step,
            weights_sha256: weights.into(),
            input_sha256: input_sha256.into(),
            kernels: kinelm_engine::dispatch::name().into(),
        }
    }

    /// Reads such a file.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for text that is no such file, of another model's dance, or of another version.
    pub fn load(path: &Path) -> Result<Sidecar<R>> {
        Sidecar::parse(path, &input::text(path).map_err(Error::io(path))?)
    }

    /// [`Sidecar::load`] of such a file's text.
    fn parse(path: &Path, text: &str) -> Result<Sidecar<R>> {
        let expected = format!("what {} wrote beside a dance", R::COMMAND);
        let wrong = |e: serde_json::Error| Error::file(path, e.to_string(), expected.clone(), "");
        let mut value: Value = serde_json::from_str(text).map_err(wrong)?;
        // the version first: keys of another one would be reported as unknown
        if value["schema"] != SCHEMA {
            let found = format!("schema {}", value["schema"]);
            let expected = format!("schema {SCHEMA}: {expected}");
            return Err(Error::file(path, found, expected, "make it again with this version"));
        }
        // both keys depend on the model; under fixed names serde can read them
        if let Some(object) = value.as_object_mut() {
            for (theirs, ours) in [(R::KEY, "request"), (R::INPUT[1], "input_sha256")] {
                match object.remove(theirs) {
                    Some(value) => object.insert(ours.into(), value),
                    None => return Err(Error::file(path, format!("no `{theirs}`"), expected, "")),
                };
            }
        }
        let found: Sidecar<R> = serde_json::from_value(value).map_err(wrong)?;
        match files::is_plain(&found.output.file) {
            true => Ok(found),
            false => {
                let (found, expected) = (format!("`{}`", found.output.file), "the name of a dance beside this file");
                Err(Error::file(path, found, expected, "it isn't as it was written"))
            }
        }
    }

    /// Refuses another network or input than the dance's, and other bytes.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for what has changed, with both hashes.
    pub fn check(&self, now: &Sidecar<R>) -> Result<()> {
        let run = now.request.run().display();
        let all = [
            (format!("{run}: the weights at step {}", self.step), &self.weights_sha256, &now.weights_sha256),
            (format!("{run}: {}", R::INPUT[0]), &self.input_sha256, &now.input_sha256),
            (format!("{}: the dance", self.output.file), &self.output.sha256, &now.output.sha256),
        ];
        for (what, then, now_is) in all {
            if then != now_is {
                let by = |made: &Sidecar<R>| format!("kinelm {} with the kernels {}", made.kinelm, made.kernels);
                let found = format!("of SHA-256 {now_is}, by {}", by(now));
                let expected = format!("{then}, by {}; nothing was written", by(self));
                return Err(Error::invalid(what, found, expected));
            }
        }
        Ok(())
    }

    /// Writes it beside the dance, and then the dance.
    ///
    /// # Errors
    /// What [`Outputs::write`] refuses; paths that aren't UTF-8, which JSON can't hold.
    pub fn write(mut self, dance: &Path, bytes: &[u8], outputs: &Outputs) -> Result<()> {
        let sha256 = self.output.sha256.clone();
        Ok(sidecar::write_beside(dance, bytes, &sha256, outputs, |before| {
            self.replaces = before;
            serde_json::to_string_pretty(&self)
        })?)
    }
}
