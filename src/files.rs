//! Files that later steps depend on: whole or not there.

use crate::{Error, Result};
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Writes `bytes` to `path` so that a reader sees the old file or the new one: a temporary name in the same folder,
/// fsync, rename, fsync of the folder.
///
/// # Errors
/// [`Error::Motion`] with the path at which the system refused; the temporary file is gone then.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(kinelm_motion::format::atomic::write(path, bytes)?)
}

/// Writes a new folder of these files, which is whole or not there: under a temporary name, synced, renamed.
///
/// # Errors
/// A folder that is there; what the system refuses. What was written is gone then.
pub fn write_folder(path: &Path, contents: &[(&str, Vec<u8>)]) -> Result<()> {
    let parent = folder_of(path);
    fs::create_dir_all(parent).map_err(Error::io(parent))?;
    let work = beside(path, "writing")?;
    let write = || -> Result<()> {
        if work.exists() {
            // a process of this number died here
            fs::remove_dir_all(&work).map_err(Error::io(&work))?;
        }
        fs::create_dir(&work).map_err(Error::io(&work))?;
        for (name, bytes) in contents {
            let path = work.join(name);
            let file = File::create(&path).and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()));
            file.map_err(Error::io(&path))?;
        }
        sync_folder(&work)?;
        if fs::symlink_metadata(path).is_ok() {
            return Err(Error::Call(format!("{} exists; give a folder that isn't there", path.display())));
        }
        fs::rename(&work, path).map_err(Error::io(path))
    };
    let written = write();
    if written.is_err() {
        let _ = fs::remove_dir_all(&work);
    }
    written?;
    sync_folder(parent)
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

/// How long what another process was writing must lie untouched before it is taken for lost: it may run on another machine
/// that shares the folder.
const LOST: Duration = Duration::from_secs(3600);

/// Removes folders that processes which are no more left half-written under names that [`beside`] gave them.
pub fn sweep(path: &Path, purpose: &str) {
    let Some(name) = path.file_name() else { return };
    let start = format!(".{}.{purpose}-", name.to_string_lossy());
    let is_old = |path: &Path| {
        let modified = fs::metadata(path).and_then(|m| m.modified());
        modified.is_ok_and(|m| m.elapsed().is_ok_and(|age| age > LOST))
    };
    for entry in fs::read_dir(folder_of(path)).into_iter().flatten().flatten() {
        let (found, folder) = (entry.file_name(), entry.path());
        let id = found.to_string_lossy().strip_prefix(&start).and_then(|id| id.parse::<u32>().ok());
        // where the system doesn't tell who runs, age alone does
        let runs = |id: u32| Path::new("/proc").join(id.to_string()).exists();
        let inside = || fs::read_dir(&folder).into_iter().flatten().flatten().all(|e| is_old(&e.path()));
        if id.is_some_and(|id| !runs(id)) && is_old(&folder) && inside() {
            let _ = fs::remove_dir_all(&folder);
        }
    }
}

/// The folder that `path` stands in; `.` for a bare name.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Refuses a file whose folder neither is there nor can be made, since a file stands in its way, before any work is done.
///
/// # Errors
/// [`Error::Call`] then.
pub fn folder_is_there(path: &Path) -> Result<()> {
    match folder_of(path).ancestors().find(|folder| folder.exists()) {
        Some(folder) if !folder.is_dir() => {
            Err(Error::Call(format!("{}: {} is a file, no folder", path.display(), folder.display())))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_dead_processes_left_long_ago_is_swept() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("index");
        let make = |id: u32, old: bool| {
            let folder = dir.path().join(format!(".index.writing-{id}"));
            fs::create_dir(&folder).unwrap();
            let file = File::create(folder.join("features")).unwrap();
            if old {
                let then = std::time::SystemTime::now() - 2 * LOST;
                file.set_modified(then).unwrap();
                File::open(&folder).unwrap().set_modified(then).unwrap();
            }
            folder
        };
        // above the largest number that a process can have
        let (lost, fresh, ours) = (make(u32::MAX, true), make(u32::MAX - 1, false), make(std::process::id(), true));
        sweep(&path, "writing");
        assert_eq!((lost.exists(), fresh.exists()), (false, true));
        assert!(ours.exists() || !Path::new("/proc/self").exists());
    }

    #[test]
    fn a_file_is_replaced_whole_and_nothing_is_left_beside_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        write_whole(&path, b"one").unwrap();
        write_whole(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        assert!(write_whole(&path.join("in/a/file"), b"").is_err());
        assert!(folder_is_there(&path.join("in/a/file")).unwrap_err().to_string().contains("a.json is a file"));
        write_whole(&dir.path().join("far/away"), b"").unwrap();
        assert!(write_whole(Path::new("/"), b"").is_err());
    }

    #[test]
    fn a_folder_is_whole_or_not_there() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a/b");
        write_folder(&path, &[("one", vec![1]), ("two", vec![2, 2])]).unwrap();
        assert_eq!((fs::read(path.join("one")).unwrap(), fs::read(path.join("two")).unwrap()), (vec![1], vec![2, 2]));
        let message = write_folder(&path, &[("one", vec![3])]).unwrap_err().to_string();
        assert!(message.contains("a/b exists; give a folder that isn't there"), "{message}");
        assert!(write_folder(&dir.path().join("c"), &[("no/where", vec![1])]).is_err());
        assert_eq!(fs::read(path.join("one")).unwrap(), [1]);
        // nothing is left beside them
        let names = |path: &Path| fs::read_dir(path).unwrap().count();
        assert_eq!((names(dir.path()), names(&dir.path().join("a"))), (1, 1));
    }
}
