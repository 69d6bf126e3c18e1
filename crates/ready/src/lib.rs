//! The model that kinelm dances with where none is given, as a run folder; [`CARD`] says what it is.
//!
//! The weights are part of the program, packed ([`packed`]). [`run`] writes them once to the user's cache folder, and whatever
//! reads runs reads this one.

pub mod packed;

use kinelm_model::checkpoint::{Checkpoints, State};
use kinelm_model::lead_in::LEAD_INS;
use kinelm_model::run::{CONFIG, HELD_OUT, MADE, TOKENIZER, WEIGHTS};
use kinelm_model::{CheckpointChoice, Error, Result, load_run, weights};
use kinelm_store::files::{self, PendingFolder};
use kinelm_store::{hash, input};
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
const FILES: [(&str, &str); 4] = [
    (CONFIG, include_str!("../data/config.toml")),
    (TOKENIZER, include_str!("../data/tokenizer.json")),
    (LEAD_INS, include_str!("../data/lead_ins.json")),
    (HELD_OUT, include_str!("../data/held_out.json")),
];
/// The files of [`MADE`], beside the tokenizer.
const MADE_FILES: [(&str, &[u8]); 3] = [
    ("corpus-made/corpus.json", include_bytes!("../data/corpus-made/corpus.json")),
    ("corpus-made/clips.jsonl", include_bytes!("../data/corpus-made/clips.jsonl")),
    ("corpus-made/tokens.u16", include_bytes!("../data/corpus-made/tokens.u16")),
];
/// Of all files, as [`pack`] wrote it.
const VERSION: &str = include_str!("../data/version.txt");

/// The ready model's run folder, in the cache folder of the user; written, if it isn't there.
///
/// # Errors
/// No cache folder is known, or can't be written; a damaged program.
pub fn run() -> Result<PathBuf> {
    let place = cache_folder()?.join(format!("ready-{}", VERSION.trim()));
    if !place.join(CONFIG).is_file() {
        write(&place)?;
    }
    Ok(place)
}

/// Writes it as a run folder; the folder is whole or not there.
///
/// # Errors
/// What the system refuses; other things at `place`; a damaged program.
pub fn write(place: &Path) -> Result<()> {
    let folder = PendingFolder::create(place)?;
    for (name, text) in FILES {
        folder.write(name, text.as_bytes())?;
    }
    folder.write("CARD.md", CARD.as_bytes())?;
    let made = folder.path().join(MADE);
    std::fs::create_dir(&made).map_err(Error::io(&made))?;
    for (name, bytes) in MADE_FILES {
        folder.write(name, bytes)?;
    }
    folder.write(&format!("{MADE}/{TOKENIZER}"), tokenizer().as_bytes())?;
    let expanded = packed::expand(PACKED)?;
    let bytes = weights::to_bytes(expanded.iter().map(|(name, tensor)| (name.as_str(), tensor)))?;
    let state: State = serde_json::from_str(STATE).map_err(|e| {
        Error::file(Path::new(STATE_NAME), e.to_string(), "where a training stood", "install kinelm again")
    })?;
    Checkpoints::of(folder.path()).write(state, &[(WEIGHTS, bytes)])?;
    Ok(folder.commit("give a run as `--run`, or set XDG_CACHE_HOME to another folder")?)
}

/// The run's tokenizer, which its corpus has too.
fn tokenizer() -> &'static str {
    FILES.iter().find(|(name, _)| *name == TOKENIZER).map_or("", |(_, text)| text)
}

/// Where programs keep what they can make again: XDG_CACHE_HOME, else as the system has it.
fn cache_folder() -> Result<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let system = || {
        if cfg!(windows) {
            return of("LOCALAPPDATA");
        }
        let below = if cfg!(target_os = "macos") { "Library/Caches" } else { ".cache" };
        of("HOME").map(|home| home.join(below))
    };
    let help = "the ready model is written there once: set XDG_CACHE_HOME, or give a run as `--run`";
    let folder = of("XDG_CACHE_HOME").or_else(system).ok_or_else(|| Error::missing("a cache folder", help))?;
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
    std::fs::create_dir_all(to.join(MADE)).map_err(Error::io(to))?;
    for (name, _) in MADE_FILES {
        let path = run.join(name);
        contents.push((name.to_owned(), input::bytes(&path).map_err(Error::io(&path))?));
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
    let keeps = |line: &&str| {
        if line.starts_with('[') {
            inside = line.trim() == "[[corpora]]";
        }
        !inside && !line.starts_with("corpora = ")
    };
    let kept: String = config.split_inclusive('\n').filter(keeps).collect();
    format!("corpora = []\n{kept}")
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
