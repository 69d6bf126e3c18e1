//! Folders that kinelm continues: runs, projects, trainings. One from somebody else may hold links, pipes and files
//! without end; here nothing in it leads out of it, and nothing makes a call wait.
//!
//! Such a folder is looked through once, when it is opened ([`refuse_links`]). A file in it that is locked, continued or read is
//! then opened as itself ([`open`]): no link is followed, no pipe waited for. New files are [`crate::part::PartFile`]s.

use crate::{Error, Result};
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Read};
use std::path::{Component, Path, PathBuf};

/// Nesting of folders that are looked through.
const DEEPEST: usize = 64;

/// The purpose for which a file of a folder is opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// To read it; it is there.
    Read,
    /// To add to its end; made where it isn't there.
    Append,
    /// To lock it, and to read and write it; made where it isn't there, and never emptied by being opened.
    Lock,
}

/// Refuses a folder with links in it, at any depth; `what` it is expected to be, and the way out. The folder itself may be
/// reached by a link.
///
/// # Errors
/// [`Error::File`] that names all links; a folder that can't be listed, or nested more than 64 deep.
pub fn refuse_links(folder: &Path, what: &str, help: &str) -> Result<()> {
    let mut links = Vec::new();
    find_links(folder, folder, 0, &mut links)?;
    if links.is_empty() {
        return Ok(());
    }
    links.sort();
    let count = crate::counted(links.len(), "links");
    Err(Error::file(folder, format!("{count}: {}", links.join(", ")), format!("{what} without links"), help))
}

fn find_links(root: &Path, folder: &Path, depth: usize, links: &mut Vec<String>) -> Result<()> {
    if depth > DEEPEST {
        return Err(Error::file(folder, "folders nested deeper", format!("{DEEPEST} at most"), "move them elsewhere"));
    }
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        let entry = entry.map_err(Error::io(folder))?;
        // of the entry itself: links aren't followed
        let kind = entry.file_type().map_err(Error::io(entry.path()))?;
        let path = entry.path();
        if kind.is_symlink() {
            links.push(path.strip_prefix(root).unwrap_or(&path).display().to_string());
        } else if kind.is_dir() {
            find_links(root, &path, depth + 1, links)?;
        }
    }
    Ok(())
}

/// Opens the file `name` of a folder, of at most `most` bytes. No folder between both may be a link, nor the file; it is judged
/// once it is open, so that nothing can be put in its place between the two.
///
/// # Errors
/// A link, a pipe, a device, a folder, a longer file; a name that leads out of the folder; I/O errors, [`ErrorKind::NotFound`]
/// among them.
pub fn open(folder: &Path, name: impl AsRef<Path>, access: Access, most: u64) -> Result<File> {
    let path = path(folder, name.as_ref())?;
    let mut options = OpenOptions::new();
    match access {
        Access::Read => options.read(true),
        Access::Append => options.read(true).append(true).create(true),
        Access::Lock => options.read(true).write(true).truncate(false).create(true),
    };
    as_it_is(&mut options);
    // O_NOFOLLOW gives ELOOP, which says nothing to a user: the link is named
    let file = options.open(&path).map_err(|e| if path.is_symlink() { is_link(&path) } else { Error::io(&path)(e) })?;
    let found = file.metadata().map_err(Error::io(&path))?;
    if is_reparse_point(&found) {
        return Err(is_link(&path));
    }
    if !found.is_file() {
        let what = if found.is_dir() { "a folder" } else { "a pipe or a device" };
        return Err(Error::file(&path, what, "a file", "move it away"));
    }
    // of the open file: the path may be another one by now
    if found.len() > most {
        let (found, most) = (format!("{} bytes", found.len()), format!("{most} at most"));
        return Err(Error::file(&path, found, most, "make it shorter, or move it away"));
    }
    Ok(file)
}

/// The bytes of a file that [`open`] opens; `None` where there is none.
///
/// # Errors
/// Those of [`open`].
pub fn bytes(folder: &Path, name: impl AsRef<Path>, most: u64) -> Result<Option<Vec<u8>>> {
    let name = name.as_ref();
    let file = match open(folder, name, Access::Read, most) {
        Err(Error::Io { source, .. }) if source.kind() == ErrorKind::NotFound => return Ok(None),
        file => file?,
    };
    let mut bytes = Vec::new();
    // it may grow while it is read
    file.take(most).read_to_end(&mut bytes).map_err(Error::io(folder.join(name)))?;
    Ok(Some(bytes))
}

/// The path of `name` in a folder, once each folder on the way has been found to be no link: for a file that is written
/// there.
///
/// # Errors
/// A link on the way; a name that leads out of the folder.
pub fn path(folder: &Path, name: impl AsRef<Path>) -> Result<PathBuf> {
    let name = name.as_ref();
    let mut path = folder.to_owned();
    let mut parts = name.components().peekable();
    while let Some(part) = parts.next() {
        // `..`, a root, a drive
        let Component::Normal(part) = part else {
            return Err(Error::file(
                name,
                "a name that leads elsewhere",
                "one of a file in its folder",
                "leave it out",
            ));
        };
        path.push(part);
        if parts.peek().is_some() && path.is_symlink() {
            return Err(is_link(&path));
        }
    }
    Ok(path)
}

fn is_link(path: &Path) -> Error {
    Error::file(path, "a link", "a file or folder of its own", "replace it by a copy of what it leads to")
}

/// Links aren't followed, and a pipe without another end isn't waited for.
#[cfg(unix)]
fn as_it_is(options: &mut OpenOptions) {
    // O_NONBLOCK: opening a pipe that nobody writes to would wait for ever; on files it has no effect
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, libc::O_NOFOLLOW | libc::O_NONBLOCK);
}

/// Links are opened themselves.
#[cfg(windows)]
fn as_it_is(options: &mut OpenOptions) {
    // winbase.h: opens a link of whatever kind as itself
    const FILE_FLAG_OPEN_REPARSE_POINT: u32 = 0x0020_0000;
    std::os::windows::fs::OpenOptionsExt::custom_flags(options, FILE_FLAG_OPEN_REPARSE_POINT);
}

#[cfg(not(any(unix, windows)))]
fn as_it_is(_: &mut OpenOptions) {}

#[cfg(windows)]
fn is_reparse_point(found: &fs::Metadata) -> bool {
    const FILE_ATTRIBUTE_REPARSE_POINT: u32 = 0x400;
    std::os::windows::fs::MetadataExt::file_attributes(found) & FILE_ATTRIBUTE_REPARSE_POINT != 0
}

#[cfg(not(windows))]
fn is_reparse_point(_: &fs::Metadata) -> bool {
    false
}

#[cfg(unix)]
#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::os::unix::fs::symlink;

    #[test]
    fn no_link_is_followed_and_all_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let (own, other) = (dir.path().join("run"), dir.path().join("theirs"));
        fs::create_dir_all(own.join("checkpoints/step")).unwrap();
        fs::create_dir(&other).unwrap();
        fs::write(other.join("notes"), "dear").unwrap();
        fs::write(own.join("lock"), "7").unwrap();
        refuse_links(&own, "a run", "copy them").unwrap();
        symlink("run", dir.path().join("named")).unwrap();
        refuse_links(&dir.path().join("named"), "a run", "copy them").unwrap();
        symlink(other.join("notes"), own.join("log")).unwrap();
        symlink("nowhere", own.join("new")).unwrap();
        symlink(&other, own.join("checkpoints/step/deep")).unwrap();
        let said = refuse_links(&own, "a run", "copy them").unwrap_err().to_string();
        for part in ["3 links", "checkpoints/step/deep, log, new", "a run without links", "copy them"] {
            assert!(said.contains(part), "{part}: {said}");
        }
        for access in [Access::Read, Access::Append, Access::Lock] {
            for name in ["log", "new", "checkpoints/step/deep/notes"] {
                let said = open(&own, name, access, 99).unwrap_err().to_string();
                assert!(said.contains("found a link"), "{access:?} {name}: {said}");
            }
            assert!(open(&own, "../theirs/notes", access, 99).unwrap_err().to_string().contains("leads elsewhere"));
            assert!(open(&own, "checkpoints", access, 99).is_err());
            open(&own, "lock", access, 99).unwrap();
        }
        assert!(bytes(&own, "log", 99).is_err() && !own.join("nowhere").exists());
        assert_eq!(fs::read_to_string(other.join("notes")).unwrap(), "dear");
        assert_eq!(fs::read_to_string(own.join("lock")).unwrap(), "7");
    }

    #[test]
    fn pipes_are_not_waited_for_and_lengths_have_a_limit() {
        let dir = tempfile::tempdir().unwrap();
        let made = std::process::Command::new("mkfifo").arg(dir.path().join("pipe")).status();
        if made.is_ok_and(|status| status.success()) {
            for access in [Access::Read, Access::Append, Access::Lock] {
                assert!(open(dir.path(), "pipe", access, 99).is_err(), "{access:?}");
            }
        }
        let mut file = open(dir.path(), "a", Access::Append, 4).unwrap();
        file.write_all(b"four").unwrap();
        assert_eq!(bytes(dir.path(), "a", 4).unwrap().unwrap(), b"four");
        assert_eq!(bytes(dir.path(), "b", 4).unwrap(), None);
        let said = bytes(dir.path(), "a", 3).unwrap_err().to_string();
        assert!(said.contains("found 4 bytes, expected 3 at most"), "{said}");
    }
}
