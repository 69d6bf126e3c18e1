//! The files of `view`, and how each is read: options of its own (`FILE:fps=60,skip=10`), what stands beside a dance, and what
//! the call says of all.

use super::read::{ReadArgs, positive};
use super::{Say, WrongCall};
use crate::generate::provenance::{self, Provenance};
use anyhow::Result;
use clap::ValueEnum;
use kinelm_motion::format::{BvhPosition, ReadOptions, RestFrame, Unit, Up};
use kinelm_store::hash;
use std::path::{Path, PathBuf};

/// A file to be shown.
#[derive(Debug, Clone)]
pub struct Shown {
    /// The file.
    pub path: PathBuf,
    /// How it is read.
    pub options: ReadOptions,
    /// Files of one number stand to each other as they put themselves.
    pub world: Option<usize>,
    /// Seconds in which something of it was made anew, if that is part of it.
    pub anew_s: Vec<[f64; 2]>,
    /// What the user should know of that.
    pub notes: Vec<String>,
}

/// A file or a folder of the call, and the `key=value` that stand behind it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Without what stands behind it.
    pub path: PathBuf,
    /// How it is read, or all that is in it.
    own: Vec<(String, String)>,
}

/// What is known of a file before it is read.
struct Known {
    named: Named,
    told: Option<Provenance>,
}

/// The files of a call, read as [`ReadArgs::of_files`] has it. What a generated dance followed is read as it was followed,
/// whatever `read` says of all; prompt and dance stand in one world, as all files do if they are `together`.
///
/// # Errors
/// Options of a file that are none.
pub fn shown(clips: &[Named], read: &ReadArgs, together: bool, say: Say) -> Result<Vec<Shown>> {
    let known = clips.iter().map(Known::of).collect::<Vec<_>>();
    let paths: Vec<&Path> = clips.iter().map(|clip| &*clip.path).collect();
    let mut all: Vec<Shown> = Vec::new();
    for (file, options) in known.iter().zip(read.of_files(&paths, RestFrame::Keep, say)) {
        let anew_s = file.told.as_ref().map(|told| told.generated_s.clone()).unwrap_or_default();
        all.push(Shown { path: file.named.path.clone(), options, world: None, anew_s, notes: Vec::new() });
    }
    for (n, told) in known.iter().enumerate().filter_map(|(n, file)| Some((n, file.told.as_ref()?))) {
        let followed = followed(told);
        for m in (0..known.len()).filter(|&m| m != n && known[m].told.is_none()) {
            let read = followed.iter().find(|(hash, _)| is_file(&known[m].named.path, hash));
            let Some((_, read)) = read else { continue };
            if all[m].world.is_none() {
                all[m].options = read.clone();
                all[m].notes.push(format!(
                    "{}: read as {} followed it",
                    known[m].named.path.display(),
                    told.output.file
                ));
            }
            let world = all[m].world.or(all[n].world).unwrap_or(m);
            // a dance without a place begins in the middle, wherever its prompt does
            if told.request.placement.is_some() {
                (all[m].world, all[n].world) = (Some(world), Some(world));
            }
        }
    }
    for (shown, file) in all.iter_mut().zip(&known) {
        file.named.own.iter().try_for_each(|(key, value)| set(&mut shown.options, key, value))?;
        shown.world = if together { Some(0) } else { shown.world };
    }
    Ok(all)
}

/// The hashes of the clips that a dance follows, and how they were read: its prompt's, or those of its plan.
fn followed(told: &Provenance) -> Vec<(String, ReadOptions)> {
    let Some(prompt) = &told.request.prompt else { return Vec::new() };
    match &prompt.timeline {
        // of one that is gone nothing can be known
        Some(plan) => {
            plan.clips.values().filter_map(|clip| Some((hash::of_file(&clip.file).ok()?, clip.options()))).collect()
        }
        None => told.prompt_sha256.iter().map(|hash| (hash.clone(), prompt.read.clone())).collect(),
    }
}

/// Whether a file has the bytes of this hash.
fn is_file(path: &Path, sha256: &str) -> bool {
    hash::of_file(path).is_ok_and(|found| found == sha256)
}

impl Known {
    fn of(clip: &Named) -> Known {
        let path = &clip.path;
        // one that was changed since is a file like any other; what is wrong with a sidecar, reading the clip says
        let told = provenance::find(path).ok().flatten().filter(|told| is_file(path, &told.output.sha256));
        Known { named: clip.clone(), told }
    }
}

impl Named {
    /// The same options for another file: one in this folder.
    pub fn of(&self, path: PathBuf) -> Named {
        Named { path, own: self.own.clone() }
    }
}

/// A file or a folder and its options, from the last `:` on, where what follows holds a `=` and nothing has the whole name.
///
/// # Errors
/// What stands behind the colon beside pairs.
pub fn named(clip: &Path) -> Result<Named> {
    let parts = clip.to_str().filter(|_| !clip.exists()).and_then(|text| text.rsplit_once(':'));
    let Some((path, list)) = parts.filter(|(_, list)| list.contains('=')) else {
        return Ok(Named { path: clip.into(), own: Vec::new() });
    };
    let pair = |part: &str| match part.split_once('=') {
        Some((key, value)) => Ok((key.trim().to_string(), value.trim().to_string())),
        None => Err(WrongCall(format!("{}: {part:?} after the colon; expected KEY=VALUE", clip.display())).into()),
    };
    Ok(Named { path: path.into(), own: list.split(',').map(pair).collect::<Result<_>>()? })
}

/// Sets one option of a file.
fn set(options: &mut ReadOptions, key: &str, value: &str) -> Result<()> {
    let wrong = |expected: &str| WrongCall(format!("{key}={value}: expected {expected}"));
    match key {
        "fps" => options.fps_source = Some(positive(value).map_err(|_| wrong("a positive number"))?),
        "skip" => options.skip = value.parse().map_err(|_| wrong("a number of frames"))?,
        "unit" => options.unit = Unit::from_str(value, false).map_err(|_| wrong("auto, m, cm, mm, in or cmu"))?,
        "up" => options.up = Up::from_str(value, false).map_err(|_| wrong("auto, x, -x, y, -y, z or -z"))?,
        "map" => options.map = Some(value.into()),
        "root" => options.root = Some(value.into()),
        "rest" => {
            options.rest = match value {
                "keep" => RestFrame::Keep,
                "drop" => RestFrame::Drop,
                _ => return Err(wrong("keep or drop").into()),
            }
        }
        "position" => {
            options.bvh_position = BvhPosition::from_str(value, false).map_err(|_| wrong("replace or add"))?;
        }
        _ => return Err(wrong("one of fps, skip, up, unit, map, root, rest and position").into()),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_stand_behind_the_last_colon() {
        let of = |text: &str| named(Path::new(text)).map(|n| (n.path, n.own)).unwrap();
        let pair = |key: &str, value: &str| (key.to_string(), value.to_string());
        assert_eq!(of("a/b.bvh:fps=60, skip=10"), ("a/b.bvh".into(), vec![pair("fps", "60"), pair("skip", "10")]));
        for plain in ["a.bvh", "C:\\a.bvh", "a:b.bvh"] {
            assert_eq!(of(plain), (plain.into(), vec![]));
        }
        assert!(named(Path::new("a.bvh:fps=60,lenient")).unwrap_err().to_string().contains("KEY=VALUE"));
    }

    #[test]
    fn what_a_file_is_told_is_checked() {
        let mut options = ReadOptions::default();
        for (key, value) in [("fps", "60"), ("skip", "10"), ("unit", "cm"), ("rest", "drop"), ("map", "cmu")] {
            set(&mut options, key, value).unwrap();
        }
        assert_eq!((options.fps_source, options.skip, options.rest), (Some(60.0), 10, RestFrame::Drop));
        for (key, value) in
            [("fps", "0"), ("fps", "x"), ("skip", "-1"), ("unit", "mile"), ("rest", "no"), ("what", "1")]
        {
            assert!(set(&mut options, key, value).unwrap_err().to_string().contains("expected"), "{key}={value}");
        }
    }
}
