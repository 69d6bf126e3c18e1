//! Writes files and folders that later steps depend on: complete, or not at all.

use crate::{Error, Result, input};
use std::collections::{BTreeSet, HashSet};
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Writes `bytes` to `path` so that a reader sees the old file or the new one: to a temporary name in the same folder, then
/// fsync, rename, and fsync of the folder. Creates missing folders.
///
/// ```
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("new/notes.txt");
/// kinelm_store::files::write_whole(&path, b"one")?;
/// assert_eq!(std::fs::read(&path)?, b"one");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Error::Io`] with the path; the temporary file is removed.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let Some(name) = path.file_name() else {
        return Err(Error::taken(path, "is no name for a file"));
    };
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(Error::io(folder))?;
    let mut temporary = name.to_owned();
    temporary.push(format!(".{}-{}.part", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed)));
    let temporary = folder.join(temporary);
    let done = (|| {
        let mut file = File::create(&temporary)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&temporary, path)?;
        // some file systems can't sync a folder; the file itself is synced
        let _ = File::open(folder).and_then(|f| f.sync_all());
        Ok(())
    })();
    done.map_err(|e| {
        let _ = fs::remove_file(&temporary);
        Error::io(path)(e)
    })
}

/// Writes a new folder of these files, complete or not at all. A folder that already holds them is left alone.
///
/// # Errors
/// Those of [`PendingFolder::commit`]; I/O errors. Nothing is left then.
pub fn write_folder(path: &Path, contents: &[(&str, Vec<u8>)]) -> Result<()> {
    let hidden = PendingFolder::create(path)?;
    contents.iter().try_for_each(|(name, bytes)| hidden.write(name, bytes))?;
    hidden.commit("give a folder that isn't there")
}

/// A folder written under a hidden name beside its final path. Dropped before it is committed, it leaves nothing.
///
/// ```
/// use kinelm_store::files::PendingFolder;
///
/// let parent = tempfile::tempdir()?;
/// let path = parent.path().join("model");
/// let folder = PendingFolder::create(&path)?;
/// folder.write("about.txt", b"a model")?;
/// assert!(!path.exists());
/// folder.commit("give another folder")?;
/// assert_eq!(std::fs::read(path.join("about.txt"))?, b"a model");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct PendingFolder {
    path: PathBuf,
    place: PathBuf,
}

impl PendingFolder {
    /// An empty folder that will be `place`. Creates the folders above it and removes leftovers of killed processes.
    ///
    /// # Errors
    /// A path without a last name; I/O errors.
    pub fn create(place: &Path) -> Result<PendingFolder> {
        let parent = folder_of(place);
        fs::create_dir_all(parent).map_err(Error::io(parent))?;
        sweep(&[place]);
        let path = beside(place, "writing")?;
        if path.exists() {
            // a process with the same id died here
            fs::remove_dir_all(&path).map_err(Error::io(&path))?;
        }
        fs::create_dir(&path).map_err(Error::io(&path))?;
        Ok(PendingFolder { path, place: place.into() })
    }

    /// Its current path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes and syncs a file in it.
    ///
    /// # Errors
    /// I/O errors.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        let path = self.path.join(name);
        let file = File::create(&path).and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()));
        file.map_err(Error::io(&path))
    }

    /// Gives the folder its name. An existing folder with the same files is left alone.
    ///
    /// # Errors
    /// [`Error::Taken`] with `help` when anything else but an empty folder is there; I/O errors.
    pub fn commit(self, help: &str) -> Result<()> {
        if is_empty(&self.place) {
            fs::remove_dir(&self.place).map_err(Error::io(&self.place))?;
        } else if fs::symlink_metadata(&self.place).is_ok() {
            let what = || format!("exists, with other contents; {help}");
            return if holds(&self.place, &self.path) { Ok(()) } else { Err(Error::taken(&self.place, what())) };
        }
        sync_folder(&self.path)?;
        rename_new(&self.path, &self.place)?;
        sync_folder(folder_of(&self.place))
    }

    /// As [`PendingFolder::commit`], but in an existing folder the files of `layout` are replaced one by one, the first of them
    /// last; other files stay.
    ///
    /// # Errors
    /// I/O errors. The first file, which describes the others, is then still the old one.
    pub fn commit_over(self, layout: &[&str]) -> Result<()> {
        if !self.place.is_dir() || is_empty(&self.place) || holds(&self.place, &self.path) {
            return self.commit("");
        }
        for name in layout.iter().rev() {
            let (new, old) = (self.path.join(name), self.place.join(name));
            let done = match (new.exists(), old.exists()) {
                (true, true) if same_bytes(&old, &new) => Ok(()),
                (true, _) => fs::rename(&new, &old),
                (false, true) => fs::remove_file(&old),
                (false, false) => Ok(()),
            };
            done.map_err(Error::io(&old))?;
        }
        sync_folder(&self.place)
    }
}

impl Drop for PendingFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.path); // already gone once committed
    }
}

/// Renames a new folder.
///
/// # Errors
/// [`Error::Taken`] when something with that name was created in the meantime; I/O errors.
pub fn rename_new(from: &Path, to: &Path) -> Result<()> {
    use std::io::ErrorKind::{AlreadyExists, DirectoryNotEmpty, NotADirectory};
    fs::rename(from, to).map_err(|e| match e.kind() {
        AlreadyExists | DirectoryNotEmpty | NotADirectory => {
            Error::taken(to, "was made by another call in the meantime; give another place, or remove it")
        }
        _ => Error::io(to)(e),
    })
}

/// Whether this is an empty folder.
fn is_empty(path: &Path) -> bool {
    fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none())
}

/// Whether a folder has all files of another, with the same bytes.
fn holds(place: &Path, new: &Path) -> bool {
    let each = |entry: std::io::Result<fs::DirEntry>| {
        let Ok(entry) = entry else { return false };
        let (new, old) = (entry.path(), place.join(entry.file_name()));
        if new.is_dir() { holds(&old, &new) } else { same_bytes(&old, &new) }
    };
    fs::read_dir(new).is_ok_and(|mut entries| entries.all(each))
}

/// Whether two files have the same bytes; `false` when one can't be read.
fn same_bytes(a: &Path, b: &Path) -> bool {
    let open = |path: &Path| -> std::io::Result<(u64, BufReader<File>)> {
        let file = input::peek(path)?;
        Ok((file.metadata()?.len(), BufReader::with_capacity(1 << 16, file)))
    };
    let (Ok((m, mut a)), Ok((n, mut b))) = (open(a), open(b)) else { return false };
    m == n
        && loop {
            let (Ok(x), Ok(y)) = (a.fill_buf(), b.fill_buf()) else { break false };
            let k = x.len().min(y.len());
            if k == 0 || x[..k] != y[..k] {
                break x.is_empty() && y.is_empty();
            }
            a.consume(k);
            b.consume(k);
        }
}

/// Syncs renames and new names in `folder`.
///
/// # Errors
/// [`Error::Io`] when the system refuses.
pub fn sync_folder(folder: &Path) -> Result<()> {
    // only Unix opens folders
    if cfg!(unix) {
        File::open(folder).and_then(|f| f.sync_all()).map_err(Error::io(folder))?;
    }
    Ok(())
}

/// A hidden name for this process beside `path`: `.{name}.{purpose}-{process id}`.
///
/// # Errors
/// [`Error::Taken`] when `path` has no last name, like `/` and `..`.
pub fn beside(path: &Path, purpose: &str) -> Result<PathBuf> {
    let what = || Error::taken(path, "can't be written; expected a name to write to");
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().ok_or_else(what)?);
    name.push(format!(".{purpose}-{}", std::process::id()));
    Ok(folder_of(path).join(name))
}

/// Leftovers of other processes are removed after this time without changes: the process may run on another machine that
/// shares the folder.
const ABANDONED: Duration = Duration::from_secs(3600);

/// Removes unfinished outputs of these names, `.NAME.writing-PID` ([`beside`]) and `NAME.PID-COUNT.part` ([`write_whole`]),
/// whose process is gone and which haven't changed for an hour.
pub fn sweep(outputs: &[&Path]) {
    let folders: BTreeSet<&Path> = outputs.iter().map(|path| folder_of(path)).collect();
    for folder in folders {
        let names: HashSet<&str> = outputs
            .iter()
            .filter(|path| folder_of(path) == folder)
            .filter_map(|path| path.file_name()?.to_str())
            .collect();
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let (found, path) = (entry.file_name(), entry.path());
            // without /proc, age alone decides
            let runs = |id: u32| Path::new("/proc").join(id.to_string()).exists();
            let left = found.to_str().and_then(left_over).filter(|(name, id)| names.contains(name) && !runs(*id));
            let inside = || fs::read_dir(&path).into_iter().flatten().flatten().all(|e| is_old(&e.path()));
            if left.is_some() && is_old(&path) && inside() {
                let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            }
        }
    }
}

/// The final name of an unfinished file or folder, and the id of its process.
pub fn left_over(found: &str) -> Option<(&str, u32)> {
    let (name, id) = match found.strip_suffix(".part") {
        Some(rest) => {
            let (name, ids) = rest.rsplit_once('.')?;
            let (id, count) = ids.split_once('-')?;
            count.parse::<u64>().ok()?;
            (name, id)
        }
        None => found.strip_prefix('.')?.rsplit_once(".writing-")?,
    };
    Some((name, id.parse().ok()?))
}

/// Whether a file or folder is abandoned.
fn is_old(path: &Path) -> bool {
    let modified = fs::symlink_metadata(path).and_then(|m| m.modified());
    modified.is_ok_and(|m| m.elapsed().is_ok_and(|age| age > ABANDONED))
}

/// Whether this is a file name and not a path: without separators of any system, not `.` or `..`.
pub fn is_plain(name: &str) -> bool {
    let path = Path::new(name);
    path.file_name().is_some_and(|file| file == name) && !name.contains(['/', '\\'])
}

/// The folder of `path`; `.` for a bare name.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A path relative to `folder`, so that both can be moved together; absolute when there is no relative path. A path that
/// doesn't exist stays as [`path_in`] returned it.
pub fn path_from(folder: &Path, path: &Path) -> PathBuf {
    // without links, because `..` of a link is elsewhere
    let found = match (path.canonicalize(), folder.canonicalize()) {
        (Ok(whole), Ok(folder)) => pathdiff::diff_paths(whole, folder),
        _ => path.strip_prefix(folder).map(Path::to_owned).ok(),
    };
    found.unwrap_or_else(|| std::path::absolute(path).unwrap_or_else(|_| path.into()))
}

/// The path that a file of `folder` names; the inverse of [`path_from`].
pub fn path_in(folder: &Path, path: &Path) -> PathBuf {
    let joined = folder.join(path);
    joined.canonicalize().unwrap_or(joined)
}

/// Refuses, before any work, an output whose folder can't be created because a file has its name.
///
/// # Errors
/// [`Error::Taken`] then.
pub fn folder_is_there(path: &Path) -> Result<()> {
    match folder_of(path).ancestors().find(|folder| folder.exists()) {
        Some(folder) if !folder.is_dir() => {
            Err(Error::taken(path, format!("can't be written: {} is a file, no folder", folder.display())))
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
        let then = std::time::SystemTime::now() - 2 * ABANDONED;
        let folder = |name: String, old: bool| {
            let folder = dir.path().join(name);
            fs::create_dir(&folder).unwrap();
            let file = File::create(folder.join("features")).unwrap();
            if old {
                file.set_modified(then).unwrap();
                File::open(&folder).unwrap().set_modified(then).unwrap();
            }
            folder
        };
        let file = |name: String| {
            let path = dir.path().join(name);
            File::create(&path).unwrap().set_modified(then).unwrap();
            path
        };
        // above the largest number that a process can have
        let gone = u32::MAX;
        let lost = [folder(format!(".index.writing-{gone}"), true), file(format!("index.{gone}-3.part"))];
        let kept = [
            folder(format!(".index.writing-{}", gone - 1), false),
            folder(format!(".other.writing-{gone}"), true),
            file(format!("index.json.{gone}-3.part")),
            file("index.a-3.part".into()),
            file("index.part".into()),
            file(".index.writing-".into()),
        ];
        let own = file(format!("index.{}-0.part", std::process::id()));
        sweep(&[&dir.path().join("index"), &dir.path().join("absent")]);
        assert!(lost.iter().all(|path| !path.exists()), "{lost:?}");
        assert!(kept.iter().all(|path| path.exists()), "{kept:?}");
        assert!(own.exists() || !Path::new("/proc/self").exists());
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
    fn paths_from_a_folder_outlive_a_move() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().canonicalize().unwrap().join(name);
        fs::create_dir_all(at("a/runs/r")).unwrap();
        fs::create_dir_all(at("a/corpus")).unwrap();
        let found = path_from(&at("a/runs/r"), &at("a/corpus"));
        assert_eq!(found, Path::new("../../corpus"));
        assert_eq!(path_in(&at("a/runs/r"), &found), at("a/corpus"));
        fs::rename(at("a"), at("b")).unwrap();
        assert_eq!(path_in(&at("b/runs/r"), &found), at("b/corpus"));
        assert_eq!(path_from(&at("b/runs/r"), &at("none")), at("none"));
        assert_eq!(path_in(&at("b/runs/r"), &at("none")), at("none"));
        // what is gone keeps its name, however often a file is written anew
        let gone = Path::new("../../gone");
        assert_eq!(path_from(&at("b/runs/r"), &path_in(&at("b/runs/r"), gone)), gone);
        assert!(path_from(&at("b/runs/r"), Path::new("gone")).is_absolute());
    }

    #[test]
    fn a_folder_is_whole_or_not_there() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a/b");
        let two = [("one", vec![1]), ("two", vec![2, 2])];
        write_folder(&path, &two).unwrap();
        assert_eq!((fs::read(path.join("one")).unwrap(), fs::read(path.join("two")).unwrap()), (vec![1], vec![2, 2]));
        fs::write(path.join("notes.txt"), "dear").unwrap();
        write_folder(&path, &two).unwrap();
        for contents in [&[("one", vec![3])][..], &[("three", vec![3])], &[("two", vec![2])]] {
            let message = write_folder(&path, contents).unwrap_err().to_string();
            assert!(message.contains("a/b exists, with other contents; give a folder that isn't there"), "{message}");
        }
        assert!(write_folder(&dir.path().join("c"), &[("no/where", vec![1])]).is_err());
        assert_eq!((fs::read(path.join("one")).unwrap(), fs::read(path.join("two")).unwrap()), (vec![1], vec![2, 2]));
        // nothing is left beside them
        let names = |path: &Path| fs::read_dir(path).unwrap().count();
        assert_eq!((names(dir.path()), names(&dir.path().join("a")), names(&path)), (1, 1, 3));
        fs::create_dir(dir.path().join("empty")).unwrap();
        write_folder(&dir.path().join("empty"), &two).unwrap();
        assert_eq!(names(&dir.path().join("empty")), 2);
    }

    #[test]
    fn a_folder_is_replaced_file_by_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        let layout = ["about", "short", "long", "same"];
        write_folder(&path, &[("about", vec![1]), ("short", vec![2]), ("same", vec![0; 200_000])]).unwrap();
        fs::write(path.join("notes.txt"), "dear").unwrap();
        let then = std::time::SystemTime::now() - ABANDONED;
        File::open(path.join("same")).unwrap().set_modified(then).unwrap();
        let hidden = PendingFolder::create(&path).unwrap();
        for (name, bytes) in [("about", vec![3]), ("long", vec![4; 9]), ("same", vec![0; 200_000])] {
            hidden.write(name, &bytes).unwrap();
        }
        hidden.commit_over(&layout).unwrap();
        let read = |name: &str| fs::read(path.join(name)).ok();
        assert_eq!((read("about"), read("short"), read("long")), (Some(vec![3]), None, Some(vec![4; 9])));
        assert_eq!(read("notes.txt").unwrap(), b"dear");
        assert_eq!(fs::metadata(path.join("same")).unwrap().modified().unwrap(), then, "the same bytes are left alone");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn nothing_is_left_beside_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        write_whole(&path, b"one").unwrap();
        write_whole(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(write_whole(&path.join("no/such"), b"x").is_err());
        assert!(write_whole(folder.path(), b"x").is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
