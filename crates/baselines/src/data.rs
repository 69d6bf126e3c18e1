//! Clips that LSTMs learn from: at the file's own rate, with the stride from one frame at the network's rate to the next.

use crate::FPS;
use crate::rig::Rig;
use crate::{Error, Result};
use kinelm_corpus::Split;
use kinelm_corpus::labels::LabelFilter;
use kinelm_corpus::{Dataset, Item};
use kinelm_motion::format::{FileRate, RateDoubts, ReadOptions};
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
    /// Patterns and tables of labels, as [`kinelm_corpus::Dataset`] reads them.
    pub labels: Vec<String>,
    /// Labels that clips must have.
    pub only: Vec<LabelFilter>,
    /// How files are read.
    pub read: ReadOptions,
}

impl Sources {
    /// With other paths of motion and labels.
    pub(crate) fn with_paths(&self, path: impl Fn(&Path) -> PathBuf) -> Sources {
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
    /// Its recording: the independent unit.
    pub take: String,
    /// Its split.
    pub split: Split,
    /// Without the margins, at its own rate.
    pub clip: Clip,
    /// Frames from one at the network's rate to the next.
    pub stride: usize,
    /// SHA-256 of its file.
    pub sha256: String,
    /// What else is known of its file.
    pub item: Item,
}

impl Recording {
    /// The clip at the network's rate.
    ///
    /// # Errors
    /// None for a recording that was read.
    pub(crate) fn at_rate(&self) -> Result<Clip> {
        Ok(resample(&self.clip, FPS, Method::Stride)?)
    }

    /// The number of its frames at the network's rate.
    pub fn frames(&self) -> usize {
        self.clip.frames().div_ceil(self.stride)
    }
}

/// The clips of a run.
#[derive(Debug, Clone)]
pub struct Recordings {
    /// In the order of the sources.
    pub all: Vec<Recording>,
    /// Their rig: the first clip's.
    pub rig: Rig,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl Recordings {
    /// Reads the clips, which must have the same rig: `rig`, if it is known.
    ///
    /// # Errors
    /// What gathering and reading fail with; no clip with the labels; a clip on another rig, with its joints; a rate that is
    /// no multiple of the network's.
    pub fn load(sources: &Sources, margin: usize, rig: Option<&Rig>) -> Result<Recordings> {
        let Dataset { items, mut notes, .. } = Dataset::find(&sources.data, &sources.labels)?;
        let meets = |item: &&Item| sources.only.iter().all(|label| label.allows(&item.labels));
        let items: Vec<&Item> = items.iter().filter(meets).collect();
        let (mut loaded, mut doubts): (Option<Recordings>, _) = (None, RateDoubts::default());
        for item in &items {
            let options = item.read_options(&sources.read);
            let (motion, sha256) = read(&item.path, &options)?;
            doubts.add(&item.file_name(), FileRate::of(&motion, &options));
            // the first clip's rig is the run's, unless a resumed run has one
            let known = loaded.as_ref().map(|loaded| &loaded.rig).or(rig);
            if let Some(rig) = known {
                rig.check(&item.path, motion.clip.skeleton())?;
            }
            let stride = stride(&item.path, motion.clip.fps())?;
            let clip = inner(&motion.clip, margin);
            let (name, take, split) = (item.name.clone(), item.take.clone(), item.split);
            let own =
                || Recordings { all: Vec::new(), rig: rig.cloned().unwrap_or(Rig::of(&motion)), notes: Vec::new() };
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
        notes.extend(doubts.line());
        loaded.map(|loaded| Recordings { notes, ..loaded }).ok_or_else(|| {
            let labels: Vec<String> = sources.only.iter().map(LabelFilter::to_string).collect();
            Error::missing(format!("clip with {}", labels.join(", ")), "see the labels' columns")
        })
    }

    /// One hash of all files, in their order.
    pub fn sha256(&self) -> String {
        let mut hash = Sha256::new();
        for one in &self.all {
            // labels and `fps_source` change splits and strides without changing a file
            hash.update(format!("{}\0{}\0{}\0{}\n", one.name, one.split, one.stride, one.sha256));
        }
        kinelm_store::hash::hex(hash)
    }

    /// SHA-256 of each file, by its path.
    pub fn files(&self) -> Hashes {
        self.all.iter().map(|one| (one.item.path.display().to_string(), one.sha256.clone())).collect()
    }

    /// The clips of a split.
    pub fn split(&self, split: Split) -> impl Iterator<Item = &Recording> {
        self.all.iter().filter(move |one| one.split == split)
    }
}

/// SHA-256 of files by their paths.
pub(crate) type Hashes = BTreeMap<String, String>;

/// Refuses other files than those that a run has learned from, by the hash of all and those of each.
///
/// # Errors
/// [`kinelm_store::Error::File`] that names the first that has changed, is gone or is new; if none has, what else may have.
pub(crate) fn check_files(run: &Path, all: [&str; 2], each: [&Hashes; 2]) -> Result<()> {
    let ([then, now], [then_each, now_each]) = (all, each);
    if then == now {
        return Ok(());
    }
    let help = "put back the files and labels that the run was begun with, or begin a new one";
    let wrong = |path: &str, found: String, expected: String| Err(Error::file(path, found, expected, help));
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
    let found = format!("files, rates, splits or times with the hash {now}");
    wrong(&run.display().to_string(), found, format!("the run's, {then}"))
}

/// A motion file and its hash.
///
/// # Errors
/// What reading fails with.
pub fn read(path: &Path, options: &ReadOptions) -> Result<(Motion, String)> {
    // a wrong name is refused before reading
    format::Format::of(path)?;
    let bytes = input::bytes(path).map_err(Error::io(path))?;
    Ok((format::parse(path, &bytes, options)?, FileRecord::of(&bytes).sha256))
}

/// A clip without `margin` frames at both ends.
pub(crate) fn inner(clip: &Clip, margin: usize) -> Clip {
    let end = clip.frames().saturating_sub(margin);
    clip.slice(margin.min(end)..end)
}

/// Frames from one at the network's rate to the next.
///
/// # Errors
/// A rate that is no multiple of the network's.
pub(crate) fn stride(path: &Path, fps: f64) -> Result<usize> {
    let stride = (fps / FPS).round();
    if stride >= 1.0 && (fps / FPS - stride).abs() <= 1e-6 * stride {
        return Ok(stride as usize);
    }
    let help = "`fps_source` gives the true rate; kinelm convert makes files of another one";
    Err(Error::file(path, format!("{fps} frames a second"), format!("a multiple of {FPS}"), help))
}
