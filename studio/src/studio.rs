//! A studio: all rooms together, and what a page is told of their changes.

use crate::error::without_folders;
use crate::events::Hub;
use crate::library::reader::Reader;
use crate::library::{Library, search, upload};
use crate::make::jobs::{Job, Jobs, State};
use crate::make::model::Model;
use crate::make::request::{Kind, Make};
use crate::make::work::{Maker, guarded};
use crate::project::dances::{file_for, plain_name};
use crate::project::document::{Change, ClipRecord, DanceRecord, Document, Music, Reading};
use crate::project::{CLIPS, DANCES, Project};
use crate::timeline::Timelines;
use crate::timeline::edit::Edit;
use crate::timeline::file::TimelineFile;
use crate::{Error, Result};
use kinelm_corpus::dataset::motion_files;
use kinelm_corpus::sidecar::read_options;
use kinelm_generate::provenance;
use kinelm_motion::convert::{ConvertOptions, TargetRig, convert};
use kinelm_motion::{format, smpl};
use kinelm_store::{Kind as ErrorKind, input};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// What a studio is opened with.
#[derive(Debug, Clone)]
pub struct Options {
    /// The project's folder.
    pub project: PathBuf,
    /// The model; `None`: the ready one.
    pub run: Option<PathBuf>,
    /// Files and folders for the library.
    pub files: Vec<PathBuf>,
    /// The corpus of real dances that the best are compared with.
    pub real: Option<PathBuf>,
    /// How files are read in a process of their own.
    pub reader: Reader,
    /// A new project begins empty, without dances that are made at once.
    pub empty: bool,
}

/// A studio.
#[derive(Debug)]
pub struct Studio {
    project: Arc<Project>,
    hub: Arc<Hub>,
    library: Arc<Library>,
    timelines: Arc<Timelines>,
    maker: Maker,
    jobs: Jobs,
    /// Folders that no answer names.
    roots: Vec<String>,
    /// Whether a new project begins with dances.
    opens: bool,
    /// Held while the timeline follows what becomes of a clip: a clip that is read otherwise just when the timeline begins
    /// with it would be stated as it was before.
    following: Mutex<()>,
}

/// Keys whose texts name no folders.
const TEXTS: [&str; 5] = ["text", "error", "note", "notes", "what"];

impl Studio {
    /// Opens a project, or makes it, with a model.
    ///
    /// # Errors
    /// Those of [`Project::open`] and [`Model::open`]; files that aren't there.
    pub fn open(options: &Options) -> Result<Arc<Studio>> {
        let model = Model::open(options.run.as_deref())?;
        let project = Arc::new(Project::open(&options.project)?);
        upload::sweep(&project);
        let jobs = Jobs::open(&project)?;
        let hub = Arc::new(Hub::default());
        let library = Arc::new(Library::new(project.clone(), options.reader.clone()));
        let timelines = Arc::new(Timelines::new(project.clone(), library.clone()));
        let real = options.real.clone();
        let mut roots = roots(&options.files, &[project.folder(), &model.run]);
        roots.sort_by_key(|root| std::cmp::Reverse(root.len()));
        let maker = Maker { model, real, library: library.clone(), timelines: timelines.clone(), hub: hub.clone() };
        let opens = !options.empty;
        let following = Mutex::default();
        let studio = Studio { project, hub, library, timelines, maker, jobs, roots, opens, following };
        if studio.project.is_new() {
            studio.take_in()?;
        }
        studio.add_files(&options.files)?;
        let clips =
            studio.project.read(|document| document.clips.iter().map(|clip| clip.id.clone()).collect::<Vec<_>>());
        studio.library.read_soon(clips);
        Ok(Arc::new(studio))
    }

    /// Starts the threads that read files and make dances.
    pub fn start(self: &Arc<Studio>) -> Vec<JoinHandle<()>> {
        let (reads, makes) = (self.clone(), self.clone());
        let reading = std::thread::spawn(move || reads.library.read_on(&|id| reads.clip_was_read(id)));
        let making = std::thread::spawn(move || {
            let _ = makes.begin_opening();
            while let Some((job, running)) = makes.jobs.next() {
                makes.carry_out(&job, &running);
            }
        });
        vec![reading, making]
    }

    /// Ends the threads.
    pub fn end(&self) {
        self.library.end();
        self.jobs.stop();
    }

    /// The events.
    pub fn hub(&self) -> &Arc<Hub> {
        &self.hub
    }

    /// The library.
    pub fn library(&self) -> &Library {
        &self.library
    }

    /// The project.
    pub fn project(&self) -> &Project {
        &self.project
    }

    /// A text without the folders of paths.
    pub fn plain(&self, text: &str) -> String {
        without_folders(text, &self.roots)
    }

    /// Texts of an answer without folders.
    fn cleaned(&self, mut value: Value) -> Value {
        self.clean(&mut value, false);
        value
    }

    fn clean(&self, value: &mut Value, is_text: bool) {
        match value {
            Value::String(text) if is_text => *text = self.plain(text),
            Value::Array(all) => all.iter_mut().for_each(|value| self.clean(value, is_text)),
            Value::Object(all) => {
                all.iter_mut().for_each(|(key, value)| self.clean(value, TEXTS.contains(&&**key)));
            }
            _ => {}
        }
    }

    /// All that a page begins with.
    pub fn state(&self) -> Value {
        let (clips, dances, music) = self.project.read(|document| {
            let Document { clips, dances, music, .. } = document.clone();
            (clips, dances, music)
        });
        let clips: Vec<Value> = clips.iter().map(|clip| self.clip_view(clip)).collect();
        let dances: Vec<Value> = dances.iter().map(|dance| self.dance_view(dance)).collect();
        let jobs: Vec<Value> = self.jobs.views().into_iter().map(|job| self.cleaned(job)).collect();
        let model = self.maker.model.view();
        let name = self.project.folder().file_name().unwrap_or_default().to_string_lossy().into_owned();
        json!({
            "version": env!("CARGO_PKG_VERSION"), "project": name, "groups": model["groups"], "model": model,
            "clips": clips, "dances": dances, "jobs": jobs, "music": music, "undo": self.undo_view(),
            "search_s": search::window_s(), "last_event": self.hub.last(),
        })
    }

    fn undo_view(&self) -> Value {
        let ((undo, redo), (undo_name, redo_name)) = self.project.history();
        json!({ "undo": undo, "redo": redo, "undo_name": undo_name, "redo_name": redo_name })
    }

    fn clip_view(&self, clip: &ClipRecord) -> Value {
        self.cleaned(self.library.view(clip))
    }

    fn dance_view(&self, dance: &DanceRecord) -> Value {
        let kept =
            dance.kept.as_ref().and_then(|file| file.file_name()).map(|name| name.to_string_lossy().into_owned());
        let mut view = json!({
            "id": dance.id, "name": dance.name, "kept": dance.kept.is_some(), "rejected": dance.rejected,
            "seconds": dance.frames as f64 / dance.fps, "frames": dance.frames, "fps": dance.fps, "job": dance.job,
            "variation": dance.variation, "seed": dance.seed, "note": dance.note, "generated_s": dance.generated_s,
            "given": dance.given, "free": dance.free, "source": dance.source, "opening": dance.opening,
            "made": dance.made_spans, "kept_name": kept,
        });
        if let Some(best) = &dance.best {
            view["score"] = json!(best.verdict.score);
            view["verdict"] = json!(best.verdict.to_string());
            view["rank"] = json!([best.better + 1, best.of]);
        }
        self.cleaned(view)
    }

    /// Tells all pages of changes, and has files read that are new or read otherwise.
    pub fn publish(&self, changes: &[Change]) {
        for change in changes {
            match change {
                Change::Clip { before, after: Some(clip) } => {
                    let is_same = |before: &ClipRecord| before.reading == clip.reading && before.file == clip.file;
                    if !before.as_deref().is_some_and(is_same) {
                        self.library.read_soon([clip.id.clone()]);
                    }
                    self.hub.send("clip", &self.clip_view(clip));
                }
                Change::Clip { before, after: None } => {
                    self.hub.send("clip_removed", &json!({ "id": before.as_ref().map(|clip| &clip.id) }));
                }
                Change::Dance { after: Some(dance), .. } => self.hub.send("dance", &self.dance_view(dance)),
                Change::Dance { before, after: None } => {
                    self.hub.send("dance_removed", &json!({ "id": before.as_ref().map(|dance| &dance.id) }));
                }
                Change::Timeline { .. } => self.hub.send("timeline", &json!({})),
                Change::Music { after, .. } => self.hub.send("music", &json!(after)),
            }
        }
        if !changes.is_empty() {
            self.hub.send("undo", &self.undo_view());
        }
    }

    /// A step of the user.
    fn step(&self, name: &str, changes: Vec<Change>) -> Result<()> {
        let changes = self.project.step(name, |_| Ok(changes))?;
        self.publish(&changes);
        Ok(())
    }

    /// The last step back.
    ///
    /// # Errors
    /// Those of [`Project::undo`].
    pub fn undo(&self) -> Result<Value> {
        self.publish(&self.project.undo()?);
        Ok(self.undo_view())
    }

    /// And on again.
    ///
    /// # Errors
    /// Those of [`Project::redo`].
    pub fn redo(&self) -> Result<Value> {
        self.publish(&self.project.redo()?);
        Ok(self.undo_view())
    }

    // ---- the library ----

    /// Files that were in the folder before it was a project.
    fn take_in(&self) -> Result<()> {
        let folder = self.project.folder();
        let clips = motion_files(&folder.join(CLIPS)).unwrap_or_default();
        let clips = clips.iter().filter_map(|path| path.strip_prefix(folder).ok());
        let clips: Vec<Change> = clips.map(|file| upload::added(&self.project, file.to_owned())).collect();
        let dances = motion_files(&folder.join(DANCES)).unwrap_or_default();
        let dances = dances.iter().filter_map(|path| self.kept_before(path));
        self.project.plain(clips.into_iter().chain(dances).collect())?;
        Ok(())
    }

    /// A dance that was kept in a project whose journal is gone.
    fn kept_before(&self, path: &Path) -> Option<Change> {
        let known = provenance::find(path).ok()??;
        let motion = format::read(path, &read_options(path).ok()??).ok()?;
        let record = DanceRecord {
            id: self.project.new_id('d'),
            name: path.file_stem()?.to_string_lossy().into_owned(),
            made: None,
            kept: Some(path.strip_prefix(self.project.folder()).ok()?.to_owned()),
            rejected: false,
            job: None,
            variation: known.variation,
            seed: known.request.seed,
            frames: motion.clip.frames(),
            fps: motion.clip.fps(),
            floor_m: known.read.floor.unwrap_or(0.0),
            note: String::new(),
            source: None,
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
    fn add_files(&self, files: &[PathBuf]) -> Result<()> {
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

    /// What follows when a clip was read: pages are told, and the first one begins the timeline.
    fn clip_was_read(&self, id: &str) {
        let Ok(record) = self.project.clip(id) else { return };
        self.hub.send("clip", &self.clip_view(&record));
        let _following = self.following.lock().unwrap_or_else(PoisonError::into_inner);
        let (text, is_motion) = (self.project.read(|d| d.timeline.clone()), self.library.source(id).is_ok());
        if text.is_none() && is_motion {
            // a rig that no timeline can have begins none
            let name = format!("begin with {}", record.name);
            if let Ok((changes, _)) = self.timelines.edit(&[Edit::UseClip { id: id.into() }], &name) {
                self.publish(&changes);
            }
        } else if text.is_some() {
            self.hub.send("timeline", &json!({}));
        }
    }

    /// Reads a clip otherwise. A timeline that has it states the same.
    ///
    /// # Errors
    /// Those of [`Library::restated`].
    pub fn restate(&self, id: &str, reading: &Reading) -> Result<()> {
        let _following = self.following.lock().unwrap_or_else(PoisonError::into_inner);
        let mut changes = self.library.restated(id, reading.clone())?;
        let record = self.project.clip(id)?;
        let (before, elsewhere) = self.project.timeline()?;
        self.publish(&elsewhere);
        if let Some(text) = &before
            && let Ok(mut file) = TimelineFile::parse(&self.timelines.path(), text)
        {
            let path = self.project.path(&record.file);
            let folder = self.project.folder();
            let named = file.clips().into_iter().find(|(_, file)| {
                folder.join(file).canonicalize().is_ok_and(|found| path.canonicalize().is_ok_and(|path| path == found))
            });
            if let Some((name, _)) = named {
                file.state(&name, reading);
                let after = Some(file.text());
                changes.extend((after != before).then_some(Change::Timeline { before, after }));
            }
        }
        self.step(&format!("read {} otherwise", record.name), changes)
    }

    /// Gives a clip or a dance another name.
    ///
    /// # Errors
    /// An unknown id.
    pub fn rename(&self, id: &str, name: &str) -> Result<()> {
        let name = plain_name(name);
        let change = match self.project.dance(id) {
            Ok(before) => {
                let after = DanceRecord { name: name.clone(), ..before.clone() };
                Change::Dance { before: Some(Box::new(before)), after: Some(Box::new(after)) }
            }
            Err(_) => {
                let before = self.project.clip(id)?;
                let after = ClipRecord { name: name.clone(), ..before.clone() };
                Change::Clip { before: Some(Box::new(before)), after: Some(Box::new(after)) }
            }
        };
        self.step(&format!("rename to {name}"), vec![change])
    }

    /// Takes a clip out of the library; its file stays. A dance is turned down.
    ///
    /// # Errors
    /// An unknown id.
    pub fn remove(&self, id: &str) -> Result<()> {
        if let Ok(before) = self.project.dance(id) {
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
                return Err(Error::invalid("`from_s`", music.from_s, "a time"));
            }
        }
        let before = self.project.read(|document| document.music.clone());
        let name = if music.is_some() { "set the music" } else { "no music" };
        self.step(name, vec![Change::Music { before, after: music }])
    }

    // ---- the timeline ----

    /// The timeline as a page has it.
    ///
    /// # Errors
    /// Those of [`Timelines::view`].
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
    /// Those of [`Timelines::edit`].
    pub fn edit(&self, edits: &[Edit]) -> Result<Value> {
        let words = edits.first().map_or_else(String::new, Edit::words);
        let name = if edits.len() > 1 { format!("{words} and more") } else { words };
        for id in edits.iter().filter_map(Edit::names) {
            if self.project.dance(id).is_ok_and(|dance| dance.kept.is_none()) {
                self.keep(id, None)?;
            }
        }
        let (changes, view) = self.timelines.edit(edits, &name)?;
        self.publish(&changes);
        Ok(self.timeline_view(&view))
    }

    // ---- dances ----

    /// Puts a request into the row of jobs; returns the job's id.
    ///
    /// # Errors
    /// A request that can't be carried out, as far as that is known at once; a row that is full.
    pub fn make(&self, make: Make) -> Result<String> {
        self.add_job(make, false)
    }

    fn add_job(&self, mut make: Make, opening: bool) -> Result<String> {
        make.check()?;
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

    fn carry_out(&self, job: &Job, running: &crate::make::jobs::Running) {
        self.publish_job(&job.id);
        let progress = || self.publish_job(&job.id);
        let made = |change: Change| {
            let changes = self.project.plain(vec![change])?;
            self.publish(&changes);
            Ok(())
        };
        let ended = guarded(|| self.maker.carry_out((job, running), &progress, &made));
        let (state, text) = match ended {
            Ok(()) => (State::Done, None),
            // the studio ends: the job is begun again
            Err(e) if e.kind() == ErrorKind::Stopped => return,
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
    fn begin_opening(&self) -> Result<()> {
        let (is_empty, first) = self.project.read(|document| {
            let is_empty = document.clips.is_empty() && document.dances.is_empty() && document.timeline.is_none();
            let first = document.dances.iter().find(|dance| dance.opening && dance.source.is_none());
            (is_empty, first.map(|dance| dance.id.clone()))
        });
        let begun = |kind: Kind| self.jobs.has_opening(kind);
        if self.opens && is_empty && self.jobs.is_empty() {
            self.add_job(Make { seed: Some(1), ..Make::free() }, true)?;
        } else if let Some(first) = first.filter(|_| begun(Kind::Free) && !begun(Kind::Edit)) {
            let free = "right_arm".parse().map_err(|e: String| Error::invalid("`free`", "right_arm", e))?;
            let make = Make { kind: Kind::Edit, clip: Some(first), free: vec![free], variations: 4, ..Make::free() };
            self.add_job(Make { seed: Some(2), ..make }, true)?;
        }
        Ok(())
    }

    /// Stops a job at once.
    ///
    /// # Errors
    /// Those of [`Jobs::cancel`].
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
        let before = self.project.dance(id)?;
        if before.kept.is_none() {
            let name = name.map_or_else(|| before.name.clone(), plain_name);
            let changes = self.project.step(&format!("keep {name}"), |document| {
                let kept = Some(file_for(self.project.folder(), document, &name));
                let after = DanceRecord { name: name.clone(), kept, rejected: false, ..before.clone() };
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
        let before = self.project.dance(id)?;
        if before.kept.is_some() {
            return Err(Error::Conflict("the dance is kept; take that step back first".into()));
        }
        if before.rejected != back {
            return Ok(());
        }
        let name = format!("{} {}", if back { "take back" } else { "reject" }, before.name);
        let after = DanceRecord { rejected: !back, ..before.clone() };
        self.step(&name, vec![Change::Dance { before: Some(Box::new(before)), after: Some(Box::new(after)) }])
    }

    /// A dance as a file of some format, with its name.
    ///
    /// # Errors
    /// An unknown dance or format; what the format can't hold.
    pub fn export(&self, id: &str, format: &str) -> Result<(String, Vec<u8>)> {
        if !["bvh", "glb", "npz", "json"].contains(&format) {
            return Err(Error::invalid("`format`", plain_name(format), "bvh, glb, npz or json"));
        }
        let source = self.library.source(id)?;
        let name = format!("{}.{format}", plain_name(&source.name));
        let bytes = input::peek_bytes(&source.path).map_err(Error::io(&source.path))?;
        if format == "bvh" {
            return Ok((name, bytes));
        }
        let motion = format::parse(&source.path, &bytes, &source.read)?;
        // AMASS has one rig
        let rig = (format == "npz").then(|| TargetRig::Smpl(smpl::neutral()));
        let motion = convert(motion, &ConvertOptions { rig, ..ConvertOptions::default() }, source.read.map.as_deref())?;
        let bytes = format::to_bytes(Path::new(&name), &motion)?;
        Ok((name, bytes))
    }
}

/// Folders that no answer names: those of the project, the model and the files of the call, and the user's own.
fn roots(files: &[PathBuf], folders: &[&Path]) -> Vec<String> {
    let above = |path: &Path| path.parent().map(Path::to_owned);
    let of_files = files.iter().filter_map(|file| file.canonicalize().ok()).filter_map(|file| above(&file));
    let own = folders.iter().flat_map(|folder| [Some(folder.to_path_buf()), above(folder)]).flatten();
    let home = std::env::var_os("HOME").map(PathBuf::from);
    let all = of_files.chain(own).chain(home).chain([std::env::temp_dir()]);
    all.filter_map(|path| path.to_str().map(str::to_owned)).collect()
}
