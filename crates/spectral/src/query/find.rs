//! What else moves like this.

use super::exclude::{Exclude, Filter, Origin};
use super::index::Index;
use super::maker::Maker;
use super::record::ClipEntry;
use super::search::{Distance, Wanted};
use crate::{Error, Result};
use kinelm_corpus::load::parse_clip;
use kinelm_motion::format::ReadOptions;
use kinelm_motion::{Clip, Vec3};
use kinelm_store::{FileRecord, input};
use kinelm_view::{Figure, page};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A question to an index.
#[derive(Debug, Clone)]
pub struct Question {
    /// The motion file.
    pub clip: PathBuf,
    /// How it is read.
    pub read: ReadOptions,
    /// Whether a file that the index has is read as it was read then instead.
    pub as_indexed: bool,
    /// Where the window begins, seconds; by itself such that it lies in the clip's middle.
    pub at_s: Option<f64>,
    /// How many windows.
    pub k: usize,
    /// What "near" means.
    pub distance: Distance,
    /// What doesn't count.
    pub exclude: Exclude,
    /// Of each clip only its nearest window.
    pub one_a_clip: bool,
}

/// A window of a clip: the query, or what was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stretch {
    /// The clip.
    pub clip: String,
    /// Its file.
    pub path: PathBuf,
    /// First frame at the index's rate.
    pub start: usize,
    /// Where it begins in the clip, seconds.
    pub start_s: f64,
    /// Where it ends.
    pub end_s: f64,
    /// The recording.
    pub take: String,
    /// Field to value.
    pub labels: BTreeMap<String, String>,
    #[serde(skip)]
    read: ReadOptions,
    #[serde(skip)]
    sha256: String,
}

/// A window that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Found {
    /// From 1.
    pub rank: usize,
    /// The cosine, or the Euclidean distance.
    pub value: f64,
    /// Which.
    #[serde(flatten)]
    pub window: Stretch,
}

/// The answer to a [`Question`].
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// What was asked with.
    pub query: Stretch,
    /// Nearest first.
    pub found: Vec<Found>,
    /// Windows of the index.
    pub windows: usize,
    /// Seconds that the search took, without opening the index and reading the clip.
    pub seconds: f64,
    /// What the user should know.
    pub said: Vec<String>,
    frames: usize,
    fps: f64,
}

/// Looks for the windows of `index` that are nearest to one of a clip.
///
/// # Errors
/// A clip that can't be read or is shorter than a window, a time outside it; [`kinelm_store::Error::Call`] for an exclusion that the index
/// can't tell; a run that is no longer the index's.
pub fn find(index: &Index, question: &Question) -> Result<Answer> {
    let (database, spec) = (index.database(), index.options().windows);
    question.exclude.check(database.clips())?;
    let bytes = input::bytes(&question.clip).map_err(Error::io(&question.clip))?;
    let sha256 = FileRecord::of(&bytes).sha256;
    let known = database.clips().iter().position(|c| c.sha256 == sha256);
    let entry = known.map(|i| &database.clips()[i]);
    let read = entry.filter(|_| question.as_indexed).map_or(&question.read, |entry| &entry.read).clone();
    let (motion, clip) = parse_clip(&question.clip, &bytes, &read, spec.fps)?;
    let start = start_of(&question.clip, clip.frames(), spec.frames, spec.fps, question.at_s)?;
    let (maker, mut finisher) = Maker::new(index.options(), index.basis())?;
    let feature = finisher.finish(maker.make(&clip, &[start])?)?;
    let query = stretch_of(question, entry, start, (spec.frames, spec.fps), read, sha256);
    let origin = Origin { clip: known, entry, start };
    let begun = Instant::now();
    let filter = Filter::new(database, question.exclude, origin, spec.frames);
    let wanted = Wanted { k: question.k, distance: question.distance, one_a_clip: question.one_a_clip };
    let hits = database.nearest(&feature, wanted, &|window| filter.allows(window))?;
    let seconds = begun.elapsed().as_secs_f64();
    let found = hits.iter().enumerate().map(|(i, hit)| {
        let window = database.window(hit.window);
        Found {
            rank: i + 1,
            value: if question.distance == Distance::Euclid { -hit.score } else { hit.score },
            window: Stretch::of(&database.clips()[window.clip], window.start, spec.frames, spec.fps),
        }
    });
    let warned = motion.warnings.iter().map(|warning| format!("{}: {warning}", question.clip.display()));
    let mut said: Vec<String> = warned.collect();
    if known.is_none() && question.exclude > Exclude::None {
        said.push("the index doesn't have this clip: nothing of it had to be left out".to_string());
    }
    if hits.len() < question.k {
        said.push(format!("only {} windows could be found of {} asked for", hits.len(), question.k));
    }
    let (frames, fps) = (spec.frames, spec.fps);
    Ok(Answer { query, found: found.collect(), windows: database.windows(), seconds, said, frames, fps })
}

/// The first frame of the window asked for.
fn start_of(path: &Path, has: usize, frames: usize, fps: f64, at_s: Option<f64>) -> Result<usize> {
    let seconds = |frames: usize| frames as f64 / fps;
    let Some(last) = has.checked_sub(frames) else {
        let found = format!("{has} frames at {fps} frames per second ({:.2} s)", seconds(has));
        let expected = format!("at least {frames} ({:.2} s), a window of the index", seconds(frames));
        return Err(Error::file(path, found, expected, "give a longer clip, or build an index of shorter windows"));
    };
    match at_s {
        None => Ok(last / 2),
        Some(at) if at.is_finite() && at >= 0.0 && (at * fps).round() <= last as f64 => Ok((at * fps).round() as usize),
        Some(at) => {
            let expected =
                format!("0 to {:.2} s, so that a window of {:.2} s lies in the clip", seconds(last), seconds(frames));
            Err(Error::file(path, format!("a window from {at} s on"), expected, ""))
        }
    }
}

fn stretch_of(
    question: &Question,
    entry: Option<&ClipEntry>,
    start: usize,
    (frames, fps): (usize, f64),
    read: ReadOptions,
    sha256: String,
) -> Stretch {
    match entry {
        Some(entry) => Stretch { path: question.clip.clone(), read, ..Stretch::of(entry, start, frames, fps) },
        None => {
            let name = question.clip.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
            Stretch {
                take: name.clone(),
                clip: name,
                path: question.clip.clone(),
                start,
                start_s: start as f64 / fps,
                end_s: (start + frames) as f64 / fps,
                labels: BTreeMap::new(),
                read,
                sha256,
            }
        }
    }
}

impl Stretch {
    fn of(entry: &ClipEntry, start: usize, frames: usize, fps: f64) -> Stretch {
        Stretch {
            clip: entry.name.clone(),
            path: entry.path.clone(),
            start,
            start_s: start as f64 / fps,
            end_s: (start + frames) as f64 / fps,
            take: entry.take.clone(),
            labels: entry.labels.clone(),
            read: entry.read.clone(),
            sha256: entry.sha256.clone(),
        }
    }

    /// Its labels in a line.
    pub fn labelled(&self) -> String {
        self.labels.iter().map(|(field, value)| format!("{field} {value}")).collect::<Vec<_>>().join(", ")
    }

    fn load(&self, frames: usize, fps: f64) -> Result<Clip> {
        let bytes = input::bytes(&self.path).map_err(Error::io(&self.path))?;
        let found = FileRecord::of(&bytes).sha256;
        if found != self.sha256 {
            let help = "the file was changed since the index was built: build it again";
            return Err(Error::file(&self.path, format!("SHA-256 {found}"), &self.sha256, help));
        }
        let (_, clip) = parse_clip(&self.path, &bytes, &self.read, fps)?;
        if self.start + frames > clip.frames() {
            let found = format!("{} frames", clip.frames());
            return Err(Error::file(
                &self.path,
                found,
                format!("at least {}", self.start + frames),
                "build the index again",
            ));
        }
        let clip = clip.slice(self.start..self.start + frames);
        let first = clip.root().first().copied().unwrap_or_default();
        let away = Vec3::new(first.x, 0.0, first.z);
        let root = clip.root().iter().map(|p| *p - away).collect();
        Ok(Clip::new(clip.skeleton().clone(), fps, root, clip.rotations().to_vec())?)
    }
}

impl Answer {
    /// A page that plays the query beside what was found, all on the model's body, each beginning on its own spot; and what
    /// was wrong with files that are gone or not as they were when the index was built, which are left
    /// out.
    ///
    /// # Errors
    /// The query's file; those of [`page`].
    pub fn page(&self) -> Result<(String, Vec<Error>)> {
        let asked = self.query.load(self.frames, self.fps)?;
        let found: Vec<Result<Clip>> = self.found.iter().map(|f| f.window.load(self.frames, self.fps)).collect();
        let clips = std::iter::once(Some(&asked)).chain(found.iter().map(|clip| clip.as_ref().ok()));
        let mut figures = Vec::new();
        for (i, clip) in clips.enumerate() {
            let Some(clip) = clip else { continue };
            let (title, window, value) = match i.checked_sub(1).map(|i| &self.found[i]) {
                None => (format!("asked: {}", self.query.clip), &self.query, String::new()),
                Some(f) => (format!("{}. {}", f.rank, f.window.clip), &f.window, format!("{:.3}, ", f.value)),
            };
            let mut note = format!("{value}{:.2} to {:.2} s", window.start_s, window.end_s);
            if !window.labels.is_empty() {
                note += &format!(", {}", window.labelled());
            }
            figures.push(Figure::new(title, clip).note(note));
        }
        let page = page(&figures)?;
        Ok((page, found.into_iter().filter_map(Result::err).collect()))
    }
}
