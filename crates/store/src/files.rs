//! Writes files and folders that later steps depend on: complete, or not at all.
//!
//! Limits: new files and folders are whole or absent, existing folders aren't replaced at once. A crash in
//! [`PendingFolder::commit_instead`] may leave no folder, one in [`PendingFolder::commit_over`] new files beside the
//! old first one.

use crate::part::{self, PartFile, folder_of, sync_folder};
use crate::{Error, Result, input};
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

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
/// I/O errors; the temporary file is removed.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    prepare(path, bytes)?.name(path)
}

/// The first half of [`write_whole`]: the bytes are on the disk, beside `path`.
///
/// # Errors
/// Those of [`write_whole`].
pub(crate) fn prepare(path: &Path, bytes: &[u8]) -> Result<PartFile> {
    let folder = folder_of(path);
    fs::create_dir_all(folder).map_err(Error::io(folder))?;
    let mut part = PartFile::create(path)?;
    part.write(bytes)?;
    part.sync()?;
    Ok(part)
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
        part::sweep(&[place]);
        let path = part::hidden(place)?;
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
        let file = File::create_new(&path).and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()));
        file.map_err(Error::io(&path))
    }

    /// Gives the folder its name. An existing folder with the same files is left alone.
    ///
    /// # Errors
    /// [`Error::Taken`] with `help` when anything else but an empty folder is there; I/O errors.
    pub fn commit(self, help: &str) -> Result<()> {
        // not every system renames over an empty folder
        if is_empty(&self.place) {
            // another call may remove it, or fill it
            let _ = fs::remove_dir(&self.place);
        }
        let is_there = || fs::symlink_metadata(&self.place).is_ok();
        if !is_there() {
            // before it has its name: after a power cut a named folder must not lack entries
            sync_folder(&self.path)?;
            match fs::rename(&self.path, &self.place) {
                Ok(()) => return sync_folder(folder_of(&self.place)),
                Err(e) if !is_there() => return Err(Error::io(&self.place)(e)),
                // another call was first, perhaps with the same files
                Err(_) => {}
            }
        }
        match holds(&self.place, &self.path) {
            true => Ok(()),
            false => Err(Error::taken(&self.place, format!("exists, with other contents; {help}"))),
        }
    }

    /// As [`PendingFolder::commit`], but a folder that is there with other files gives way to it.
    ///
    /// # Errors
    /// I/O errors; another call that puts other files there at the same time.
    pub fn commit_instead(self) -> Result<()> {
        if fs::symlink_metadata(&self.place).is_ok() && !holds(&self.place, &self.path) {
            // aside first: nobody finds half of it
            let aside = self.path.join("replaced");
            fs::rename(&self.place, &aside).map_err(Error::io(&self.place))?;
            let removed = if aside.is_dir() { fs::remove_dir_all(&aside) } else { fs::remove_file(&aside) };
            removed.map_err(Error::io(&aside))?;
        }
        self.commit("call again")
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
        // the first file has the hashes of the others: until it is replaced, a reader sees that they don't fit
        for name in layout.iter().rev() {
            let (new, old) = (self.path.join(name), self.place.join(name));
            let done = match (new.exists(), old.exists()) {
                // unchanged, it is left with its modification time, by which other programs notice changes
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
    // a rename replaces an empty folder, but none with files: that is the test for being new
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
            // both readers may give pieces of different length
            let k = x.len().min(y.len());
            if k == 0 || x[..k] != y[..k] {
                break x.is_empty() && y.is_empty();
            }
            a.consume(k);
            b.consume(k);
        }
}

/// Whether this is a file name and not a path: without separators of any system, not `.` or `..`.
pub fn is_plain(name: &str) -> bool {
    let path = Path::new(name);
    // not the system's separators alone: a name from Windows may be read on Linux
    path.file_name().is_some_and(|file| file == name) && !name.contains(['/', '\\'])
}

/// A path relative to `folder`, so that both can be moved together; absolute when there is no relative path. A path that
/// doesn't exist stays as [`path_in`] returned it.
pub fn path_from(folder: &Path, path: &Path) -> PathBuf {
    // without links, because `..` of a link is elsewhere
    let found = match (path.canonicalize(), folder.canonicalize()) {
        (Ok(whole), Ok(folder)) => pathdiff::diff_paths(whole, folder),
        // one of them isn't there and may be a link later: only the text is known
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
pub(crate) fn folder_is_there(path: &Path) -> Result<()> {
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
        // a missing file has the same name in the folder, however often it is written again
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
        let then = std::time::SystemTime::now() - part::ABANDONED;
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
