//! Clips as the network learns them: their frames in a form, at the file's own rate, and how far apart those are that
//! follow each other at the network's.

use super::form::Coder;
use super::{Config, FPS, Rig};
use crate::{Error, Result};
use kinelm_classify::Only;
use kinelm_corpus::Split;
use kinelm_corpus::gather::{Gathered, Item, gather};
use kinelm_corpus::load::item_options;
use kinelm_motion::format::{RateDoubt, RateDoubts, ReadOptions};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, Motion, format};
use kinelm_store::{FileRecord, input};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where a run's motion is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sources {
    /// Folders of motion files, or files.
    pub data: Vec<PathBuf>,
    /// As [`gather`] takes them.
    pub labels: Vec<String>,
    /// Labels that clips must have.
    pub only: Vec<Only>,
    /// How files are read.
    pub read: ReadOptions,
}

impl Sources {
    /// With other paths of motion and labels.
    pub fn with_paths(&self, path: impl Fn(&Path) -> PathBuf) -> Sources {
        let label = |text: &String| match text.is_empty() || text.contains(['{', '}']) {
            true => text.clone(), // known names, or a pattern
            false => path(Path::new(text)).to_string_lossy().into_owned(),
        };
        let data = self.data.iter().map(|one| path(one)).collect();
        Sources { data, labels: self.labels.iter().map(label).collect(), ..self.clone() }
    }
}

/// A clip.
#[derive(Debug, Clone)]
pub struct Recording {
    /// Its name.
    pub name: String,
    /// The recording it is of: the independent unit.
    pub take: String,
    /// Which part of the experiment it serves.
    pub split: Split,
    /// As it was read, without its ends, at its own rate.
    pub clip: Clip,
    /// Frames from one that is used to the next.
    pub stride: usize,
    /// SHA-256 of its file.
    pub sha256: String,
    /// What else is known of its file.
    pub item: Item,
}

impl Recording {
    /// The clip at the network's rate, from a frame of the file's on.
    ///
    /// # Errors
    /// None that a recording brings about.
    pub fn at_rate(&self) -> Result<Clip> {
        Ok(resample(&self.clip, FPS, Method::Stride)?)
    }

    /// Frames that it has at the network's rate.
    pub fn frames(&self) -> usize {
        self.clip.frames().div_ceil(self.stride)
    }
}

/// The clips of a run.
#[derive(Debug, Clone)]
pub struct Recordings {
    /// In the order of [`gather`].
    pub all: Vec<Recording>,
    /// Their rig: the first clip's.
    pub rig: Rig,
    /// What the user should be told.
    pub said: Vec<String>,
}

impl Recordings {
    /// Reads the clips; `rig` is the one that they must have, if one is known.
    ///
    /// # Errors
    /// What gathering and reading fail with; no clip with the labels; a clip on another rig than the first, with its joints;
    /// a rate that is no multiple of the network's.
    pub fn load(sources: &Sources, margin: usize, rig: Option<&Rig>) -> Result<Recordings> {
        let Gathered { items, mut said, .. } = gather(&sources.data, &sources.labels)?;
        let meets = |item: &&Item| sources.only.iter().all(|o| item.labels.get(&o.field) == Some(&o.value));
        let items: Vec<&Item> = items.iter().filter(meets).collect();
        let (mut loaded, mut doubts): (Option<Recordings>, _) = (None, RateDoubts::default());
        for item in &items {
            let options = item_options(item, &sources.read);
            let (motion, sha256) = read(&item.path, &options)?;
            doubts.add(&item.file_name(), RateDoubt::in_reading(&motion));
            let known = loaded.as_ref().map(|loaded| &loaded.rig).or(rig);
            if let Some(rig) = known {
                rig.check(&item.path, motion.clip.skeleton())?;
            }
            let stride = stride(&item.path, motion.clip.fps())?;
            let clip = inner(&motion.clip, margin);
            let (name, take, split) = (item.name.clone(), item.take.clone(), item.split);
            let own =
                || Recordings { all: Vec::new(), rig: rig.cloned().unwrap_or(Rig::of(&motion)), said: Vec::new() };
            loaded.get_or_insert_with(own).all.push(Recording {
                name,
                take,
                split,
                clip,
                stride,
                sha256,
                item: (*item).clone(),
            });
        }
        said.extend(doubts.line());
        loaded.map(|loaded| Recordings { said, ..loaded }).ok_or_else(|| {
            let asked: Vec<String> = sources.only.iter().map(|o| format!("{}={}", o.field, o.value)).collect();
            Error::call(format!("no clip with {}; see the labels' columns", asked.join(", ")))
        })
    }

    /// One hash of all files, in their order.
    pub fn sha256(&self) -> String {
        let mut hash = Sha256::new();
        for one in &self.all {
            hash.update(format!("{}\0{}\0{}\0{}\n", one.name, one.split, one.stride, one.sha256));
        }
        kinelm_store::hash::hex(hash)
    }

    /// SHA-256 of each file, by its path.
    pub fn files(&self) -> Hashes {
        self.all.iter().map(|one| (one.item.path.display().to_string(), one.sha256.clone())).collect()
    }

    /// Those of a split.
    pub fn split(&self, split: Split) -> impl Iterator<Item = &Recording> {
        self.all.iter().filter(move |one| one.split == split)
    }
}

/// SHA-256 of files by their paths.
pub type Hashes = BTreeMap<String, String>;

/// Refuses files that aren't those that a run has learned from, by the hash of all and those of each: of each nothing is known
/// in runs of before.
///
/// # Errors
/// [`kinelm_store::Error::File`] that names the first that has changed, is gone or is new; where none has, what else may have.
pub fn check_files(run: &Path, all: [&str; 2], each: [&Hashes; 2]) -> Result<()> {
    let ([then, now], [then_each, now_each]) = (all, each);
    if then == now {
        return Ok(());
    }
    let help = "put back the files and labels that the run was begun with, or begin a new one";
    let wrong = |path: &str, found: String, expected: String| Err(Error::file(path, found, expected, help));
    if !then_each.is_empty() {
        for (path, then) in then_each {
            let expected = format!("the file that {} was begun with, {then}", run.display());
            match now_each.get(path) {
                Some(now) if now == then => {}
                Some(now) => return wrong(path, format!("SHA-256 {now}"), expected),
                None => return wrong(path, "no such file among those of the run".into(), expected),
            }
        }
        if let Some(path) = now_each.keys().find(|path| !then_each.contains_key(*path)) {
            return wrong(path, "a file".into(), format!("none: {} was begun without it", run.display()));
        }
    }
    let found = format!("files, rates, splits or times with the hash {now}");
    wrong(&run.display().to_string(), found, format!("the run's, {then}"))
}

/// A motion and the hash of its file.
///
/// # Errors
/// What reading fails with.
pub fn read(path: &Path, options: &ReadOptions) -> Result<(Motion, String)> {
    // refused by its name before it is read
    format::Format::of(path)?;
    let bytes = input::bytes(path).map_err(Error::io(path))?;
    Ok((format::parse(path, &bytes, options)?, FileRecord::of(&bytes).sha256))
}

/// A clip without this many frames at both its ends.
pub fn inner(clip: &Clip, margin: usize) -> Clip {
    let end = clip.frames().saturating_sub(margin);
    clip.slice(margin.min(end)..end)
}

/// Frames from one that is used to the next.
///
/// # Errors
/// A rate that is no multiple of the network's.
pub fn stride(path: &Path, fps: f64) -> Result<usize> {
    let stride = (fps / FPS).round();
    if stride >= 1.0 && (fps / FPS - stride).abs() <= 1e-6 * stride {
        return Ok(stride as usize);
    }
    let help = "--fps-source says the true rate; kinelm convert --fps makes files of another one";
    Err(Error::file(path, format!("{fps} frames a second"), format!("a multiple of {FPS}"), help))
}

/// What sequences are drawn from: clips that are long enough, as frames.
pub struct Learned {
    /// (F, C) of each, with its stride and its name.
    pub clips: Vec<(Vec<f32>, usize, String)>,
    /// Clips that are too short.
    pub short: Vec<String>,
}

impl Learned {
    /// The training clips.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] when none is long enough.
    pub fn of(recordings: &Recordings, coder: &Coder, config: &Config) -> Result<Learned> {
        let mut learned = Learned { clips: Vec::new(), short: Vec::new() };
        for one in recordings.split(Split::Train) {
            match one.frames() >= config.length + 2 {
                true => {
                    let frames = coder.frames(&one.clip).into_iter().map(|x| x as f32).collect();
                    learned.clips.push((frames, one.stride, one.name.clone()));
                }
                false => learned.short.push(one.name.clone()),
            }
        }
        if learned.clips.is_empty() {
            let (found, length) = (learned.short.len(), config.length + 2);
            let what = format!("no training clip of {length} frames at {FPS} a second; {found} are shorter");
            return Err(Error::call(format!("{what}: take a shorter length, or other clips")));
        }
        Ok(learned)
    }
}
