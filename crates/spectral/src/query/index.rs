//! The folder that searches read.
//!
//! `index.json` names the parts; a part is a folder of the windows that were added in one go (`features.f32`,
//! `heads.i8`, `rests.i8`, `order.u32`, `scales.f32`, `sizes.f64`, `clips.jsonl`) and never changes. A part is written under a temporary name, synced and renamed, and only then
//! named in `index.json`, which is replaced whole: a build that is cut off leaves the index as it was.

use super::database::Database;
use super::options::{FeatureKind, IndexOptions, unfitted};
use super::part::Part;
use super::record::{DAMAGED, Manifest, VERSION};
use crate::{Error, PcaBasis, Result};
use kinelm_store::{FileRecord, input};
use std::path::Path;

pub(super) const MANIFEST: &str = "index.json";
pub(super) const BASIS: &str = "basis.json";

/// An index, open for reading; its features stay in their files.
pub struct Index {
    manifest: Manifest,
    basis: Option<PcaBasis>,
    database: Database,
}

impl Index {
    /// Opens an index after checking its version and every file's length and checksum.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for a folder that is no index, one of another version, and files that are not as they
    /// were written.
    pub fn open(dir: &Path) -> Result<Index> {
        if cfg!(target_endian = "big") {
            return Err(Error::unsupported("reading an index", "its files are little-endian, this machine is not"));
        }
        let manifest = read_manifest(dir)?;
        let basis = manifest.basis.as_ref().map(|record| read_basis(&dir.join(BASIS), record)).transpose()?;
        check(&dir.join(MANIFEST), &manifest, basis.as_ref())?;
        let mut parts = Vec::new();
        for record in &manifest.parts {
            parts.push(Part::open(&dir.join(&record.name), record, manifest.numbers)?);
        }
        let database = Database::new(manifest.numbers, parts);
        Ok(Index { manifest, basis, database })
    }

    /// `index.json`.
    pub(crate) fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// How windows are cut and what is held of them.
    pub fn options(&self) -> &IndexOptions {
        &self.manifest.options
    }

    /// The basis of a fitted transform.
    pub(crate) fn basis(&self) -> Option<&PcaBasis> {
        self.basis.as_ref()
    }

    /// The windows.
    pub fn database(&self) -> &Database {
        &self.database
    }
}

/// Reads `index.json`, its version first.
pub(super) fn read_manifest(dir: &Path) -> Result<Manifest> {
    let path = dir.join(MANIFEST);
    let text = input::text(&path).map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound => {
            let help = "an index is a folder that `kinelm query build` wrote";
            Error::file(dir, "no index.json", "an index", help)
        }
        _ => Error::io(&path)(e),
    })?;
    let wrong = |e: serde_json::Error| Error::file(&path, e.to_string(), "an index's description", DAMAGED);
    let value: serde_json::Value = serde_json::from_str(&text).map_err(wrong)?;
    match value.get("version").and_then(serde_json::Value::as_u64) {
        Some(version) if version == u64::from(VERSION) => serde_json::from_value(value).map_err(wrong),
        found => {
            let program = value.get("program").and_then(|p| p.as_str()).unwrap_or("unknown");
            let found = found.map_or("no version".into(), |v| format!("version {v}, written by kinelm {program}"));
            let help = "build the index again with this program, or read it with the one that wrote it";
            Err(Error::file(&path, found, format!("version {VERSION}"), help))
        }
    }
}

/// Holds what the description says against itself.
fn check(path: &Path, manifest: &Manifest, basis: Option<&PcaBasis>) -> Result<()> {
    let wrong = |found: String, expected: String| Err(Error::file(path, found, expected, DAMAGED));
    let options = &manifest.options;
    if let Err(e) = options.validate() {
        return wrong(e.to_string(), "what an index can be built with".into());
    }
    // a name is joined to the folder's path: it must not lead out of it
    if let Some(part) = manifest.parts.iter().find(|p| !is_part(&p.name)) {
        return wrong(format!("a part `{}`", part.name), "part-0001 and so on".into());
    }
    let frames = options.windows.frames;
    let kept = match (&options.transform, basis) {
        (FeatureKind::Model { .. }, _) => return Ok(()), // its run is read on demand
        (FeatureKind::Pca { keep }, Some(basis)) if basis.length() == frames && basis.variances.len() == *keep => *keep,
        (FeatureKind::Pca { keep }, _) => {
            return wrong("another basis or none".into(), format!("{keep} components of {frames}"));
        }
        (kind, _) => unfitted(kind, frames).map_or(0, |transform| transform.kept()),
    };
    match kept * options.channels() {
        numbers if numbers == manifest.numbers => Ok(()),
        numbers => wrong(format!("features of {} numbers", manifest.numbers), format!("{numbers}, by its options")),
    }
}

/// Whether a part may be called so.
fn is_part(name: &str) -> bool {
    name.strip_prefix("part-").is_some_and(|number| number.len() >= 4 && number.bytes().all(|b| b.is_ascii_digit()))
}

fn read_basis(path: &Path, record: &FileRecord) -> Result<PcaBasis> {
    let bytes = input::bytes(path).map_err(Error::io(path))?;
    if FileRecord::of(&bytes) != *record {
        return Err(Error::file(path, "another basis", "the one that the features were made with", DAMAGED));
    }
    serde_json::from_slice(&bytes).map_err(|e| Error::file(path, e.to_string(), "a basis", DAMAGED))
}
