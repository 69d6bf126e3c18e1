//! The list of jobs: one line of JSON for each change of a job, so that a job which a process didn't end is begun
//! again.

use super::request::{Kind, Make};
use crate::project::Project;
use crate::project::document::is_id;
use crate::{Error, Result};
use kinelm_store::files;
use kinelm_store::owned::{self, Access};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// The file of the list.
const JOBS: &str = ".studio/jobs.jsonl";
/// Bytes of it, at most.
const MOST_BYTES: u64 = 64 << 20;
/// Ended jobs that are remembered.
const MOST_ENDED: usize = 100;
/// Jobs that may wait.
const MOST_WAITING: usize = 32;
/// How often a job is begun without an end: one that ends the process isn't begun for ever.
const MOST_BEGUN: usize = 5;

/// The state of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// Others are before it.
    Waiting,
    /// Its dances are sampled.
    Running,
    /// Its dances are there.
    Done,
    /// It failed.
    Failed,
    /// The user stopped it.
    Cancelled,
}

/// A job, as the list has it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// `j1`, `j2`, ..
    pub id: String,
    /// What it makes.
    pub make: Make,
    /// The ids of its dances, by variation.
    pub dances: Vec<String>,
    /// Its state.
    pub state: State,
    /// How often it was begun, but for times that the user ended the studio.
    #[serde(default)]
    pub begun: usize,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
    /// Whether a new project begins with it.
    #[serde(default)]
    pub opening: bool,
}

/// A job of this process.
#[derive(Debug)]
pub struct Running {
    /// Whether the user stopped it.
    pub cancelled: AtomicBool,
    /// Frames that were sampled, and those that will be.
    pub frames: [AtomicUsize; 2],
    /// The last event before those with its frames.
    pub since: AtomicU64,
}

impl Running {
    fn new() -> Arc<Running> {
        let (cancelled, since) = (AtomicBool::new(false), AtomicU64::new(0));
        Arc::new(Running { cancelled, frames: Default::default(), since })
    }
}

/// The jobs of a project.
#[derive(Debug)]
pub struct Jobs {
    inner: Mutex<Inner>,
    wake: Condvar,
    stop: AtomicBool,
}

#[derive(Debug)]
struct Inner {
    path: PathBuf,
    file: File,
    /// By number.
    jobs: BTreeMap<u64, (Job, Arc<Running>)>,
}

impl Jobs {
    /// The list of a project; jobs that a process didn't end wait again.
    ///
    /// # Errors
    /// I/O errors. Lines that are no jobs are left out: their dances can be requested again.
    pub fn open(project: &Project) -> Result<Jobs> {
        let (folder, path) = (project.folder(), project.folder().join(JOBS));
        let mut jobs = BTreeMap::new();
        for line in owned::bytes(folder, JOBS, MOST_BYTES)?.unwrap_or_default().split(|byte| *byte == b'\n') {
            let job = serde_json::from_slice::<Job>(line).ok();
            if let Some(job) = job.filter(|job| is_id(&job.id) && job.dances.iter().all(|id| is_id(id))) {
                // a later line of a job replaces the earlier ones
                jobs.insert(crate::project::document::number(&job.id), (job, Running::new()));
            }
        }
        for (job, _) in jobs.values_mut() {
            // the journal lacks them, and no new job or dance may get their numbers
            job.dances.iter().chain([&job.id]).for_each(|id| project.leave_out(id));
            if job.state == State::Running {
                job.state = State::Waiting;
            }
            if job.state == State::Waiting && job.begun >= MOST_BEGUN {
                job.state = State::Failed;
                job.text = Some("the studio ended again and again while it was made; ask for less at once".into());
            }
        }
        let is_ended = |job: &Job| job.state != State::Waiting;
        let ended: Vec<u64> = jobs.iter().filter(|(_, (job, _))| is_ended(job)).map(|(number, _)| *number).collect();
        ended.iter().take(ended.len().saturating_sub(MOST_ENDED)).for_each(|number| {
            jobs.remove(number);
        });
        // a line for each job: the list would grow for ever
        let lines = jobs.values().filter_map(|(job, _)| serde_json::to_string(job).ok()).map(|line| line + "\n");
        files::write_whole(&path, lines.collect::<String>().as_bytes())?;
        let file = owned::open(folder, JOBS, Access::Append, MOST_BYTES)?;
        Ok(Jobs { inner: Mutex::new(Inner { path, file, jobs }), wake: Condvar::new(), stop: AtomicBool::new(false) })
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a job after the others; it is on the disk when this returns.
    ///
    /// # Errors
    /// Too many that wait; I/O errors.
    pub fn add(&self, job: Job) -> Result<()> {
        let mut inner = self.inner();
        let waiting = inner.jobs.values().filter(|(job, _)| job.state == State::Waiting).count();
        if waiting >= MOST_WAITING {
            let help = "wait for them, or cancel some";
            return Err(Error::limit("the list of jobs", waiting + 1, format!("{MOST_WAITING} that wait"), help));
        }
        // on the disk first: what pages know of must outlive the process
        inner.write(&job)?;
        inner.jobs.insert(crate::project::document::number(&job.id), (job, Running::new()));
        drop(inner);
        self.wake.notify_all();
        Ok(())
    }

    /// Waits for a job and begins it; `None` where the studio ends.
    pub fn next(&self) -> Option<(Job, Arc<Running>)> {
        let mut inner = self.inner();
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return None;
            }
            let waiting = inner.jobs.iter().find(|(_, (job, _))| job.state == State::Waiting);
            if let Some(number) = waiting.map(|(number, _)| *number) {
                let (job, running) = inner.jobs.get_mut(&number)?;
                (job.state, job.begun) = (State::Running, job.begun + 1);
                let found = (job.clone(), running.clone());
                // where it can't be written, it is begun all the same: the count alone is lost
                let _ = inner.write(&found.0);
                return Some(found);
            }
            inner = self.wake.wait(inner).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Ends a job, unless the user has stopped it meanwhile.
    ///
    /// # Errors
    /// I/O errors.
    pub fn end(&self, id: &str, state: State, text: Option<String>) -> Result<()> {
        self.leave(id, |job| (job.state, job.text) = (state, text))
    }

    /// Puts a job back that the studio's own end has stopped, as if it had not been begun: an end that the user
    /// requested doesn't count against it.
    ///
    /// # Errors
    /// I/O errors.
    pub fn put_back(&self, id: &str) -> Result<()> {
        self.leave(id, |job| (job.state, job.begun) = (State::Waiting, job.begun.saturating_sub(1)))
    }

    /// Changes a job that is running; one that the user has stopped meanwhile stays as it is.
    fn leave(&self, id: &str, change: impl FnOnce(&mut Job)) -> Result<()> {
        let mut inner = self.inner();
        let Some((job, _)) = inner.jobs.get_mut(&crate::project::document::number(id)) else { return Ok(()) };
        if job.state != State::Running {
            return Ok(());
        }
        change(job);
        let job = job.clone();
        inner.write(&job)
    }

    /// Stops a job at once.
    ///
    /// # Errors
    /// An unknown job, one that has ended; I/O errors.
    pub fn cancel(&self, id: &str) -> Result<()> {
        let mut inner = self.inner();
        let found = inner.jobs.get_mut(&crate::project::document::number(id)).filter(|(job, _)| job.id == id);
        let (job, running) = found.ok_or_else(|| Error::unknown("job", id))?;
        if !matches!(job.state, State::Waiting | State::Running) {
            return Err(Error::Conflict("the job has ended already".into()));
        }
        running.cancelled.store(true, Ordering::Relaxed);
        job.state = State::Cancelled;
        let job = job.clone();
        inner.write(&job)
    }

    /// A job.
    pub fn find(&self, id: &str) -> Option<Job> {
        let inner = self.inner();
        let (job, _) = inner.jobs.get(&crate::project::document::number(id))?;
        (job.id == id).then(|| job.clone())
    }

    /// Whether one was ever there.
    pub fn is_empty(&self) -> bool {
        self.inner().jobs.is_empty()
    }

    /// Whether a new project begins, or began, with one of a kind.
    pub fn has_opening(&self, kind: Kind) -> bool {
        self.inner().jobs.values().any(|(job, _)| job.opening && job.make.kind == kind)
    }

    /// A job as a page has it.
    pub fn view(&self, id: &str) -> Option<Value> {
        let inner = self.inner();
        inner.jobs.get(&crate::project::document::number(id)).map(|(job, running)| view(job, running))
    }

    /// All jobs as a page has them.
    pub fn views(&self) -> Vec<Value> {
        self.inner().jobs.values().map(|(job, running)| view(job, running)).collect()
    }

    /// Ends the thread that makes them, and the job that it makes: it is begun again when the project is opened.
    pub fn stop(&self) {
        // before the lock: a maker that waits for it must not begin another job
        self.stop.store(true, Ordering::Relaxed);
        let inner = self.inner();
        inner.jobs.values().for_each(|(_, running)| running.cancelled.store(true, Ordering::Relaxed));
        drop(inner);
        self.wake.notify_all();
    }
}

impl Inner {
    fn write(&mut self, job: &Job) -> Result<()> {
        let mut line = serde_json::to_vec(job).map_err(Error::failed)?;
        line.push(b'\n');
        let whole = self.file.metadata().map_err(Error::io(&self.path))?.len();
        self.file.write_all(&line).and_then(|()| self.file.sync_data()).map_err(|e| {
            // the next line isn't to follow half of this one
            let _ = self.file.set_len(whole);
            Error::io(&self.path)(e)
        })
    }
}

fn view(job: &Job, running: &Running) -> Value {
    let [frames, of] = &running.frames;
    let since = Some(running.since.load(Ordering::Relaxed)).filter(|since| *since > 0);
    json!({
        "id": job.id, "kind": job.make.kind, "make": job.make, "dances": job.dances, "state": job.state, "text": job.text,
        "opening": job.opening, "started": crate::project::document::number(&job.id),
        "frames": frames.load(Ordering::Relaxed), "of": of.load(Ordering::Relaxed), "since": since,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn job(id: &str) -> Job {
        let dances = vec![format!("d{}", crate::project::document::number(id) + 1)];
        let (make, state) = (Make::free(), State::Waiting);
        Job { id: id.into(), make, dances, state, begun: 0, text: None, opening: false }
    }

    #[test]
    fn jobs_that_a_process_did_not_end_are_begun_again() {
        let dir = tempfile::tempdir().unwrap();
        let open = || {
            let project = crate::fixture::open_again(dir.path());
            let jobs = Jobs::open(&project).unwrap();
            (jobs, project.new_id('c'))
        };
        let (jobs, _) = open();
        jobs.add(job("j1")).unwrap();
        jobs.add(job("j3")).unwrap();
        assert_eq!(jobs.next().unwrap().0.id, "j1");
        drop(jobs);
        // killed in the middle of a line
        let path = dir.path().join(".studio/jobs.jsonl");
        let mut bytes = std::fs::read(&path).unwrap();
        bytes.extend(b"{\"id\": \"j");
        std::fs::write(&path, bytes).unwrap();
        let (jobs, next) = open();
        assert_eq!(next, "c5", "the numbers of jobs and their dances are taken");
        let (first, _) = jobs.next().unwrap();
        assert_eq!((first.id.as_str(), first.begun), ("j1", 2));
        jobs.end("j3", State::Done, None).unwrap();
        assert_eq!(jobs.find("j3").unwrap().state, State::Waiting, "it wasn't begun");
        drop(jobs);
        for begun in 3..=MOST_BEGUN {
            let (jobs, _) = open();
            assert_eq!(jobs.next().unwrap().0.begun, begun);
        }
        let (jobs, _) = open();
        let ended = jobs.find("j1").unwrap();
        assert!(ended.state == State::Failed && ended.text.unwrap().contains("again and again"));
        for _ in 0..=MOST_BEGUN {
            // ends that the user requested don't count
            let (jobs, _) = open();
            assert_eq!(jobs.next().map(|(job, _)| (job.id, job.begun)), Some(("j3".into(), 1)));
            jobs.put_back("j3").unwrap();
        }
        let (jobs, _) = open();
        assert_eq!(jobs.next().unwrap().0.id, "j3");
        jobs.end("j3", State::Done, None).unwrap();
        jobs.put_back("j3").unwrap();
        drop(jobs);
        let (jobs, _) = open();
        assert!(jobs.find("j3").unwrap().state == State::Done);
    }

    #[test]
    fn a_cancelled_job_stays_so_and_a_row_has_an_end() {
        let dir = tempfile::tempdir().unwrap();
        let project = Project::open(dir.path()).unwrap();
        let jobs = Jobs::open(&project).unwrap();
        jobs.add(job("j1")).unwrap();
        let (_, running) = jobs.next().unwrap();
        jobs.cancel("j1").unwrap();
        assert!(running.cancelled.load(Ordering::Relaxed));
        jobs.end("j1", State::Done, None).unwrap();
        assert_eq!((jobs.find("j1").unwrap().state, jobs.cancel("j1").unwrap_err().status()), (State::Cancelled, 409));
        assert_eq!(jobs.cancel("j9").unwrap_err().status(), 404);
        for n in 2..2 + MOST_WAITING {
            jobs.add(job(&format!("j{n}"))).unwrap();
        }
        assert_eq!(jobs.add(job("j99")).unwrap_err().status(), 413);
        jobs.stop();
        assert!(jobs.next().is_none());
    }
}
