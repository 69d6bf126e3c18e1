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
//! ([`input`]): what its run, its corpus, its plan or a file beside a clip has named.

use crate::corpus::load::hash_file;
use crate::generate::provenance;
use crate::music::beats;
use crate::view::{self, plot};
use crate::{Error, Result, files, ours};
use kinelm_motion::format::input::{self, Identity, identity};
use std::collections::HashSet;
use std::ffi::OsStr;
use std::fs::{self, Metadata};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Where our marks stand in a page, a picture or a table, at the latest: bytes from the file's beginning.
const MARK_WITHIN: u64 = 4096;

/// The first key of tables as JSON.
const JSON_MARKS: [&str; 2] = ["{\n  \"made_by\": \"kinelm\"", "{\"made_by\":\"kinelm\""];

/// What a call reads, and whether it may replace what isn't its own.
#[derive(Debug, Clone, Default)]
pub struct Outputs {
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
    pub fn new(inputs: impl IntoIterator<Item = impl Into<PathBuf>>, force: bool) -> Outputs {
        Outputs { inputs: inputs.into_iter().map(Into::into).collect(), force, known: OnceLock::new() }
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
            if self.standing(path)?.is_some() && is_marked(path) {
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
        let is_it = || sha256.is_some_and(|wanted| hash_file(path).is_ok_and(|found| found == wanted));
        match standing.is_none() || self.force || is_it() || is_ours(path)? {
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
            ours::owner(&path).map(|(folder, kind)| format!("{}, {kind}", folder.display()))
        });
        if let Some(part) = part.filter(|_| !is_ours(path).unwrap_or(false)) {
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

/// Whether files of this name carry our mark inside.
fn is_marked(path: &Path) -> bool {
    ["html", "png", "svg", "md", "txt"].contains(&extension(path).as_str())
}

/// Whether this program made the file, beyond doubt.
fn is_ours(path: &Path) -> Result<bool> {
    let mut head = Vec::new();
    // what can't be read is nobody's
    let _ = input::peek(path).and_then(|file| file.take(MARK_WITHIN).read_to_end(&mut head));
    let has = |mark: &[u8]| head.windows(mark.len()).any(|w| w == mark);
    match extension(path).as_str() {
        "html" => Ok(has(view::MARK.as_bytes())),
        "png" => Ok(has(&plot::PNG_MARK)),
        "json" if JSON_MARKS.iter().any(|mark| head.starts_with(mark.as_bytes())) => Ok(true),
        "svg" | "md" => Ok(has(plot::TEXT_MARK.as_bytes())),
        // beats that somebody has corrected aren't ours any more
        "txt" if !head.starts_with(beats::MARK.as_bytes()) => Ok(false),
        "txt" => Ok(input::peek_bytes(path).is_ok_and(|text| beats::is_as_written(&String::from_utf8_lossy(&text)))),
        _ => Ok(provenance::is_beside_its_dance(path) || provenance::tells_of(path)?),
    }
}

fn extension(path: &Path) -> String {
    path.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase).unwrap_or_default()
}
