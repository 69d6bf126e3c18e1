//! Motion files below a folder.

use super::gather::Gathered;
use super::pattern::{EXTENSIONS, without_extension};
use crate::{Error, Result};
use std::collections::HashSet;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

/// The motion files of one place, and what was left out.
pub(super) struct Walk<'a> {
    /// Where what is left out is counted.
    pub gathered: &'a mut Gathered,
    /// Files with their paths below the place, `/` between parts.
    pub files: Vec<(PathBuf, String)>,
    folders: HashSet<PathBuf>, // seen: a link may lead back up
}

impl<'a> Walk<'a> {
    pub fn new(gathered: &'a mut Gathered) -> Self {
        Walk { gathered, files: Vec::new(), folders: HashSet::new() }
    }

    /// Takes a file or all files of a folder; whether it was a folder.
    pub fn start(&mut self, place: &Path) -> Result<bool> {
        let kind = fs::metadata(place).map_err(Error::io(place))?;
        if kind.is_dir() {
            let beside = place.parent().filter(|_| place.file_name().is_some());
            let ignore = beside.map(ignore_list).transpose()?.unwrap_or_default();
            self.folder(place, "", &ignore)?;
            return Ok(true);
        }
        let name = place.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        if without_extension(&name) == name {
            let expected = format!("a file ending in {}, or a folder", EXTENSIONS.join(", "));
            return Err(Error::file(place, "a file of another kind", expected, ""));
        }
        self.files.push((place.to_owned(), name));
        Ok(false)
    }

    fn folder(&mut self, folder: &Path, relative: &str, ignore: &HashSet<String>) -> Result<()> {
        if !self.folders.insert(fs::canonicalize(folder).map_err(Error::io(folder))?) {
            return Ok(());
        }
        let ignore: HashSet<String> = ignore.union(&ignore_list(folder)?).cloned().collect();
        let mut entries = Vec::new();
        for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
            entries.push(entry.map_err(Error::io(folder))?.file_name());
        }
        entries.sort();
        for name in entries {
            let path = folder.join(&name);
            let name = name.to_string_lossy();
            if name.starts_with('.') {
                continue;
            }
            let relative = if relative.is_empty() { name.to_string() } else { format!("{relative}/{name}") };
            match fs::metadata(&path) {
                Ok(m) if m.is_dir() => self.folder(&path, &relative, &ignore)?,
                Ok(_) => self.file(path, relative, &ignore),
                Err(_) if without_extension(&name) == name => {} // a link to nowhere
                Err(e) => return Err(Error::io(&path)(e)),
            }
        }
        Ok(())
    }

    fn file(&mut self, path: PathBuf, relative: String, ignore: &HashSet<String>) {
        let stem = without_extension(&relative);
        if stem == relative {
            return;
        }
        let name = stem.rsplit('/').next().unwrap_or(stem);
        if ignore.contains(name) {
            self.gathered.ignored += 1;
        } else if holds_no_motion(&path, name) {
            self.gathered.no_motion += 1;
        } else {
            self.files.push((path, relative));
        }
    }
}

/// Whether a file found in a folder is known not to hold motion: AMASS's body shapes and first stages by name, JSON
/// that has not the first key of a clip.
fn holds_no_motion(path: &Path, stem: &str) -> bool {
    match path.extension().map(|e| e.to_ascii_lowercase()) {
        Some(e) if e == "npz" => stem == "shape" || stem.ends_with("_stagei"),
        Some(e) if e == "json" => {
            let mut head = Vec::new();
            let read = File::open(path).and_then(|f| f.take(4096).read_to_end(&mut head));
            read.is_ok() && !String::from_utf8_lossy(&head).contains("\"schema\"")
        }
        _ => false,
    }
}

/// The names in a folder's `ignore_list.txt`, one a line, without extension.
fn ignore_list(folder: &Path) -> Result<HashSet<String>> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let path = folder.join("ignore_list.txt");
    match fs::read(&path) {
        Ok(bytes) => {
            let text = String::from_utf8_lossy(&bytes).into_owned();
            Ok(text.lines().map(|l| without_extension(l.trim()).to_owned()).filter(|l| !l.is_empty()).collect())
        }
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(HashSet::new()),
        Err(e) => Err(Error::io(&path)(e)),
    }
}
