//! The files that a call may overwrite: never its inputs, and without `force` only files that the program certainly
//! made.
//!
//! | existing output | |
//! |---|---|
//! | none | written |
//! | an input of the call, under any name or link | refused, with `force` too |
//! | a file of a run, a corpus, an index or a classifier | refused, with `force` too |
//! | a file with the same bytes | left alone |
//! | a dance whose sidecar has its hash; a page, picture or table with the program's mark | replaced |
//! | anything else | refused; replaced with `force` |
//!
//! Inputs are the paths that the call was given, which are checked before the work, and all files that it has opened by then
//! where it records them ([`input::Inputs`]).

use crate::{
    Error, Result, files, hash, input,
    input::{Identity, identity},
    part::{self, PartFile},
};
use std::collections::HashSet;
use std::ffi::OsStr;
use std::fs::{self, Metadata};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The tests by which the program recognises its own files.
#[derive(Debug, Clone, Copy)]
pub struct Ours {
    /// Whether files of this name contain the program's mark.
    pub is_marked: fn(&Path) -> bool,
    /// Whether the program certainly made this file.
    pub is_file: fn(&Path) -> Result<bool>,
    /// The program's folder (a run, a corpus) that a path without links belongs to, and its kind.
    pub owner: for<'a> fn(&'a Path) -> Option<(&'a Path, &'static str)>,
}

/// The inputs of a call, and whether it may replace other files.
#[derive(Debug, Clone)]
pub struct Outputs {
    ours: Ours,
    inputs: Vec<PathBuf>,
    force: bool,
    /// The inputs that are files, and those that are folders; looked up once, when an output exists.
    known: OnceLock<(HashSet<Identity>, Vec<Folder>)>,
}

/// A folder as it was given, and without links.
type Folder = (PathBuf, PathBuf);

/// The result of [`Outputs::write`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Written {
    /// A new file was written.
    New,
    /// The file already had these bytes.
    Same,
    /// Another file was replaced.
    Replaced,
}

/// A file that is written but has no name yet (`Outputs::prepare`); dropped, it leaves nothing.
#[derive(Debug)]
pub struct Prepared<'a> {
    path: &'a Path,
    /// None where the file already has these bytes.
    part: Option<PartFile>,
    written: Written,
}

impl Prepared<'_> {
    /// Gives it its name, which takes no space on the disk.
    ///
    /// # Errors
    /// I/O errors.
    pub fn name(self) -> Result<Written> {
        self.part.map_or(Ok(()), |part| part.name(self.path))?;
        Ok(self.written)
    }
}

impl Outputs {
    /// For a call that reads these files, and in these folders all files but motion, pages and pictures. Missing inputs are
    /// ignored.
    pub fn new(ours: Ours, inputs: impl IntoIterator<Item = impl Into<PathBuf>>, force: bool) -> Outputs {
        Outputs { ours, inputs: inputs.into_iter().map(Into::into).collect(), force, known: OnceLock::new() }
    }

    fn known(&self) -> &(HashSet<Identity>, Vec<Folder>) {
        self.known.get_or_init(|| {
            let folders = self.inputs.iter().filter(|input| input.is_dir());
            let whole = |input: &PathBuf| Some((input.clone(), input.canonicalize().ok()?));
            (self.inputs.iter().filter_map(|input| identity(input)).collect(), folders.filter_map(whole).collect())
        })
    }

    /// Refuses, before any work, what [`Outputs::write`] would refuse for any bytes: an input, something that is no file, a page
    /// or a picture without the program's mark; and two outputs of one name. Removes leftovers of killed processes.
    ///
    /// # Errors
    /// [`Error::Taken`] with the reason.
    pub fn check<'a>(&self, outputs: impl IntoIterator<Item = &'a Path>) -> Result<()> {
        let outputs: Vec<&Path> = outputs.into_iter().collect();
        let mut names = HashSet::new();
        for path in &outputs {
            // of two names for one folder: `a/x` and `./a/x`
            let folder = part::folder_of(path);
            if !names.insert((folder.canonicalize().unwrap_or(folder.into()), path.file_name())) {
                return Err(Error::taken(path, "would be written twice; give each output a name of its own"));
            }
            files::folder_is_there(path)?;
            // a dance may turn out to have the same bytes, which only `prepare` knows; a page's mark is known now
            if self.existing(path)?.is_some() && (self.ours.is_marked)(path) {
                self.check_replaceable(path, None)?;
            }
        }
        // after all checks: a call that is refused changes nothing
        part::sweep(&outputs);
        Ok(())
    }

    /// Refuses an output folder when the call reads it or one of its files of `layout`.
    ///
    /// # Errors
    /// [`Error::Taken`] then.
    pub fn check_folder(&self, folder: &Path, layout: &[&str]) -> Result<()> {
        let parts = layout.iter().map(|name| folder.join(name)).chain([folder.to_owned()]);
        for part in parts {
            if self.is_input(&part) {
                return Err(Error::taken(part, "would be written over, and this call reads it; give another `out`"));
            }
        }
        Ok(())
    }

    /// Refuses, before long work, an existing file unless the program made it, it has this SHA-256, or `force` is set.
    ///
    /// # Errors
    /// [`Error::Taken`] then.
    pub fn check_replaceable(&self, path: &Path, sha256: Option<&str>) -> Result<()> {
        let existing = self.existing(path)?;
        let is_it = || sha256.is_some_and(|expected| hash::of_file(path).is_ok_and(|found| found == expected));
        match existing.is_none() || self.force || is_it() || (self.ours.is_file)(path)? {
            true => Ok(()),
            false => {
                let what = "is there already, with other contents; give `force` to replace it, or another name";
                Err(Error::taken(path, what))
            }
        }
    }

    /// Writes a file, complete or not at all, if the table above allows it. Creates the folders above it.
    ///
    /// # Errors
    /// [`Error::Taken`] with the reason; I/O errors.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<Written> {
        self.prepare(path, bytes)?.name()
    }

    /// The first half of [`Outputs::write`]: the bytes are on the disk, under a temporary name.
    ///
    /// # Errors
    /// Those of [`Outputs::write`].
    pub(crate) fn prepare<'a>(&self, path: &'a Path, bytes: &[u8]) -> Result<Prepared<'a>> {
        let existing = self.existing(path)?;
        if let Some(file) = &existing {
            if holds(path, file, bytes) {
                return Ok(Prepared { path, part: None, written: Written::Same });
            }
            self.check_replaceable(path, None)?;
        }
        let written = if existing.is_some() { Written::Replaced } else { Written::New };
        Ok(Prepared { path, part: Some(files::prepare(path, bytes)?), written })
    }

    /// The existing file at `path`, links followed; of a broken link the link itself.
    fn existing(&self, path: &Path) -> Result<Option<Metadata>> {
        use std::io::ErrorKind::NotFound;
        if path.file_name().is_none() {
            return Err(Error::taken(path, "is no name for a file"));
        }
        let found = match fs::metadata(path).or_else(|_| fs::symlink_metadata(path)) {
            Ok(found) => found,
            Err(e) if e.kind() == NotFound => return Ok(None),
            Err(e) => return Err(Error::io(path)(e)),
        };
        if found.is_dir() {
            return Err(Error::taken(path, "is a folder; give a name in it"));
        }
        if !found.is_file() && !found.is_symlink() {
            return Err(Error::taken(path, "is no regular file, so it is not replaced; give another name"));
        }
        if self.is_input(path) {
            return Err(Error::taken(path, "would be written over, and this call reads it; give another output"));
        }
        let part = part_of(path, &self.known().1).map(|folder| format!("{}, which this call reads", folder.display()));
        let part = part.or_else(|| {
            let path = path.canonicalize().ok()?;
            (self.ours.owner)(&path).map(|(folder, kind)| format!("{}, {kind}", folder.display()))
        });
        // a dance that was written into a run's folder is still a dance of ours
        if let Some(part) = part.filter(|_| !(self.ours.is_file)(path).unwrap_or(false)) {
            return Err(Error::taken(path, format!("is one of the files of {part}; give another output")));
        }
        Ok(Some(found))
    }

    /// Whether this file or folder is an input so far.
    fn is_input(&self, path: &Path) -> bool {
        // by identity: hard links and other spellings are the same file
        identity(path).is_some_and(|id| self.known().0.contains(&id)) || input::was_read(path)
    }
}

/// Whether both paths are one file, links followed.
pub fn is_same(a: &Path, b: &Path) -> bool {
    identity(a).is_some_and(|a| identity(b) == Some(a))
}

/// The input folder (a run, a corpus, an index, a classifier) that this file may be a part of; none for motion, pages and
/// pictures.
fn part_of<'a>(path: &Path, folders: &'a [Folder]) -> Option<&'a Path> {
    if folders.is_empty() || ["bvh", "npz", "html", "png", "svg"].contains(&extension(path).as_str()) {
        return None;
    }
    let path = path.canonicalize().ok()?;
    folders.iter().find(|(_, whole)| path.starts_with(whole)).map(|(folder, _)| &**folder)
}

/// Whether the file has exactly these bytes; `false` when it can't be read.
fn holds(path: &Path, file: &Metadata, bytes: &[u8]) -> bool {
    // the length first, which costs no read
    file.len() == bytes.len() as u64 && input::peek_bytes(path).is_ok_and(|found| found == bytes)
}

/// The extension in lower case; empty without one.
pub fn extension(path: &Path) -> String {
    path.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase).unwrap_or_default()
}
