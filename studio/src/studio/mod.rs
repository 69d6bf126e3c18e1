//! A studio: all rooms together, and the events by which pages follow its changes.
//!
//! - `view`: the project as pages get it.
//! - `clips`, `dances`: what a user does.

mod clips;
mod dances;
mod view;

use crate::Result;
use crate::events::Hub;
use crate::library::Library;
use crate::library::reader::Reader;
use crate::make::jobs::Jobs;
use crate::make::model::Model;
use crate::make::work::Maker;
use crate::project::Project;
use crate::project::document::{Change, ClipRecord};
use crate::timeline::Timelines;
use kinelm_model::CheckpointChoice;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

/// What a studio is opened with.
#[derive(Debug, Clone)]
pub struct Options {
    /// The project's folder.
    pub project: PathBuf,
    /// The model; `None`: the ready one.
    pub run: Option<PathBuf>,
    /// Which of its checkpoints.
    pub checkpoint: CheckpointChoice,
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
    /// Held while the timeline follows what becomes of a clip: a clip that is read otherwise just when the timeline
    /// begins with it would be stated as it was before.
    following: Mutex<()>,
}

impl Studio {
    /// Opens a project, or makes it, with a model.
    ///
    /// # Errors
    /// Those of [`Project::open`] and [`Model::open`]; files that aren't there.
    pub fn open(options: &Options) -> Result<Arc<Studio>> {
        let model = Model::open(options.run.as_deref(), options.checkpoint)?;
        let project = Arc::new(Project::open(&options.project)?);
        let jobs = Jobs::open(&project)?;
        let hub = Arc::new(Hub::default());
        let library = Arc::new(Library::new(project.clone(), options.reader.clone()));
        let timelines = Arc::new(Timelines::new(project.clone(), library.clone()));
        let real = options.real.clone();
        let mut roots = roots(&options.files, &[project.folder(), &model.run]);
        // the longest first: a folder within another is left out whole
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
            // a studio that can't open with a dance works all the same
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

    /// Reports changes to all pages, and has files read that are new or read otherwise.
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
                Change::Timeline { before, after } => {
                    for clip in self.library.read_otherwise(before.as_deref(), after.as_deref()) {
                        self.library.read_soon([clip.id.clone()]);
                        self.hub.send("clip", &self.clip_view(&clip));
                    }
                    self.hub.send("timeline", &json!({}));
                }
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

    /// The next step again.
    ///
    /// # Errors
    /// Those of [`Project::redo`].
    pub fn redo(&self) -> Result<Value> {
        self.publish(&self.project.redo()?);
        Ok(self.undo_view())
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
