//! The windows of an index that are nearest to one of a clip.

use super::distance::{Distance, SearchOptions};
use super::embedding::Models;
use super::exclude::{Exclude, Exclusion, Origin};
use super::extract::FeatureExtractor;
use super::index::Index;
use super::record::ClipEntry;
use super::search::Hit;
use crate::{Error, Result};
use comfy_table::{CellAlignment, ContentArrangement, Table, presets};
use kinelm_corpus::load::{ClipSpec, ModelClip};
use kinelm_motion::format::ReadOptions;
use kinelm_motion::{Clip, Vec3};
use kinelm_store::{FileRecord, input};
use kinelm_view::{Figure, page};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A query to an index.
#[derive(Debug, Clone)]
pub struct Query {
    /// The motion file.
    pub clip: PathBuf,
    /// How it is read.
    pub read: ReadOptions,
    /// Whether a file that the index has is read as it was read then instead.
    pub as_indexed: bool,
    /// The window's beginning, seconds; `None`: such that the window is in the clip's middle.
    pub at_s: Option<f64>,
    /// The number of windows.
    pub k: usize,
    /// The number of least similar windows that are found too, none of them among the `k`.
    pub lowest: usize,
    /// The measure of nearness.
    pub distance: Distance,
    /// The windows that don't count.
    pub exclude: Exclude,
    /// Of each clip only its nearest window, and its least similar one of a clip that is not among the nearest.
    pub one_per_clip: bool,
    /// How the model of the index is opened, if it has one.
    pub models: Models,
}

/// A window of a clip: the query, or what was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClipWindow {
    /// The clip.
    pub clip: String,
    /// Its file.
    pub path: PathBuf,
    /// First frame at the index's rate.
    pub start: usize,
    /// Its beginning in the clip, seconds.
    pub start_s: f64,
    /// Its end.
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
pub struct Match {
    /// From 1, the nearest, or of the least similar windows the least similar.
    pub rank: usize,
    /// The cosine, or the Euclidean distance.
    pub value: f64,
    /// Which.
    #[serde(flatten)]
    pub window: ClipWindow,
}

/// The answer to a [`Query`].
#[derive(Debug, Clone, PartialEq)]
pub struct SearchResult {
    /// The query's window.
    pub query: ClipWindow,
    /// Nearest first.
    pub matches: Vec<Match>,
    /// Least similar first.
    pub lowest: Vec<Match>,
    /// Windows of the index.
    pub windows: usize,
    /// Windows that were measured from their f32 features, after the scan of the bytes.
    pub measured: usize,
    /// Seconds that the search took, without opening the index and reading the clip.
    pub seconds: f64,
    /// Notes for the user.
    pub notes: Vec<String>,
    frames: usize,
    fps: f64,
}

impl Index {
    /// Looks for the windows of `index` that are nearest to one of a clip, and for the least similar ones.
    ///
    /// # Errors
    /// A clip that can't be read or is shorter than a window, a time outside it; [`kinelm_store::Error::Invalid`] for an exclusion that the index
    /// can't tell; a run that is no longer the index's.
    pub fn find(&self, query: &Query) -> Result<SearchResult> {
        let (database, spec) = (self.database(), self.options().windows);
        query.exclude.check(database.clips())?;
        let bytes = input::bytes(&query.clip).map_err(Error::io(&query.clip))?;
        let sha256 = FileRecord::of(&bytes).sha256;
        let known = database.clips().iter().position(|c| c.sha256 == sha256);
        let entry = known.map(|i| &database.clips()[i]);
        let read = entry.filter(|_| query.as_indexed).map_or(&query.read, |entry| &entry.read).clone();
        let ModelClip { motion, clip, .. } =
            ModelClip::parse(&query.clip, &bytes, &read, ClipSpec::in_world(spec.fps))?;
        let start = start_of(&query.clip, clip.frames(), spec.frames, spec.fps, query.at_s)?;
        let extractor = FeatureExtractor::new(self.options(), self.basis(), query.models)?;
        let feature = extractor.embed(extractor.extract(&clip, &[start])?)?;
        let own = query_window(query, entry, start, spec.frames, spec.fps, read, sha256);
        let origin = Origin { clip: known, entry, start };
        // from here on the time of a search: reading the clip is its own business
        let begun = Instant::now();
        let exclusion = Exclusion::new(database, query.exclude, origin, spec.frames);
        let &Query { k, distance, one_per_clip, .. } = query;
        let search = |options: SearchOptions, allowed: &(dyn Fn(usize) -> bool + Sync)| -> Result<_> {
            if options.k == 0 {
                return Ok((Vec::new(), 0));
            }
            let found = database.nearest(&feature, options, allowed)?;
            Ok((found.hits, found.measured))
        };
        let options = SearchOptions { k, distance, one_per_clip, farthest: false };
        let (hits, measured) = search(options, &|window| exclusion.allows(window))?;
        // in a small index the least similar windows would be the nearest again
        let place = |window: usize| if one_per_clip { database.window(window).clip } else { window };
        let found: BTreeSet<usize> = hits.iter().map(|hit| place(hit.window)).collect();
        let other = |window: usize| exclusion.allows(window) && !found.contains(&place(window));
        let (lowest, more) = search(SearchOptions { k: query.lowest, farthest: true, ..options }, &other)?;
        let seconds = begun.elapsed().as_secs_f64();
        let of_hit = |(i, hit): (usize, &Hit)| {
            let window = database.window(hit.window);
            Match {
                rank: i + 1,
                value: if distance == Distance::Euclid { -hit.score } else { hit.score },
                window: ClipWindow::of(&database.clips()[window.clip], window.start, spec.frames, spec.fps),
            }
        };
        let matches = |hits: &[Hit]| hits.iter().enumerate().map(of_hit).collect();
        let warned = motion.warnings.iter().map(|warning| format!("{}: {warning}", query.clip.display()));
        let mut notes: Vec<String> = warned.collect();
        if known.is_none() && query.exclude > Exclude::None {
            notes.push("the index doesn't have this clip: nothing of it had to be left out".to_string());
        }
        for (hits, requested, what) in [(&hits, k, "windows"), (&lowest, query.lowest, "least similar windows")] {
            if hits.len() < requested {
                notes.push(format!("only {} of {requested} requested {what} were found", hits.len()));
            }
        }
        let (frames, fps, windows) = (spec.frames, spec.fps, database.windows());
        let (matches, lowest, measured) = (matches(&hits), matches(&lowest), measured + more);
        Ok(SearchResult { query: own, matches, lowest, windows, measured, seconds, notes, frames, fps })
    }
}

/// The first frame of the query's window.
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

fn query_window(
    query: &Query,
    entry: Option<&ClipEntry>,
    start: usize,
    frames: usize,
    fps: f64,
    read: ReadOptions,
    sha256: String,
) -> ClipWindow {
    match entry {
        Some(entry) => ClipWindow { path: query.clip.clone(), read, ..ClipWindow::of(entry, start, frames, fps) },
        None => {
            let name = query.clip.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
            ClipWindow {
                take: name.clone(),
                clip: name,
                path: query.clip.clone(),
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

impl ClipWindow {
    fn of(entry: &ClipEntry, start: usize, frames: usize, fps: f64) -> ClipWindow {
        ClipWindow {
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
        let clip = ModelClip::parse(&self.path, &bytes, &self.read, ClipSpec::in_world(fps))?.clip;
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
        // beside each other on a page: only the place on the floor is taken off
        let away = Vec3::new(first.x, 0.0, first.z);
        let root = clip.root().iter().map(|p| *p - away).collect();
        Ok(Clip::new(clip.skeleton().clone(), fps, root, clip.rotations().to_vec())?)
    }
}

impl SearchResult {
    /// A row for each match, by the `distance` of the query, for a terminal; the least similar windows in a table of
    /// their own.
    pub fn table(&self, distance: Distance) -> String {
        let nearest = rows(&self.matches, distance);
        match &self.lowest[..] {
            [] => nearest,
            lowest => format!("{nearest}\nlowest, the least similar first:\n{}", rows(lowest, distance)),
        }
    }

    /// A page that plays the query beside what was found, the nearest and then the least similar, all on the model's
    /// body, each beginning on its own spot; and what was wrong with files that are gone or not as they were when the
    /// index was built, which are left out.
    ///
    /// # Errors
    /// The query's file; those of [`page`].
    pub fn page(&self) -> Result<(String, Vec<Error>)> {
        let query = self.query.load(self.frames, self.fps)?;
        let all = self.matches.iter().map(|found| ("", found));
        let all: Vec<(&str, &Match)> = all.chain(self.lowest.iter().map(|found| ("lowest ", found))).collect();
        let clips: Vec<Result<Clip>> = all.iter().map(|(_, found)| found.window.load(self.frames, self.fps)).collect();
        let mut figures = vec![figure(format!("query: {}", self.query.clip), "", &self.query, &query)];
        for ((which, found), clip) in all.iter().zip(&clips) {
            let Ok(clip) = clip else { continue };
            let title = format!("{which}{}. {}", found.rank, found.window.clip);
            figures.push(figure(title, &format!("{:.3}, ", found.value), &found.window, clip));
        }
        let page = page(&figures)?;
        Ok((page, clips.into_iter().filter_map(Result::err).collect()))
    }
}

/// A window on a page, with its value and its labels.
fn figure<'a>(title: String, value: &str, window: &ClipWindow, clip: &'a Clip) -> Figure<'a> {
    let mut note = format!("{value}{:.2} to {:.2} s", window.start_s, window.end_s);
    if !window.labels.is_empty() {
        note += &format!(", {}", window.labelled());
    }
    Figure::new(title, clip).note(note)
}

/// A table with a row for each match.
fn rows(matches: &[Match], distance: Distance) -> String {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_content_arrangement(ContentArrangement::Disabled);
    table.set_header(["", distance.name(), "clip", "seconds", "labels"]);
    for found in matches {
        let window = &found.window;
        table.add_row([
            found.rank.to_string(),
            format!("{:.4}", found.value),
            window.clip.clone(),
            format!("{:.2} to {:.2}", window.start_s, window.end_s),
            window.labelled(),
        ]);
    }
    table.column_iter_mut().take(2).for_each(|c| c.set_cell_alignment(CellAlignment::Right));
    format!("{table}\n")
}
