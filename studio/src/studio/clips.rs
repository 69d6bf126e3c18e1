//! The library: files that come, are read otherwise, renamed and go.

use super::Studio;
use crate::library::doubts::{Info, Outcome, is_music};
use crate::library::{derive, maps, upload};
use crate::project::dances::plain_name;
use crate::project::document::{Change, ClipRecord, DanceRecord, Music, Reading};
use crate::project::{CLIPS, DANCES};
use crate::timeline::edit::Edit;
use crate::timeline::refit::{Length, Reread};
use crate::{Error, Result};
use kinelm_corpus::dataset::motion_files;
use kinelm_corpus::sidecar::read_options;
use kinelm_generate::provenance;
use kinelm_motion::rig::SkeletonMap;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::PoisonError;

/// Frames of a clip that begins a timeline unasked: laying one out reads all of its clip, which of an hour takes gigabytes.
const MOST_BEGUN: usize = 100_000;

impl Studio {
    /// Files that were in the folder before it was a project.
    pub(super) fn take_in(&self) -> Result<()> {
        let folder = self.project.folder();
        let motion = motion_files(&folder.join(CLIPS)).unwrap_or_default();
        let entries = std::fs::read_dir(folder.join(CLIPS)).into_iter().flatten().flatten();
        let mut music: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| is_music(path)).collect();
        // a folder lists its files in no order
        music.sort();
        let clips = motion.iter().chain(&music).filter_map(|path| path.strip_prefix(folder).ok());
        let clips: Vec<Change> = clips.map(|file| upload::added(&self.project, file.to_owned())).collect();
        let dances = motion_files(&folder.join(DANCES)).unwrap_or_default();
        let dances = dances.iter().filter_map(|path| self.kept_before(path));
        self.project.plain(clips.into_iter().chain(dances).collect())?;
        Ok(())
    }

    /// A dance that was kept in a project whose journal is gone.
    fn kept_before(&self, path: &Path) -> Option<Change> {
        let known = provenance::find(path).ok()??;
        // one whose bytes are others is no dance of ours any more
        read_options(path).ok()??;
        let Outcome::Ready(info) = self.library.looked_at(path).ok()? else { return None };
        let record = DanceRecord {
            id: self.project.new_id('d'),
            name: path.file_stem()?.to_string_lossy().into_owned(),
            made: None,
            kept: Some(path.strip_prefix(self.project.folder()).ok()?.to_owned()),
            rejected: false,
            job: None,
            variation: known.variation,
            seed: known.request.seed,
            frames: info.frames,
            fps: info.fps,
            floor_m: known.read.floor.unwrap_or(0.0),
            note: String::new(),
            source: None,
            rig: None,
            generated_s: known.generated_s,
            given: known.request.prompt.and_then(|prompt| prompt.joints).unwrap_or_default(),
            free: String::new(),
            made_spans: Vec::new(),
            best: known.best,
            opening: false,
        };
        Some(Change::Dance { before: None, after: Some(Box::new(record)) })
    }

    /// Takes files and folders of the call in, where the library doesn't have them.
    pub(super) fn add_files(&self, files: &[PathBuf]) -> Result<()> {
        let mut found: Vec<PathBuf> = Vec::new();
        for path in files {
            let path = path.canonicalize().map_err(Error::io(path))?;
            match path.is_dir() {
                true => found.extend(motion_files(&path)?),
                false => {
                    upload::name_of(&path.file_name().unwrap_or_default().to_string_lossy())?;
                    found.push(path);
                }
            }
        }
        let known = |path: &PathBuf| {
            self.project.read(|document| document.clips.iter().any(|clip| self.project.path(&clip.file) == *path))
        };
        let changes: Vec<Change> =
            found.into_iter().filter(|path| !known(path)).map(|path| upload::added(&self.project, path)).collect();
        let name = format!("add {}", kinelm_store::counted(changes.len(), "files"));
        self.project.step(&name, |_| Ok(changes))?;
        Ok(())
    }

    /// Takes an uploaded file in; `None` for the skeleton of clips beside it, which are read again.
    ///
    /// # Errors
    /// I/O errors.
    pub fn uploaded(&self, upload: upload::Upload) -> Result<Option<String>> {
        let Some(change) = upload.finish(&self.project)? else {
            let is_amc = |clip: &&ClipRecord| clip.file.extension().is_some_and(|e| e.eq_ignore_ascii_case("amc"));
            let ids =
                self.project.read(|d| d.clips.iter().filter(is_amc).map(|clip| clip.id.clone()).collect::<Vec<_>>());
            self.library.read_soon(ids);
            return Ok(None);
        };
        let Change::Clip { after: Some(clip), .. } = &change else { return Ok(None) };
        let (id, name) = (clip.id.clone(), format!("add {}", clip.name));
        self.step(&name, vec![change])?;
        Ok(Some(id))
    }

    /// Adds a changed clip to the library; its id.
    ///
    /// # Errors
    /// Those of [`crate::library::Library::changed`]; I/O errors.
    pub fn derive(&self, id: &str, change: derive::Change) -> Result<String> {
        let before = self.project.clip(id)?;
        let name = plain_name(&change.name(&before.name));
        let (derived, extension) = self.library.changed(id, change, &name)?;
        let mut upload = upload::Upload::begin(&self.project, &format!("{name}.{extension}"))?;
        upload.write(&derived.bytes)?;
        let Some(Change::Clip { after: Some(mut clip), .. }) = upload.finish(&self.project)? else {
            return Err(Error::failed("a clip that is none"));
        };
        // its frames are those that were read, at a rate that is known
        let Reading { up, unit, map, root, mirror_axis, .. } = self.library.reading(&before);
        let written = Reading { map, fps_source: Some(self.library.info(id)?.fps), ..Reading::default() };
        clip.reading = match extension {
            "glb" => Reading { take: Some(name), up, unit, root, mirror_axis, ..written },
            _ => written,
        };
        let id = clip.id.clone();
        self.step(&format!("make {}", clip.name), vec![Change::Clip { before: None, after: Some(clip) }])?;
        Ok(id)
    }

    /// What follows when a clip was read: pages get it, and the first one begins the timeline, unless it is back by a
    /// step that others follow.
    pub(super) fn clip_was_read(&self, id: &str) {
        let Ok(record) = self.project.clip(id) else { return };
        let others = self.library.judge_rates();
        for record in others.iter().filter(|other| *other != id).filter_map(|other| self.project.clip(other).ok()) {
            self.hub.send("clip", &self.clip_view(&record));
        }
        self.hub.send("clip", &self.clip_view(&record));
        let _following = self.following.lock().unwrap_or_else(PoisonError::into_inner);
        let text = self.project.read(|d| d.timeline.clone());
        let is_short = self.library.source(id).is_ok_and(|source| source.frames <= MOST_BEGUN);
        let ((_, redo), _) = self.project.history();
        if text.is_none() && is_short && redo == 0 {
            // a rig that no timeline can have begins none
            let name = format!("begin with {}", record.name);
            if let Ok((changes, _)) = self.timelines.edit(&[Edit::UseClip { id: id.into() }], &name) {
                self.publish(&changes);
            }
        } else if text.is_some() {
            self.hub.send("timeline", &json!({}));
        }
    }

    /// Reads a clip otherwise. A timeline that has it states the same, and its segments are extended and clipped with it.
    ///
    /// # Errors
    /// Those of [`crate::library::Library::restated`]; a reading by which a clip that could be read no longer can, or a
    /// timeline that could be danced.
    pub fn restate(&self, id: &str, reading: &Reading) -> Result<()> {
        self.library.wait_for(id, &|| true);
        let _following = self.following.lock().unwrap_or_else(PoisonError::into_inner);
        let mut changes = self.library.restated(id, reading.clone())?;
        let record = self.project.clip(id)?;
        let before = self.library.info(id).ok();
        let after = match self.library.tried(&record, reading)? {
            Outcome::Ready(info) => Some(*info),
            Outcome::Failed { text, .. } if before.is_some() => {
                return Err(Error::Conflict(format!("so it can't be read, and stays as it was: {text}")));
            }
            Outcome::Failed { .. } => None,
        };
        let was = self.library.reading(&record);
        // another root or take is other motion, to which a timeline's times don't apply
        let is_same_motion = (&was.root, &was.take) == (&reading.root, &reading.take);
        let length = |info: Info| Length { fps: info.fps, frames: info.frames };
        let lengths = before.map(length).zip(after.map(length));
        let reread = lengths.map(|(before, after)| Reread { before, after, is_same_motion });
        let (text, elsewhere) = self.project.timeline()?;
        self.publish(&elsewhere);
        let after = text.as_ref().and_then(|text| self.timelines.reread(&record, text, reading, reread));
        if let Some(after) = after.filter(|after| Some(after) != text.as_ref()) {
            let checked = text.as_ref().map_or(Ok(()), |before| self.timelines.check_stays_fine(before, &after));
            let wrong = |e| Error::Conflict(format!("so the timeline couldn't be danced, change it first: {e}"));
            checked.map_err(wrong)?;
            changes.push(Change::Timeline { before: text, after: Some(after) });
        }
        self.step(&format!("read {} otherwise", record.name), changes)
    }

    /// Takes a skeleton map in; its name.
    ///
    /// # Errors
    /// Those of [`maps::keep`].
    pub fn add_map(&self, called: &str, bytes: &[u8]) -> Result<String> {
        let name = maps::keep(&self.project, called, bytes)?;
        self.hub.send("maps", &self.maps());
        Ok(name)
    }

    /// The maps that a clip can be read with: those that are built in, and the project's.
    pub(super) fn maps(&self) -> Vec<String> {
        let built_in = SkeletonMap::names().map(str::to_owned);
        built_in.chain(maps::names(self.project.folder())).collect()
    }

    /// Gives a clip or a dance another name.
    ///
    /// # Errors
    /// An unknown id.
    pub fn rename(&self, id: &str, name: &str) -> Result<()> {
        let name = plain_name(name);
        let changes = self.project.step(&format!("rename to {name}"), |document| {
            let clip = document.clip(id).map(|before| {
                let after = ClipRecord { name: name.clone(), ..before.clone() };
                Change::Clip { before: Some(Box::new(before.clone())), after: Some(Box::new(after)) }
            });
            let dance = document.dance(id).map(|before| {
                let after = DanceRecord { name: name.clone(), ..before.clone() };
                Change::Dance { before: Some(Box::new(before.clone())), after: Some(Box::new(after)) }
            });
            Ok(vec![clip.or(dance).ok_or_else(|| Error::unknown("clip", id))?])
        })?;
        self.publish(&changes);
        Ok(())
    }

    /// Takes a clip out of the library; its file stays. A dance is turned down.
    ///
    /// # Errors
    /// An unknown id.
    pub fn remove(&self, id: &str) -> Result<()> {
        if let Ok(before) = self.project.dance(id) {
            // a dance that was found in the folder has no other file
            let kept = before.kept.clone().filter(|_| before.made.is_none());
            let (name, after) =
                (format!("remove {}", before.name), DanceRecord { kept, rejected: true, ..before.clone() });
            return self
                .step(&name, vec![Change::Dance { before: Some(Box::new(before)), after: Some(Box::new(after)) }]);
        }
        let before = self.project.clip(id)?;
        let music = self.project.read(|document| document.music.clone()).filter(|music| music.clip == id);
        let name = format!("remove {}", before.name);
        let music = music.map(|music| Change::Music { before: Some(music), after: None });
        let gone = Change::Clip { before: Some(Box::new(before)), after: None };
        self.step(&name, [Some(gone), music].into_iter().flatten().collect())
    }

    /// What is danced to on the stage.
    ///
    /// # Errors
    /// A clip that is no music.
    pub fn set_music(&self, music: Option<Music>) -> Result<()> {
        if let Some(music) = &music {
            self.library.sound(&music.clip)?;
            if !music.from_s.is_finite() {
                return Err(Error::invalid_parameter("from_s", music.from_s, "a time"));
            }
        }
        let before = self.project.read(|document| document.music.clone());
        let name = if music.is_some() { "set the music" } else { "no music" };
        self.step(name, vec![Change::Music { before, after: music }])
    }
}
