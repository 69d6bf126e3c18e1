//! What a call may write over: never what it reads, and unasked only what is its own beyond doubt.
//!
//! | what stands at the output | what happens |
//! |---|---|
//! | nothing | it is written |
//! | a file that the call reads, by whatever name or link, whoever named it | it is refused, with `--force` too |
//! | a file of a run, a corpus, an index or a classifier | the same |
//! | the very bytes that would be written | it is left as it is |
//! | a dance whose hash stands in the file beside it; a page, picture or table with our mark | it is replaced |
//! | anything else | it is refused; with `--force` it is replaced |
//!
//! What a call reads is what it was given, which is refused before the work, and whatever it has opened by then
//! ([`mod@input`]): what its run, its corpus, its plan or a file beside a clip has named.

use crate::{
    Error, Result, files, hash, input,
    input::{Identity, identity},
};
use std::collections::HashSet;
use std::ffi::OsStr;
use std::fs::{self, Metadata};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// How a program tells its own files from those of others.
#[derive(Debug, Clone, Copy)]
pub struct Ours {
    /// Whether files of this name carry the program's mark inside.
    pub is_marked: fn(&Path) -> bool,
    /// Whether the program made this file, beyond doubt.
    pub is_file: fn(&Path) -> Result<bool>,
    /// The folder of the program's (a run, a corpus) that a path without links is a file of, and what that folder is.
    pub owner: for<'a> fn(&'a Path) -> Option<(&'a Path, &'static str)>,
}

/// What a call reads, and whether it may replace what isn't its own.
#[derive(Debug, Clone)]
pub struct Outputs {
    ours: Ours,
    inputs: Vec<PathBuf>,
    force: bool,
    /// Of the inputs the files, and the folders by their paths without links; looked up once, where an output is there.
    known: OnceLock<(HashSet<Identity>, Vec<Folder>)>,
}

/// A folder as it was given, and without links.
type Folder = (PathBuf, PathBuf);

/// What writing came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Written {
    /// Nothing stood there.
    New,
    /// The very bytes stood there.
    Same,
    /// Something else stood there.
    Replaced,
}

impl Outputs {
    /// For a call that reads these files, and of these folders the files that are no motion, page or picture. Inputs that
    /// aren't there matter not.
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

    /// Refuses, before any work, what [`Outputs::write`] would refuse whatever the bytes: an input, what is no file, a page
    /// or a picture without our mark; and two outputs of one name. What killed calls left under these names is swept.
    ///
    /// # Errors
    /// [`Error::Taken`] with what stands in the way.
    pub fn check<'a>(&self, outputs: impl IntoIterator<Item = &'a Path>) -> Result<()> {
        let outputs: Vec<&Path> = outputs.into_iter().collect();
        let mut names = HashSet::new();
        for path in &outputs {
            let folder = files::folder_of(path);
            if !names.insert((folder.canonicalize().unwrap_or(folder.into()), path.file_name())) {
                return Err(Error::taken(path, "would be written twice; give each output a name of its own"));
            }
            files::folder_is_there(path)?;
            if self.standing(path)?.is_some() && (self.ours.is_marked)(path) {
                self.check_replaceable(path, None)?;
            }
        }
        files::sweep(&outputs);
        Ok(())
    }

    /// Refuses a folder whose files of these names would be replaced, where the call reads one of them or the folder itself.
    ///
    /// # Errors
    /// [`Error::Taken`] then.
    pub fn check_folder(&self, folder: &Path, layout: &[&str]) -> Result<()> {
        let parts = layout.iter().map(|name| folder.join(name)).chain([folder.to_owned()]);
        for part in parts {
            if self.is_input(&part) {
                return Err(Error::taken(part, "would be written over, and this call reads it; give another --out"));
            }
        }
        Ok(())
    }

    /// Refuses what stands at `path` unless it is ours, has this SHA-256, or `--force` is given: before work that is long.
    ///
    /// # Errors
    /// [`Error::Taken`] then.
    pub fn check_replaceable(&self, path: &Path, sha256: Option<&str>) -> Result<()> {
        let standing = self.standing(path)?;
        let is_it = || sha256.is_some_and(|wanted| hash::of_file(path).is_ok_and(|found| found == wanted));
        match standing.is_none() || self.force || is_it() || (self.ours.is_file)(path)? {
            true => Ok(()),
            false => {
                let what = "is there already, with other contents; give --force to replace it, or another name";
                Err(Error::taken(path, what))
            }
        }
    }

    /// Writes a file whole or not at all, where the table above allows it; the folders above it are made.
    ///
    /// # Errors
    /// [`Error::Taken`] with what stands in the way; what the system refuses.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<Written> {
        let standing = self.standing(path)?;
        if let Some(file) = &standing {
            if holds(path, file, bytes) {
                return Ok(Written::Same);
            }
            self.check_replaceable(path, None)?;
        }
        files::write_whole(path, bytes)?;
        Ok(if standing.is_some() { Written::Replaced } else { Written::New })
    }

    /// The file at `path`, of a link what it leads to (of one that leads nowhere itself).
    fn standing(&self, path: &Path) -> Result<Option<Metadata>> {
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
        if let Some(part) = part.filter(|_| !(self.ours.is_file)(path).unwrap_or(false)) {
            return Err(Error::taken(path, format!("is one of the files of {part}; give another output")));
        }
        Ok(Some(found))
    }

    /// Whether the call reads this file or folder, as far as is known by now.
    fn is_input(&self, path: &Path) -> bool {
        identity(path).is_some_and(|id| self.known().0.contains(&id)) || input::was_read(path)
    }
}

/// Whether both are one file, links followed.
pub fn is_same(a: &Path, b: &Path) -> bool {
    identity(a).is_some_and(|a| identity(b) == Some(a))
}

/// Which of the folders, a run, a corpus, an index or a classifier, may be made of this file. Of motion, pages and pictures
/// none is.
fn part_of<'a>(path: &Path, folders: &'a [Folder]) -> Option<&'a Path> {
    if folders.is_empty() || ["bvh", "npz", "html", "png", "svg"].contains(&extension(path).as_str()) {
        return None;
    }
    let path = path.canonicalize().ok()?;
    folders.iter().find(|(_, whole)| path.starts_with(whole)).map(|(folder, _)| &**folder)
}

/// Whether the file holds these bytes and no others. One that can't be read doesn't.
fn holds(path: &Path, file: &Metadata, bytes: &[u8]) -> bool {
    file.len() == bytes.len() as u64 && input::peek_bytes(path).is_ok_and(|found| found == bytes)
}

/// What the name ends in, in small letters; empty where it ends in nothing.
pub fn extension(path: &Path) -> String {
    path.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase).unwrap_or_default()
}
