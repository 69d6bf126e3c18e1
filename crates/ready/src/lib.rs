//! The model that kinelm dances with where none is given, as a run folder; [`CARD`] says what it is.
//!
//! The weights are part of the program, packed ([`packed`]). [`run`] writes them once to the user's cache folder, and whatever
//! reads runs reads this one.

pub mod packed;

use etcetera::base_strategy::{BaseStrategy, choose_native_strategy};
use kinelm_model::checkpoint::{Checkpoints, State};
use kinelm_model::lead_in::LEAD_INS;
use kinelm_model::run::{CONFIG, HELD_OUT, LIMITS, TOKENIZER, WEIGHTS};
use kinelm_model::{CheckpointChoice, Error, Result, load_run, weights};
use kinelm_store::files::{self, PendingFolder};
use kinelm_store::{hash, input, owned, part};
use std::path::{Path, PathBuf};

/// What the model was trained on and for, how good it is, and what it can't do.
pub const CARD: &str = include_str!("../CARD.md");
/// Where its name is expected beside paths of runs.
pub const NAME: &str = "ready";

/// What [`pack`] writes beside copies of the run's files.
const PACKED_NAME: &str = "weights.bin";
const STATE_NAME: &str = "state.json";
const VERSION_NAME: &str = "version.txt";
const PACKED: &[u8] = include_bytes!("../data/weights.bin");
const STATE: &str = include_str!("../data/state.json");
/// The other files of the run, as they are.
const FILES: [(&str, &str); 5] = [
    (CONFIG, include_str!("../data/config.toml")),
    (TOKENIZER, include_str!("../data/tokenizer.json")),
    (LEAD_INS, include_str!("../data/lead_ins.json")),
    (LIMITS, include_str!("../data/limits.json")),
    (HELD_OUT, include_str!("../data/held_out.json")),
];
/// The version of all files, as [`pack`] wrote it.
const VERSION: &str = include_str!("../data/version.txt");

/// The ready model's run folder, in the cache folder of the user; written, if it isn't there, and written again where it is
/// damaged.
///
/// # Errors
/// No cache folder is known, or can't be written; a damaged program.
pub fn run() -> Result<PathBuf> {
    run_in(&cache_folder()?)
}

fn run_in(cache: &Path) -> Result<PathBuf> {
    let place = cache.join(format!("ready-{}", VERSION.trim()));
    // parts of a call that was killed while it wrote
    part::sweep(&[&place]);
    if !is_whole(&place) {
        prepare(&place)?.commit_instead()?;
    }
    Ok(place)
}

/// Whether a folder is the run, by a quick look. The weights are hashed where they were changed after they had
/// been written; whoever loads them hashes them in any case.
fn is_whole(place: &Path) -> bool {
    let holds = |(name, bytes): (&str, &[u8])| input::peek_bytes(&place.join(name)).is_ok_and(|found| found == bytes);
    let checkpoints = Checkpoints::of(place);
    let weights = || {
        let state = checkpoints.steps().ok().and_then(|steps| checkpoints.state(*steps.last()?).ok())?;
        let (record, dir) = (state.files.get(WEIGHTS)?.clone(), checkpoints.path(state.step));
        let (found, written) = (dir.join(WEIGHTS).metadata().ok()?, dir.join(STATE_NAME).metadata().ok()?);
        // the state is written last: newer weights were changed since
        let is_as_written = found.modified().ok()? <= written.modified().ok()?;
        let is_it = found.len() == record.bytes
            && (is_as_written || hash::of_file(&dir.join(WEIGHTS)).is_ok_and(|hash| hash == record.sha256));
        Some(
            is_it
                && checkpoints.named("latest") == Some(state.step)
                // the packed state names no files, for their hashes are the run's own
                && State { files: Default::default(), ..state } == packed_state().ok()?,
        )
    };
    let is_plain = || owned::refuse_links(place, "a run", "").is_ok();
    // links first: the files that are read below would be elsewhere
    is_plain() && small_files().all(holds) && weights() == Some(true)
}

/// All files but those of the checkpoint.
fn small_files() -> impl Iterator<Item = (&'static str, &'static [u8])> {
    FILES.into_iter().chain([("CARD.md", CARD)]).map(|(name, text)| (name, text.as_bytes()))
}

fn packed_state() -> Result<State> {
    serde_json::from_str(STATE).map_err(|e| {
        Error::file(Path::new(STATE_NAME), e.to_string(), "where a training stood", "install kinelm again")
    })
}

/// Writes it as a run folder; the folder is whole or not there.
///
/// # Errors
/// What the system refuses; other things at `place`; a damaged program.
pub fn write(place: &Path) -> Result<()> {
    Ok(prepare(place)?.commit("give a run as `--run`, or set XDG_CACHE_HOME to another folder")?)
}

fn prepare(place: &Path) -> Result<PendingFolder> {
    let folder = PendingFolder::create(place)?;
    for (name, bytes) in small_files() {
        folder.write(name, bytes)?;
    }
    let expanded = packed::expand(PACKED)?;
    let bytes = weights::to_bytes(&expanded)?;
    Checkpoints::of(folder.path()).write(packed_state()?, &[(WEIGHTS, bytes)])?;
    Ok(folder)
}

/// Where programs store what they can make again: XDG_CACHE_HOME, else as the system has it.
fn cache_folder() -> Result<PathBuf> {
    let set = std::env::var_os("XDG_CACHE_HOME").filter(|value| !value.is_empty()).map(PathBuf::from);
    let system = || choose_native_strategy().ok().map(|system| system.cache_dir());
    let help = "the ready model is written there once: set XDG_CACHE_HOME, or give a run as `--run`";
    let folder = set.or_else(system).ok_or_else(|| Error::missing("a cache folder", help))?;
    Ok(folder.join("kinelm"))
}

/// Writes the data of this crate, `to`, from a trained run.
///
/// # Errors
/// A run that can't be read; what the system refuses.
pub fn pack(run: &Path, to: &Path) -> Result<()> {
    let loaded = load_run(run, CheckpointChoice::Auto)?;
    let mut contents = vec![(PACKED_NAME.to_owned(), packed::pack(&loaded.weights)?)];
    for (name, _) in FILES {
        let path = run.join(name);
        let text = input::text(&path).map_err(Error::io(&path))?;
        let text = if name == CONFIG { without_corpora(&text) } else { text };
        contents.push((name.to_owned(), text.into_bytes()));
    }
    let State { step, windows, tokens, seed, .. } = loaded.state;
    let state = serde_json::to_vec_pretty(&State::new(step, windows, tokens, seed, None));
    contents.push((STATE_NAME.to_owned(), state.expect("a state is plain data")));
    let all: Vec<u8> = contents.iter().flat_map(|(_, bytes)| bytes.clone()).collect();
    contents.push((VERSION_NAME.to_owned(), format!("{}\n", &hash::of(&all)[..12]).into_bytes()));
    for (name, bytes) in contents {
        files::write_whole(&to.join(name), &bytes)?;
    }
    Ok(())
}

/// A run's configuration without its corpora, which are nowhere else.
fn without_corpora(config: &str) -> String {
    let mut inside = false;
    let is_other = |line: &&str| {
        if line.starts_with('[') {
            inside = line.trim() == "[[corpora]]";
        }
        !inside && !line.starts_with("corpora = ")
    };
    let others: String = config.split_inclusive('\n').filter(is_other).collect();
    // before any table, which would take the key for its own
    format!("corpora = []\n{others}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_a_run_that_opens_and_dances() {
        let dir = tempfile::tempdir().unwrap();
        let run = dir.path().join("run");
        write(&run).unwrap();
        write(&run).unwrap();
        let loaded = load_run(&run, CheckpointChoice::Auto).unwrap();
        assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
        let tokenizer = loaded.load_tokenizer().unwrap();
        assert_eq!(loaded.conditions, ["genre"]);
        assert!(kinelm_model::lead_in::LeadIns::load(&run, &tokenizer).unwrap().is_some());
        loaded.reader(Default::default()).unwrap();
    }

    #[test]
    fn calls_at_once_take_one_folder_and_a_damaged_one_mends_itself() {
        let dir = tempfile::tempdir().unwrap();
        let begin = std::sync::Barrier::new(4);
        let first = || {
            begin.wait();
            run_in(dir.path()).map_err(|e| e.to_string())
        };
        let made = std::thread::scope(|scope| {
            let all: Vec<_> = (0..4).map(|_| scope.spawn(first)).collect();
            all.into_iter().map(|one| one.join().unwrap()).collect::<Vec<_>>()
        });
        let place = made[0].clone().unwrap();
        assert!(made.iter().all(|one| one.as_ref() == Ok(&place)), "{made:?}");
        let names = || std::fs::read_dir(dir.path()).unwrap().count();
        let checkpoint = Checkpoints::of(&place).path(packed_state().unwrap().step);
        let weights = std::fs::read(checkpoint.join(WEIGHTS)).unwrap();
        let other = [&weights[..weights.len() - 1], &[weights[weights.len() - 1] ^ 1]].concat();
        type Damage<'a> = &'a dyn Fn();
        let all: [(&str, Damage<'_>); 8] = [
            ("nothing", &|| ()),
            ("an empty file", &|| std::fs::write(place.join(LEAD_INS), "").unwrap()),
            ("a missing file", &|| std::fs::remove_file(place.join(TOKENIZER)).unwrap()),
            ("cut weights", &|| std::fs::write(checkpoint.join(WEIGHTS), &weights[..9]).unwrap()),
            ("other weights", &|| {
                std::thread::sleep(std::time::Duration::from_millis(20));
                std::fs::write(checkpoint.join(WEIGHTS), &other).unwrap();
            }),
            ("no checkpoint", &|| std::fs::remove_dir_all(place.join("checkpoints")).unwrap()),
            ("a file in its place", &|| {
                std::fs::remove_dir_all(&place).unwrap();
                std::fs::write(&place, "").unwrap();
            }),
            ("another name", &|| std::fs::write(place.join("latest"), "step-9").unwrap()),
        ];
        for (what, damage) in all {
            damage();
            assert_eq!(run_in(dir.path()).unwrap(), place, "{what}");
            assert!(load_run(&place, CheckpointChoice::Auto).unwrap().notes.is_empty(), "{what}");
            assert_eq!(names(), 1, "{what}: nothing is left beside it");
        }
    }

    #[test]
    fn what_is_packed_again_is_the_same() {
        let dir = tempfile::tempdir().unwrap();
        let (run, data) = (dir.path().join("run"), dir.path().join("data"));
        write(&run).unwrap();
        std::fs::create_dir(&data).unwrap();
        pack(&run, &data).unwrap();
        assert_eq!(std::fs::read(data.join(PACKED_NAME)).unwrap(), PACKED);
        assert_eq!(std::fs::read_to_string(data.join(VERSION_NAME)).unwrap(), VERSION);
    }
}
