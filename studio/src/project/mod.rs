//! A project: a folder with the timeline, the clips and the kept dances, and a journal of their changes.
//!
//! ```text
//! timeline.toml   the timeline, a file like any other (docs/timelines.md)
//! clips/          files that were uploaded
//! converted/      clips of other formats as BVH, which timelines and edits need
//! dances/         kept dances, each with its sidecar
//! .studio/        journal.jsonl, jobs.jsonl, made/ (dances that aren't kept yet), cache/, open.html, lock
//! ```
//!
//! - [`document`]: the state of a project, and its changes.
//! - [`history`]: steps back and on.
//! - [`journal`]: the file that both are in.
//! - [`dances`]: the files of dances.
//!
//! One process has a project at a time. Files are written before the line of the journal that names them, so each file
//! of a line exists.

pub mod dances;
pub mod document;
pub mod history;
pub mod journal;

use crate::{Error, Result};
use document::{Change, ClipRecord, DanceRecord, Document};
use history::Step;
use journal::{Journal, Line, Replayed};
use kinelm_store::files;
use kinelm_store::owned::{self, Access};
use kinelm_store::part::{self, sweep_locked};
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The timeline's file.
pub const TIMELINE: &str = "timeline.toml";
/// Uploaded files.
pub const CLIPS: &str = "clips";
/// Clips of other formats as BVH.
pub const CONVERTED: &str = "converted";
/// Kept dances.
pub const DANCES: &str = "dances";
/// Skeleton maps of the user.
pub const MAPS: &str = "maps";
/// The studio's own files.
pub const OWN: &str = ".studio";
/// The changes of a project.
pub(crate) const JOURNAL: &str = ".studio/journal.jsonl";
/// The file that one studio locks.
const LOCK: &str = ".studio/lock";
/// Dances that aren't kept yet.
pub const MADE: &str = ".studio/made";
/// Files that can be computed again.
pub const CACHE: &str = ".studio/cache";
/// The most bytes of a timeline that are read, as the library has it.
const MOST_TIMELINE: u64 = 1 << 20;

/// An open project.
#[derive(Debug)]
pub struct Project {
    folder: PathBuf,
    /// Whether nothing was known of it before this start.
    is_new: bool,
    inner: Mutex<Inner>,
    /// Held as long as the project is open.
    _lock: File,
}

#[derive(Debug)]
struct Inner {
    state: Replayed,
    journal: Journal,
}

impl Project {
    /// Opens a project's folder, or makes it.
    ///
    /// # Errors
    /// A folder with links in it, or that another studio has open; a damaged journal; I/O errors.
    pub fn open(folder: &Path) -> Result<Project> {
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let help = "replace each by a copy of what it leads to; clips that are elsewhere come by `kinelm studio FILE`";
        // before anything is written in it: a link named `dances` would lead new files elsewhere
        owned::refuse_links(folder, "a project", help)?;
        for part in [CLIPS, DANCES, OWN, MADE, CACHE] {
            let part = folder.join(part);
            fs::create_dir_all(&part).map_err(Error::io(&part))?;
        }
        // absolute from here on, whatever the working folder becomes
        let folder = folder.canonicalize().map_err(Error::io(folder))?;
        let lock = lock(&folder)?;
        // under the lock nobody else writes here
        for part in ["", CLIPS, CONVERTED, DANCES, MAPS, OWN, MADE, CACHE].map(|part| folder.join(part)) {
            if part.is_dir() {
                sweep_locked(&part)?;
            }
        }
        let (journal, state) = Journal::open(&folder)?;
        let is_new = journal.is_new();
        let project = Project { folder, is_new, inner: Mutex::new(Inner { state, journal }), _lock: lock };
        project.reconcile()?;
        Ok(project)
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Its folder, absolute.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Whether nothing was known of it before this start: it was made by it, or its journal is lost.
    pub fn is_new(&self) -> bool {
        self.is_new
    }

    /// The absolute path of a file that a record names.
    pub fn path(&self, file: &Path) -> PathBuf {
        self.folder.join(file)
    }

    /// Looks at the state.
    pub fn read<T>(&self, look: impl FnOnce(&Document) -> T) -> T {
        look(&self.inner().state.document)
    }

    /// The clip with this id.
    ///
    /// # Errors
    /// An id that no clip has.
    pub fn clip(&self, id: &str) -> Result<ClipRecord> {
        self.read(|document| document.clip(id).cloned()).ok_or_else(|| Error::unknown("clip", id))
    }

    /// The dance with this id.
    ///
    /// # Errors
    /// An id that no dance has.
    pub fn dance(&self, id: &str) -> Result<DanceRecord> {
        self.read(|document| document.dance(id).cloned()).ok_or_else(|| Error::unknown("dance", id))
    }

    /// A new id: `c3` for the kind `c`.
    pub fn new_id(&self, kind: char) -> String {
        let mut inner = self.inner();
        let id = format!("{kind}{}", inner.state.next);
        // not in the journal until a record has it: an id that was never used may be given again after a restart
        inner.state.next += 1;
        id
    }

    /// Leaves out the numbers up to that of an id which isn't in the journal.
    pub fn leave_out(&self, id: &str) {
        let mut inner = self.inner();
        inner.state.next = inner.state.next.max(document::number(id) + 1);
    }

    /// Steps back and on that there are, and their names.
    pub fn history(&self) -> ((usize, usize), (Option<String>, Option<String>)) {
        let inner = self.inner();
        let (undo, redo) = inner.state.history.names();
        (inner.state.history.counts(), (undo.map(str::to_owned), redo.map(str::to_owned)))
    }

    /// Carries out a step of the user, the changes that `of` makes of the state. Returns them; none if nothing changes.
    ///
    /// # Errors
    /// Those of `of`; I/O errors. Nothing has changed then.
    pub fn step(&self, name: &str, of: impl FnOnce(&Document) -> Result<Vec<Change>>) -> Result<Vec<Change>> {
        let mut inner = self.inner();
        let changes = of(&inner.state.document)?;
        if changes.is_empty() {
            return Ok(changes);
        }
        let line = Line::Step(Step { name: name.into(), changes: changes.clone() });
        self.carry_out(&mut inner, line, &changes)?;
        Ok(changes)
    }

    /// As [`Project::step`], for changes that can't be undone.
    ///
    /// # Errors
    /// Those of [`Project::step`].
    pub fn plain(&self, changes: Vec<Change>) -> Result<Vec<Change>> {
        if !changes.is_empty() {
            self.carry_out(&mut self.inner(), Line::Plain(changes.clone()), &changes)?;
        }
        Ok(changes)
    }

    /// Undoes the last step.
    ///
    /// # Errors
    /// Nothing to undo; I/O errors.
    pub fn undo(&self) -> Result<Vec<Change>> {
        let mut inner = self.inner();
        // on a copy: if the files or the journal fail, nothing was undone
        let changes = inner.state.history.clone().undo();
        let changes = changes.ok_or_else(|| Error::Conflict("there is nothing to undo".into()))?;
        self.carry_out(&mut inner, Line::Undo, &changes)?;
        Ok(changes)
    }

    /// Carries out the last undone step again.
    ///
    /// # Errors
    /// Nothing to redo; I/O errors.
    pub fn redo(&self) -> Result<Vec<Change>> {
        let mut inner = self.inner();
        let changes = inner.state.history.clone().redo();
        let changes = changes.ok_or_else(|| Error::Conflict("there is nothing to redo".into()))?;
        self.carry_out(&mut inner, Line::Redo, &changes)?;
        Ok(changes)
    }

    /// Files first, then the journal: each file of a line exists.
    fn carry_out(&self, inner: &mut Inner, line: Line, changes: &[Change]) -> Result<()> {
        for (n, change) in changes.iter().enumerate() {
            if let Err(e) = self.settle(change) {
                self.take_back(&changes[..n]);
                return Err(e);
            }
        }
        if let Err(e) = inner.journal.append(&line) {
            self.take_back(changes);
            return Err(e);
        }
        inner.state.apply(&line);
        if inner.journal.has_grown() {
            // the line is on the disk already; a longer file does no harm
            let _ = inner.journal.rewrite(&inner.state);
        }
        Ok(())
    }

    /// Makes the files as they were before changes that couldn't be carried out.
    fn take_back(&self, changes: &[Change]) {
        for change in changes.iter().rev() {
            let _ = self.settle(&change.inverse());
        }
    }

    /// Makes the files as a change has them.
    fn settle(&self, change: &Change) -> Result<()> {
        match change {
            Change::Timeline { after, .. } => {
                let path = self.folder.join(TIMELINE);
                match after {
                    Some(text) => Ok(files::write_whole(&path, text.as_bytes())?),
                    None => remove(&path),
                }
            }
            Change::Dance { before, after } => dances::settle(&self.folder, before.as_deref(), after.as_deref()),
            Change::Clip { .. } | Change::Music { .. } => Ok(()),
        }
    }

    /// The timeline as its file has it. What another program wrote there becomes a step of its own.
    ///
    /// # Errors
    /// A file that can't be read, is no text or too large.
    pub fn timeline(&self) -> Result<(Option<String>, Vec<Change>)> {
        let mut inner = self.inner();
        let found = self.timeline_file()?;
        let known = inner.state.document.timeline.clone();
        if found == known {
            return Ok((found, Vec::new()));
        }
        let changes = vec![Change::Timeline { before: known, after: found.clone() }];
        let line = Line::Step(Step { name: "edit the timeline elsewhere".into(), changes: changes.clone() });
        inner.journal.append(&line)?;
        inner.state.apply(&line);
        Ok((found, changes))
    }

    fn timeline_file(&self) -> Result<Option<String>> {
        let Some(bytes) = owned::bytes(&self.folder, TIMELINE, MOST_TIMELINE)? else { return Ok(None) };
        let path = self.folder.join(TIMELINE);
        let wrong = |_| Error::file(&path, "bytes that are no UTF-8", "a text", "save it as UTF-8, or move it away");
        String::from_utf8(bytes).map(Some).map_err(wrong)
    }

    /// Adapts the state to the existing files: a process may have ended between writing files and journal, and the user
    /// may have moved files.
    fn reconcile(&self) -> Result<()> {
        if self.is_new {
            let found = self.timeline_file()?;
            if found.is_some() {
                self.plain(vec![Change::Timeline { before: None, after: found }])?;
            }
            return Ok(());
        }
        // an edit while no studio ran becomes a step, which can be undone
        self.timeline()?;
        let all = self.read(|document| document.dances.clone());
        let changes = all.iter().filter_map(|dance| dances::missing(&self.folder, dance)).collect::<Vec<_>>();
        self.plain(changes)?;
        let inner = self.inner();
        dances::sweep(&self.folder, &inner.state.document, &inner.state.history);
        Ok(())
    }
}

/// Keeps other studios from a project.
fn lock(folder: &Path) -> Result<File> {
    let file = owned::open(folder, LOCK, Access::Lock, MOST_TIMELINE)?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            Err(Error::taken(folder, "is open in another studio; close that one, or name another project"))
        }
        // some file systems have no locks: two studios there are the user's risk
        _ => Ok(file),
    }
}

/// Removes a file that may not be there.
fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io(path)(e)),
        _ => Ok(part::sync_folder(part::folder_of(path))?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::open_again;

    fn text(project: &Project) -> Option<String> {
        project.read(|document| document.timeline.clone())
    }

    fn edit(project: &Project, to: &str) {
        let change = |document: &Document| {
            Ok(vec![Change::Timeline { before: document.timeline.clone(), after: Some(to.into()) }])
        };
        project.step("edit", change).unwrap();
    }

    #[test]
    fn a_timeline_survives_byte_for_byte_and_steps_a_restart() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("p");
        fs::create_dir(&folder).unwrap();
        let own = "# mine\r\n  rig   = 'a'\n\n";
        fs::write(folder.join(TIMELINE), own).unwrap();
        let project = Project::open(&folder).unwrap();
        assert_eq!((text(&project).as_deref(), project.history().0), (Some(own), (0, 0)));
        assert!(Project::open(&folder).unwrap_err().to_string().contains("another studio"));
        edit(&project, "one");
        edit(&project, "two");
        project.undo().unwrap();
        drop(project);
        let project = open_again(&folder);
        assert_eq!(fs::read_to_string(folder.join(TIMELINE)).unwrap(), "one");
        assert_eq!(project.history(), ((1, 1), (Some("edit".into()), Some("edit".into()))));
        project.undo().unwrap();
        assert_eq!(fs::read_to_string(folder.join(TIMELINE)).unwrap(), own);
        assert_eq!(project.undo().unwrap_err().status(), 409);
        project.redo().unwrap();
        project.redo().unwrap();
        assert!(project.redo().is_err() && text(&project).as_deref() == Some("two"));
    }

    #[test]
    fn what_another_program_wrote_is_a_step() {
        let dir = tempfile::tempdir().unwrap();
        let project = Project::open(dir.path()).unwrap();
        edit(&project, "one");
        fs::write(dir.path().join(TIMELINE), "theirs").unwrap();
        let (found, changes) = project.timeline().unwrap();
        assert_eq!((found.as_deref(), changes.len(), project.history().0), (Some("theirs"), 1, (2, 0)));
        drop(project);
        fs::write(dir.path().join(TIMELINE), "while it was closed").unwrap();
        let project = open_again(dir.path());
        assert_eq!(project.history().0, (3, 0));
        project.undo().unwrap();
        assert_eq!(text(&project).as_deref(), Some("theirs"));
        fs::write(dir.path().join(TIMELINE), [0xff, 0xfe]).unwrap();
        assert!(project.timeline().unwrap_err().to_string().contains("save it as UTF-8"));
    }

    #[test]
    fn a_step_that_fails_changes_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let project = Project::open(dir.path()).unwrap();
        edit(&project, "one");
        // a folder has the name of the file
        let path = dir.path().join(TIMELINE);
        fs::remove_file(&path).unwrap();
        fs::create_dir_all(path.join("in")).unwrap();
        let change = |_: &Document| Ok(vec![Change::Timeline { before: None, after: Some("two".into()) }]);
        assert!(project.step("edit", change).is_err());
        assert_eq!((text(&project).as_deref(), project.history().0), (Some("one"), (1, 0)));
    }

    #[test]
    fn ids_are_new_after_a_restart() {
        let dir = tempfile::tempdir().unwrap();
        let project = Project::open(dir.path()).unwrap();
        assert_eq!([project.new_id('c'), project.new_id('d')], ["c1", "d2"]);
        let clip = ClipRecord { id: "c7".into(), name: "a".into(), file: "a".into(), reading: Default::default() };
        project.plain(vec![Change::Clip { before: None, after: Some(Box::new(clip)) }]).unwrap();
        assert_eq!(project.new_id('j'), "j8");
        drop(project);
        let project = open_again(dir.path());
        assert_eq!(project.new_id('c'), "c8");
        project.leave_out("j30");
        assert_eq!((project.new_id('c').as_str(), project.clip("c9").is_err()), ("c31", true));
    }
}
