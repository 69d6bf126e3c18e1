//! What a call reads is never its output: every command, with what it reads as where it would write, by another name.

use crate::support::{kinelm_in, stdout};
use assert_cmd::Command;
use kinelm::corpus::music::synth::music;
use kinelm_motion::{Motion, format, synth};
use kinelm_music::wav;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

const TRAIN: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 130\n\
                     [train]\nbatch = 1\nsteps = 2\nwarmup = 1\neval_every = 2\ncheckpoint_every = 2\n";
const ACLSTM: &str = "width = 24\nlayers = 1\nlength = 20\nbatch = 2\nsteps = 1\nmargin = 3\ncheckpoint_every = 1\n";
const MUSIC: &str = "encoder = [8]\nwidth = 12\nlayers = 1\nlength = 20\nbatch = 2\nsteps = 1\nmargin = 3\n\
                     checkpoint_every = 1\n";
const PLAN: &str = "rig = \"a\"\n[clips.a]\nfile = \"data/0.bvh\"\n[clips.b]\nfile = \"data/1.bvh\"\n\
                    [[segment]]\nclip = \"a\"\nfrom = 0\nto = 1\n[[segment]]\nclip = \"b\"\nfrom = 1.5\nto = 2\n";

struct Place(tempfile::TempDir);

impl Place {
    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn call(&self, words: &str) -> Command {
        kinelm_in(self.0.path(), words)
    }

    fn done(&self, words: &str) {
        stdout(&mut self.call(words));
    }

    /// Of a name that begins so the whole.
    fn whole(&self, name: &str) -> PathBuf {
        let (folder, begins) = name.rsplit_once('/').unwrap_or((".", name));
        let mut found = fs::read_dir(self.at(folder)).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
        let name = found.find(|found| found.starts_with(begins)).unwrap_or_else(|| panic!("no {name}"));
        Path::new(folder).join(name)
    }
}

/// A little of all that commands read.
fn place() -> &'static Place {
    static PLACE: OnceLock<Place> = OnceLock::new();
    PLACE.get_or_init(|| {
        let place = Place(tempfile::tempdir().unwrap());
        ["data", "seeds", "songs"].into_iter().for_each(|name| fs::create_dir(place.at(name)).unwrap());
        let mut labels = "clip,split,genre,music,music_from\n".to_owned();
        for (i, dance) in synth::corpus(3, 5, 4.0, 60.0).unwrap().into_iter().enumerate() {
            let sound = music(&dance, 3, 16_000).unwrap();
            fs::write(place.at(&format!("songs/song{i}.wav")), wav::bytes(&sound, 16_000)).unwrap();
            let path = place.at(&format!("data/{i}.bvh"));
            let motion = Motion::new(&path, dance.clip);
            format::write(&path, &motion).unwrap();
            let (split, genre) = (["train", "test", "train", "valid", "train"][i], ["salsa", "waltz"][i / 2 % 2]);
            labels += &format!("{i},{split},{genre},song{i},0\n");
            // named as aclstm evaluate names its seeds
            fs::copy(&path, place.at(&format!("seeds/seed-0{i}.bvh"))).unwrap();
        }
        fs::write(place.at("seeds.csv"), labels.replace("\n", "\nseed-0").trim_end_matches("seed-0")).unwrap();
        fs::write(place.at("labels.csv"), labels).unwrap();
        for (name, text) in [("c.toml", TRAIN), ("a.toml", ACLSTM), ("m.toml", MUSIC), ("plan.toml", PLAN)] {
            fs::write(place.at(name), text).unwrap();
        }
        fs::write(place.at("fit.toml"), "joints = \"13\"\nfps = 10.0\n").unwrap();
        for call in MADE {
            place.done(call);
        }
        let words = place.call("tokenizer text data/0.bvh --tokenizer t.json").output().unwrap().stdout;
        fs::write(place.at("w.json"), words).unwrap();
        let report =
            place.call("aclstm evaluate --run arun --seeds 1 --seed-frames 20 --frames 400 --json").output().unwrap();
        fs::write(place.at("report.json"), report.stdout).unwrap();
        place
    })
}

const MADE: &[&str] = &[
    "tokenizer fit data --labels labels.csv --config fit.toml --out t.json",
    "tokenize data --labels labels.csv --tokenizer t.json --out corpus",
    "tokenize data --labels labels.csv --tokenizer t.json --shard 0/1 --out piece",
    "pretrain --config c.toml --corpus corpus --run run",
    "export --run run --out model",
    "classify train --run run --corpus corpus --fields genre --steps 1 --batch 2 --out who",
    "query build data --labels labels.csv --window 20 --hop 10 --out index",
    "generate --run run --frames 3 --out d.bvh",
    "aclstm train seeds --labels seeds.csv --config a.toml --run arun",
    "music-lstm train data --labels labels.csv --music songs --config m.toml --run mrun",
    "aclstm generate --run arun --seed-clip data/0.bvh --seed-frames 20 --frames 5 --out a.bvh",
    "music-lstm generate --run mrun --music songs/song0.wav --frames 40 --out m.bvh",
];

/// A command, a call of it whose output is `OUT`, how that ends (`/`: a folder), and files or folders that the call reads.
type Row = (&'static str, &'static str, &'static str, &'static [&'static str]);

const WRITE: &[Row] = &[
    ("convert", "convert data/0.bvh OUT --onto data/1.bvh", "bvh", &["data/0.bvh", "data/1.bvh"]),
    ("convert", "convert data/0.bvh OUT --positions", "npz", &["data/0.bvh"]),
    ("view", "view data/0.bvh --music songs/song0.wav --out OUT", "html", &["data/0.bvh", "songs/song0.wav"]),
    (
        "tokenizer fit",
        "tokenizer fit data --labels labels.csv --config fit.toml --out OUT",
        "json",
        &["data/0.bvh", "labels.csv", "fit.toml"],
    ),
    ("tokenizer text", "tokenizer text data/0.bvh --tokenizer t.json --page OUT", "html", &["data/0.bvh", "t.json"]),
    ("tokenizer decode", "tokenizer decode w.json OUT --tokenizer t.json", "bvh", &["w.json", "t.json"]),
    (
        "tokenize",
        "tokenize data --labels labels.csv --tokenizer t.json --out OUT",
        "/",
        &["data", "run", "index", "who"],
    ),
    ("tokenize", "tokenize data --labels labels.csv --tokenizer corpus/tokenizer.json --out OUT", "/", &["corpus"]),
    ("corpus clean", "corpus clean data --labels labels.csv --out OUT", "csv", &["data/0.bvh", "labels.csv"]),
    (
        "corpus order",
        "corpus order --corpus corpus --config c.toml --steps 2 --out OUT",
        "npz",
        &["corpus/corpus.json", "corpus/clips.jsonl", "corpus/tokens.", "c.toml"],
    ),
    ("corpus merge", "corpus merge piece --out OUT", "/", &["piece", "data"]),
    ("pretrain", "pretrain --config c.toml --corpus corpus --run OUT", "/", &["data", "corpus", "run"]),
    ("runs plot", "runs plot run --out OUT", "svg", &["run/metrics.jsonl"]),
    ("finetune", "finetune --from run --config c.toml --corpus corpus --run OUT", "/", &["run", "corpus"]),
    ("lr-find", "lr-find --config c.toml --corpus corpus --steps 3 --out OUT", "svg", &["c.toml", "corpus/tokens."]),
    (
        "generate",
        "generate --run run --frames 3 --out OUT",
        "bvh",
        &["run/config.toml", "run/tokenizer.json", "run/checkpoints/step-00000002/model."],
    ),
    (
        "generate",
        "generate --run run --prompt data/0.bvh --joints legs --best 2 --real corpus --frames 3 --out OUT",
        "json",
        &["data/0.bvh", "corpus/corpus.json", "corpus/clips.jsonl"],
    ),
    ("generate", "generate --run run --best 2 --frames 3 --out OUT", "json", &["corpus/corpus.json", "corpus/tokens."]),
    (
        "generate timeline",
        "generate timeline plan.toml --run run --out OUT",
        "bvh",
        &["plan.toml", "data/0.bvh", "data/1.bvh"],
    ),
    ("again", "again d.bvh.kinelm.json --out OUT", "bvh", &["d.bvh.kinelm.json", "run/config.toml"]),
    (
        "classify train",
        "classify train --run run --corpus corpus --fields genre --steps 1 --out OUT",
        "/",
        &["run", "corpus", "who"],
    ),
    (
        "classify eval",
        "classify eval --classifier who --corpus corpus --plot OUT",
        "svg",
        &["who/classifier.json", "who/model-", "corpus/tokens."],
    ),
    ("export", "export --run run --out OUT", "/", &["run", "corpus"]),
    ("import", "import model --run OUT", "/", &["run", "model"]),
    (
        "interpolate",
        "interpolate data/0.bvh data/1.bvh --window 40 --steps 3 --out OUT",
        "bvh",
        &["data/0.bvh", "data/1.bvh"],
    ),
    (
        "interpolate",
        "interpolate data/0.bvh data/1.bvh --window 40 --steps 3 --out new.bvh --page OUT",
        "html",
        &["data/1.bvh"],
    ),
    (
        "interpolate",
        "interpolate data/0.bvh data/1.bvh --window 40 --steps 3 --out new.bvh --plot OUT",
        "svg",
        &["data/1.bvh"],
    ),
    ("compare", "compare data/0.bvh data/1.bvh --page OUT", "html", &["data/0.bvh", "data/1.bvh"]),
    (
        "evaluate blind make",
        "evaluate blind make data seeds --ask better --out OUT",
        "html",
        &["data/0.bvh", "seeds/seed-00.bvh"],
    ),
    ("filter", "filter data/0.bvh --out OUT", "bvh", &["data/0.bvh"]),
    ("mirror", "mirror data/0.bvh --out OUT", "bvh", &["data/0.bvh"]),
    ("spectrum", "spectrum data/0.bvh --out OUT", "svg", &["data/0.bvh"]),
    ("spectrum", "spectrum data/0.bvh data/1.bvh --page OUT", "html", &["data/0.bvh", "data/1.bvh"]),
    ("music inspect", "music inspect songs/song0.wav --out OUT", "svg", &["songs/song0.wav"]),
    ("music beats", "music beats songs/song0.wav --out OUT", "txt", &["songs/song0.wav"]),
    (
        "evaluate dance",
        "evaluate dance data/0.bvh data/1.bvh --music songs/song0.wav --real corpus --plot OUT",
        "svg",
        &["data/0.bvh", "data/1.bvh", "songs/song0.wav", "corpus/clips.jsonl"],
    ),
    (
        "evaluate dance",
        "evaluate dance data/0.bvh data/1.bvh --real corpus --page OUT",
        "html",
        &["data/0.bvh", "data/1.bvh", "corpus/clips.jsonl"],
    ),
    ("query build", "query build data --out OUT", "/", &["data", "run", "corpus"]),
    ("query find", "query find data/0.bvh --index index --page OUT", "html", &["data/0.bvh", "index/index.json"]),
    (
        "query evaluate",
        "query evaluate data --labels labels.csv --window 20 --save OUT",
        "json",
        &["data/0.bvh", "labels.csv"],
    ),
    ("aclstm train", "aclstm train data --labels labels.csv --config a.toml --run OUT", "/", &["data", "arun", "run"]),
    (
        "aclstm generate",
        "aclstm generate --run arun --seed-clip data/0.bvh --seed-frames 20 --frames 5 --out OUT",
        "bvh",
        &["arun/config.toml", "data/0.bvh", "arun/checkpoints/step-00000001/model."],
    ),
    ("again", "again a.bvh.kinelm.json --out OUT", "bvh", &["a.bvh.kinelm.json", "arun/config.toml", "data/0.bvh"]),
    (
        "aclstm evaluate",
        "aclstm evaluate --run arun --seeds 1 --seed-frames 20 --frames 400 --write-seeds OUT",
        "/",
        &["seeds"],
    ),
    ("aclstm plot", "aclstm plot report.json --out OUT", "svg", &["report.json"]),
    (
        "music-lstm train",
        "music-lstm train data --labels labels.csv --music songs --config m.toml --run OUT",
        "/",
        &["data", "mrun", "songs"],
    ),
    (
        "music-lstm generate",
        "music-lstm generate --run mrun --music songs/song0.wav --frames 40 --out OUT",
        "bvh",
        &["mrun/config.toml", "songs/song0.wav"],
    ),
    (
        "again",
        "again m.bvh.kinelm.json --out OUT",
        "bvh",
        &["m.bvh.kinelm.json", "mrun/config.toml", "songs/song0.wav"],
    ),
];

/// Commands that write no file, or that read none.
const OTHERS: &[&str] = &[
    "inspect",
    "config show",
    "completions",
    "corpus stats",
    "runs list",
    // into the run that they resume
    "pretrain resume",
    "finetune resume",
    "aclstm resume",
    "music-lstm resume",
    "classify predict",
    "evaluate baselines",
    "evaluate blind count",
    "evaluate likelihood",
    "evaluate gaps",
    "evaluate prediction",
    "music-lstm evaluate",
    "music render",
    // into folders of their own, by names of their own: study.rs, files.rs
    "tokenizer study",
    "demo",
    // a project of its own: studio.rs
    "studio",
    // into a new run and its corpus: ready.rs
    "tune",
];

/// Options that name what is written.
const OUTPUTS: [&str; 6] = ["--out ", "--run ", "--page ", "--plot ", "--save ", "--write-seeds "];

/// All commands that can be called, with their help.
fn leaves(place: &Place, command: &str, found: &mut Vec<(String, String)>) {
    let help = place.call(&format!("{command} --help")).output().unwrap().stdout;
    let help = String::from_utf8(help).unwrap();
    if let Some((_, below)) = help.split_once("\nCommands:\n") {
        let lines = below.lines().take_while(|line| line.starts_with("  "));
        let names = lines.filter(|line| !line.starts_with("   ")).filter_map(|line| line.split_whitespace().next());
        for name in names.filter(|name| *name != "help") {
            leaves(place, &format!("{command} {name}"), found);
        }
    }
    // one that only has commands below it shows no other usage
    let usage = help.lines().find(|line| line.starts_with("Usage: ")).unwrap_or_default();
    if !usage.ends_with(" <COMMAND>") {
        found.push((command.trim().to_owned(), help));
    }
}

#[test]
fn every_command_is_known_here() {
    let mut found = Vec::new();
    leaves(place(), "", &mut found);
    assert!(found.len() > 40, "{found:?}");
    let listed: BTreeSet<&str> = WRITE.iter().map(|row| row.0).chain(OTHERS.iter().copied()).collect();
    let there: BTreeSet<&str> = found.iter().map(|(command, _)| &**command).collect();
    assert_eq!(there, listed, "a new command belongs into WRITE with what it reads, or into OTHERS");
    for (command, help) in &found {
        let options = OUTPUTS.iter().filter(|option| help.contains(&format!("{option}<")) && **option != "--run ");
        for option in options.filter(|_| !["demo", "tokenizer study", "music render"].contains(&&**command)) {
            let is_tried = |row: &&Row| row.0 == *command && row.1.contains(&format!("{option}OUT"));
            assert!(WRITE.iter().any(|row| is_tried(&row)), "{command} {option}: no call of it in WRITE");
        }
    }
}

#[test]
fn no_command_writes_over_what_it_reads() {
    let place = place();
    let mut wrong = Vec::new();
    for (n, (_, call, end, inputs)) in WRITE.iter().enumerate() {
        for (i, input) in inputs.iter().enumerate() {
            let (call, of) = if *end == "/" {
                (call.replace("OUT", input), place.at(input))
            } else {
                let (name, of) = (format!("out-{n}-{i}.{end}"), place.at("").join(place.whole(input)));
                fs::hard_link(&of, place.at(&name)).unwrap();
                (call.replace("OUT", &name), of)
            };
            let before = contents(&of);
            for force in ["", " --force"] {
                if force.is_empty() || takes_force(place, call.split("--").next().unwrap_or_default()) {
                    let said = place.call(&format!("{call}{force}")).output().unwrap();
                    let (code, said) = (said.status.code(), String::from_utf8_lossy(&said.stderr).into_owned());
                    if code != Some(2) {
                        wrong.push(format!("{call}{force}: {code:?} {said}"));
                        continue;
                    }
                    let told = ["this call reads", "one of the files of", "exists", "is there already", "holds"];
                    if !told.iter().any(|what| said.contains(what)) {
                        wrong.push(format!("{call}{force}: {said}"));
                    }
                }
            }
            if contents(&of) != before {
                wrong.push(format!("{call}: {input} has changed"));
            }
            assert!(!place.at("new.bvh").exists(), "{call}");
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn takes_force(place: &Place, call: &str) -> bool {
    let names = call.split_whitespace().take_while(|word| !word.contains(['/', '.']));
    let help = |command: &str| place.call(&format!("{command} --help")).output().unwrap();
    let names: Vec<&str> = names.collect();
    // as many words as name a command
    (1..=names.len()).rev().any(|n| {
        let help = help(&names[..n].join(" "));
        help.status.success() && String::from_utf8_lossy(&help.stdout).contains("--force")
    })
}

/// A file's bytes, or those of all files of a folder.
fn contents(path: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    if path.is_file() {
        return vec![(path.to_owned(), fs::read(path).unwrap())];
    }
    let mut all: Vec<_> = fs::read_dir(path).unwrap().map(|e| e.unwrap().path()).collect();
    all.sort();
    // that somebody holds a run is told in its lock
    all.iter().filter(|path| !path.ends_with(".lock")).flat_map(|path| contents(path)).collect()
}

/// What a run names, and what it reads by it.
#[test]
fn a_corpus_is_safe_from_the_dances_of_its_run() {
    let place = place();
    let before = contents(&place.at("corpus"));
    for call in [
        "generate --run run --frames 3 --out corpus/corpus.json --force",
        "generate --run run --best 2 --real corpus --frames 3 --out corpus/corpus.json --force",
        "tokenizer fit data --labels labels.csv --config fit.toml --out corpus/tokenizer.json --force",
    ] {
        let said = place.call(call).output().unwrap();
        let said = (said.status.code(), String::from_utf8_lossy(&said.stderr).into_owned());
        assert!(said.0 == Some(2) && said.1.contains("is one of the files of"), "{call}: {said:?}");
        assert!(contents(&place.at("corpus")) == before, "{call}");
    }
}
