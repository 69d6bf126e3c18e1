//! Checkpoints: folders that are whole or not there.
//!
//! `checkpoints/step-00001000/` holds its files and, written last, `state.json` with their lengths and hashes. It is
//! written under a hidden name, synced and renamed. `latest` and `best` beside `checkpoints/` hold the name of a folder
//! and are written after it.

pub use crate::choice::{CheckpointChoice, Keep};
use crate::{Error, Result};
use kinelm_store::files::PendingFolder;
use kinelm_store::{FileRecord, files, hash, input, memory, owned, part};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The layout of `state.json` that this program writes and reads.
const SCHEMA: u32 = 1;
const STATE: &str = "state.json";

/// `state.json`: the state of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// The layout's version.
    pub schema: u32,
    /// Updates done.
    pub step: u64,
    /// Training windows taken so far: the next one's place in the order of the data. All random numbers are functions
    /// of the seed and of this.
    pub windows: u64,
    /// Tokens trained on so far, padding left out.
    pub tokens: u64,
    /// The run's seed.
    pub seed: u64,
    /// The best measurement on the validation clips so far.
    pub best: Option<Best>,
    /// What computed the products so far, where that was not f32 from the start: `amx`, `emulated` or `f32`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub products: Option<String>,
    /// The other files of the folder.
    pub files: BTreeMap<String, FileRecord>,
}

/// The best measurement on the validation clips.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Best {
    /// After how many updates.
    pub step: u64,
    /// What was measured.
    #[serde(flatten)]
    pub measured: Measured,
}

/// A measurement on the validation clips; less is better.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Measured {
    /// Bits per frame, of a GPT.
    BitsPerFrame(f64),
    /// The loss, in the network's own measure.
    Loss(f64),
}

impl Measured {
    /// Its number.
    pub fn value(self) -> f64 {
        match self {
            Measured::BitsPerFrame(value) | Measured::Loss(value) => value,
        }
    }
}

impl State {
    /// Counts a measurement after the present step; whether it is the best so far.
    pub fn measured(&mut self, measured: Measured) -> bool {
        // strictly less: of equal ones the earlier checkpoint stays the best
        let is_best = self.best.is_none_or(|best| measured.value() < best.measured.value());
        if is_best {
            self.best = Some(Best { step: self.step, measured });
        }
        is_best
    }

    /// A state without files.
    pub fn new(step: u64, windows: u64, tokens: u64, seed: u64, best: Option<Best>) -> State {
        State { schema: SCHEMA, step, windows, tokens, seed, best, products: None, files: BTreeMap::new() }
    }
}

/// The checkpoints of a run folder.
#[derive(Debug, Clone)]
pub struct Checkpoints {
    run: PathBuf,
}

/// A checkpoint that was read and whose hashes are right.
#[derive(Debug)]
pub struct Checkpoint {
    /// Its folder.
    pub dir: PathBuf,
    /// Its state.
    pub state: State,
    /// The bytes of the requested files.
    pub files: BTreeMap<String, Vec<u8>>,
}

impl Checkpoints {
    /// Those of the run folder `run`.
    pub fn of(run: &Path) -> Checkpoints {
        Checkpoints { run: run.to_owned() }
    }

    fn dir(&self) -> PathBuf {
        self.run.join("checkpoints")
    }

    /// The run folder.
    pub fn run(&self) -> &Path {
        &self.run
    }

    /// The folder of the checkpoint after `step` updates.
    pub fn path(&self, step: u64) -> PathBuf {
        self.dir().join(name(step))
    }

    /// Steps of the checkpoints there, ascending.
    ///
    /// # Errors
    /// A folder that can't be listed.
    pub fn steps(&self) -> Result<Vec<u64>> {
        let entries = match fs::read_dir(self.dir()) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
            other => other.map_err(Error::io(self.dir()))?,
        };
        let names = entries.filter_map(|e| Some(e.ok()?.file_name().to_string_lossy().into_owned()));
        let mut steps: Vec<u64> = names.filter_map(|n| step_of(&n)).collect();
        steps.sort_unstable();
        Ok(steps)
    }

    /// The step that `latest` or `best` names.
    pub fn named(&self, which: &str) -> Option<u64> {
        step_of(input::text(&self.run.join(which)).ok()?.trim())
    }

    /// The step of the best checkpoint. The last readable state has it too: where `best` is missing, damaged or
    /// names another, that state decides, and `note` reports it.
    fn best(&self, steps: &[u64], note: &mut dyn FnMut(String)) -> Option<u64> {
        let named = self.named("best");
        // a killed process may have written a checkpoint and not yet `best`: the newest readable state decides
        let last = steps.iter().rev().find_map(|&step| self.state(step).ok());
        let stored = last.as_ref().and_then(|state| state.best).map(|best| best.step);
        let path = self.run.join("best");
        match (last, stored.filter(|step| steps.contains(step))) {
            (Some(last), Some(stored)) if named != Some(stored) => {
                let found = match named {
                    Some(step) => name(step),
                    None if path.exists() => "no name of a checkpoint".into(),
                    None => "no file".into(),
                };
                let (path, expected, by) = (path.display(), name(stored), name(last.step));
                note(format!("{path}: found {found}, expected {expected}, as the state of {by} says; taking that"));
                Some(stored)
            }
            _ => {
                if named.is_none() && path.exists() {
                    note(format!("{}: found no name of a checkpoint; taking the latest", path.display()));
                }
                named
            }
        }
    }

    /// Writes a checkpoint, then `latest`, and `best` if it is the best.
    ///
    /// # Errors
    /// I/O errors; the run's earlier checkpoints are still there then.
    pub fn write(&self, mut state: State, contents: &[(&str, Vec<u8>)]) -> Result<PathBuf> {
        let (dir, path) = (self.dir(), self.path(state.step));
        fs::create_dir_all(&dir).map_err(Error::io(&dir))?;
        state.files = contents.iter().map(|(n, bytes)| (n.to_string(), FileRecord::of(bytes))).collect();
        // a resumed run with nothing left to do saves its state again: the same bytes stay as they are
        let whole = read_state(&path).is_ok_and(|s| s == state) && check(&path, &state, &[]).is_ok();
        if !whole {
            let work = PendingFolder::create(&path)?;
            let json = serde_json::to_vec_pretty(&state).expect("a state is plain data");
            contents.iter().try_for_each(|(name, bytes)| work.write(name, bytes))?;
            // last: a folder without a state is never whole
            work.write(STATE, &json)?;
            if path.exists() {
                // the same step again after a damaged one, or after going back
                fs::remove_dir_all(&path).map_err(Error::io(&path))?;
            }
            work.commit("")?;
        }
        // only now: a pointer never names a folder that isn't there
        files::write_whole(&self.run.join("latest"), format!("{}\n", name(state.step)).as_bytes())?;
        if state.best.is_some_and(|b| b.step == state.step) {
            files::write_whole(&self.run.join("best"), format!("{}\n", name(state.step)).as_bytes())?;
        }
        Ok(path)
    }

    /// Removes all checkpoints up to step `now`, which was just written, but those to `keep` and the best, and what a killed
    /// process left half written.
    ///
    /// # Errors
    /// I/O errors.
    pub fn prune(&self, keep: Keep, now: u64) -> Result<()> {
        // a later one was damaged when the run was resumed from one before it: it must not take the place of what is written
        // since
        let steps: Vec<u64> = self.steps()?.into_iter().filter(|step| *step <= now).collect();
        // by the state, not the file alone: a damaged `best` must not cost the best checkpoint
        let best = self.best(&steps, &mut |_| ());
        for step in steps.iter().rev().skip(keep.newest()).filter(|s| Some(**s) != best) {
            let path = self.path(*step);
            fs::remove_dir_all(&path).map_err(Error::io(&path))?;
        }
        self.sweep()
    }

    /// Removes all checkpoints, also half written ones, and `latest` and `best`.
    ///
    /// # Errors
    /// I/O errors.
    pub fn clear(&self) -> Result<()> {
        // first: a pointer never names a folder that isn't there
        for path in ["latest", "best"].map(|name| self.run.join(name)) {
            match fs::remove_file(&path) {
                Err(e) if e.kind() != ErrorKind::NotFound => return Err(Error::io(&path)(e)),
                _ => (),
            }
        }
        for path in self.steps()?.into_iter().map(|step| self.path(step)) {
            fs::remove_dir_all(&path).map_err(Error::io(&path))?;
        }
        self.sweep()
    }

    /// Removes what a killed process left half written.
    ///
    /// # Errors
    /// I/O errors.
    pub fn sweep(&self) -> Result<()> {
        for entry in fs::read_dir(self.dir()).into_iter().flatten().flatten() {
            let name = entry.file_name();
            // only what this program names so: other files in the folder are the user's
            let of = name.to_str().and_then(part::left_over).and_then(|(name, _)| step_of(name));
            if of.is_some() && entry.path().is_dir() {
                fs::remove_dir_all(entry.path()).map_err(Error::io(entry.path()))?;
            }
        }
        Ok(())
    }

    /// The state of a checkpoint; its files are not checked.
    ///
    /// # Errors
    /// No such checkpoint, or one without a state.
    pub fn state(&self, step: u64) -> Result<State> {
        read_state(&self.path(step))
    }

    /// Reads the files `wanted` of one checkpoint, and those of `also` that it has; all its hashes are checked first.
    ///
    /// # Errors
    /// A checkpoint that is missing, cut short or changed: which file, what was found and expected.
    pub fn read(&self, step: u64, wanted: &[&str], also: &[&str]) -> Result<Checkpoint> {
        let dir = self.path(step);
        let state = read_state(&dir)?;
        // a renamed folder would pass every hash and resume at another step
        if state.step != step {
            let found = format!("step {}", state.step);
            return Err(Error::file(dir.join(STATE), found, format!("step {step}"), ""));
        }
        let files = check(&dir, &state, &[wanted, also].concat())?;
        match wanted.iter().find(|w| !files.contains_key(**w)) {
            Some(missing) => Err(Error::file(&dir, format!("no {missing} in state.json"), "a whole checkpoint", "")),
            None => Ok(Checkpoint { dir, state, files }),
        }
    }

    /// The requested checkpoint, or the nearest earlier one that is whole; `note` reports those passed over.
    ///
    /// # Errors
    /// Links in the run; no checkpoint that is whole, with the reason of the last one tried; too little memory
    /// for the requested one.
    pub fn find(
        &self,
        which: CheckpointChoice,
        wanted: &[&str],
        also: &[&str],
        note: &mut dyn FnMut(String),
    ) -> Result<Checkpoint> {
        // before anything is opened, since a link may lead out of the run
        refuse_links(&self.run)?;
        let steps = self.steps()?;
        let latest = || self.named("latest").filter(|s| steps.contains(s)).or(steps.last().copied());
        let there = || steps.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
        let first = match which {
            CheckpointChoice::Auto => self.best(&steps, note).or_else(latest),
            CheckpointChoice::Best => match self.best(&steps, note) {
                None if !steps.is_empty() => {
                    let help = "none was measured on validation clips yet; the key eval_every says how often";
                    return Err(Error::file(
                        &self.run,
                        "no best checkpoint",
                        format!("latest, or one of {}", there()),
                        help,
                    ));
                }
                best => best,
            },
            CheckpointChoice::Latest => latest(),
            CheckpointChoice::Step(step) if !steps.contains(&step) => {
                let expected = format!("one of step {step}; there are {}", there());
                let help = "the run has gone on, and its key keep says how many stay beside the best; keep = \"all\" is every one";
                return Err(Error::file(&self.run, format!("no checkpoint of step {step}"), expected, help));
            }
            CheckpointChoice::Step(step) => Some(step),
        };
        let nothing = || Error::file(&self.run, "no checkpoint", "a run that reached its first one", "train it first");
        let first = first.ok_or_else(nothing)?;
        let mut reason = match self.read(first, wanted, also) {
            // a step by its number is what the user asked for: no other stands in for it
            Err(e) if !matches!(which, CheckpointChoice::Step(_)) && is_fault(&e) => e,
            other => return other,
        };
        // never a later one: none measured better than the best
        for &step in steps.iter().rev().filter(|s| **s < first) {
            note(format!("{reason}; going back to the checkpoint of step {step}"));
            match self.read(step, wanted, also) {
                Err(e) if is_fault(&e) => reason = e,
                other => return other,
            }
        }
        let damaged = steps.iter().filter(|s| **s <= first).map(|s| name(*s)).collect::<Vec<_>>().join(", ");
        let others = match steps.last() > Some(&first) {
            true => "the latest of the others is taken then",
            false => "and begin the run again, as there is no other",
        };
        let (dir, help) = (self.dir(), format!("put back a copy of the files, or remove {damaged}: {others}"));
        Err(Error::file(dir, format!("no whole checkpoint ({reason})"), format!("one up to step {first}"), help))
    }
}

/// Refuses a run that holds links: one of somebody else's could lead to any file of the user.
///
/// # Errors
/// [`kinelm_store::Error::File`] that names all of them.
pub fn refuse_links(run: &Path) -> Result<()> {
    let help = "replace each by a copy of what it leads to, also a linked `checkpoints`";
    Ok(owned::refuse_links(run, "a run", help)?)
}

fn name(step: u64) -> String {
    // eight digits, so that a listing by name is a listing by step
    format!("step-{step:08}")
}

fn step_of(name: &str) -> Option<u64> {
    name.strip_prefix("step-")?.parse().ok()
}

fn read_state(dir: &Path) -> Result<State> {
    let path = dir.join(STATE);
    let text = input::bytes(&path).map_err(Error::io(&path))?;
    let state: State = serde_json::from_slice(&text)
        .map_err(|e| Error::file(&path, format!("no state: {e}"), "the state of a checkpoint", ""))?;
    match state.schema {
        SCHEMA => Ok(state),
        other => Err(Error::file(&path, format!("schema {other}"), format!("schema {SCHEMA}"), "use its kinelm")),
    }
}

/// The bytes of the files `wanted`, after checking every file that the state lists.
fn check(dir: &Path, state: &State, wanted: &[&str]) -> Result<BTreeMap<String, Vec<u8>>> {
    // a file's bytes, its tensors, and the form that computes
    let bytes =
        state.files.iter().filter(|(name, _)| wanted.contains(&name.as_str())).map(|(_, r)| u128::from(r.bytes));
    let what = format!("{}: reading this model", dir.display());
    memory::check(3 * bytes.sum::<u128>(), &what, "give the program more, or take a smaller model")?;
    let mut kept = BTreeMap::new();
    for (name, record) in &state.files {
        let path = dir.join(name);
        let read = |e| Error::io(&path)(short_of_memory(e));
        // files that aren't requested, such as the optimizer's moments for generation, are hashed in pieces
        let bytes = wanted.contains(&name.as_str()).then(|| input::bytes(&path)).transpose().map_err(read)?;
        let found = match &bytes {
            Some(bytes) => FileRecord::of(bytes),
            None => FileRecord { bytes: fs::metadata(&path).map_err(read)?.len(), sha256: hash::of_file(&path)? },
        };
        if found != *record {
            let say = |r: &FileRecord| format!("{} bytes with SHA-256 {}", r.bytes, r.sha256);
            return Err(Error::file(&path, say(&found), say(record), ""));
        }
        kept.extend(bytes.map(|bytes| (name.clone(), bytes)));
    }
    Ok(kept)
}

/// An error of reading; where memory ran out it says so.
fn short_of_memory(e: std::io::Error) -> std::io::Error {
    match e.kind() {
        ErrorKind::OutOfMemory => std::io::Error::new(e.kind(), "memory ran out in reading it; the file may be whole"),
        _ => e,
    }
}

/// Whether an error means that a checkpoint is damaged: running out of memory doesn't.
fn is_fault(e: &Error) -> bool {
    match e {
        Error::Store(kinelm_store::Error::Io { source, .. }) => source.kind() != ErrorKind::OutOfMemory,
        Error::Store(kinelm_store::Error::Limit { .. }) => false,
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(step: u64, best: Option<u64>) -> State {
        State::new(step, 0, 0, 1, best.map(|step| Best { step, measured: Measured::BitsPerFrame(2.0) }))
    }

    #[test]
    fn the_last_and_the_best_stay_and_cut_ones_are_passed_over() {
        let dir = tempfile::tempdir().unwrap();
        let all = Checkpoints::of(dir.path());
        assert!(
            all.find(CheckpointChoice::Auto, &[], &[], &mut |_| ()).unwrap_err().to_string().contains("no checkpoint")
        );
        for (step, best) in [(10, Some(10)), (20, Some(10)), (30, Some(10)), (40, Some(10))] {
            all.write(state(step, best), &[("a", vec![step as u8; 9])]).unwrap();
            all.prune(Keep::Last(2), step).unwrap();
        }
        assert_eq!(all.steps().unwrap(), [10, 30, 40]);
        assert_eq!((all.named("latest"), all.named("best")), (Some(40), Some(10)));
        let find = |which| {
            let mut notes = Vec::new();
            let found = all.find(which, &["a"], &["b"], &mut |n| notes.push(n));
            (found.map(|c| (c.state.step, c.files["a"].clone())).map_err(|e| e.to_string()), notes)
        };
        assert_eq!(find(CheckpointChoice::Auto).0.unwrap(), (10, vec![10; 9]));
        assert_eq!(find(CheckpointChoice::Latest).0.unwrap(), (40, vec![40; 9]));
        fs::write(all.path(40).join("a"), [40; 8]).unwrap();
        let (found, notes) = find(CheckpointChoice::Latest);
        assert_eq!(found.unwrap().0, 30);
        assert!(
            notes[0].contains("8 bytes") && notes[0].contains("9 bytes") && notes[0].contains("step 30"),
            "{notes:?}"
        );
        assert!(find(CheckpointChoice::Step(40)).0.unwrap_err().contains("8 bytes"));
        assert!(
            find(CheckpointChoice::Step(41))
                .0
                .unwrap_err()
                .contains("no checkpoint of step 41, expected one of step 41; there are")
        );
        fs::remove_file(all.path(30).join(STATE)).unwrap();
        assert_eq!(find(CheckpointChoice::Latest).0.unwrap().0, 10);
        // written again, the damaged one is whole
        all.write(state(40, Some(10)), &[("a", vec![40; 9])]).unwrap();
        assert_eq!(find(CheckpointChoice::Latest).0.unwrap().0, 40);
    }

    #[test]
    fn the_best_is_the_one_of_the_state_where_its_name_is_gone_damaged_or_old() {
        let dir = tempfile::tempdir().unwrap();
        let all = Checkpoints::of(dir.path());
        for (step, best) in [(10, 10), (20, 20), (30, 20)] {
            all.write(state(step, Some(best)), &[("a", vec![step as u8; 9])]).unwrap();
        }
        let find = || {
            let mut notes = Vec::new();
            let found = all.find(CheckpointChoice::Auto, &["a"], &[], &mut |n| notes.push(n));
            (found.map(|c| c.state.step).map_err(|e| e.to_string()), notes.join("\n"))
        };
        let best = dir.path().join("best");
        assert_eq!(find(), (Ok(20), String::new()));
        for (text, found) in [("step-0", "step-00000000"), ("step-00000010", "step-00000010"), ("st", "no name")] {
            fs::write(&best, text).unwrap();
            let (step, note) = find();
            assert_eq!(step, Ok(20), "{text}");
            assert!(
                note.contains(&format!("best: found {found}")) && note.contains("expected step-00000020"),
                "{note}"
            );
        }
        fs::remove_file(&best).unwrap();
        let (step, note) = find();
        assert!(step == Ok(20) && note.contains("found no file"), "{note}");
        all.prune(Keep::Last(1), 30).unwrap();
        assert_eq!(all.steps().unwrap(), [20, 30]);
        // the message now says how to go back
        fs::write(all.path(20).join("a"), "").unwrap();
        let message = find().0.unwrap_err();
        assert!(
            message.contains("step-00000020/a: found 0 bytes") && message.contains("remove step-00000020: the latest")
        );
        fs::write(all.path(30).join("a"), "").unwrap();
        let message = all.find(CheckpointChoice::Latest, &[], &[], &mut |_| ()).unwrap_err().to_string();
        assert!(message.contains("put back a copy of the files, or remove step-00000020, step-00000030: and begin"));
        fs::remove_dir_all(all.path(20)).unwrap();
        assert!(find().0.unwrap_err().contains("remove step-00000030"));
    }

    #[test]
    fn a_damaged_one_ahead_does_not_take_the_place_of_what_is_written_since() {
        let dir = tempfile::tempdir().unwrap();
        let all = Checkpoints::of(dir.path());
        for step in [100, 200] {
            all.write(state(step, None), &[("a", vec![1; 9])]).unwrap();
        }
        fs::write(all.path(200).join("a"), [1; 8]).unwrap();
        // the run goes on from 100
        all.write(state(125, None), &[("a", vec![1; 9])]).unwrap();
        all.prune(Keep::Last(1), 125).unwrap();
        let found = all.find(CheckpointChoice::Latest, &["a"], &[], &mut |_| ()).unwrap();
        assert_eq!((found.state.step, all.steps().unwrap()), (125, vec![125, 200]));
    }

    #[test]
    fn files_that_nobody_wants_are_checked_and_not_kept() {
        let dir = tempfile::tempdir().unwrap();
        let all = Checkpoints::of(dir.path());
        all.write(state(1, None), &[("a", vec![1; 9]), ("b", vec![2; 9])]).unwrap();
        assert_eq!(all.read(1, &["a"], &[]).unwrap().files.keys().collect::<Vec<_>>(), ["a"]);
        fs::write(all.path(1).join("b"), [3; 9]).unwrap();
        let message = all.read(1, &["a"], &[]).unwrap_err().to_string();
        assert!(message.contains("/b: found 9 bytes with SHA-256"), "{message}");
    }

    #[test]
    fn too_little_memory_is_no_fault_of_a_checkpoint() {
        let of = |kind: ErrorKind| Error::io("c/a")(short_of_memory(kind.into()));
        let (none, gone) = (of(ErrorKind::OutOfMemory), of(ErrorKind::NotFound));
        assert!(!is_fault(&none) && none.to_string().contains("c/a: memory ran out"), "{none}");
        assert!(is_fault(&gone) && !gone.to_string().contains("memory"), "{gone}");
    }

    #[test]
    fn what_a_killed_process_left_is_swept() {
        let dir = tempfile::tempdir().unwrap();
        let all = Checkpoints::of(dir.path());
        all.write(state(1, None), &[]).unwrap();
        fs::create_dir(dir.path().join("checkpoints/.step-00000002.writing-77-00112233445566ff")).unwrap();
        assert_eq!(all.steps().unwrap(), [1]);
        all.prune(Keep::Last(1), 1).unwrap();
        assert_eq!(fs::read_dir(dir.path().join("checkpoints")).unwrap().count(), 1);
    }
}
