//! The timeline: the file `timeline.toml` as a page shows it, and edits that change nothing else in it.
//!
//! - [`segments`]: its segments as numbers, cut and joined.
//! - [`mod@file`]: its text, changed in place.
//! - [`edit`]: the edits that a page may request.
//! - [`view`]: the view of a page.
//! - [`raw`]: segments of a text that can't be laid out.
//! - [`refit`]: segments of a clip whose reading changes.

pub mod edit;
pub mod file;
pub mod raw;
pub mod refit;
pub mod segments;
pub mod view;

use crate::library::stated::of_converted;
use crate::library::{Library, Source, maps};
use crate::project::document::{Change, ClipRecord, Reading};
use crate::project::{Project, TIMELINE};
use crate::{Error, Result};
use edit::Edit;
use file::TimelineFile;
use kinelm_generate::request::Timeline;
use kinelm_generate::timeline::TimelineLayout;
use kinelm_store::Subject;
use refit::Reread;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Segments of a timeline, which is laid out at every step.
const MOST_SEGMENTS: usize = 1000;

/// The timeline of a project.
#[derive(Debug)]
pub struct Timelines {
    project: Arc<Project>,
    library: Arc<Library>,
    /// The last view, by all that it depends on.
    seen: Mutex<Option<(String, Arc<Value>)>>,
}

/// A timeline that the library has parsed and laid out.
pub struct Laid {
    /// As its text says.
    pub timeline: Timeline,
    /// In frames.
    pub layout: TimelineLayout,
}

impl Timelines {
    /// The timeline of a project.
    pub fn new(project: Arc<Project>, library: Arc<Library>) -> Timelines {
        Timelines { project, library, seen: Mutex::default() }
    }

    /// Its file.
    pub fn path(&self) -> PathBuf {
        self.project.folder().join(TIMELINE)
    }

    /// Reads the clips of a text and lays it out.
    ///
    /// # Errors
    /// A clip that isn't in the library, or a map that is neither built in nor the project's: a page writes the text, and
    /// names no other files.
    /// Those of [`Timeline::parse`].
    pub fn lay_out(&self, text: &str) -> Result<Laid> {
        // a text that isn't TOML has its own message below, with its line
        if let Ok(file) = TimelineFile::parse(&self.path(), text) {
            self.check(&file)?;
        }
        let (timeline, layout) = Timeline::parse(&self.path(), text)?;
        Ok(Laid { timeline, layout })
    }

    /// Refuses files that a page may not name, and more segments than can be laid out at every step.
    fn check(&self, file: &TimelineFile) -> Result<()> {
        if file.segments() > MOST_SEGMENTS {
            let (needs, limit) = (format!("{} segments", file.segments()), format!("{MOST_SEGMENTS} segments"));
            return Err(Error::limit("the timeline", needs, limit, "make it of fewer"));
        }
        let last = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let known: Vec<PathBuf> = self.sources().iter().filter_map(|one| one.path.canonicalize().ok()).collect();
        for (name, path) in file.clips() {
            let found = self.project.folder().join(&path).canonicalize();
            if !found.as_ref().is_ok_and(|found| known.contains(found)) {
                // a clip of the library that is being read, or can't be
                if let Some(record) = found.ok().and_then(|found| self.record_of(&found)) {
                    self.library.info(&record.id)?;
                }
                let expected = "a clip of the library; drop it in first";
                return Err(Error::invalid(Subject::of_parameter(format!("clips.{name}.file")), last(&path), expected));
            }
        }
        match file.maps().into_iter().find(|(_, map)| !maps::is_known(self.project.folder(), map)) {
            Some((name, map)) => {
                let expected = "a skeleton map that is built in, or one of the project's maps/";
                Err(Error::invalid(Subject::of_parameter(format!("clips.{name}.map")), last(Path::new(&map)), expected))
            }
            None => Ok(()),
        }
    }

    /// The clip of the library that is this file.
    fn record_of(&self, file: &Path) -> Option<ClipRecord> {
        let is = |clip: &&ClipRecord| self.project.path(&clip.file).canonicalize().is_ok_and(|path| path == file);
        self.project.read(|document| document.clips.iter().find(is).cloned())
    }

    /// Whether a timeline waits for a clip that is being read.
    fn waits(&self, file: &TimelineFile, being_read: &[String]) -> bool {
        let folder = self.project.folder();
        let record = |path: &Path| self.record_of(&folder.join(path).canonicalize().ok()?);
        let waits = |record: ClipRecord| being_read.contains(&record.id);
        let is_converted =
            |path: &Path| being_read.iter().any(|id| edit::is_same(&folder.join(path), &self.library.converted(id)));
        !being_read.is_empty()
            && file.clips().iter().any(|(_, path)| record(path).is_some_and(waits) || is_converted(path))
    }

    /// The view of a page, and the changes that another program made to the file.
    ///
    /// # Errors
    /// A file that can't be read.
    pub fn view(&self) -> Result<(Arc<Value>, Vec<Change>)> {
        let (text, changes) = self.project.timeline()?;
        Ok((self.view_of(text.as_deref(), None)?, changes))
    }

    /// The view of a text; `parsed`, where it is laid out already.
    fn view_of(&self, text: Option<&str>, parsed: Option<Laid>) -> Result<Arc<Value>> {
        let (sources, being_read) = (self.sources(), self.library.being_read());
        // the layout depends on these beside the text
        let key = format!("{}\n{sources:?}\n{being_read:?}", text.unwrap_or_default());
        // held while the view is made: of two requests at once the second gets the first one's
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, view)) = seen.as_ref().filter(|(other, _)| *other == key) {
            return Ok(view.clone());
        }
        let view = Arc::new(view::of(self, text, parsed, &sources, &being_read));
        *seen = Some((key, view.clone()));
        Ok(view)
    }

    /// All that a timeline may name: clips and dances.
    pub fn sources(&self) -> Vec<Source> {
        let ids = self.project.read(|document| {
            let dances = document.dances.iter().filter(|dance| !dance.rejected).map(|dance| dance.id.clone());
            document.clips.iter().map(|clip| clip.id.clone()).chain(dances).collect::<Vec<_>>()
        });
        ids.iter().filter_map(|id| self.library.source(id).ok()).collect()
    }

    /// Carries out edits as one step. Returns the changes, and the view afterwards.
    ///
    /// # Errors
    /// An edit that can't be carried out, or after which the timeline couldn't be danced though it could before:
    /// nothing has changed then.
    pub fn edit(&self, edits: &[Edit], name: &str) -> Result<(Vec<Change>, Arc<Value>)> {
        let (before, mut changes) = self.project.timeline()?;
        let (after, parsed) = self.edited(before.as_deref(), edits)?;
        if before.as_deref() != Some(&after) {
            let step = |document: &crate::project::document::Document| match document.timeline == before {
                // compared under the project's lock: laying out took time, and another page may have edited
                true => Ok(vec![Change::Timeline { before: before.clone(), after: Some(after.clone()) }]),
                false => Err(Error::Conflict("the timeline was changed meanwhile; try again".into())),
            };
            changes.extend(self.project.step(name, step)?);
        }
        Ok((changes, self.view_of(Some(&after), parsed)?))
    }

    /// The text after edits, laid out where it can be.
    fn edited(&self, before: Option<&str>, edits: &[Edit]) -> Result<(String, Option<Laid>)> {
        let path = self.path();
        let mut file = match TimelineFile::parse(&path, before.unwrap_or_default()) {
            Ok(file) => Some(file),
            // a text that replaces it needs none of it
            Err(_) if matches!(edits.first(), Some(Edit::Text { .. })) => None,
            Err(e) => return Err(e),
        };
        let mut is_written = false;
        for edit in edits {
            match (edit, &mut file) {
                (Edit::Text { text }, _) => {
                    is_written = true;
                    // a text by hand may be wrong for a while, but not longer than a timeline
                    let most = kinelm_generate::timeline::MOST_BYTES;
                    if text.len() > most {
                        let (needs, limit) = (format!("{} bytes", text.len()), format!("{most} bytes"));
                        return Err(Error::limit("the timeline", needs, limit, "make it shorter"));
                    }
                    match TimelineFile::parse(&path, text) {
                        Ok(other) => file = Some(other),
                        // alone it may be any text; with edits after it, those need tables
                        Err(_) if edits.len() == 1 => return Ok((text.clone(), None)),
                        Err(e) => return Err(e),
                    }
                }
                (edit, Some(file)) => edit::apply(self, file, edit)?,
                (_, None) => return Err(Error::Conflict("the text of the timeline isn't whole".into())),
            }
        }
        let file = file.ok_or_else(|| Error::invalid_parameter("edits", "none", "at least one"))?;
        let text = file.text();
        if file.is_empty() {
            return Ok((text, None));
        }
        match self.lay_out(&text) {
            Ok(parsed) => Ok((text, Some(parsed))),
            // a fault from before doesn't block other edits, and a text by hand may be wrong for a while
            Err(_) if is_written || before.is_some_and(|before| !self.is_fine(before)) => Ok((text, None)),
            Err(e) => Err(e),
        }
    }

    /// The text after the reading of a clip has changed: it states the reading, and the clip's segments are fitted to
    /// it.
    /// `reread`: its lengths before and after, if both are known. `None` if the text doesn't have the clip.
    pub fn reread(&self, record: &ClipRecord, text: &str, reading: &Reading, reread: Option<Reread>) -> Option<String> {
        let mut file = TimelineFile::parse(&self.path(), text).ok()?;
        let (own, converted) = (self.project.path(&record.file), self.library.converted(&record.id));
        let is = |file: &Path, other: &Path| edit::is_same(&self.project.folder().join(file), other);
        let named: Vec<(String, PathBuf)> =
            file.clips().into_iter().filter(|(_, file)| is(file, &own) || is(file, &converted)).collect();
        let names: Vec<String> = named.iter().map(|(name, _)| name.clone()).collect();
        if let Some(reread) = reread.filter(|_| !names.is_empty()) {
            // a timeline that can't be laid out stays as it is, and its view says why
            let _ = refit::refit(self, &mut file, &names, reread);
        }
        for (name, path) in &named {
            match is(path, &own) {
                true => file.state(name, reading),
                false => file.state(name, &of_converted(reading.clone())),
            }
        }
        (!named.is_empty()).then(|| file.text())
    }

    /// Refuses a text that can't be danced, where the one before could.
    ///
    /// # Errors
    /// Those of [`Timelines::lay_out`].
    pub fn check_stays_fine(&self, before: &str, after: &str) -> Result<()> {
        match self.lay_out(after) {
            Err(e) if self.is_fine(before) => Err(e),
            _ => Ok(()),
        }
    }

    /// Whether a timeline can be danced, or has nothing in it yet.
    fn is_fine(&self, text: &str) -> bool {
        TimelineFile::parse(&self.path(), text).is_ok_and(|file| file.is_empty()) || self.lay_out(text).is_ok()
    }

    /// The library.
    pub fn library(&self) -> &Library {
        &self.library
    }

    /// The project.
    pub fn project(&self) -> &Project {
        &self.project
    }
}

#[cfg(test)]
mod tests;
