//! What stands beside a dance that another model than a GPT made.
//!
//! The file is `dance.bvh.kinelm.json`, as beside any dance ([`kinelm_generate::provenance`]); which model's it is, its recipe's key
//! tells: `aclstm`, `music_lstm`.

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
const SCHEMA: u32 = 2;

/// Everything that decides a dance of some model, but the bytes of the network and of what it is given.
pub trait Recipe: Clone + Serialize + DeserializeOwned {
    /// The key of the recipe.
    const KEY: &'static str;
    /// What the network is given, and the key of its hash.
    const GIVEN: [&'static str; 2];
    /// The command that makes such dances.
    const COMMAND: &'static str;
    /// The run folder.
    fn run(&self) -> &Path;
    /// How a dance is read that is written to the file `dance`.
    fn read_back(&self, dance: &Path) -> ReadOptions;
}

/// What is told of a dance.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Told<R> {
    /// The layout's version, `SCHEMA`.
    pub schema: u32,
    /// The program's version.
    pub kinelm: String,
    /// The dance.
    pub output: FileHash,
    /// How it is read.
    pub read: ReadOptions,
    /// SHA-256 of the dance that this one takes the place of.
    #[serde(default)]
    pub replaces: Option<String>,
    /// What decides it.
    pub recipe: R,
    /// Updates that the network had.
    pub step: u64,
    /// SHA-256 of its weights' file.
    pub weights_sha256: String,
    /// SHA-256 of the file that the network is given.
    pub given_sha256: String,
    /// Instructions of the processor that the engine used.
    pub kernels: String,
}

impl<R: Recipe> Serialize for Told<R> {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("schema", &self.schema)?;
        map.serialize_entry("kinelm", &self.kinelm)?;
        map.serialize_entry("output", &self.output)?;
        map.serialize_entry("read", &self.read)?;
        if let Some(replaces) = &self.replaces {
            map.serialize_entry("replaces", replaces)?;
        }
        map.serialize_entry(R::KEY, &self.recipe)?;
        map.serialize_entry("step", &self.step)?;
        map.serialize_entry("weights_sha256", &self.weights_sha256)?;
        map.serialize_entry(R::GIVEN[1], &self.given_sha256)?;
        map.serialize_entry("kernels", &self.kernels)?;
        map.end()
    }
}

impl<R: Recipe> Told<R> {
    /// Of a dance that is to be written at a rate, by its bytes; `weights`: updates that they had, and their hash.
    pub fn of(
        recipe: &R,
        (step, weights): (u64, &str),
        given_sha256: &str,
        (dance, fps): (&Path, f64),
        bytes: &[u8],
    ) -> Told<R> {
        Told {
            schema: SCHEMA,
            kinelm: env!("CARGO_PKG_VERSION").into(),
            output: FileHash { file: sidecar::name_of(dance), sha256: FileRecord::of(bytes).sha256 },
            read: ReadOptions { fps_source: Some(fps), ..recipe.read_back(dance) },
            replaces: None,
            recipe: recipe.clone(),
            step,
            weights_sha256: weights.into(),
            given_sha256: given_sha256.into(),
            kernels: kinelm_engine::dispatch::name().into(),
        }
    }

    /// Reads such a file.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for text that is no such file, of another model's dance, or of another version.
    pub fn load(path: &Path) -> Result<Told<R>> {
        Told::parse(path, &input::text(path).map_err(Error::io(path))?)
    }

    /// [`Told::load`] of such a file's text.
    fn parse(path: &Path, text: &str) -> Result<Told<R>> {
        let expected = format!("what {} wrote beside a dance", R::COMMAND);
        let wrong = |e: serde_json::Error| Error::file(path, e.to_string(), expected.clone(), "");
        let mut value: Value = serde_json::from_str(text).map_err(wrong)?;
        if value["schema"] != SCHEMA {
            let found = format!("schema {}", value["schema"]);
            let expected = format!("schema {SCHEMA}: {expected}");
            return Err(Error::file(path, found, expected, "make it again with this version"));
        }
        if let Some(object) = value.as_object_mut() {
            for (theirs, ours) in [(R::KEY, "recipe"), (R::GIVEN[1], "given_sha256")] {
                match object.remove(theirs) {
                    Some(value) => object.insert(ours.into(), value),
                    None => return Err(Error::file(path, format!("no `{theirs}`"), expected, "")),
                };
            }
        }
        let told: Told<R> = serde_json::from_value(value).map_err(wrong)?;
        match files::is_plain(&told.output.file) {
            true => Ok(told),
            false => {
                let (found, expected) = (format!("`{}`", told.output.file), "the name of a dance beside this file");
                Err(Error::file(path, found, expected, "it isn't as it was written"))
            }
        }
    }

    /// Refuses a network or a file that is not the one that made the dance, and bytes that came out different.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] that names what has changed, with both hashes.
    pub fn check(&self, now: &Told<R>) -> Result<()> {
        let run = now.recipe.run().display();
        let all = [
            (format!("{run}: the weights at step {}", self.step), &self.weights_sha256, &now.weights_sha256),
            (format!("{run}: {}", R::GIVEN[0]), &self.given_sha256, &now.given_sha256),
            (format!("{}: the dance", self.output.file), &self.output.sha256, &now.output.sha256),
        ];
        for (what, then, now_is) in all {
            if then != now_is {
                let (kernels, by) = (&self.kernels, &self.kinelm);
                let what =
                    format!("{what} has SHA-256 {now_is}, then {then}, made by kinelm {by} with the kernels {kernels}");
                return Err(Error::call(format!(
                    "{what}; this is {} with {}. Nothing was written",
                    now.kinelm, now.kernels
                )));
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
