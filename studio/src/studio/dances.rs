//! The timeline, jobs and dances.

use super::Studio;
use crate::make::jobs::{Job, Running, State};
use crate::make::request::{Kind, Make};
use crate::make::work::guarded;
use crate::project::dances::{file_for, plain_name};
use crate::project::document::{Change, DanceRecord};
use crate::timeline::edit::Edit;
use crate::{Error, Result};
use kinelm_motion::convert::{ConvertOptions, TargetRig, convert};
use kinelm_motion::format::{self, Format, Importer};
use kinelm_motion::smpl;
use kinelm_store::{Kind as ErrorKind, input};
use serde_json::Value;
use std::path::Path;

impl Studio {
    /// The timeline as a page has it.
    ///
    /// # Errors
    /// Those of [`crate::timeline::Timelines::view`].
    pub fn timeline(&self) -> Result<Value> {
        let (view, changes) = self.timelines.view()?;
        self.publish(&changes);
        Ok(self.timeline_view(&view))
    }

    fn timeline_view(&self, view: &Value) -> Value {
        let mut view = view.clone();
        // the text is the file's, whatever it says
        for key in ["trouble", "notes"] {
            self.clean(&mut view[key], key == "notes");
        }
        view
    }

    /// Edits the timeline as one step. A dance that it begins to use is kept first.
    ///
    /// # Errors
    /// Those of [`crate::timeline::Timelines::edit`].
    pub fn edit(&self, edits: &[Edit]) -> Result<Value> {
        // a new timeline is begun by clearing the one before
        let is_begun = matches!(edits, [Edit::Text { .. }, Edit::UseClip { .. }]);
        let words = if is_begun { edits.last() } else { edits.first() }.map_or_else(String::new, Edit::words);
        let name = if edits.len() > 1 && !is_begun { format!("{words} and more") } else { words };
        for id in edits.iter().filter_map(Edit::names) {
            if self.project.dance(id).is_ok_and(|dance| dance.kept.is_none()) {
                self.keep(id, None)?;
            }
        }
        let (changes, view) = self.timelines.edit(edits, &name)?;
        self.publish(&changes);
        Ok(self.timeline_view(&view))
    }

    /// Puts a request into the row of jobs; returns the job's id.
    ///
    /// # Errors
    /// A request that can't be carried out, as far as that is known at once; a row that is full.
    pub fn make(&self, make: Make) -> Result<String> {
        self.add_job(make, false)
    }

    fn add_job(&self, mut make: Make, opening: bool) -> Result<String> {
        make.check()?;
        // once, so that a job which is begun again makes the same dance
        if make.seed.is_none() {
            let mut bytes = [0; 4];
            getrandom::fill(&mut bytes).map_err(|e| Error::missing("random numbers", e.to_string()))?;
            // short enough to be read out
            make.seed = Some(u32::from_le_bytes(bytes) % 1_000_000);
        }
        let id = self.project.new_id('j');
        let dances = (0..make.variations).map(|_| self.project.new_id('d')).collect();
        self.jobs.add(Job { id: id.clone(), make, dances, state: State::Waiting, begun: 0, text: None, opening })?;
        self.publish_job(&id);
        Ok(id)
    }

    fn publish_job(&self, id: &str) {
        if let Some(view) = self.jobs.view(id) {
            self.hub.send("job", &self.cleaned(view));
        }
    }

    pub(super) fn carry_out(&self, job: &Job, running: &Running) {
        self.publish_job(&job.id);
        let progress = || self.publish_job(&job.id);
        let made = |change: Change| {
            // no step of the user's, so none to undo
            let changes = self.project.plain(vec![change])?;
            self.publish(&changes);
            Ok(())
        };
        let ended = guarded(|| self.maker.carry_out(job, running, &progress, &made));
        let (state, text) = match ended {
            Ok(()) => (State::Done, None),
            // the studio ends, or the user has stopped it
            Err(e) if e.kind() == ErrorKind::Stopped => {
                let _ = self.jobs.put_back(&job.id);
                return;
            }
            Err(e) => (State::Failed, Some(e.to_string())),
        };
        // what can't be written is begun again
        let _ = self.jobs.end(&job.id, state, text);
        self.publish_job(&job.id);
        if job.opening {
            let _ = self.begin_opening();
        }
    }

    /// What a new project begins with: a dance, then four variations of its right arm.
    pub(super) fn begin_opening(&self) -> Result<()> {
        let (is_empty, first) = self.project.read(|document| {
            let is_empty = document.clips.is_empty() && document.dances.is_empty() && document.timeline.is_none();
            let first = document.dances.iter().find(|dance| dance.opening && dance.source.is_none());
            (is_empty, first.map(|dance| dance.id.clone()))
        });
        let begun = |kind: Kind| self.jobs.has_opening(kind);
        if self.opens && is_empty && self.jobs.is_empty() {
            self.add_job(Make { seed: Some(1), ..Make::free() }, true)?;
        } else if let Some(first) = first.filter(|_| begun(Kind::Free) && !begun(Kind::Edit)) {
            let free = "right_arm".parse().map_err(|e: String| Error::invalid_parameter("free", "right_arm", e))?;
            let make = Make { kind: Kind::Edit, clip: Some(first), free: vec![free], variations: 4, ..Make::free() };
            self.add_job(Make { seed: Some(2), ..make }, true)?;
        }
        Ok(())
    }

    /// Stops a job at once.
    ///
    /// # Errors
    /// Those of [`crate::make::jobs::Jobs::cancel`].
    pub fn cancel(&self, id: &str) -> Result<()> {
        self.jobs.cancel(id)?;
        self.publish_job(id);
        Ok(())
    }

    /// Keeps a dance: its file and sidecar are in the project's dances when this returns.
    ///
    /// # Errors
    /// An unknown dance; I/O errors.
    pub fn keep(&self, id: &str, name: Option<&str>) -> Result<Value> {
        let known = self.project.dance(id)?;
        if known.kept.is_none() {
            let name = name.map_or_else(|| known.name.clone(), plain_name);
            let changes = self.project.step(&format!("keep {name}"), |document| {
                // another page may have kept it meanwhile
                let before = document.dance(id).filter(|dance| dance.kept.is_none());
                let Some(before) = before else { return Ok(Vec::new()) };
                let kept = file_for(self.project.folder(), document, &name);
                // as its file, so that no two are called alike
                let name = kept.file_stem().map_or(name.clone(), |stem| stem.to_string_lossy().into_owned());
                let after = DanceRecord { name, kept: Some(kept), rejected: false, ..before.clone() };
                Ok(vec![Change::Dance { before: Some(Box::new(before.clone())), after: Some(Box::new(after)) }])
            })?;
            self.publish(&changes);
        }
        Ok(self.dance_view(&self.project.dance(id)?))
    }

    /// Turns a dance down, or takes that back.
    ///
    /// # Errors
    /// An unknown dance, one that is kept.
    pub fn reject(&self, id: &str, back: bool) -> Result<()> {
        let name = format!("{} {}", if back { "take back" } else { "reject" }, self.project.dance(id)?.name);
        let changes = self.project.step(&name, |document| {
            let before = document.dance(id).ok_or_else(|| Error::unknown("dance", id))?;
            if before.kept.is_some() {
                return Err(Error::Conflict("the dance is kept; take that step back first".into()));
            }
            let after = DanceRecord { rejected: !back, ..before.clone() };
            let change = Change::Dance { before: Some(Box::new(before.clone())), after: Some(Box::new(after)) };
            Ok(if before.rejected == back { vec![change] } else { Vec::new() })
        })?;
        self.publish(&changes);
        Ok(())
    }

    /// A dance as a file of some format, with its name; a GLB is the file of its character, if it has one. `importer`: the
    /// program that imports it with its defaults.
    ///
    /// # Errors
    /// An unknown dance, format or program; what the format can't hold, or the program doesn't read.
    pub fn export(&self, id: &str, format: &str, importer: Option<&str>) -> Result<(String, Vec<u8>)> {
        let kind = Format::of_name(Path::new(&format!("x.{format}"))).filter(|_| Format::WRITTEN.contains(&format));
        let Some(kind) = kind else {
            return Err(Error::invalid_parameter("format", plain_name(format), "bvh, glb, vrma, npz or json"));
        };
        let importer = match importer {
            None => None,
            Some("blender") => Some(Importer::Blender),
            Some(other) => return Err(Error::invalid_parameter("for", plain_name(other), "blender")),
        };
        let source = self.library.source(id)?;
        let stem = plain_name(&source.name);
        let bytes = input::peek_bytes(&source.path).map_err(Error::io(&source.path))?;
        if let Some(importer) = importer {
            let motion = format::parse(&source.path, &bytes, &source.read)?;
            return Ok((format!("{stem}-blender.{format}"), importer.to_bytes(&stem, &motion, kind)?));
        }
        let name = format!("{stem}.{format}");
        if matches!(kind, Format::Glb | Format::Vrma) && self.library.character_of(id).is_some() {
            let bytes = self.library.on_character(id, &name)?.bytes;
            return Ok((name, bytes));
        }
        // the file is a BVH already
        if kind == Format::Bvh {
            return Ok((name, bytes));
        }
        let motion = format::parse(&source.path, &bytes, &source.read)?;
        // AMASS has one rig
        let rig = (kind == Format::Npz).then(|| TargetRig::Smpl(smpl::neutral()));
        let motion = convert(motion, &ConvertOptions { rig, ..ConvertOptions::default() })?;
        let bytes = format::to_bytes(Path::new(&name), &motion)?;
        Ok((name, bytes))
    }
}
