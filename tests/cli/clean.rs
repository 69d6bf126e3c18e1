//! Clips that are not clean, from the list of what is wrong to a corpus that does without.

use assert_cmd::Command;
use kinelm_motion::{Clip, Motion, Quat, format, synth};
use predicates::str::contains;
use std::fs;
use std::path::Path;

fn call(dir: &Path, words: &str) -> Command {
    let mut c = Command::cargo_bin("kinelm").unwrap();
    c.env("NO_COLOR", "1").current_dir(dir).args(words.split_whitespace());
    c
}

/// Three dances of ten seconds, the thigh of the first turned around for three frames.
fn data(dir: &Path) {
    fs::create_dir(dir.join("data")).unwrap();
    for (i, dance) in synth::corpus(9, 3, 10.0, 20.0).unwrap().into_iter().enumerate() {
        let (clip, j) = (&dance.clip, dance.clip.joints());
        let mut rotations = clip.rotations().to_vec();
        for f in (60..63).filter(|_| i == 0) {
            rotations[f * j + 1] *= Quat::from_rotation_x(2.8);
        }
        let clip = Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations).unwrap();
        let path = dir.join(format!("data/{i}.json"));
        format::write(&path, &Motion::new(&path, clip)).unwrap();
    }
    fs::write(dir.join("l.csv"), "clip,split\n0,train\n1,train\n2,valid\n").unwrap();
}

#[test]
fn a_corpus_does_without_what_is_listed_and_says_so() {
    let tmp = tempfile::tempdir().unwrap();
    let dir = tmp.path();
    data(dir);
    let clean = "corpus clean data --labels l.csv --out odd.csv";
    call(dir, clean)
        .assert()
        .success()
        .stderr(contains("glitches: 1 range of 1 clip"))
        .stderr(contains("in all 1 range"));
    let csv = fs::read_to_string(dir.join("odd.csv")).unwrap();
    assert!(csv.starts_with("clip,from_s,to_s,why\n0,2.95,3.2,left_hip 160 degrees in one frame"), "{csv}");
    // the same list again is no trouble, a stranger's file is
    call(dir, clean).assert().success();
    call(dir, "corpus clean data --labels l.csv --out l.csv --force")
        .assert()
        .code(2)
        .stderr(contains("this call reads it"));

    call(dir, "tokenizer fit data --labels l.csv --out t.json").assert().success();
    call(dir, "corpus clean data --labels l.csv --tokenizer t.json --out odd.csv").assert().success();
    let tokenize = "tokenize data --labels l.csv --tokenizer t.json";
    call(dir, &format!("{tokenize} --out whole")).assert().success();
    fs::write(dir.join("more.csv"), csv + "gone,0,1,\n").unwrap();
    call(dir, &format!("{tokenize} --exclude more.csv --out part"))
        .assert()
        .success()
        .stderr(contains("more.csv: 1 range of 1 clip excluded"))
        .stderr(contains("more.csv: 1 rows have no file: gone (line 3)"))
        .stderr(contains("part: 4 clips, 595 frames"));
    let manifest = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&fs::read(dir.join(name).join("corpus.json")).unwrap()).unwrap()
    };
    assert_eq!((manifest("whole").get("excluded"), &manifest("whole")["count"]["frames"]), (None, &600.into()));
    let told = &manifest("part")["excluded"][0];
    assert_eq!((&told["clip"], &told["from_s"], &told["to_s"]), (&"0".into(), &2.95.into(), &3.2.into()));
    let names: Vec<String> = fs::read_to_string(dir.join("part/clips.jsonl"))
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["name"].as_str().unwrap().to_string())
        .collect();
    assert_eq!(names, ["0@0s-2.95s", "0@3.2s-end", "1", "2"]);
    call(dir, "corpus stats part").assert().success().stdout(contains("glitches: none"));

    // shards agree on it
    for i in 0..2 {
        call(dir, &format!("{tokenize} --exclude more.csv --shard {i}/2 --out s{i}")).assert().success();
    }
    call(dir, "corpus merge s1 s0 --out merged").assert().success();
    for file in ["corpus.json", "clips.jsonl", "tokens.u16"] {
        assert!(
            fs::read(dir.join("merged").join(file)).unwrap() == fs::read(dir.join("part").join(file)).unwrap(),
            "{file}"
        );
    }
    call(dir, &format!("{tokenize} --shard 1/2 --out other")).assert().success();
    call(dir, "corpus merge s0 other --out wrong").assert().failure().stderr(contains("the same `exclude`"));
}

#[test]
fn ranges_that_are_wrong_are_told_with_their_place() {
    let tmp = tempfile::tempdir().unwrap();
    let dir = tmp.path();
    data(dir);
    call(dir, "tokenizer fit data --labels l.csv --out t.json").assert().success();
    let refused = |csv: &str, message: &str| {
        fs::write(dir.join("x.csv"), csv).unwrap();
        let call = call(dir, "tokenize data --labels l.csv --tokenizer t.json --exclude x.csv --strict --out c");
        { call }.assert().failure().stderr(contains(message));
        assert!(!dir.join("c").exists());
    };
    refused("clip,from_s,to_s\n0,2,1\n", "x.csv:2:5: found to_s `1`, expected more than from_s, 2");
    refused("clip,from\n", "x.csv:1:6: found column `from`");
    fs::write(dir.join("x.csv"), "clip,from_s,to_s\n0,20,21\n").unwrap();
    call(dir, "tokenize data --labels l.csv --tokenizer t.json --exclude x.csv --strict --out behind")
        .assert()
        .success()
        .stderr(contains("line 2 of the excluded ranges begins at 20 s of a clip of 10.00 s"));
    let whole = call(dir, "corpus stats behind").assert().success().get_output().stdout.clone();
    assert!(String::from_utf8(whole).unwrap().contains("600 frames"));
    fs::remove_file(dir.join("x.csv")).unwrap();
    call(dir, "tokenize data --tokenizer t.json --exclude x.csv --out c").assert().failure().stderr(contains("x.csv"));
}
