//! Run folders, each written by one process.

use super::metrics::METRICS;
use super::provenance::{self, PROVENANCE};
use crate::{Error, Result};
use kinelm_model::checkpoint::{Checkpoints, refuse_links};
use kinelm_model::lead_in::LEAD_INS;
use kinelm_model::run::{CONFIG, TOKENIZER};
use kinelm_store::owned::{self, Access};
use kinelm_store::part::{is_unfinished_file, sweep_locked};
use std::fs::{self, File, TryLockError};
use std::io::{ErrorKind, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The file that the writing process locks; it contains the process id.
const LOCK: &str = ".lock";
/// Bytes of that file, at most.
// a process id has ten digits; more is no lock of ours, and isn't read into a message
const MOST_LOCK: u64 = 1 << 10;
/// Attempts to lock, and the time between them: [`is_written`] holds the lock for an instant.
const TRIES: (u32, Duration) = (5, Duration::from_millis(40));
/// Files that are written before `config.toml`.
const EARLY: [&str; 9] =
    [LOCK, "samples", "checkpoints", "corpus.json", TOKENIZER, PROVENANCE, METRICS, "latest", "best"];

/// A run folder that is locked while this value lives. The system releases the lock if the process dies.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    _lock: Option<File>,
}

impl RunFolder {
    /// Makes the folder of a new run. One that was begun incompletely is begun again.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Taken`] for a folder that exists and isn't empty; another process that writes it; what the
    /// system refuses.
    pub fn create(run: &Path) -> Result<RunFolder> {
        check_free(run)?;
        fs::create_dir_all(run).map_err(Error::io(run))?;
        let folder = RunFolder::locked(run)?;
        // another process may have begun and ended a run since
        check_free(run)?;
        for folder in [run.join("samples"), run.join("checkpoints")] {
            fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        }
        // of a call that was killed, maybe with other weights: this run would go on from them
        Checkpoints::of(run).clear()?;
        provenance::note(run)?;
        Ok(folder)
    }

    /// The folder of a run to resume.
    ///
    /// # Errors
    /// A folder without a run; another process that writes it.
    pub fn open(run: &Path) -> Result<RunFolder> {
        // a link is there too, and refused with all others
        let is_there = fs::symlink_metadata(run.join(CONFIG)).is_ok_and(|found| !found.is_dir());
        if !is_there {
            let help = "start a run in a folder that is empty or not there";
            return Err(Error::file(run, "no config.toml", "a run folder", help));
        }
        let folder = RunFolder::locked(run)?;
        provenance::note(run)?;
        Ok(folder)
    }

    /// Locks any folder.
    ///
    /// # Errors
    /// Links in it; another process that writes it; what the system refuses.
    pub fn locked(run: &Path) -> Result<RunFolder> {
        refuse_links(run)?;
        let path = run.join(LOCK);
        let mut file = owned::open(run, LOCK, Access::Lock, MOST_LOCK)?;
        for _ in 0..TRIES.0 {
            match file.try_lock() {
                Ok(()) => {
                    let write = |f: &mut File| f.set_len(0).and_then(|()| write!(f, "{}", std::process::id()));
                    write(&mut file).map_err(Error::io(&path))?;
                    for folder in [run.to_owned(), run.join("samples")].iter().filter(|folder| folder.is_dir()) {
                        // only under the lock: what looks unfinished may be another process's work
                        sweep_locked(folder)?;
                    }
                    return Ok(RunFolder { path: run.to_owned(), _lock: Some(file) });
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(TRIES.1),
                // a file system without locks
                Err(TryLockError::Error(e)) if e.kind() == ErrorKind::Unsupported => {
                    return Ok(RunFolder { path: run.to_owned(), _lock: None });
                }
                Err(TryLockError::Error(e)) => return Err(Error::io(&path)(e)),
            }
        }
        let mut who = String::new();
        let _ = file.rewind().and_then(|()| file.read_to_string(&mut who));
        let who = if who.is_empty() { String::new() } else { format!(" (number {who})") };
        let why = format!("another process{who} is writing it; stop that one first");
        Err(Error::io(run)(std::io::Error::new(ErrorKind::ResourceBusy, why)))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Whether a process is writing this run.
pub(crate) fn is_written(run: &Path) -> bool {
    let lock = owned::open(run, LOCK, Access::Read, MOST_LOCK);
    lock.is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

/// Removes a run, whole or not at all.
///
/// # Errors
/// [`kinelm_store::Error::Taken`] for a file in it that no training writes; a run that is being written; what the system
/// refuses.
pub fn remove(run: &Path) -> Result<()> {
    let _locked = RunFolder::locked(run)?;
    let names = |folder: &Path| -> Result<Vec<String>> {
        let entries = fs::read_dir(folder).map_err(Error::io(folder))?;
        Ok(entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect())
    };
    // what training writes and nothing else: a file that somebody put there must not go with the run
    let own = |name: &str| {
        EARLY.contains(&name)
            || [CONFIG, LEAD_INS].contains(&name)
            || name.starts_with("events.out.tfevents.")
            || is_corpus(name)
    };
    let mut strange: Vec<PathBuf> = names(run)?.iter().filter(|name| !own(name)).map(|name| run.join(name)).collect();
    for folder in ["samples", "checkpoints"].map(|name| run.join(name)).into_iter().filter(|folder| folder.is_dir()) {
        let step = |name: &String| name.starts_with("step-") || name.starts_with(".step-");
        strange.extend(names(&folder)?.iter().filter(|name| !step(name)).map(|name| folder.join(name)));
    }
    if let Some(path) = strange.first() {
        return Err(Error::taken(path, "is in a run and no file of it; move it away, or give another folder"));
    }
    fs::remove_dir_all(run).map_err(Error::io(run))
}

/// Whether this is the manifest of a further corpus: `corpus-2.json` and so on.
fn is_corpus(name: &str) -> bool {
    name.strip_prefix("corpus-").is_some_and(|n| n.ends_with(".json"))
}

/// Refuses a folder in which no run can begin.
///
/// # Errors
/// [`kinelm_store::Error::Taken`] for such a folder.
pub(crate) fn check_free(run: &Path) -> Result<()> {
    let help = match run.join(CONFIG).is_file() {
        _ if is_free(run) => return Ok(()),
        true => "resume it, or give another run folder",
        false => "it holds something else than a run; give another run folder",
    };
    Err(Error::taken(run, format!("exists; {help}")))
}

/// Whether it doesn't exist, is empty, or holds only the beginning of a run whose process died.
fn is_free(run: &Path) -> bool {
    if fs::symlink_metadata(run).is_err() {
        return true;
    }
    let Ok(entries) = fs::read_dir(run) else { return false };
    let names: Vec<String> = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let early = |name: &String| EARLY.contains(&name.as_str()) || is_corpus(name) || is_unfinished_file(name);
    // without the lock the same names may be somebody's own folder
    names.is_empty() || (names.iter().any(|n| n == LOCK) && names.iter().all(early))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_model::checkpoint::{Best, Measured, State};

    #[test]
    fn one_process_at_a_time() {
        let dir = tempfile::tempdir().unwrap();
        let run = dir.path().join("run");
        assert!(RunFolder::open(&run).unwrap_err().to_string().contains("no config.toml"));
        let first = RunFolder::create(&run).unwrap();
        assert!(RunFolder::open(&run).unwrap_err().to_string().contains("no config.toml"));
        fs::write(run.join(CONFIG), "").unwrap();
        assert!(is_written(&run));
        let message = RunFolder::open(&run).unwrap_err().to_string();
        let expected = format!("another process (number {}) is writing it", std::process::id());
        assert!(message.contains(&expected), "{message}");
        drop(first);
        assert!(!is_written(&run));
        RunFolder::open(&run).unwrap();
    }

    /// Both find the folder free; the second gets the lock after the first has begun and ended its run.
    #[test]
    fn free_is_checked_again_under_the_lock() {
        let dir = tempfile::tempdir().unwrap();
        let run = dir.path().join("run");
        fs::create_dir(&run).unwrap();
        let first = RunFolder::locked(&run).unwrap();
        let second = std::thread::spawn({
            let run = run.clone();
            move || RunFolder::create(&run).map_err(|e| e.to_string())
        });
        std::thread::sleep(TRIES.1 * 3 / 2);
        fs::write(run.join(CONFIG), "the first's").unwrap();
        drop(first);
        let message = second.join().unwrap().unwrap_err();
        assert!(message.contains("run exists; resume it"), "{message}");
        assert_eq!(fs::read_to_string(run.join(CONFIG)).unwrap(), "the first's");
    }

    #[test]
    fn a_run_is_removed_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let run = dir.path().join("run");
        drop(RunFolder::create(&run).unwrap());
        for name in
            [CONFIG, LEAD_INS, TOKENIZER, "corpus-2.json", "best", "events.out.tfevents.1", "samples/step-00000001.bvh"]
        {
            fs::write(run.join(name), "").unwrap();
        }
        for name in ["notes.txt", "samples/mine.bvh", "checkpoints/notes"] {
            fs::write(run.join(name), "").unwrap();
            let message = remove(&run).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("move it away"), "{message}");
            assert!(run.join(CONFIG).exists());
            fs::remove_file(run.join(name)).unwrap();
        }
        remove(&run).unwrap();
        assert!(!run.exists());
    }

    #[test]
    fn an_incomplete_beginning_is_begun_again_and_nothing_else_is_touched() {
        let dir = tempfile::tempdir().unwrap();
        let run = dir.path().join("run");
        drop(RunFolder::create(&run).unwrap());
        fs::write(run.join(TOKENIZER), "{}").unwrap();
        fs::write(run.join("config.toml.77-0011223344556677.part"), "ver").unwrap();
        fs::write(run.join("notes.part"), "mine").unwrap();
        assert!(RunFolder::create(&run).is_err(), "notes are no beginning of a run");
        drop(RunFolder::locked(&run).unwrap());
        assert!(run.join("notes.part").exists());
        fs::remove_file(run.join("notes.part")).unwrap();
        fs::write(run.join("config.toml.77-0011223344556677.part"), "ver").unwrap();
        drop(RunFolder::create(&run).unwrap());
        assert!(!run.join("config.toml.77-0011223344556677.part").exists());
        // a branch that was killed after its first checkpoint
        let checkpoints = Checkpoints::of(&run);
        checkpoints.write(State::new(9, 0, 0, 1, Some(Best { step: 9, measured: Measured::Loss(1.0) })), &[]).unwrap();
        fs::write(run.join("checkpoints/notes"), "mine").unwrap();
        drop(RunFolder::create(&run).unwrap());
        assert_eq!(
            (checkpoints.steps().unwrap(), checkpoints.named("latest"), checkpoints.named("best")),
            (vec![], None, None)
        );
        assert!(run.join("checkpoints/notes").exists());
        fs::write(run.join("config.toml"), "").unwrap();
        assert!(RunFolder::create(&run).unwrap_err().to_string().contains("run exists; resume it"));
        // no run's
        let other = dir.path().join("other");
        fs::create_dir(&other).unwrap();
        fs::write(other.join(TOKENIZER), "{}").unwrap();
        assert!(RunFolder::create(&other).unwrap_err().to_string().contains("other exists; it holds something else"));
        assert!(RunFolder::open(&other).unwrap_err().to_string().contains("no config.toml"));
        assert_eq!(fs::read_dir(&other).unwrap().count(), 1, "a folder of somebody else's is left as it was");
        drop(RunFolder::create(&dir.path().join("a/b")).unwrap());
    }
}
