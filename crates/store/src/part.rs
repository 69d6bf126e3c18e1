//! Unfinished files: a new one has a temporary name until it is whole, by which leftovers of killed processes are
//! found.
//!
//! Limits: whether a process still runs is known by `/proc`; elsewhere, and on folders that machines share, an hour
//! without changes decides. On file systems that can't sync a folder, a new name may be lost with the power.

use crate::{Error, Result};
use std::collections::{BTreeSet, HashSet};
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A new file that is written beside its final path, as `NAME.PID-RANDOM.part`. Dropped before it has its name, it is removed.
///
/// It never opens an existing file: a folder that comes from somebody else may hold links of all names that could be
/// guessed, so the name has 64 random bits, and a name that is taken is an error.
///
/// ```
/// use kinelm_store::part::PartFile;
///
/// let folder = tempfile::tempdir()?;
/// let place = folder.path().join("clip.bvh");
/// let mut part = PartFile::create(&place)?;
/// part.write(b"HIER")?;
/// part.write(b"ARCHY")?;
/// assert!(!place.exists());
/// part.name(&place)?;
/// assert_eq!(place.metadata()?.len(), 9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct PartFile {
    path: PathBuf,
    file: File,
}

impl PartFile {
    /// An empty file that will be `place`, whose folder exists.
    ///
    /// # Errors
    /// [`Error::Taken`] for a path without a last name; I/O errors.
    pub fn create(place: &Path) -> Result<PartFile> {
        PartFile::with(place, OpenOptions::new())
    }

    /// As [`PartFile::create`], where the system has such a thing for this user alone.
    ///
    /// # Errors
    /// Those of [`PartFile::create`].
    pub fn create_private(place: &Path) -> Result<PartFile> {
        #[cfg_attr(not(unix), allow(unused_mut))]
        let mut options = OpenOptions::new();
        #[cfg(unix)]
        // from its creation: a chmod afterwards would leave a moment in which others open it
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        PartFile::with(place, options)
    }

    fn with(place: &Path, mut options: OpenOptions) -> Result<PartFile> {
        let mut name = name_of(place)?.to_owned();
        name.push(format!(".{}.part", own(place)?));
        let path = folder_of(place).join(name);
        // an existing file, or a link, is never opened
        let file = options.write(true).create_new(true).open(&path).map_err(Error::io(place))?;
        Ok(PartFile { path, file })
    }

    /// Adds bytes.
    ///
    /// # Errors
    /// I/O errors.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(Error::io(&self.path))
    }

    /// Syncs the written bytes to the disk.
    ///
    /// # Errors
    /// I/O errors.
    pub fn sync(&self) -> Result<()> {
        self.file.sync_all().map_err(Error::io(&self.path))
    }

    /// Gives the file its name, in place of any file that has it; a link is replaced, not followed. It is on the disk
    /// when this returns.
    ///
    /// # Errors
    /// I/O errors.
    pub fn name(self, place: &Path) -> Result<()> {
        // before the rename: a crash must not leave the name with an empty file
        self.sync()?;
        fs::rename(&self.path, place).map_err(Error::io(place))?;
        // some file systems can't sync a folder; the file itself is synced
        let _ = sync_folder(folder_of(place));
        Ok(())
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path); // already gone once it has its name
    }
}

/// The name of an unfinished folder beside `place`: `.NAME.writing-PID-RANDOM`.
pub(crate) fn hidden(place: &Path) -> Result<PathBuf> {
    let mut name = OsString::from(".");
    name.push(name_of(place)?);
    name.push(format!(".writing-{}", own(place)?));
    Ok(folder_of(place).join(name))
}

fn name_of(place: &Path) -> Result<&OsStr> {
    place.file_name().ok_or_else(|| Error::taken(place, "can't be written; expected a name to write to"))
}

/// The part of a name that no other process or thread uses: the process's id and 64 random bits.
fn own(place: &Path) -> Result<String> {
    let random = getrandom::u64().map_err(|e| Error::io(place)(std::io::Error::other(e.to_string())))?;
    Ok(format!("{}-{random:016x}", std::process::id()))
}

/// Leftovers of other processes are removed after this time without changes: the process may run on another machine that
/// shares the folder.
pub(crate) const ABANDONED: Duration = Duration::from_secs(3600);

/// Removes unfinished outputs of these names, `.NAME.writing-PID-RANDOM` ([`crate::files::PendingFolder`]) and
/// `NAME.PID-RANDOM.part` ([`PartFile`]), whose process is gone and which haven't changed for an hour.
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
            // a folder's own time is that of its entries, not of what is written into them
            let inside = || fs::read_dir(&path).into_iter().flatten().flatten().all(|e| is_old(&e.path()));
            if left.is_some() && is_old(&path) && inside() {
                let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            }
        }
    }
}

/// Removes all unfinished files of a folder whose lock this process holds: no other writes in it.
///
/// # Errors
/// A folder that can't be listed; a file that can't be removed.
pub fn sweep_locked(folder: &Path) -> Result<()> {
    for entry in fs::read_dir(folder).map_err(Error::io(folder))?.flatten() {
        if entry.file_name().to_str().is_some_and(is_unfinished_file) {
            fs::remove_file(entry.path()).map_err(Error::io(entry.path()))?;
        }
    }
    Ok(())
}

/// Whether this is the name of an unfinished file.
pub fn is_unfinished_file(name: &str) -> bool {
    name.ends_with(".part") && left_over(name).is_some()
}

/// The final name of an unfinished file or folder, and the id of its process.
pub fn left_over(found: &str) -> Option<(&str, u32)> {
    let (name, own) = match found.strip_suffix(".part") {
        // from the right, as names have dots themselves
        Some(rest) => rest.rsplit_once('.')?,
        None => found.strip_prefix('.')?.rsplit_once(".writing-")?,
    };
    let (id, random) = own.split_once('-')?;
    let is_random = random.len() == 16 && random.bytes().all(|b| b.is_ascii_hexdigit());
    is_random.then_some((name, id.parse().ok()?))
}

/// Whether a file or folder is abandoned.
fn is_old(path: &Path) -> bool {
    let modified = fs::symlink_metadata(path).and_then(|m| m.modified());
    modified.is_ok_and(|m| m.elapsed().is_ok_and(|age| age > ABANDONED))
}

/// The folder of `path`; `.` for a bare name.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
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

#[cfg(test)]
mod tests {
    use super::*;

    const RANDOM: &str = "00112233445566ff";

    /// The name of a file as a process with this id leaves it.
    fn part(name: &str, id: u32) -> String {
        format!("{name}.{id}-{RANDOM}.part")
    }

    /// And that of a folder.
    fn writing(name: &str, id: u32) -> String {
        format!(".{name}.writing-{id}-{RANDOM}")
    }

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
        let lost = [folder(writing("index", gone), true), file(part("index", gone))];
        let kept = [
            folder(writing("index", gone - 1), false),
            folder(writing("other", gone), true),
            file(part("index.json", gone)),
            file(format!("index.{gone}-3.part")),
            file(format!("index.a-{RANDOM}.part")),
            file("index.part".into()),
            file(format!(".index.writing-{gone}")),
        ];
        let own = file(part("index", std::process::id()));
        sweep(&[&dir.path().join("index"), &dir.path().join("absent")]);
        assert!(lost.iter().all(|path| !path.exists()), "{lost:?}");
        assert!(kept.iter().all(|path| path.exists()), "{kept:?}");
        assert!(own.exists() || !Path::new("/proc/self").exists());
        sweep_locked(dir.path()).unwrap();
        assert!(!own.exists() && !kept[2].exists() && kept[3..].iter().all(|path| path.exists()), "{kept:?}");
    }

    #[test]
    fn a_part_is_new_has_a_name_of_its_own_and_goes_when_it_is_dropped() {
        let dir = tempfile::tempdir().unwrap();
        let place = dir.path().join("a.json");
        let names = || -> Vec<String> {
            let entries = fs::read_dir(dir.path()).unwrap();
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
        };
        let (a, b) = (PartFile::create(&place).unwrap(), PartFile::create_private(&place).unwrap());
        assert!(a.path != b.path && names().len() == 2);
        for name in names() {
            assert_eq!(left_over(&name), Some(("a.json", std::process::id())), "{name}");
        }
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(fs::metadata(&b.path).unwrap().permissions().mode() & 0o777, 0o600);
        }
        drop((a, b));
        assert_eq!(names().len(), 0);
        assert!(PartFile::create(Path::new("/")).is_err() && PartFile::create(&place.join("in")).is_err());
    }
}
