//! `kinelm classify` as a user runs it.

use crate::support::json;
use assert_cmd::Command;
use kinelm_motion::{Motion, format, synth};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fs;
use std::path::PathBuf;

const TRAIN: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 128\n\
                     [train]\nbatch = 2\nsteps = 2\nwarmup = 1\neval_every = 2\ncheckpoint_every = 2\n";

/// Eight short dances of two genres, their corpus and a run of two steps.
struct Data(tempfile::TempDir);

impl Data {
    fn new() -> Data {
        let data = Data(tempfile::tempdir().unwrap());
        fs::create_dir(data.at("data")).unwrap();
        let mut csv = "clip,split,genre,dancer,skip\n".to_string();
        for (i, dance) in synth::corpus(4, 8, 2.0, 30.0).unwrap().into_iter().enumerate() {
            let path = data.at(&format!("data/d{i}.bvh"));
            let motion = Motion::new(&path, dance.clip);
            format::write(&path, &motion).unwrap();
            let split = ["train", "train", "train", "train", "valid", "valid", "test", "test"][i];
            csv += &format!("d{i},{split},{},one,{}\n", ["salsa", "waltz"][i % 2], ["0", "12"][i % 2]);
        }
        fs::write(data.at("labels.csv"), csv).unwrap();
        fs::write(data.at("train.toml"), TRAIN).unwrap();
        data.run("tokenizer fit data --labels labels.csv --joints 13 --fps 10 --out tokenizer.json").success();
        data.run("tokenize data --labels labels.csv --tokenizer tokenizer.json --out corpus").success();
        data.run("pretrain --config train.toml --corpus corpus --run run").success();
        data
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A call in the folder of the data.
    fn call(&self, line: &str) -> Command {
        let mut c = Command::cargo_bin("kinelm").unwrap();
        c.env("NO_COLOR", "1").current_dir(self.0.path()).args(line.split(' '));
        c
    }

    fn run(&self, line: &str) -> assert_cmd::assert::Assert {
        self.call(line).assert()
    }

    fn train(&self, more: &str) -> assert_cmd::assert::Assert {
        self.run(&format!("classify train --run run --corpus corpus --steps 2 --batch 2 {more}"))
    }
}

#[test]
fn a_classifier_its_figures_and_a_name() {
    let data = Data::new();
    data.train("--fields genre --out who").success().stderr(contains("genre: training clips of salsa 2, waltz 2"));

    let eval = "classify eval --classifier who --corpus corpus --baselines --run run";
    data.run(&format!("{eval} --plot confusion.png")).success().stdout(
        contains("2 test clips; learned from 4 train clips")
            .and(contains("majority class"))
            .and(contains("LDA of the model's vectors"))
            .and(contains("class tokens by clip, a row per true class, a column per predicted one"))
            .and(contains("class tokens and LDA by clip, a row per true class, a column per predicted one")),
    );
    assert!(fs::read(data.at("confusion.png")).unwrap().starts_with(b"\x89PNG"));
    data.run(&format!("{eval} --plot confusion.svg")).success();
    let svg = fs::read_to_string(data.at("confusion.svg")).unwrap();
    assert!(svg.contains("genre by class tokens: ") && svg.contains("genre by class tokens and LDA: "), "{svg}");
    let figures = json(data.call(eval).arg("--json"));
    assert_eq!((&figures["schema"], &figures["clips"]), (&1.into(), &serde_json::json!([4, 2])));
    let rows = figures["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 7);
    for row in rows {
        let confusion: u64 = row["clips"]["confusion"]
            .as_array()
            .unwrap()
            .iter()
            .flat_map(|r| r.as_array().unwrap())
            .map(|n| n.as_u64().unwrap())
            .sum();
        assert_eq!(confusion, 2, "{row}");
    }

    data.run("classify predict --classifier who data/d6.bvh data/d7.bvh")
        .success()
        .stdout(contains("data/d6.bvh (2.0 s)").and(contains("a letter a second")).and(contains("data/d7.bvh (1.6 s)")))
        .stderr(contains("data/d7.bvh: read as the model's corpus read it: skip 12"));
    let whole = "classify predict --classifier who data/d7.bvh --skip 0";
    data.run(whole).success().stdout(contains("data/d7.bvh (2.0 s)")).stderr(contains("corpus").not());
    let named = json(&mut data.call("classify predict --classifier who data/d6.bvh --json"));
    let field = &named["fields"][0];
    let sum: f64 = field["probabilities"].as_array().unwrap().iter().map(|p| p[1].as_f64().unwrap()).sum();
    assert!((sum - 1.0).abs() < 1e-9, "{named}");
    assert_eq!(
        (field["class"].clone(), field["strip"].as_array().unwrap().len()),
        (field["probabilities"][0][0].clone(), 2)
    );

    // the same call gives the same weights, on any number of threads
    data.train("--fields genre --out again --threads 1").success();
    let weights = |folder: &str| {
        let file = fs::read_dir(data.at(folder)).unwrap().map(|e| e.unwrap().path());
        fs::read(file.into_iter().find(|p| p.extension().is_some_and(|e| e == "safetensors")).unwrap()).unwrap()
    };
    assert!(weights("who") == weights("again"));
}

#[test]
fn what_cannot_be_learnt_is_said() {
    let data = Data::new();
    let refused = |more: &str, code, says: &str| {
        data.train(more).failure().code(code).stderr(contains(says));
        assert!(!data.at("x").exists(), "{more} left a folder");
    };
    refused(
        "--fields mood --out x",
        1,
        "no training clip has the label `mood`, expected training clips of two classes of `mood` or more; they have dancer, genre",
    );
    refused("--fields dancer --out x", 1, "the training clips have one dancer alone, one");
    refused("--fields genre,genre --out x", 2, "--fields is genre, given twice");
    refused("--fields genre --only genre --out x", 2, "expected FIELD=VALUE, such as genre=salsa");
    refused("--fields genre --only genre=polka --out x", 1, "no such clip, expected clips with genre=polka");
    refused("--fields genre --share 0 --out x", 2, "--share is 0; expected above 0");
    refused("--fields genre --rate=-1 --out x", 2, "--rate");
    refused("--fields genre, --out x", 2, "--fields");
    refused("--fields genre --rate 1e30 --out x", 1, "try a lower learning rate");
    data.train("--fields genre --share 0.5 --out half")
        .success()
        .stderr(contains("training clips of salsa 1, waltz 1"));
    fs::create_dir(data.at("there")).unwrap();
    data.train("--fields genre --out there")
        .code(2)
        .stderr(contains("there is there already; give another --out, or remove it"));
    assert!(fs::read_dir(data.at("there")).unwrap().next().is_none());

    data.run("tokenizer fit data --labels labels.csv --joints root,legs --fps 10 --out other.json").success();
    data.run("tokenize data --labels labels.csv --tokenizer other.json --out other").success();
    data.run("classify train --run run --corpus other --fields genre --out x")
        .failure()
        .stderr(contains("a corpus of tokenizer").and(contains("expected that of the model")));
    data.run("classify train --run nowhere --corpus corpus --fields genre --out x")
        .failure()
        .stderr(contains("nowhere"));
    assert!(!data.at("x").exists());
}

#[test]
fn what_cannot_be_named_is_said() {
    let data = Data::new();
    data.train("--fields genre --out who").success();
    let refused = |line: &str, says: &str| {
        data.run(line).failure().stderr(contains(says).and(contains("panicked").not()));
    };
    refused("classify eval --classifier run --corpus corpus", "run");
    refused("classify eval --classifier who --corpus data", "corpus folder");
    refused("classify eval --classifier who --corpus corpus --plot a.jpg", "expected a name ending in .png or .svg");
    refused("classify eval --classifier who --corpus corpus --plot corpus/clips.jsonl/a.png", "is a file, no folder");
    fs::write(data.at("empty.bvh"), "").unwrap();
    refused("classify predict --classifier who empty.bvh", "empty.bvh");
    refused("classify predict --classifier who nothing.bvh", "nothing.bvh");
    let text = fs::read_to_string(data.at("data/d6.bvh")).unwrap();
    let (hierarchy, _) = text.split_once("MOTION").unwrap();
    fs::write(data.at("zero.bvh"), format!("{hierarchy}MOTION\nFrames: 0\nFrame Time: 0.0333333\n")).unwrap();
    refused("classify predict --classifier who zero.bvh", "zero.bvh: found 0 frames");
    data.run("classify predict --classifier who zero.bvh data/d7.bvh")
        .code(1)
        .stdout(contains("data/d7.bvh (1.6 s)"))
        .stderr(contains("zero.bvh: found 0 frames").and(contains("1 file could not be used")));

    // a corpus that is gone is told once
    fs::rename(data.at("corpus"), data.at("elsewhere")).unwrap();
    let assert = data.run("classify predict --classifier who data/d6.bvh data/d7.bvh").success();
    let said = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert_eq!(
        said.matches("corpus: the model's corpus can't be read: whether it has these files").count(),
        1,
        "{said}"
    );

    // what is cut or of another version
    let about = fs::read_to_string(data.at("who/classifier.json")).unwrap();
    fs::write(
        data.at("who/classifier.json"),
        about.replacen("\"schema\": 3", "\"schema\": 9", 1).replacen("\"schema\":3", "\"schema\":9", 1),
    )
    .unwrap();
    refused("classify predict --classifier who data/d6.bvh", "schema 9");
    fs::write(data.at("who/classifier.json"), &about[..about.len() / 2]).unwrap();
    refused("classify predict --classifier who data/d6.bvh", "classifier.json");
    fs::write(data.at("who/classifier.json"), &about).unwrap();
    let weights = fs::read_dir(data.at("who"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .find(|p| p.extension().is_some_and(|e| e == "safetensors"))
        .unwrap();
    let bytes = fs::read(&weights).unwrap();
    fs::write(&weights, &bytes[..bytes.len() - 8]).unwrap();
    refused("classify predict --classifier who data/d6.bvh", "safetensors");
}
