//! The library: the files of a project, their facts, their figures, and search among them.
//!
//! - [`doubts`]: the facts of a file, and its doubts.
//! - [`child`], [`reader`]: the process that reads a file, and its parent's side.
//! - [`upload`]: a file that comes in pieces.
//! - `rates`: rates of a folder, judged together.
//! - [`maps`]: skeleton maps of the project.
//! - [`stated`]: the readings of clips in the timeline's text.
//! - [`figure`]: the figure of a clip for the stage.
//! - [`mod@derive`]: files that are made of clips and dances.
//! - [`search`]: clips that move alike.
//!
//! Files are read one after the other by a thread of their own; of each only a few facts stay in memory.

pub mod child;
pub mod compare;
pub mod derive;
pub mod doubts;
pub mod figure;
pub mod maps;
mod rates;
pub mod reader;
pub mod search;
pub mod stated;
pub mod upload;

use crate::project::document::{ClipRecord, Reading};
use crate::project::{CACHE, CONVERTED, Project};
use crate::{Error, Result};
use doubts::{Info, Outcome};
use kinelm_corpus::{Dataset, Item, sidecar};
use kinelm_motion::format::{ReadOptions, RestFrame};
use kinelm_store::{files, hash, owned};
use reader::Reader;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

/// The files of a project and their facts.
#[derive(Debug)]
pub struct Library {
    project: Arc<Project>,
    reader: Reader,
    inner: Mutex<Inner>,
    /// Wakes the thread that reads.
    wake: Condvar,
    stop: AtomicBool,
    /// Held while the index of a search is built, one at a time.
    searching: Mutex<()>,
    figures: figure::Figures,
    texts: stated::Texts,
}

#[derive(Debug, Default)]
struct Inner {
    /// By the id of the clip.
    known: BTreeMap<String, Known>,
    waiting: VecDeque<String>,
    /// Likely rates of clips that are doubted because of others in their folder, frames per second, by id.
    doubted_rates: BTreeMap<String, f64>,
    /// The options by which dances are read, each for a length and a time of change.
    dances: BTreeMap<PathBuf, DanceRead>,
}

/// The options by which a dance is read, while it has this length and time of change.
type DanceRead = ((u64, Option<SystemTime>), Option<ReadOptions>);

/// The state of a clip's facts.
#[derive(Debug, Clone)]
enum Known {
    Reading,
    Read(Arc<Outcome>),
}

/// A clip or a dance, with all that is needed to use it.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// Its id.
    pub id: String,
    /// The name that is shown.
    pub name: String,
    /// The file that library calls read: the clip's own where it is a BVH.
    pub path: PathBuf,
    /// The options by which it is read.
    pub read: ReadOptions,
    /// Its reading as a timeline states it.
    pub stated: Reading,
    /// Frames per second.
    pub fps: f64,
    /// Frames.
    pub frames: usize,
    /// The height of its floor, metres.
    pub floor_m: f64,
}

/// An earlier outcome, with a key of all that it depends on.
#[derive(Debug, Serialize, Deserialize)]
struct Cached {
    key: String,
    outcome: Outcome,
}

impl Library {
    /// The library of a project.
    pub fn new(project: Arc<Project>, reader: Reader) -> Library {
        Library {
            project,
            reader,
            inner: Mutex::default(),
            wake: Condvar::new(),
            stop: AtomicBool::new(false),
            searching: Mutex::default(),
            figures: figure::Figures::default(),
            texts: stated::Texts::default(),
        }
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts clips into the queue of the reading thread.
    pub fn read_soon(&self, ids: impl IntoIterator<Item = String>) {
        let mut inner = self.inner();
        for id in ids {
            // also for one in the queue: its facts are outdated
            inner.known.insert(id.clone(), Known::Reading);
            if !inner.waiting.contains(&id) {
                inner.waiting.push_back(id);
            }
        }
        self.wake.notify_all();
    }

    /// Reads clips as they come, until [`Library::end`]: the work of a thread. `done` gets the id of each.
    pub fn read_on(&self, done: &dyn Fn(&str)) {
        loop {
            let mut inner = self.inner();
            while inner.waiting.is_empty() && !self.stop.load(Ordering::Relaxed) {
                inner = self.wake.wait(inner).unwrap_or_else(PoisonError::into_inner);
            }
            if self.stop.load(Ordering::Relaxed) {
                return;
            }
            let Some(id) = inner.waiting.pop_front() else { continue };
            drop(inner);
            // removed while it waited
            let Ok(record) = self.project.clip(&id) else { continue };
            let outcome = self.outcome(&record).unwrap_or_else(|e| Outcome::failed(&e));
            let mut inner = self.inner();
            // put into the queue again meanwhile, with another reading: this outcome is outdated
            if !inner.waiting.contains(&id) {
                inner.known.insert(id.clone(), Known::Read(Arc::new(outcome)));
                drop(inner);
                self.wake.notify_all();
                done(&id);
            }
        }
    }

    /// Waits while a clip is read, as long as `goes_on` says so. Clips of a project that was just opened are still
    /// read.
    pub fn wait_for(&self, id: &str, goes_on: &dyn Fn() -> bool) {
        let mut inner = self.inner();
        while matches!(inner.known.get(id), Some(Known::Reading)) && !self.stop.load(Ordering::Relaxed) && goes_on() {
            let waited = self.wake.wait_timeout(inner, Duration::from_millis(100));
            inner = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// The clips that are being read, or will be soon.
    pub fn being_read(&self) -> Vec<String> {
        let inner = self.inner();
        inner.known.iter().filter(|(_, known)| matches!(known, Known::Reading)).map(|(id, _)| id.clone()).collect()
    }

    /// Ends the thread that reads.
    pub fn end(&self) {
        self.stop.store(true, Ordering::Relaxed);
        // a thread between its check of `stop` and its wait holds the lock: after this it waits, and gets the wake
        drop(self.inner());
        self.wake.notify_all();
    }

    /// Takes [`Library::end`] back.
    #[cfg(test)]
    pub fn begin_again(&self) {
        self.stop.store(false, Ordering::Relaxed);
    }

    /// The outcome of a clip, from the cache or by reading it.
    fn outcome(&self, record: &ClipRecord) -> Result<Outcome> {
        let file = self.project.path(&record.file);
        let found = std::fs::metadata(&file).map_err(Error::io(&file))?;
        let changed = found.modified().ok().and_then(|time| time.duration_since(std::time::UNIX_EPOCH).ok());
        let stated = self.resolved(self.reading(record))?;
        let reading = serde_json::to_string(&stated).unwrap_or_default();
        // a sidecar decides how its dance is read
        let beside = hash::of_file(&kinelm_store::sidecar::path_of(&file)).unwrap_or_default();
        let (version, nanos) = (env!("CARGO_PKG_VERSION"), changed.unwrap_or_default().as_nanos());
        let key = format!("{version} {} {nanos} {} {beside} {reading}", file.display(), found.len());
        let cache = owned::path(self.project.folder(), Path::new(CACHE).join(format!("{}.json", record.id)))?;
        let convert = self.converted(&record.id);
        let before = reader::read_cached(&cache).and_then(|text| serde_json::from_slice::<Cached>(&text).ok());
        if let Some(cached) = before {
            let is_there = match &cached.outcome {
                Outcome::Ready(info) => !info.converted || convert.is_file(),
                // tried again at every start: a failure may be of the machine, such as too little memory
                Outcome::Failed { .. } => false,
            };
            if cached.key == key && is_there {
                return Ok(cached.outcome);
            }
        }
        let out = cache.with_extension("read");
        let outcome = self.reader.read(&file, &stated, &convert, &out, &self.stop)?;
        let cached = Cached { key, outcome };
        if let Ok(text) = serde_json::to_vec(&cached) {
            // only a cache: without it the file is read again
            let _ = files::write_whole(&cache, &text);
        }
        Ok(cached.outcome)
    }

    /// The file for a process's answer, a new one each time: several processes may work at once.
    fn answer_file(&self, of: &str) -> Result<PathBuf> {
        static COUNT: AtomicU64 = AtomicU64::new(0);
        let name = format!("{of}-{}.read", COUNT.fetch_add(1, Ordering::Relaxed));
        Ok(owned::path(self.project.folder(), Path::new(CACHE).join(name))?)
    }

    /// The BVH that a clip of another format was converted to.
    pub fn converted(&self, id: &str) -> PathBuf {
        self.project.folder().join(CONVERTED).join(format!("{id}.bvh"))
    }

    /// The facts of a clip that was read.
    ///
    /// # Errors
    /// An unknown clip, one that is still read, and one that can't be.
    pub fn info(&self, id: &str) -> Result<Info> {
        let known = self.inner().known.get(id).cloned();
        match known {
            Some(Known::Read(outcome)) => match &*outcome {
                Outcome::Ready(info) => Ok((**info).clone()),
                Outcome::Failed { text, .. } => Err(Error::Conflict(format!("the clip can't be read: {text}"))),
            },
            Some(Known::Reading) => Err(Error::Conflict("the clip is still being read; wait a moment".into())),
            None => Err(Error::unknown("clip", id)),
        }
    }

    /// The options by which a dance is read, from its sidecar. That hashes the dance, so it happens once for each state
    /// of the file.
    fn dance_options(&self, path: &Path) -> Result<Option<ReadOptions>> {
        let file = std::fs::metadata(path).map_err(Error::io(path))?;
        let key = (file.len(), file.modified().ok());
        // not under the lock while the dance is hashed: two calls may do it, to the same end
        let known = self.inner().dances.get(path).filter(|(other, _)| *other == key).cloned();
        if let Some((_, options)) = known {
            return Ok(options);
        }
        let options = sidecar::read_options(path)?;
        self.inner().dances.insert(path.into(), (key, options.clone()));
        Ok(options)
    }

    /// A clip or a dance by its id.
    ///
    /// # Errors
    /// Those of [`Library::info`]; music; a dance whose file is gone.
    pub fn source(&self, id: &str) -> Result<Source> {
        if let Ok(dance) = self.project.dance(id) {
            let gone = || Error::Conflict(format!("the file of the dance {} is gone", dance.name));
            let path = self.project.path(dance.file().ok_or_else(gone)?);
            let read = self.dance_options(&path)?.ok_or_else(|| {
                let text = format!("the dance {} was changed: put its file back, or drop it in as a clip", dance.name);
                Error::Conflict(text)
            })?;
            // the sidecar says all of it
            let stated = Reading::default();
            let (fps, frames, floor_m) = (dance.fps, dance.frames, dance.floor_m);
            return Ok(Source { id: dance.id, name: dance.name, path, read, stated, fps, frames, floor_m });
        }
        let record = self.project.clip(id)?;
        let info = self.info(id)?;
        if info.music {
            return Err(Error::invalid_parameter("clip", &record.name, "a clip with a body; this is music"));
        }
        let Info { fps, frames, floor_m, .. } = info;
        let reading = self.reading(&record);
        let (path, stated, read) = match info.converted {
            false => {
                let path = self.project.path(&record.file);
                let read = doubts::options(&path, &self.resolved(reading.clone())?)?;
                (path, reading, read)
            }
            true => {
                let stated = stated::of_converted(reading);
                // as for any BVH without a sidecar
                let own = ReadOptions { rest: RestFrame::Drop, ..ReadOptions::default() };
                let read = self.resolved(stated.clone())?.options(Some(&own));
                (self.converted(id), stated, read)
            }
        };
        Ok(Source { id: record.id, name: record.name, path, read, stated, fps, frames, floor_m })
    }

    /// The file of music, and the extension that says its kind.
    ///
    /// # Errors
    /// A clip that is no music.
    pub fn sound(&self, id: &str) -> Result<PathBuf> {
        let record = self.project.clip(id)?;
        match doubts::is_music(&record.file) {
            true => Ok(self.project.path(&record.file)),
            false => Err(Error::unknown("music", id)),
        }
    }

    /// A clip as the page has it.
    pub fn view(&self, record: &ClipRecord) -> Value {
        let mut view = json!({
            "id": record.id, "name": record.name, "reading": self.reading(record), "music": doubts::is_music(&record.file),
        });
        let known = self.inner().known.get(&record.id).cloned();
        match known.as_ref() {
            Some(Known::Read(outcome)) => match &**outcome {
                Outcome::Ready(info) => {
                    let doubts: Vec<_> =
                        info.doubts.iter().cloned().chain(self.folder_rate(&record.id, info)).collect();
                    let (seconds, fps, frames, rig) = (info.seconds, info.fps, info.frames, &info.rig);
                    let more = json!({
                        "state": "ready", "seconds": seconds, "fps": fps, "frames": frames, "rig": rig,
                        "format": info.format, "joints": info.joints, "doubts": doubts,
                        "floor": info.floor_m, "character": info.character,
                    });
                    extend(&mut view, more);
                    if info.music {
                        view["beats"] = json!(info.beats_s);
                    }
                }
                Outcome::Failed { text, doubts } => {
                    extend(&mut view, json!({ "state": "failed", "error": text, "doubts": doubts }));
                }
            },
            _ => extend(&mut view, json!({ "state": "reading", "doubts": [] })),
        }
        view
    }

    /// The clips that were read, whose ids are in the project.
    pub fn sources(&self) -> Vec<Source> {
        let ids: Vec<String> =
            self.project.read(|document| document.clips.iter().map(|clip| clip.id.clone()).collect());
        ids.iter().filter_map(|id| self.source(id).ok()).collect()
    }

    /// Figures that were made lately.
    pub fn figures(&self) -> &figure::Figures {
        &self.figures
    }

    /// The project.
    pub fn project(&self) -> &Project {
        &self.project
    }
}

/// Clips as the library's other parts take many.
pub fn dataset(sources: &[Source]) -> Dataset {
    let item = |(key, source): (usize, &Source)| Item {
        path: source.path.clone(),
        name: source.id.clone(),
        take: source.id.clone(),
        // the whole reading, whatever options an index or a corpus is built with
        sidecar: Some(source.read.clone()),
        fps: source.read.fps_source,
        skip: Some(source.read.skip),
        floor: source.read.floor,
        key,
        ..Item::default()
    };
    let items = sources.iter().enumerate().map(item).collect();
    Dataset { items, sources: vec![String::new()], ..Dataset::default() }
}

/// A hash of clips with their files and readings: another one for any other of these.
pub fn fingerprint(sources: &[Source]) -> String {
    let of = |source: &Source| {
        // by length and time, not by hash: this runs at every search
        let file = std::fs::metadata(&source.path).ok().map(|file| (file.len(), file.modified().ok()));
        let read = serde_json::to_string(&source.read).unwrap_or_default();
        format!("{} {} {file:?} {read}", source.id, source.path.display())
    };
    hash::of(sources.iter().map(of).collect::<Vec<_>>().join("\n").as_bytes())
}

/// Removes the folders whose names begin with `beginning`, built from an earlier state of the library.
pub fn remove_folders(inside: &Path, beginning: &str) {
    for entry in std::fs::read_dir(inside).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(beginning) {
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

fn extend(value: &mut Value, more: Value) {
    if let (Some(value), Value::Object(more)) = (value.as_object_mut(), more) {
        value.extend(more);
    }
}

/// Whether a file of this name is taken in: motion, music, or the skeleton of an AMC.
pub fn is_taken(name: &Path) -> bool {
    let is_skeleton = name.extension().is_some_and(|e| e.eq_ignore_ascii_case("asf"));
    is_skeleton || doubts::is_music(name) || kinelm_motion::format::Format::of_name(name).is_some()
}
