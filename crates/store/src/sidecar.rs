//! Sidecars: `dance.bvh.kinelm.json` holds the request that generated `dance.bvh`.
//!
//! Every sidecar has one envelope: `schema` (the version of its layout), `kinelm` (the program's version), `output` (name and
//! hash of its file), `replaces` (the hash of the file being replaced, while it is written), and the request, under a key that
//! names its kind.

use crate::output::Outputs;
use crate::{Error, Result, files, hash, input, part};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// The end of a sidecar's name.
pub(crate) const ENDING: &str = "kinelm.json";

/// A file in the same folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileHash {
    /// Its name.
    pub file: String,
    /// SHA-256 of its bytes.
    pub sha256: String,
}

/// The sidecar of `file`: `dance.bvh.kinelm.json`, one for each format.
///
/// ```
/// use std::path::Path;
///
/// let sidecar = kinelm_store::sidecar::path_of(Path::new("a/dance.bvh"));
/// assert_eq!(sidecar, Path::new("a/dance.bvh.kinelm.json"));
/// ```
pub fn path_of(file: &Path) -> PathBuf {
    let mut path = file.as_os_str().to_owned();
    path.push(format!(".{ENDING}"));
    path.into()
}

/// A file's name without its folder.
pub fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Whether `file` is unchanged: its sidecar has the hash of its bytes.
///
/// # Errors
/// [`Error::Io`] when the file can't be read.
pub fn has_hash_of(file: &Path) -> Result<bool> {
    let hashes = |envelope: Value| -> Option<Vec<String>> {
        // between the renames of sidecar and file, the sidecar is new and the file has the hash `replaces`
        let found = [&envelope["output"]["sha256"], &envelope["replaces"]].into_iter().filter_map(|hash| hash.as_str());
        (envelope["output"]["file"] == name_of(file)).then(|| found.map(str::to_owned).collect())
    };
    let found = json(&path_of(file)).and_then(hashes).unwrap_or_default();
    Ok(!found.is_empty() && found.contains(&hash::of_file(file)?))
}

/// Whether `path` is a sidecar whose file has the matching name.
pub fn is_beside_its_file(path: &Path) -> bool {
    let Some(envelope) = json(path).filter(|json| json["schema"].is_u64() && json["kinelm"].is_string()) else {
        return false;
    };
    let output: Option<FileHash> = serde_json::from_value(envelope["output"].clone()).ok();
    output.is_some_and(|output| path_of(&path.with_file_name(&output.file)) == path && files::is_plain(&output.file))
}

/// Whether the sidecar at `path` has its request under one of these keys.
pub fn is_of_kind(path: &Path, keys: &[&str]) -> bool {
    json(path).is_some_and(|envelope| keys.iter().any(|key| envelope.get(key).is_some()))
}

/// A JSON file, read without marking it as an input.
fn json(path: &Path) -> Option<Value> {
    serde_json::from_slice(&input::peek_bytes(path).ok()?).ok()
}

/// Refuses `file` while it is the one that its sidecar was to replace: the sidecar is of a dance whose replacement didn't
/// finish, and made again, that would be written over the only copy of another.
///
/// # Errors
/// [`Error::Taken`] then; [`Error::Io`] when the file can't be read.
pub fn check_finished(file: &Path) -> Result<()> {
    let replaces = json(&path_of(file)).and_then(|envelope| Some(envelope["replaces"].as_str()?.to_owned()));
    let Some(replaces) = replaces.filter(|_| file.is_file()) else { return Ok(()) };
    match hash::of_file(file)? == replaces {
        true => {
            let what = "is the dance before: its replacement didn't finish, and its sidecar is of the new one. Give `out` for \
                        the new one, or `force` to write it over this one";
            Err(Error::taken(file, what))
        }
        false => Ok(()),
    }
}

/// Writes the sidecar of `file`, and the file. Both are on the disk under temporary names before either has its own: what fails
/// for want of space changes nothing, and if this is interrupted between both names, the sidecar has the hash of the old file
/// too, as the one it replaces ([`check_finished`]). `text` builds the sidecar's text from the hash of the file being
/// replaced;
/// `sha256` is that of the new `bytes`.
///
/// # Errors
/// Those of [`Outputs::write`]; a path that isn't UTF-8, which JSON can't hold.
pub fn write_beside(
    file: &Path,
    bytes: &[u8],
    sha256: &str,
    outputs: &Outputs,
    text: impl FnOnce(Option<String>) -> serde_json::Result<String>,
) -> Result<()> {
    outputs.check_replaceable(file, Some(sha256))?;
    let before = hash::of_file(file).ok().filter(|hash| hash != sha256);
    let text = text(before.filter(|_| has_hash_of(file).unwrap_or(false)));
    let text = text.map_err(|e| Error::unsupported(path_of(file).display().to_string(), e.to_string()))?;
    let path = path_of(file);
    part::sweep(&[file, &path]);
    let (new, sidecar) = (outputs.prepare(file, bytes)?, outputs.prepare(&path, (text + "\n").as_bytes())?);
    // first: `replaces` covers a crash in between; a new file beside an old sidecar would look changed by hand
    sidecar.name()?;
    new.name()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_sidecar_stands_beside_the_file_it_names() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::write(at("a.bvh"), "dance").unwrap();
        let output = FileHash { file: "a.bvh".into(), sha256: hash::of(b"dance") };
        let envelope = serde_json::json!({ "schema": 3, "kinelm": "0.1.0", "output": output, "recipe": {} });
        fs::write(path_of(&at("a.bvh")), envelope.to_string()).unwrap();
        assert!(is_beside_its_file(&at("a.bvh.kinelm.json")) && has_hash_of(&at("a.bvh")).unwrap());
        assert!(
            is_of_kind(&at("a.bvh.kinelm.json"), &["aclstm", "recipe"])
                && !is_of_kind(&at("a.bvh.kinelm.json"), &["aclstm"])
        );
        fs::copy(at("a.bvh.kinelm.json"), at("b.bvh.kinelm.json")).unwrap();
        fs::copy(at("a.bvh"), at("b.bvh")).unwrap();
        assert!(!is_beside_its_file(&at("b.bvh.kinelm.json")) && !has_hash_of(&at("b.bvh")).unwrap());
        fs::write(at("a.bvh"), "danced").unwrap();
        assert!(!has_hash_of(&at("a.bvh")).unwrap() && !has_hash_of(&at("b.bvh")).unwrap());
        assert!(has_hash_of(&at("none")).is_ok_and(|has| !has));
    }
}
