//! What a study has finished, on disk: a row that was measured is not measured again.

use super::row::Row;
use crate::{Error, Result};
use kinelm_store::hash::hex;
use kinelm_store::{files, input};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fs;
use std::path::{Path, PathBuf};

/// Counted up whenever a figure comes to mean something else.
const FORMAT: u32 = 1;

/// The folder of finished rows.
#[derive(Debug, Clone)]
pub struct Store {
    rows: PathBuf,
    data: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Finished<T> {
    key: String,
    result: T,
}

impl Store {
    /// The rows under `out`; `data` is the hash of the clips. With `force` whatever was finished is removed.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] when `out` holds something that no study wrote; [`kinelm_store::Error::Io`].
    pub fn open(out: &Path, data: &str, force: bool) -> Result<Self> {
        let rows = out.join("rows");
        let strange = |p: &Path| p.is_dir() && !rows.is_dir() && fs::read_dir(p).is_ok_and(|mut d| d.next().is_some());
        if strange(out) {
            let what = "a folder that no study wrote: it has files and no rows/";
            return Err(Error::file(out, what, "a new folder, or a study's", "give another folder"));
        }
        if force {
            let finished = |path: &PathBuf| path.file_name().and_then(|n| n.to_str()).is_some_and(is_finished);
            for path in fs::read_dir(&rows).into_iter().flatten().flatten().map(|e| e.path()).filter(finished) {
                fs::remove_file(&path).map_err(Error::io(&path))?;
            }
        }
        fs::create_dir_all(&rows).map_err(Error::io(&rows))?;
        Ok(Store { rows, data: data.to_string() })
    }

    /// What a result depends on: what was measured, the clips, the program.
    fn key(&self, what: &impl Serialize) -> String {
        let text = serde_json::to_vec(&(FORMAT, env!("CARGO_PKG_VERSION"), &self.data, what));
        hex(Sha256::new_with_prefix(text.expect("settings have text keys")))
    }

    fn path(&self, name: &str, key: &str, end: &str) -> PathBuf {
        // 12 digits make the name; the file has the whole key, which `get` compares
        self.rows.join(format!("{name}-{}{end}", &key[..12]))
    }

    /// The result stored under a name for these settings; `None` if there is none or it can't be read.
    pub fn get<T: DeserializeOwned>(&self, name: &str, what: &impl Serialize) -> Option<T> {
        let key = self.key(what);
        let Ok(bytes) = input::peek_bytes(&self.path(name, &key, ".json")) else { return None };
        let finished = serde_json::from_slice::<Finished<T>>(&bytes).ok().filter(|f| f.key == key);
        finished.map(|f| f.result)
    }

    /// Stores a finished result.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`] when it can't be written.
    pub fn put(&self, name: &str, what: &impl Serialize, result: &impl Serialize) -> Result<()> {
        let key = self.key(what);
        let text = serde_json::to_vec_pretty(&Finished { key: key.clone(), result }).expect("results have text keys");
        Ok(files::write_whole(&self.path(name, &key, ".json"), &text)?)
    }

    /// The file of a row's tokenizer.
    pub fn tokenizer(&self, row: &Row) -> PathBuf {
        self.path(&row.name, &self.key(&row.config), ".tokenizer.json")
    }
}

/// Whether [`Store::path`] gives such names.
fn is_finished(name: &str) -> bool {
    let stem = name.strip_suffix(".tokenizer.json").or(name.strip_suffix(".json"));
    let key = stem.and_then(|stem| stem.rsplit_once('-')).map(|(_, key)| key);
    key.is_some_and(|key| key.len() == 12 && key.bytes().all(|b| b.is_ascii_hexdigit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_finished_is_found_again_for_the_same_data_and_settings_alone() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("study");
        let store = Store::open(&out, "data", false).unwrap();
        assert_eq!(store.get::<u32>("a", &60), None);
        store.put("a", &60, &7).unwrap();
        let again = Store::open(&out, "data", false).unwrap();
        assert_eq!(again.get("a", &60), Some(7));
        assert_eq!((again.get::<u32>("a", &61), again.get::<u32>("b", &60)), (None, None));
        assert_eq!(Store::open(&out, "other", false).unwrap().get::<u32>("a", &60), None);
        let only = fs::read_dir(out.join("rows")).unwrap().next().unwrap().unwrap().path();
        fs::write(&only, "{").unwrap();
        assert_eq!(again.get::<u32>("a", &60), None, "a broken file counts for nothing");
        again.put("a", &60, &8).unwrap();
        let notes = out.join("rows/notes.json");
        fs::write(&notes, "mine").unwrap();
        assert_eq!(Store::open(&out, "data", true).unwrap().get::<u32>("a", &60), None, "by force anew");
        assert!(notes.exists(), "and nothing else is removed");
    }

    #[test]
    fn a_folder_of_something_else_is_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("a.bvh"), "").unwrap();
        let e = Store::open(dir.path(), "data", true).unwrap_err().to_string();
        assert!(e.contains("no study wrote") && e.contains("another folder"), "{e}");
        assert!(!dir.path().join("rows").exists());
    }
}
