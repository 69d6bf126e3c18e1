//! Measuring many hours: what stays in memory, what is a sample, and what is refused for its size.

use assert_cmd::Command;
use kinelm::corpus::record::ClipRecord;
use kinelm::corpus::{CorpusWriter, NewClip, Split};
use kinelm_motion::{Clip, Motion, format, synth};
use kinelm_tokenizer::{Tokenizer, TokenizerConfig};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

fn kinelm(dir: &Path, line: &str) -> Command {
    let mut c = Command::cargo_bin("kinelm").unwrap();
    c.env("NO_COLOR", "1").current_dir(dir).args(line.split(' '));
    c
}

fn done(dir: &Path, line: &str) -> String {
    let output = kinelm(dir, line).output().unwrap();
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// What a call that ends with this code says on stderr.
fn refused(dir: &Path, line: &str, code: i32) -> String {
    let output = kinelm(dir, line).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{line}: {said}");
    said
}

fn clip(name: String, key: usize, split: Split, frames: usize) -> NewClip {
    let (take, sha256, labels) = (name.clone(), format!("{key:064}"), BTreeMap::new());
    let record = ClipRecord {
        name,
        labels,
        split,
        take,
        key,
        sha256,
        read: Default::default(),
        frames,
        clipped: 0,
        second_codes: 0,
        source: 0,
        floor_m: None,
        beats: None,
        offset: 0,
        tokens: 0,
        music: None,
    };
    NewClip { record, music: Vec::new() }
}

/// A corpus of clips of the dances' words, of these splits in turn.
fn write(path: &Path, tokenizer: &Tokenizer, dances: &[Clip], splits: &[Split]) {
    let mut writer = CorpusWriter::create(path, tokenizer, &["made".into()], None, false).unwrap();
    for (key, dance) in dances.iter().enumerate() {
        let ids = tokenizer.ids_of_words(&tokenizer.encode(dance).unwrap().words).unwrap();
        let split = splits[key % splits.len()];
        writer.push(clip(format!("clip{key}"), key, split, dance.frames()), &ids).unwrap();
    }
    writer.finish().unwrap();
}

fn dances(clips: usize, seconds: f64) -> Vec<Clip> {
    synth::corpus(5, clips, seconds, 20.0).unwrap().into_iter().map(|dance| dance.clip).collect()
}

fn small_tokenizer(dances: &[Clip]) -> Tokenizer {
    Tokenizer::fit(dances, TokenizerConfig::uniform(&[0, 4, 5], 20.0, 60)).unwrap()
}

/// The most memory that a call took, bytes, as the system tells while it runs.
#[cfg(target_os = "linux")]
fn peak(dir: &Path, line: &str) -> u64 {
    let mut call = std::process::Command::new(assert_cmd::cargo::cargo_bin("kinelm"));
    call.current_dir(dir).args(line.split(' ')).stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = call.spawn().unwrap();
    let mut most = 0;
    let status = loop {
        let text = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let kb =
            text.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse::<u64>().ok());
        most = most.max(kb.unwrap_or(0) * 1024);
        match child.try_wait().unwrap() {
            Some(status) => break status,
            None => std::thread::sleep(Duration::from_millis(2)),
        }
    };
    assert!(status.success(), "{line}");
    most
}

#[test]
#[cfg(target_os = "linux")]
fn four_hours_take_hardly_more_memory_than_one() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    // dances of a minute, a part of each hour in every split
    let all = dances(240, 60.0);
    let tokenizer = small_tokenizer(&all[..20]);
    let mut splits = [Split::Train; 10];
    (splits[3], splits[7]) = (Split::Valid, Split::Test);
    write(&at("one"), &tokenizer, &all[..60], &splits);
    write(&at("four"), &tokenizer, &all, &splits);
    let motion = Motion::new(at("a.bvh"), all[3].slice(0..200));
    format::write(&at("a.bvh"), &motion).unwrap();
    for line in [
        "corpus stats CORPUS --threads 2",
        "evaluate baselines --corpus CORPUS --threads 2",
        "evaluate dance --real CORPUS a.bvh --features --threads 2",
    ] {
        let [one, four] = ["one", "four"].map(|corpus| peak(dir.path(), &line.replace("CORPUS", corpus)));
        let mb = [one, four].map(|bytes| bytes as f64 / 1e6);
        assert!(four < one + 20_000_000, "{line}: {mb:?} MB of one and of four hours");
    }
}

const TRAIN: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 64\n\
                     [train]\nbatch = 2\nsteps = 1\nwarmup = 1\n";

#[test]
fn a_corpus_without_train_clips_is_measured_and_its_floors_come_from_another() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let all = dances(4, 4.0);
    let tokenizer = small_tokenizer(&all);
    write(&at("whole"), &tokenizer, &all, &[Split::Train, Split::Test]);
    write(&at("tests"), &tokenizer, &[all[1].clone(), all[3].clone()], &[Split::Test]);
    let other = Tokenizer::fit(&all, TokenizerConfig::uniform(&[0, 4, 5], 20.0, 90)).unwrap();
    write(&at("other"), &other, &all, &[Split::Train, Split::Test]);
    fs::write(at("c.toml"), TRAIN).unwrap();
    done(dir.path(), "pretrain --config c.toml --corpus whole --run run");

    let call = |more: &str| format!("evaluate likelihood --run run --corpus tests{more}");
    let table = done(dir.path(), &call(""));
    assert!(table.contains("the model") && table.contains("n/a   tests has no train frame to fit on"), "{table}");
    let line: Value = serde_json::from_str(&done(dir.path(), &call(" --json"))).unwrap();
    assert!(
        line["floors"].is_null() && line["bits"]["order0"].is_null() && line["bits"]["model"].is_number(),
        "{line}"
    );
    let from: Value = serde_json::from_str(&done(dir.path(), &call(" --floors-from whole --json --trust"))).unwrap();
    let whole = done(dir.path(), "evaluate likelihood --run run --corpus whole --json");
    let whole: Value = serde_json::from_str(&whole).unwrap();
    assert_eq!(
        (&from["floors"], &from["bits"], &from["bits_per_frame"]),
        (&whole["floors"], &whole["bits"], &whole["bits_per_frame"])
    );
    assert!(done(dir.path(), &call(" --floors none")).contains("n/a   --floors none"));

    let said = refused(dir.path(), "evaluate baselines --corpus tests", 1);
    assert!(said.contains("tests has no train frame to fit on; --floors-from CORPUS names one"), "{said}");
    let of = |line: &str| done(dir.path(), line);
    assert_eq!(of("evaluate baselines --corpus tests --floors-from whole"), of("evaluate baselines --corpus whole"));
    let said = refused(dir.path(), "evaluate baselines --corpus tests --floors-from other", 2);
    assert!(said.contains("--floors-from other: a corpus of tokenizer"), "{said}");
    refused(dir.path(), "evaluate baselines --corpus whole --floors none", 2);
}

#[test]
fn a_file_of_many_pieces_is_read_once() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let dance = dances(1, 60.0).remove(0);
    let tokenizer = small_tokenizer(std::slice::from_ref(&dance));
    fs::create_dir(at("data")).unwrap();
    let motion = Motion::new(at("data/a.bvh"), dance);
    format::write(&at("data/a.bvh"), &motion).unwrap();
    fs::write(at("tokenizer.json"), tokenizer.to_json()).unwrap();
    // between the frames, each of which becomes a clip
    let row = |i: usize| format!("a,{:.2},{:.2}\n", i as f64 * 0.05 + 0.01, i as f64 * 0.05 + 0.03);
    fs::write(at("out.csv"), "clip,from_s,to_s\n".to_string() + &(0..1_000).map(row).collect::<String>()).unwrap();
    let started = std::time::Instant::now();
    done(dir.path(), "tokenize data --tokenizer tokenizer.json --exclude out.csv --out corpus --threads 1");
    assert!(started.elapsed() < Duration::from_secs(10), "{:?}", started.elapsed());
    let stats: Value = serde_json::from_str(&done(dir.path(), "corpus stats corpus --json")).unwrap();
    assert!(stats["count"]["clips"].as_u64().unwrap() > 100, "{stats}");
}

#[test]
fn what_is_too_large_is_refused_with_its_bound() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("plan.toml"), "[[segment]]\n".repeat(1_000_000)).unwrap();
    let said = refused(dir.path(), "generate timeline plan.toml --check", 1);
    assert!(said.contains("plan.toml: found 12000000 bytes, expected a timeline of at most 1048576 bytes"), "{said}");

    let deep = (0..100).fold(at("deep"), |path, _| path.join("d"));
    fs::create_dir_all(&deep).unwrap();
    let said = refused(dir.path(), "tokenizer fit deep --out t.json", 1);
    assert!(said.contains("found folders in more than 64 others"), "{said}");
}
