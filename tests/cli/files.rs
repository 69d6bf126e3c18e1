//! What a call writes over: never what it reads, and unasked only what is its own.

use crate::support::{kinelm_in, stdout};
use assert_cmd::Command;
use kinelm_motion::{Motion, format, synth};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::SystemTime;

const TRAIN: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 130\n\
                     [train]\nbatch = 1\nsteps = 2\nwarmup = 1\neval_every = 2\ncheckpoint_every = 2\n";
/// What stands where something else is to be written.
const MINE: &[u8] = b"mine";

/// A folder that calls are made in.
struct Place(tempfile::TempDir);

impl Place {
    /// A copy of six dances with labels, a tokenizer, words, a corpus and a run of two steps.
    fn new() -> Place {
        static FIRST: OnceLock<Place> = OnceLock::new();
        let first = FIRST.get_or_init(Place::first);
        let place = Place(tempfile::tempdir().unwrap());
        copy(first.0.path(), place.0.path());
        place
    }

    fn first() -> Place {
        let place = Place(tempfile::tempdir().unwrap());
        fs::create_dir(place.at("data")).unwrap();
        let mut labels = "clip,split,genre\n".to_string();
        for (i, dance) in synth::corpus(3, 6, 2.0, 30.0).unwrap().into_iter().enumerate() {
            save(&place.at(&format!("data/{i}.bvh")), dance.clip);
            labels += &format!("{i},{},{}\n", ["train", "valid", "test"][i % 3], ["salsa", "waltz"][i / 3]);
        }
        fs::write(place.at("labels.csv"), labels).unwrap();
        fs::write(place.at("fit.toml"), "joints = \"13\"\n").unwrap();
        fs::write(place.at("c.toml"), TRAIN).unwrap();
        for name in ["a.bvh", "a.npz", "a.json", "rig.json", "b.bvh"] {
            let seed = if name == "b.bvh" { 9 } else { 8 };
            save(&place.at(name), synth::corpus(seed, 1, 2.0, 30.0).unwrap().remove(0).clip);
        }
        place.done("tokenizer fit data --labels labels.csv --out t.json");
        place.done("tokenize data --labels labels.csv --tokenizer t.json --out corpus");
        place.done("pretrain --config c.toml --corpus corpus --run run");
        let words = place.call("tokenizer text a.bvh --tokenizer t.json").output().unwrap().stdout;
        fs::write(place.at("w.json"), words).unwrap();
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn call(&self, words: &str) -> Command {
        kinelm_in(self.0.path(), words)
    }

    fn done(&self, words: &str) {
        stdout(&mut self.call(words));
    }

    /// Every file with its bytes and when it was written.
    fn files(&self) -> BTreeMap<PathBuf, (Vec<u8>, SystemTime)> {
        let mut found = BTreeMap::new();
        let mut folders = vec![self.0.path().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
                match entry.is_dir() {
                    true => folders.push(entry),
                    false => {
                        let written = fs::symlink_metadata(&entry).unwrap().modified().unwrap();
                        found.insert(entry.clone(), (fs::read(&entry).unwrap(), written));
                    }
                }
            }
        }
        found
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(|e| e.unwrap()) {
        let (path, to) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() { copy(&path, &to) } else { fs::copy(&path, &to).map(|_| ()).unwrap() }
    }
}

fn save(path: &Path, clip: kinelm_motion::Clip) {
    let motion = Motion::new(path, clip);
    format::write(path, &motion).unwrap();
}

/// Calls that would write over a file that they read. None does, `--force` or not.
#[test]
fn no_input_is_written_over() {
    let place = Place::new();
    fs::hard_link(place.at("a.bvh"), place.at("hard.bvh")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("a.bvh", place.at("link.bvh")).unwrap();
    #[cfg(not(unix))]
    fs::hard_link(place.at("a.bvh"), place.at("link.bvh")).unwrap();
    for piece in [0, 1] {
        let call = format!("tokenize data --labels labels.csv --tokenizer t.json --shard {piece}/2 --out piece{piece}");
        place.done(&call);
    }
    #[cfg(unix)]
    std::os::unix::fs::symlink("data/0.bvh", place.at("a.html")).unwrap();
    let before = place.files();
    for call in NO_INPUT.iter().flat_map(|call| [call.to_string(), format!("{call} --force")]) {
        place.call(&call).assert().code(2).stderr(contains("this call reads"));
        assert_eq!(place.files(), before, "{call}");
    }
}

const NO_INPUT: &[&str] = &[
    "convert a.bvh a.bvh",
    "convert a.bvh ./data/../a.bvh",
    "convert a.bvh link.bvh",
    "convert link.bvh a.bvh",
    "convert a.bvh hard.bvh",
    "convert a.bvh rig.json --onto rig.json",
    "convert a.bvh rig.json --onto b.bvh --onto-map rig.json",
    "convert a.npz a.npz --positions",
    "view a.bvh data/0.bvh --out a.html",
    "view a.bvh data/0.bvh:fps=29.97,skip=1 --out a.html",
    "view data:fps=29.97 --out a.html",
    "generate --run run --frames 3 --out run/tokenizer.json",
    "generate --run run --frames 3 --out run/corpus.json",
    "generate --run run --prompt a.json --joints legs --out a.json",
    "generate --run run --prompt a.bvh --joints legs --map rig.json --out rig.json",
    "filter a.bvh --out a.bvh",
    "filter data/0.bvh data/1.bvh --out data",
    "interpolate a.bvh b.bvh --window 40 --out b.bvh",
    "interpolate a.bvh b.bvh --window 40 --out c.bvh --page a.html --map a.html",
    "tokenizer decode w.json w.json --tokenizer t.json",
    "tokenizer decode w.json t.json --tokenizer t.json",
    "tokenizer fit data --labels labels.csv --out labels.csv",
    "tokenizer fit data --labels labels.csv --config fit.toml --out fit.toml",
    "tokenizer fit data --labels labels.csv --out data/0.bvh",
    "tokenizer fit a.bvh --out a.bvh",
    "tokenize data --labels labels.csv --tokenizer corpus/tokenizer.json --out corpus",
    "corpus merge piece0 piece1 --out piece0",
    "query evaluate data --labels labels.csv --window 16 --save labels.csv",
];

/// Calls that write to the first name, where something of the user's stands that is as long as `MINE`.
#[test]
fn what_is_not_ours_is_replaced_by_force_alone() {
    for (out, call) in NOT_OURS {
        let place = Place::new();
        fs::create_dir_all(place.at(out).parent().unwrap()).unwrap();
        fs::write(place.at(out), MINE).unwrap();
        let before = place.files();
        place.call(call).assert().code(2).stderr(contains(*out)).stderr(contains("--force"));
        assert_eq!(place.files(), before, "{call}");
        place.done(&format!("{call} --force"));
        assert_ne!(fs::read(place.at(out)).unwrap(), MINE, "{call}");
    }
}

const NOT_OURS: &[(&str, &str)] = &[
    ("out.bvh", "convert a.bvh out.bvh --fps 20"),
    ("out.npz", "convert a.bvh out.npz --positions"),
    ("page.html", "view a.bvh --out page.html"),
    ("new/a.html", "view a.bvh:fps=29.97 --out new/"),
    ("d.bvh", "generate --run run --frames 3 --out d.bvh"),
    ("d.bvh.kinelm.json", "generate --run run --frames 3 --out d.bvh"),
    ("f.bvh", "filter a.bvh --out f.bvh"),
    ("new/a.bvh", "filter a.bvh --out new/"),
    ("c.bvh", "interpolate a.bvh b.bvh --window 40 --steps 3 --out c.bvh"),
    ("c.html", "interpolate a.bvh b.bvh --window 40 --steps 3 --out c.bvh --page c.html"),
    ("t2.json", "tokenizer fit data --labels labels.csv --out t2.json"),
    ("w.bvh", "tokenizer decode w.json w.bvh --tokenizer t.json"),
    ("s.png", "spectrum a.bvh --out s.png"),
    ("s.svg", "spectrum a.bvh --out s.svg"),
    ("r.png", "runs plot run --out r.png"),
    ("lr.svg", "lr-find --config c.toml --corpus corpus --steps 3 --out lr.svg"),
    ("o.npz", "corpus order --corpus corpus --config c.toml --steps 2 --out o.npz"),
    ("o/windows.npy", "corpus order --corpus corpus --config c.toml --steps 2 --out o"),
    ("d-2.bvh", "generate --run run --frames 3 --variations 2 --out d.bvh"),
    ("d-2.bvh.kinelm.json", "generate --run run --frames 3 --variations 2 --out d.bvh"),
];

/// Calls that write a new file into a new folder: made the second time, they leave it as it is.
#[test]
fn a_call_repeated_is_no_error_and_changes_nothing() {
    let place = Place::new();
    for call in REPEATED {
        place.done(call);
        let before = place.files();
        place.done(call);
        assert_eq!(place.files(), before, "{call}");
    }
}

const REPEATED: &[&str] = &[
    "convert a.bvh new/out.bvh --fps 20",
    "convert a.bvh new/out.json",
    "convert a.bvh new/out.npz",
    "convert a.bvh new/positions.npz --positions",
    "view a.bvh --out new/page.html",
    "generate --run run --frames 3 --out new/d.bvh",
    "generate --run run --frames 3 --variations 2 --out run/d.json",
    "again new/d.bvh.kinelm.json",
    "filter a.bvh --out new/f.npz",
    "filter a.bvh b.bvh --out new/filtered/",
    "interpolate a.bvh b.bvh --window 40 --steps 3 --out new/c.bvh --page new/c.html",
    "tokenizer fit data --labels labels.csv --out new/t.json",
    "tokenizer decode w.json new/w.bvh --tokenizer t.json",
    "spectrum a.bvh --out new/s.png",
    "spectrum a.bvh --out new/s.svg",
    "runs plot run --out run/r.png",
    "lr-find --config c.toml --corpus corpus --steps 3 --out new/lr.svg",
    "corpus order --corpus corpus --config c.toml --steps 2 --out corpus/o.npz",
    "tokenize data --labels labels.csv --tokenizer t.json --out new/corpus",
    "tokenize data --labels labels.csv --tokenizer t.json --shard 0/1 --out piece",
    "corpus merge piece --out new/merged",
    "export --run run --out new/model",
    "import new/model --run new/run",
    "again new/d.bvh.kinelm.json --out again.bvh",
];

/// A call, then one with other settings and the same output: ours is replaced without a word.
#[test]
fn a_folder_of_others_is_no_place_for_a_demo() {
    let place = Place::new();
    let before = place.files();
    for call in ["demo --out . --force", "demo --out data --force", "demo --out ."] {
        place.call(call).assert().code(2).stderr(contains("holds files that are no demo's"));
        assert_eq!(place.files(), before, "{call}");
    }
}

#[test]
fn ours_is_replaced() {
    for (out, first, second) in OURS {
        let place = Place::new();
        place.done(first);
        let before = fs::read(place.at(out)).unwrap();
        place.done(second);
        assert_ne!(fs::read(place.at(out)).unwrap(), before, "{second}");
        // but not what the user has made of it
        fs::write(place.at(out), MINE).unwrap();
        place.call(first).assert().code(2).stderr(contains("--force"));
        assert_eq!(fs::read(place.at(out)).unwrap(), MINE, "{first}");
    }
}

const OURS: &[(&str, &str, &str)] = &[
    ("page.html", "view a.bvh --out page.html", "view b.bvh --out page.html"),
    (
        "c.html",
        "interpolate a.bvh b.bvh --window 40 --steps 3 --out c.bvh --page c.html",
        "interpolate a.bvh b.bvh --window 40 --steps 3 --out e.bvh --page c.html",
    ),
    ("s.png", "spectrum a.bvh --out s.png", "spectrum b.bvh --out s.png"),
    ("s.svg", "spectrum a.bvh --out s.svg", "spectrum b.bvh --out s.svg"),
    ("r.png", "runs plot run --out r.png", "runs plot run --metric rate --out r.png"),
    ("d.bvh", "generate --run run --frames 3 --out d.bvh", "generate --run run --frames 4 --out d.bvh"),
    ("d.npz", "generate --run run --frames 3 --out d.npz", "generate --run run --frames 4 --out d.npz"),
];

#[test]
fn each_format_of_a_dance_has_its_own_record_which_may_have_another_name() {
    let place = Place::new();
    for name in ["d.bvh", "d.npz", "d.json"] {
        place.done(&format!("generate --run run --frames 3 --out {name}"));
    }
    for name in ["d.bvh", "d.npz", "d.json"] {
        let told: serde_json::Value =
            serde_json::from_slice(&fs::read(place.at(&format!("{name}.kinelm.json"))).unwrap()).unwrap();
        assert_eq!(told["output"]["file"], name);
    }
    // by a record of another name it is made again, and has its own beside it
    fs::rename(place.at("d.bvh.kinelm.json"), place.at("d.kinelm.json")).unwrap();
    let dance = fs::read(place.at("d.bvh")).unwrap();
    place.done("again d.kinelm.json");
    assert_eq!(fs::read(place.at("d.bvh")).unwrap(), dance);
    assert!(place.at("d.bvh.kinelm.json").exists());
}

#[test]
fn a_dance_is_ours_whenever_a_call_was_killed() {
    let place = Place::new();
    let [dance, told] = ["d.bvh", "d.bvh.kinelm.json"].map(|name| place.at(name));
    place.done("generate --run run --frames 3 --out d.bvh");
    let first = fs::read(&dance).unwrap();
    place.done("generate --run run --frames 4 --out d.bvh");
    let second = fs::read(&dance).unwrap();
    // between the two files: the record is the new one, the dance still the old
    fs::write(&dance, &first).unwrap();
    let record = fs::read_to_string(&told).unwrap();
    assert!(record.contains("\"replaces\""), "{record}");
    place.done("generate --run run --frames 4 --out d.bvh");
    assert_eq!(fs::read(&dance).unwrap(), second);
    // a dance that somebody has worked on since stays
    let worked_on = [&first[..], b"\n"].concat();
    fs::write(&dance, &worked_on).unwrap();
    for call in ["again d.bvh.kinelm.json", "generate --run run --frames 5 --out d.bvh"] {
        place.call(call).assert().code(2).stderr(contains("--force"));
        assert_eq!(
            (fs::read(&dance).unwrap(), fs::read_to_string(&told).unwrap()),
            (worked_on.clone(), record.clone())
        );
    }
}

#[test]
fn a_record_names_no_other_place() {
    let place = Place::new();
    place.done("generate --run run --frames 3 --out new/d.bvh");
    let record = fs::read_to_string(place.at("new/d.bvh.kinelm.json")).unwrap();
    fs::write(place.at("victim.bvh"), MINE).unwrap();
    fs::write(place.at("new/victim.bvh"), MINE).unwrap();
    let absolute = place.at("victim.bvh").display().to_string();
    for name in
        ["../victim.bvh", "/victim.bvh", "..", ".", "", "..\\\\victim.bvh", "x/../victim.bvh", &absolute, "victim.bvh"]
    {
        let changed = record.replace("\"file\": \"d.bvh\"", &format!("\"file\": \"{name}\""));
        assert_ne!(changed, record);
        fs::write(place.at("new/d.bvh.kinelm.json"), changed).unwrap();
        let before = place.files();
        place.call("again new/d.bvh.kinelm.json").assert().failure();
        assert_eq!(place.files(), before, "{name}");
    }
}

#[test]
fn a_corpus_is_replaced_file_by_file_and_by_force_alone() {
    let place = Place::new();
    fs::write(place.at("corpus/notes.txt"), MINE).unwrap();
    let before = place.files();
    place.done("tokenize data --labels labels.csv --tokenizer t.json --out corpus");
    assert_eq!(place.files(), before);
    let other = "tokenize data a.bvh --labels labels.csv --tokenizer t.json --out corpus";
    place.call(other).assert().code(2).stderr(contains("--force"));
    assert_eq!(place.files(), before);
    place.done(&format!("{other} --force"));
    let after = place.files();
    let notes = place.at("corpus/notes.txt");
    assert_eq!(after[&notes], before[&notes]);
    assert_ne!(after[&place.at("corpus/corpus.json")], before[&place.at("corpus/corpus.json")]);
    assert_eq!(after.len(), before.len());
    // a model that was exported, and changed since
    place.done("export --run run --out model");
    fs::write(place.at("model/kinelm.json"), MINE).unwrap();
    let before = place.files();
    place.call("export --run run --out model").assert().code(2).stderr(contains("model exists, with other contents"));
    assert_eq!(place.files(), before);
}

/// A dance that replaces another, where the disk is full or the process is killed: the old one stays beside its sidecar, or
/// the new one beside its own, or it is told that the new one's isn't beside its dance.
#[cfg(unix)]
#[test]
fn a_replacement_that_fails_or_is_killed_loses_nothing() {
    let place = Place::new();
    let other = "generate --run run --frames 40 --seed 2 --out d.bvh";
    place.done("generate --run run --frames 40 --seed 1 --out d.bvh");
    let pair = || ["d.bvh", "d.bvh.kinelm.json"].map(|name| fs::read(place.at(name)).unwrap());
    let old = pair();
    place.done("generate --run run --frames 40 --seed 2 --out e.bvh");
    // at every size that a file may have: of the dance, of its sidecar, of neither
    let program = Command::cargo_bin("kinelm").unwrap().get_program().to_owned();
    let blocks = old[0].len().max(old[1].len()) / 512 + 2;
    let mut failed = 0;
    for most in 0..blocks {
        let script = format!("ulimit -f {most} || exit 77; exec \"$0\" {other}");
        let mut shell = std::process::Command::new("sh");
        let done = shell.current_dir(place.0.path()).arg("-c").arg(script).arg(&program).output().unwrap();
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        match done.status.code() {
            Some(77) => return kinelm_shared_data::skipped("a file that outgrows", "this shell has no limits of size"),
            Some(0) => break,
            code => assert!(code == Some(1) && said.contains("File too large"), "{most}: {code:?} {said}"),
        }
        assert!(pair() == old, "{most} blocks");
        failed += 1;
    }
    assert!(failed > 3, "{failed}");
    place.done("again d.bvh.kinelm.json");
    place.done(other);
    let new = pair();
    assert!(new[0] != old[0]);
    let left = || {
        fs::read_dir(place.0.path()).unwrap().flatten().filter(|e| e.file_name().to_string_lossy().ends_with(".part"))
    };
    assert_eq!(left().count(), 0, "what failed left nothing");

    // killed at any time
    let (mut finished, mut between) = (0, 0);
    for round in 0..40 {
        let (seed, before) = (3 + round % 2, pair());
        let words = format!("generate --run run --frames 40 --seed {seed} --out d.bvh");
        let mut call = std::process::Command::new(&program);
        call.current_dir(place.0.path()).args(words.split(' ')).stderr(std::process::Stdio::null());
        let mut child = call.spawn().unwrap();
        // while its files are written, sooner or later
        let begun = SystemTime::now();
        while left().count() == 0 && child.try_wait().unwrap().is_none() {
            assert!(begun.elapsed().unwrap().as_secs() < 60);
        }
        std::thread::sleep(std::time::Duration::from_micros(round * 150));
        let _ = child.kill();
        child.wait().unwrap();
        let after = pair();
        let stands: serde_json::Value = serde_json::from_slice(&after[1]).unwrap();
        let dance = kinelm_store::hash::of(&after[0]);
        match (stands["output"]["sha256"] == dance, stands["replaces"] == dance) {
            (true, _) => finished += usize::from(after != before),
            (false, true) => between += 1,
            (false, false) => panic!("round {round}: the sidecar is of another dance"),
        }
        left().for_each(|part| fs::remove_file(part.path()).unwrap());
    }
    println!("finished {finished}, killed between both names {between}");

    // killed between both names, as a kill may or may not have hit it
    fs::write(place.at("d.bvh"), &old[0]).unwrap();
    fs::write(place.at("d.bvh.kinelm.json"), &old[1]).unwrap();
    place.done(other);
    fs::write(place.at("d.bvh"), &old[0]).unwrap();
    let refused = place.call("again d.bvh.kinelm.json").assert().code(2);
    refused.stderr(contains("its replacement didn't finish").and(contains("--out")));
    assert_eq!(fs::read(place.at("d.bvh")).unwrap(), old[0]);
    place.done("again d.bvh.kinelm.json --out new.bvh");
    assert_eq!(fs::read(place.at("new.bvh")).unwrap(), new[0]);
    place.done("again d.bvh.kinelm.json --force");
    assert_eq!(fs::read(place.at("d.bvh")).unwrap(), new[0]);
}

#[test]
fn what_killed_calls_left_is_swept_by_name() {
    let place = Place::new();
    let old = SystemTime::now() - std::time::Duration::from_secs(2 * 3600);
    let put = |name: &str| {
        fs::File::create(place.at(name)).unwrap().set_modified(old).unwrap();
        place.at(name)
    };
    let gone = u32::MAX; // above the largest number that a process can have
    let left = put(&format!("out.bvh.{gone}-00112233445566ff.part"));
    let others = [put(&format!("b.bvh.{gone}-00112233445566ff.part")), put("out.bvh.part"), put(".out.bvh.writing-x")];
    place.done("convert a.bvh out.bvh");
    assert!(!left.exists() && others.iter().all(|path| path.exists()));
}
