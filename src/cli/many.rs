//! Many motion files and folders, and where each goes.

use super::{WrongCall, extension};
use crate::corpus::gather::files_below;
use anyhow::{Context, Result};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// A file that is read, and the file that is written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pair {
    pub input: PathBuf,
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
            let found = files_below(place)?;
            anyhow::ensure!(!found.is_empty(), "{}: no motion file in this folder", place.display());
            let below = |path: PathBuf| {
                let below = path.strip_prefix(place).unwrap_or(&path).to_owned();
                (path, below)
            };
            all.extend(found.into_iter().map(below));
        } else {
            let name = place.file_name().ok_or_else(|| WrongCall(format!("{}: no file", place.display())))?;
            all.push((place.clone(), name.into()));
        }
    }
    Ok(all)
}

/// The format that is written for a file of another: of those that are read alone one that holds as much.
pub fn written_for(own: &str) -> &str {
    match own {
        "pkl" => "npz",
        "fbx" => "bvh",
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

/// Where each file goes below the folder `out`, under the extension that `to` gives to its own. Files that lie in `out` are no
/// inputs, where that is a folder in one that was given.
///
/// # Errors
/// [`WrongCall`], before anything is written, for an `out` that is no folder, and for two files with one output.
pub fn into_folder(given: &[PathBuf], out: &Path, to: impl Fn(&str) -> String) -> Result<Vec<Pair>> {
    if out.exists() && !out.is_dir()
        || !out.is_dir() && extension(out).len() > 1 && extension(out) == to(&extension(out))
    {
        let what = format!("{}: several files go there, and it is no folder; give a folder", out.display());
        return Err(WrongCall(what).into());
    }
    let inside = |place: &Path| -> Result<bool> {
        let whole = |path: &Path| path.canonicalize().with_context(|| path.display().to_string());
        Ok(out.is_dir() && whole(place)?.starts_with(whole(out)?))
    };
    let mut pairs = Vec::new();
    let mut from: HashMap<PathBuf, PathBuf> = HashMap::new();
    for place in given {
        // what stands in OUT was written by an earlier call, unless OUT itself was given, or lies above
        let skip = place.is_dir() && !inside(place)?;
        for (input, below) in files(std::slice::from_ref(place))? {
            if skip && inside(&input)? {
                continue;
            }
            let output = out.join(below.with_extension(to(&extension(&below))));
            if let Some(other) = from.insert(output.clone(), input.clone()) {
                let (a, b, to) = (other.display(), input.display(), output.display());
                return Err(WrongCall(format!("{a} and {b} would both be written to {to}; give them apart")).into());
            }
            pairs.push(Pair { input, output });
        }
    }
    anyhow::ensure!(!pairs.is_empty(), "no motion file but those in {}", out.display());
    Ok(pairs)
}

/// Clips, and where what is made of each of them goes.
#[derive(Debug, clap::Args)]
pub struct InOut {
    /// Motion files (.bvh .npz .pkl .json), or folders of them
    #[arg(required = true, value_name = "CLIP")]
    clips: Vec<PathBuf>,
    /// The file to write (.bvh .npz .json), or a folder, which is made if it isn't there: files go by their names,
    /// those of a folder by their paths below it
    #[arg(long, value_name = "FILE|DIR")]
    out: PathBuf,
}

impl InOut {
    /// Where each clip goes: to `out` itself, or into it under its own path. A .pkl, which isn't written, becomes an .npz, an .fbx a .bvh.
    pub fn pairs(&self) -> Result<Vec<Pair>> {
        let InOut { clips, out } = self;
        let pairs = match is_folder(clips, out) {
            true => into_folder(clips, out, |own| written_for(own).into())?,
            false => vec![Pair { input: clips[0].clone(), output: out.to_owned() }],
        };
        for Pair { output, .. } in &pairs {
            super::writable(output)?;
        }
        Ok(pairs)
    }
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
        assert!(wrong.contains("2.npz and ") && wrong.contains("would both be written to"), "{wrong}");
        // with the extensions that they have they don't meet
        assert_eq!(into_folder(&at(&["d", "e"]), &out, str::to_owned).unwrap().len(), 3);
        let wrong = into_folder(&at(&["d"]), &dir.path().join("x.bvh"), json).unwrap_err().to_string();
        assert!(wrong.contains("it is no folder"), "{wrong}");
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
