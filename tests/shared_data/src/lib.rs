//! Real motion for the tests: `../shared/data` beside the checkout, unpacked once into `target/shared-data`.
//!
//! The data's licences keep them out of this repository, so tests that need them ask here and return early, saying so,
//! where there are none. Where the folder is there, what is missing in it fails the test.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// The folder of a set (`cmu-dance`, `bandai-1`, `bandai-2`), or `None` after a line on stderr that `test` was skipped.
///
/// # Panics
/// If the folder of the sets is there and can't be unpacked, or lacks this one.
pub fn set(name: &str, test: &str) -> Option<PathBuf> {
    let Some(folder) = unpacked().map(|d| d.join(name)) else {
        skipped(test, "the shared motion data are not on hand");
        return None;
    };
    assert!(folder.is_dir(), "{} is missing", folder.display());
    Some(folder)
}

/// The split list of a set: a CSV with the columns `clip,split,...labels`.
pub fn split_csv(name: &str) -> PathBuf {
    shared().join("data/splits").join(name).with_extension("csv")
}

/// A file or folder of the reference material, or `None` after a line on stderr.
///
/// # Panics
/// If there is reference material without it.
pub fn reference(name: &str, test: &str) -> Option<PathBuf> {
    let reference = shared().join("reference");
    if !reference.exists() {
        skipped(test, "the reference material is not on hand");
        return None;
    }
    let path = reference.join(name);
    assert!(path.exists(), "{} is missing", path.display());
    Some(path)
}

/// Says that a test was skipped, past the test runner's capture, in a form that a script can count.
pub fn skipped(test: &str, why: &str) {
    // not eprintln!, which the runner swallows for tests that pass
    let _ = writeln!(std::io::stderr(), "SKIPPED {test}: {why}");
}

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

fn shared() -> PathBuf {
    root().join("../shared")
}

fn unpacked() -> Option<&'static Path> {
    static DATA: OnceLock<Option<PathBuf>> = OnceLock::new();
    DATA.get_or_init(|| {
        let script = shared().join("data/unpack.sh");
        if !script.exists() {
            return None;
        }
        let data = root().join("target/shared-data");
        std::fs::create_dir_all(&data).unwrap();
        // several test programs start at once; the first unpacks, the others wait
        let lock = File::create(data.join(".lock")).unwrap();
        lock.lock().unwrap();
        let done = Command::new("sh").arg(script).arg(&data).output().unwrap();
        assert!(done.status.success(), "unpacking: {}", String::from_utf8_lossy(&done.stderr));
        Some(data)
    })
    .as_deref()
}
