//! The files that a call reads and writes: motion files and folders of them, and where each goes.

use crate::dataset::motion_files;
use crate::{Error, Result};
use kinelm_store::output::extension;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// A file that is read, and the file that is written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pair {
    /// The file that is read.
    pub input: PathBuf,
    /// The file that is written.
    pub output: PathBuf,
}

/// A motion file, and its path below the folder that it was found in; of one that was given itself its name.
type Found = (PathBuf, PathBuf);

/// The motion files that were given, those in folders at any depth.
///
/// # Errors
/// A folder that can't be read, or holds no motion; no name of a file.
pub fn files(given: &[PathBuf]) -> Result<Vec<Found>> {
    let mut all = Vec::new();
    for place in given {
        if place.is_dir() {
            let found = motion_files(place)?;
            if found.is_empty() {
                return Err(Error::file(place, "no motion file in this folder", "some", ""));
            }
            let below = |path: PathBuf| {
                let below = path.strip_prefix(place).unwrap_or(&path).to_owned();
                (path, below)
            };
            all.extend(found.into_iter().map(below));
        } else {
            let name = place.file_name().ok_or_else(|| Error::unsupported(place.display().to_string(), "no file"))?;
            all.push((place.clone(), name.into()));
        }
    }
    Ok(all)
}

/// The format to write for a file of this extension; for formats that are only read, one that stores as much.
pub fn written_for(own: &str) -> &str {
    match own {
        "pkl" => "npz",
        "amc" | "fbx" | "vrm" => "bvh",
        own => own,
    }
}

/// Whether a path ends as only a folder's does.
pub fn ends_as_folder(path: &Path) -> bool {
    path.to_string_lossy().ends_with(std::path::is_separator)
}

/// Whether `out` is meant as a folder: it is one, ends as one, or several files go there.
pub fn is_folder(given: &[PathBuf], out: &Path) -> bool {
    out.is_dir() || ends_as_folder(out) || given.len() > 1 || given.iter().any(|place| place.is_dir())
}

/// Where each file goes below the folder `out`, under the extension that `to` gives to its own. Files inside `out` are no
/// inputs, where that is a folder in one that was given.
///
/// # Errors
/// Before anything is written, for an `out` that is no folder, and for two files with one output.
pub fn into_folder(given: &[PathBuf], out: &Path, to: impl Fn(&str) -> String) -> Result<Vec<Pair>> {
    if out.exists() && !out.is_dir()
        || !out.is_dir() && extension(out).len() > 1 && extension(out) == to(&extension(out))
    {
        let what = "is no folder, and several files go there; give a folder";
        return Err(Error::taken(out, what));
    }
    let inside = |place: &Path| -> Result<bool> {
        let whole = |path: &Path| path.canonicalize().map_err(Error::io(path));
        Ok(out.is_dir() && whole(place)?.starts_with(whole(out)?))
    };
    let mut pairs = Vec::new();
    let mut from: HashMap<PathBuf, PathBuf> = HashMap::new();
    for place in given {
        // files in `out` were written by an earlier call, unless `out` itself or a folder in it was given
        let skip = place.is_dir() && !inside(place)?;
        for (input, below) in files(std::slice::from_ref(place))? {
            if skip && inside(&input)? {
                continue;
            }
            let output = out.join(below.with_extension(to(&extension(&below))));
            if let Some(other) = from.insert(output.clone(), input.clone()) {
                let both = format!("{} and {}", other.display(), input.display());
                return Err(Error::taken(
                    &output,
                    format!("would be written for both {both}; convert them in two calls"),
                ));
            }
            pairs.push(Pair { input, output });
        }
    }
    if pairs.is_empty() {
        return Err(Error::missing(
            format!("motion file but those in {}", out.display()),
            "these were written there before",
        ));
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(files: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for file in files {
            let path = dir.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        dir
    }

    #[test]
    fn paths_below_a_folder_are_kept_and_outputs_are_one_each() {
        let dir = place(&["d/salsa/1.bvh", "d/2.npz", "d/notes.txt", "e/2.bvh", "x.bvh"]);
        let at = |names: &[&str]| names.iter().map(|n| dir.path().join(n)).collect::<Vec<_>>();
        let out = dir.path().join("out");
        let json = |_: &str| "json".to_string();
        let pairs = into_folder(&at(&["d", "x.bvh"]), &out, json).unwrap();
        let outputs: Vec<_> = pairs.iter().map(|p| p.output.strip_prefix(&out).unwrap().to_owned()).collect();
        assert_eq!(outputs, ["2.json", "salsa/1.json", "x.json"].map(PathBuf::from));
        let wrong = into_folder(&at(&["d", "e"]), &out, json).unwrap_err().to_string();
        assert!(wrong.contains("2.npz and ") && wrong.contains("would be written for both"), "{wrong}");
        // with the extensions that they have they don't meet
        assert_eq!(into_folder(&at(&["d", "e"]), &out, str::to_owned).unwrap().len(), 3);
        let wrong = into_folder(&at(&["d"]), &dir.path().join("x.bvh"), json).unwrap_err().to_string();
        assert!(wrong.contains("is no folder"), "{wrong}");
        assert!(into_folder(&at(&["d"]), &dir.path().join("new.json"), json).is_err());
        std::fs::create_dir(dir.path().join("empty")).unwrap();
        assert!(files(&at(&["empty"])).is_err());
    }

    #[test]
    fn what_stands_in_the_output_folder_is_no_input() {
        let dir = place(&["d/1.bvh", "d/out/1.bvh"]);
        let (d, out) = (dir.path().join("d"), dir.path().join("d/out"));
        let same = str::to_owned;
        let pairs = into_folder(std::slice::from_ref(&d), &out, same).unwrap();
        assert_eq!(pairs, [Pair { input: d.join("1.bvh"), output: out.join("1.bvh") }]);
        assert_eq!(into_folder(std::slice::from_ref(&out), &out, |_| "npz".into()).unwrap().len(), 1);
    }
}
