//! Training as a user goes: killed, gone on with, watched.

mod crash;
mod watch;

use crate::support::kinelm;
use assert_cmd::Command;
use kinelm_motion::{Motion, format, synth};
use predicates::str::contains;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A folder with a corpus of short made-up dances.
struct Place {
    dir: tempfile::TempDir,
}

impl Place {
    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// A training file of a tiny model with these keys of `[train]`, and tables behind them.
    fn config(&self, name: &str, train: &str) -> PathBuf {
        let path = self.at(name);
        let model = "[model]\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 90\ndropout = 0.1\n";
        fs::write(&path, format!("{model}[train]\nbatch = 2\nwarmup = 5\n{train}")).unwrap();
        path
    }

    fn pretrain(&self, config: &Path, run: &Path) -> Command {
        let mut c = kinelm();
        c.arg("pretrain").arg("--config").arg(config).arg("--corpus").arg(self.at("corpus")).arg("--run").arg(run);
        c
    }

    fn resume(&self, run: &Path) -> Command {
        let mut c = kinelm();
        c.arg("pretrain").arg("resume").arg(run);
        c
    }
}

fn place() -> &'static Place {
    static PLACE: OnceLock<Place> = OnceLock::new();
    PLACE.get_or_init(|| {
        let place = Place { dir: tempfile::tempdir().unwrap() };
        let data = place.at("data");
        let mut labels = "clip,split\n".to_string();
        for (i, dance) in synth::corpus(3, 6, 3.0, 20.0).unwrap().into_iter().enumerate() {
            let path = data.join(format!("d{i}.bvh"));
            fs::create_dir_all(&data).unwrap();
            let motion = Motion::new(&path, dance.clip);
            format::write(&path, &motion).unwrap();
            labels += &format!("d{i},{}\n", ["valid", "test", "train"][i.min(2)]);
        }
        fs::write(place.at("labels.csv"), labels).unwrap();
        let of_data = |c: &mut Command| {
            c.arg(&data).arg("--labels").arg(place.at("labels.csv"));
        };
        let mut c = kinelm();
        of_data(c.args(["tokenizer", "fit", "--joints", "13"]));
        c.arg("--out").arg(place.at("t.json")).assert().success();
        let mut c = kinelm();
        of_data(c.arg("tokenize"));
        c.arg("--tokenizer").arg(place.at("t.json")).arg("--out").arg(place.at("corpus")).assert().success();
        place
    })
}

#[test]
fn folders_that_an_output_lacks_are_made() {
    let place = place();
    let called = |args: &[&str], outs: &[(&str, &str)]| {
        let mut c = kinelm();
        c.args(args);
        for (flag, out) in outs {
            c.arg(flag).arg(place.at(out));
        }
        c.assert().success();
        outs.iter().for_each(|(_, out)| assert!(place.at(out).exists(), "{out}"));
    };
    let data = place.at("data").display().to_string();
    called(&["tokenizer", "fit", "--joints", "13", &data], &[("--out", "new/a/t.json")]);
    called(&["tokenize", &data], &[("--tokenizer", "new/a/t.json"), ("--out", "new/b/corpus")]);
    let config = place.config("parents.toml", "steps = 2\n").display().to_string();
    let corpus = ("--corpus", "new/b/corpus");
    called(&["pretrain", "--config", &config], &[corpus, ("--run", "new/c/run")]);
    called(&["lr-find", "--config", &config, "--steps", "3"], &[corpus, ("--out", "new/d/lr.svg")]);
    called(&["runs", "plot", &place.at("new/c/run").display().to_string()], &[("--out", "new/e/curves.svg")]);
    called(&["export"], &[("--run", "new/c/run"), ("--out", "new/f/own")]);
    called(&["generate", "--frames", "4"], &[("--run", "new/c/run"), ("--out", "new/g/dance.bvh")]);
}

#[test]
fn keys_are_set_over_those_of_the_file_and_some_when_a_run_is_resumed() {
    let place = place();
    let (config, run, fine) = (place.config("set.toml", "steps = 9\n"), place.at("set"), place.at("set-fine"));
    let settings =
        |run: &Path| -> toml::Table { fs::read_to_string(run.join("config.toml")).unwrap().parse().unwrap() };
    let sets =
        |pairs: &[&str]| pairs.iter().flat_map(|pair| ["--set".to_string(), pair.to_string()]).collect::<Vec<_>>();
    let set = sets(&["train.steps=2", "model.dropout=0", "augment.mirror=0.5", "train.schedule=constant"]);
    place.pretrain(&config, &run).args(set).assert().success();
    let found = settings(&run);
    assert_eq!(
        (found["train"]["steps"].as_integer(), found["train"]["schedule"].as_str()),
        (Some(2), Some("constant"))
    );
    assert_eq!((found["model"]["dropout"].as_float(), found["augment"]["mirror"].as_float()), (Some(0.0), Some(0.5)));
    let set = sets(&["train.steps=3", "train.learning_rate=1e-5", "train.checkpoint_every=1"]);
    place.resume(&run).args(set).assert().success();
    let found = settings(&run);
    let train = &found["train"];
    assert_eq!((train["steps"].as_integer(), train["learning_rate"].as_float()), (Some(3), Some(1e-5)));
    let mut finetune = kinelm();
    finetune.args(["finetune", "--config", "finetune", "--set", "train.steps=1", "--from"]).arg(&run);
    finetune.arg("--corpus").arg(place.at("corpus")).arg("--run").arg(&fine).assert().success();
    assert_eq!(settings(&fine)["train"]["steps"].as_integer(), Some(1));
    for (set, says) in [
        ("train.batch=0", "--set train.batch is 0; expected 1 to 65536"),
        ("train.stepz=1", "--set train.stepz=1: unknown field stepz"),
        ("batch=3", "--set is batch=3; expected a key of [model], [train] or [augment]"),
    ] {
        place.pretrain(&config, &place.at("never")).args(sets(&[set])).assert().code(2).stderr(contains(says));
    }
    let stays = place.resume(&run).args(sets(&["model.width=32"])).assert().code(2);
    stays.stderr(contains("--set model.width: weights, optimizer, windows and measurements depend on it"));
    assert!(!place.at("never").exists());
}

/// The files of a run's last checkpoint, by name.
fn latest(run: &Path) -> Vec<(String, Vec<u8>)> {
    let name = fs::read_to_string(run.join("latest")).unwrap();
    let mut files: Vec<_> = fs::read_dir(run.join("checkpoints").join(name.trim()))
        .unwrap()
        .map(|e| e.unwrap().path())
        .map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), fs::read(&p).unwrap()))
        .collect();
    files.sort();
    files
}

/// The lines of `metrics.jsonl` without what a clock said.
fn metrics(run: &Path) -> Vec<serde_json::Value> {
    let text = fs::read_to_string(run.join("metrics.jsonl")).unwrap();
    let line = |line: &str| {
        let mut line: serde_json::Value = serde_json::from_str(line).unwrap();
        line.as_object_mut().unwrap().remove("tokens_per_second");
        line
    };
    text.lines().map(line).collect()
}

fn assert_same(run: &Path, straight: &Path) {
    for ((name, found), (expected_name, expected)) in latest(run).iter().zip(&latest(straight)) {
        assert_eq!(name, expected_name);
        assert!(found == expected, "{name} of {} differs", run.display());
    }
    assert_eq!(latest(run).len(), latest(straight).len());
    assert_eq!(metrics(run), metrics(straight));
}
