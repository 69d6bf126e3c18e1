//! The calls, dates and machines of a run: `provenance.json`. They aren't in `config.toml`, so that the same settings give the
//! same bytes there.

use crate::Result;
use kinelm_store::{files, input};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::OnceLock;
use std::time::SystemTime;

/// Its file in a run's folder.
pub(crate) const PROVENANCE: &str = "provenance.json";
/// The layout's version.
const VERSION: u32 = 1;

/// The contents of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The layout's version.
    pub version: u32,
    /// The call that began the run, and those that resumed it.
    pub calls: Vec<Call>,
}

/// A process that trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Call {
    /// The words of its command line.
    pub command: Vec<String>,
    /// The version of kinelm.
    pub kinelm: String,
    /// The commit that it was built from; `null` where it was built without its history.
    pub commit: Option<String>,
    /// When it began, RFC 3339, UTC.
    pub date: String,
    /// The machine's name.
    pub host: String,
}

/// The commit that the program was built from.
static COMMIT: OnceLock<&str> = OnceLock::new();

/// Sets the commit that the program was built from, which runs store. Only the first call counts.
pub fn built_from(commit: &'static str) {
    let _ = COMMIT.set(commit);
}

impl Call {
    /// This process, now.
    pub fn now() -> Call {
        Call {
            command: std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect(),
            kinelm: env!("CARGO_PKG_VERSION").into(),
            commit: COMMIT.get().map(|commit| (*commit).to_owned()),
            date: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            host: gethostname::gethostname().to_string_lossy().into_owned(),
        }
    }
}

/// Adds this process to the calls of a run. A file that can't be read is replaced: no run fails for it.
///
/// # Errors
/// I/O errors.
pub fn note(run: &Path) -> Result<()> {
    let path = run.join(PROVENANCE);
    let found = input::bytes(&path).ok().and_then(|bytes| serde_json::from_slice::<Provenance>(&bytes).ok());
    let mut all = found.unwrap_or(Provenance { version: VERSION, calls: Vec::new() });
    all.calls.push(Call::now());
    let text = serde_json::to_string_pretty(&all).expect("strings are JSON");
    Ok(files::write_whole(&path, (text + "\n").as_bytes())?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn every_call_is_stored() {
        let dir = tempfile::tempdir().unwrap();
        note(dir.path()).unwrap();
        note(dir.path()).unwrap();
        let read =
            || -> Provenance { serde_json::from_slice(&fs::read(dir.path().join(PROVENANCE)).unwrap()).unwrap() };
        let found = read();
        assert_eq!((found.version, found.calls.len()), (VERSION, 2));
        let call = &found.calls[0];
        assert!(call.date.ends_with('Z') && call.date.starts_with("20"), "{call:?}");
        assert!(!call.command.is_empty() && !call.host.is_empty(), "{call:?}");
        assert!(call.commit.as_ref().is_none_or(|commit| commit.len() >= 7), "{call:?}");
        fs::write(dir.path().join(PROVENANCE), "{").unwrap();
        note(dir.path()).unwrap();
        assert_eq!(read().calls.len(), 1);
    }
}
