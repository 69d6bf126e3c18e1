//! Files that later steps depend on: whole or not there.

use crate::{Error, Result};
use std::fs::File;
use std::path::{Path, PathBuf};

/// Writes `bytes` to `path` so that a reader sees the old file or the new one: a temporary name in the same folder,
/// fsync, rename, fsync of the folder.
///
/// # Errors
/// [`Error::Motion`] with the path at which the system refused; the temporary file is gone then.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(kinelm_motion::format::atomic::write(path, bytes)?)
}

/// Makes renames and new names in `folder` last.
///
/// # Errors
/// [`Error::Io`] when the system refuses.
pub fn sync_folder(folder: &Path) -> Result<()> {
    // only Unix opens folders; elsewhere a rename is as lasting as the system makes it
    if cfg!(unix) {
        File::open(folder).and_then(|f| f.sync_all()).map_err(Error::io(folder))?;
    }
    Ok(())
}

/// A hidden name for this process beside `path`: `.{name}.{purpose}-{process id}`.
///
/// # Errors
/// [`Error::Call`] when `path` ends in no name, as `/` and `..` do.
pub fn beside(path: &Path, purpose: &str) -> Result<PathBuf> {
    let name = path
        .file_name()
        .ok_or_else(|| Error::Call(format!("{}: can't be written; expected a name to write to", path.display())))?;
    let id = std::process::id();
    Ok(folder_of(path).join(format!(".{}.{purpose}-{id}", name.to_string_lossy())))
}

/// The folder that `path` stands in; `.` for a bare name.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_file_is_replaced_whole_and_nothing_is_left_beside_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        write_whole(&path, b"one").unwrap();
        write_whole(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        assert!(write_whole(&dir.path().join("no/where"), b"").is_err());
        assert!(write_whole(Path::new("/"), b"").is_err());
    }
}
