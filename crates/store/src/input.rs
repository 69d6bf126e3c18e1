//! Opens all inputs: refuses pipes, devices and text that isn't UTF-8, and records what a call reads, so that it doesn't
//! overwrite its inputs.
//!
//! Limit: the record is the process's. Calls at the same time (Python, the studio) can't write over each other's inputs
//! either.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Identity of a file: device and inode; on other systems the path without links.
#[cfg(unix)]
pub type Identity = (u64, u64);
/// Identity of a file: device and inode; on other systems the path without links.
#[cfg(not(unix))]
pub type Identity = PathBuf;

/// The inputs of a call: all files that are opened while it lives, on any thread. What was read before it or is read after
/// it is no input of the call; where no call lives, nothing is recorded. Calls that run at once share their inputs.
#[derive(Debug)]
pub struct Inputs(());

/// How many calls live, and the path of each file that they have read. Of the process, since files are opened far below
/// the call, on rayon's threads too.
static READ: Mutex<(usize, BTreeMap<Identity, PathBuf>)> = Mutex::new((0, BTreeMap::new()));

fn read() -> MutexGuard<'static, (usize, BTreeMap<Identity, PathBuf>)> {
    READ.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Inputs {
    /// Records the files that are read from now on.
    pub fn record() -> Inputs {
        read().0 += 1;
        Inputs(())
    }
}

impl Drop for Inputs {
    fn drop(&mut self) {
        let mut read = read();
        read.0 -= 1;
        // not before: a call that began later may still need what an earlier one read
        if read.0 == 0 {
            read.1.clear();
        }
    }
}

/// The identity of the file at `path`, links followed; `None` without a file.
#[cfg(unix)]
pub fn identity(path: &Path) -> Option<Identity> {
    use std::os::unix::fs::MetadataExt;
    fs::metadata(path).map(|m| (m.dev(), m.ino())).ok()
}

/// The identity of the file at `path`, links followed; `None` without a file.
#[cfg(not(unix))]
pub(crate) fn identity(path: &Path) -> Option<Identity> {
    path.canonicalize().ok()
}

/// Opens an input. Refuses pipes and devices, which may have no end, before they are opened.
///
/// # Errors
/// Something that is no file; I/O errors.
pub fn open(path: &Path) -> Result<File> {
    let file = peek(path)?;
    note(path);
    Ok(file)
}

/// As [`open`], for a file that is no input: an output that may be replaced, or a file that the call itself continues.
///
/// # Errors
/// Those of [`open`].
pub fn peek(path: &Path) -> Result<File> {
    check(path)?;
    File::open(path)
}

/// Records an input that is opened elsewhere.
pub fn note(path: &Path) {
    // not held while the file system answers
    let calls = read().0;
    if let Some(id) = identity(path).filter(|_| calls > 0 && path.is_file()) {
        read().1.insert(id, path.to_owned());
    }
}

/// Whether a call that lives has read the file at `path`, under any name.
pub(crate) fn was_read(path: &Path) -> bool {
    let Some(id) = identity(path) else { return false };
    // if the input was deleted, another file may have its inode
    read().1.get(&id).is_some_and(|input| identity(input) == Some(id))
}

/// The bytes of an input.
///
/// # Errors
/// Those of [`open`].
pub fn bytes(path: &Path) -> Result<Vec<u8>> {
    all(open(path)?)
}

/// The bytes of a file that is no input, as [`peek`] opens it.
///
/// # Errors
/// Those of [`open`].
pub fn peek_bytes(path: &Path) -> Result<Vec<u8>> {
    all(peek(path)?)
}

/// Some of the bytes of an input: as many as are there.
///
/// # Errors
/// Those of [`open`].
pub fn part(path: &Path, at: u64, length: u64) -> Result<Vec<u8>> {
    let mut file = open(path)?;
    file.seek(SeekFrom::Start(at))?;
    to_end(file.take(length), length)
}

fn all(file: File) -> Result<Vec<u8>> {
    let length = file.metadata()?.len();
    to_end(file, length)
}

/// What is left of an input that is of about this length.
fn to_end(mut input: impl Read, length: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // a length that no memory has is an error here, not an abort in the allocator
    let length = usize::try_from(length).map_err(|_| ErrorKind::OutOfMemory)?;
    // one more, so that the end is found without growing the buffer
    bytes.try_reserve_exact(length.saturating_add(1))?;
    input.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of an input.
///
/// # Errors
/// As [`bytes`]; [`ErrorKind::InvalidData`] for bytes that are not UTF-8.
pub fn text(path: &Path) -> Result<String> {
    let no_text =
        |_| Error::new(ErrorKind::InvalidData, "found bytes that are no UTF-8, expected text; save it as UTF-8");
    String::from_utf8(bytes(path)?).map_err(no_text)
}

/// The text of an input that may be missing.
///
/// # Errors
/// As [`text`], but for a file that isn't there.
pub fn text_if_there(path: &Path) -> Result<Option<String>> {
    match text(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        found => found.map(Some),
    }
}

/// Refuses pipes and devices. Folders pass; opening them fails with its own message.
///
/// # Errors
/// Something that is no file; I/O errors.
pub fn check(path: &Path) -> Result<()> {
    let kind = fs::metadata(path)?;
    match kind.is_file() || kind.is_dir() {
        true => Ok(()),
        false => Err(Error::other("found a pipe or a device, expected a file; save what it gives as a file first")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_file_and_what_is_no_text_is_said() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bvh");
        fs::write(&path, b"a\xff").unwrap();
        assert_eq!(bytes(&path).unwrap(), b"a\xff");
        let e = text(&path).unwrap_err();
        assert!(e.kind() == ErrorKind::InvalidData && e.to_string().contains("no UTF-8"), "{e}");
        assert_eq!(bytes(&dir.path().join("none")).unwrap_err().kind(), ErrorKind::NotFound);
        assert!(bytes(dir.path()).is_err());
        if cfg!(unix) {
            // with no end
            assert!(bytes(Path::new("/dev/zero")).unwrap_err().to_string().contains("expected a file"));
        }
    }

    #[test]
    fn a_file_that_was_read_is_known_by_all_its_names_while_it_is_there() {
        let dir = tempfile::tempdir().unwrap();
        let [path, other, link] = ["a", "b", "c"].map(|name| dir.path().join(name));
        fs::write(&path, b"x").unwrap();
        fs::hard_link(&path, &link).unwrap();
        fs::write(&other, b"x").unwrap();
        let call = Inputs::record();
        peek_bytes(&path).unwrap();
        assert!(!was_read(&path));
        bytes(&path).unwrap();
        assert!(was_read(&path) && (was_read(&link) || cfg!(not(unix))));
        assert!(!was_read(&other) && !was_read(&dir.path().join("none")) && !was_read(dir.path()));
        fs::rename(&other, &path).unwrap();
        assert!(!was_read(&link));
        drop(call);
        bytes(&link).unwrap();
        assert!(!was_read(&link));
    }
}
