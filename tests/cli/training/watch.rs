//! Looking at runs: lists, curves, dances on the way, and rates before there is a run.

use super::{kinelm, metrics, place};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::process::Stdio;
use std::time::Duration;

#[test]
fn runs_are_listed_and_drawn() {
    let place = place();
    let keys = "eval_every = 4\ncheckpoint_every = 5\nsteps = 8\n";
    let config = place.config("watch.toml", keys);
    for run in ["watched/a", "watched/b"] {
        fs::create_dir_all(place.at("watched")).unwrap();
        place.pretrain(&config, &place.at(run)).assert().success();
    }
    let list = || {
        let mut c = kinelm();
        c.args(["runs", "list"]).arg(place.at("watched"));
        c
    };
    list().assert().success().stdout(contains("watched/a").and(contains("done")).and(contains("8/8")));
    let json = list().arg("--json").output().unwrap().stdout;
    let runs: Vec<serde_json::Value> =
        String::from_utf8(json).unwrap().lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(runs.len(), 2);
    assert_eq!((&runs[0]["schema"], &runs[0]["step"], &runs[0]["status"]), (&1.into(), &8.into(), &"done".into()));
    assert!(runs[0]["best"]["bits_per_frame"].as_f64().is_some_and(|b| b > 0.0));
    // half a line, as of a run that is being written
    let metrics = place.at("watched/b/metrics.jsonl");
    let text = fs::read_to_string(&metrics).unwrap();
    fs::write(&metrics, &text[..text.len() - 40]).unwrap();
    let plot = |out: &str, more: &[&str]| {
        let mut c = kinelm();
        c.args(["runs", "plot"]).arg(place.at("watched/a")).arg(place.at("watched/b"));
        c.arg("--out").arg(place.at(out)).args(more);
        c
    };
    plot("c.svg", &["--metric", "bits_per_frame", "--over", "tokens"]).assert().success();
    let svg = fs::read_to_string(place.at("c.svg")).unwrap();
    assert!(svg.contains("a valid\n") && svg.contains("b\n") && svg.contains("bits a frame"));
    plot("c.png", &[]).assert().success();
    assert!(fs::read(place.at("c.png")).unwrap().starts_with(b"\x89PNG"));
    plot("c.pdf", &[]).assert().code(2).stderr(contains("expected a name ending in .png or .svg"));
    let mut none = kinelm();
    none.args(["runs", "plot"]).arg(place.at("data")).arg("--out").arg(place.at("n.png"));
    none.assert().code(1).stderr(contains("no metrics.jsonl, expected a run folder"));
}

#[test]
fn a_run_says_who_began_it_and_can_be_moved_with_its_corpus() {
    let place = place();
    let run = place.at("moved/run");
    let config = place.config("moved.toml", "steps = 6\nkeep = 1\ncheckpoint_every = 2\neval_every = 0\n");
    place.pretrain(&config, &run).args(["--steps", "4"]).assert().success();
    let text = fs::read_to_string(run.join("config.toml")).unwrap();
    assert!(text.contains("path = \"../../corpus\"") && !text.contains("kinelm ="), "{text}");
    let calls = || -> serde_json::Value {
        let bytes = fs::read(run.join("provenance.json")).unwrap();
        serde_json::from_slice::<serde_json::Value>(&bytes).unwrap()["calls"].clone()
    };
    assert_eq!(calls().as_array().unwrap().len(), 1);
    assert_eq!(calls()[0]["command"][1], "pretrain");
    for key in ["kinelm", "date", "host"] {
        assert!(calls()[0][key].as_str().is_some_and(|text| !text.is_empty()), "{key}: {}", calls());
    }
    // a dance of a checkpoint that the run, trained on, no longer has
    let dance = place.at("moved/dance.bvh");
    let mut c = kinelm();
    c.args(["generate", "--frames", "10", "--out"]).arg(&dance).arg("--run").arg(&run).assert().success();
    place.resume(&run).args(["--steps", "6"]).assert().success();
    assert_eq!(calls().as_array().unwrap().len(), 2, "{}", calls());
    // a corpus that has moved is named once
    fs::create_dir(place.at("moved/corpus")).unwrap();
    for entry in fs::read_dir(place.at("corpus")).unwrap().map(|entry| entry.unwrap().path()) {
        fs::copy(&entry, place.at("moved/corpus").join(entry.file_name().unwrap())).unwrap();
    }
    let text = fs::read_to_string(run.join("config.toml")).unwrap().replace("../../corpus", "../gone");
    fs::write(run.join("config.toml"), text).unwrap();
    place.resume(&run).args(["--steps", "8"]).assert().code(1).stderr(contains("--corpus, also to resume a run"));
    let mut named = place.resume(&run);
    named.args(["--steps", "8", "--corpus"]).arg(place.at("moved/corpus")).assert().success();
    let text = fs::read_to_string(run.join("config.toml")).unwrap();
    assert!(text.contains("path = \"../corpus\""), "{text}");
    place.resume(&run).args(["--steps", "10"]).assert().success();
    let beside = format!("{}.kinelm.json", dance.display());
    let said = kinelm().args(["again", &beside]).assert().code(1);
    let said = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    assert!(
        said.contains("no checkpoint of step 4, expected one of step 4; there are") && said.contains("key keep"),
        "{said}"
    );
}

#[test]
fn settings_are_shown_and_fields_are_given_in_the_call() {
    let place = place();
    let shown = kinelm().args(["config", "show", "tiny"]).assert().success().get_output().stdout.clone();
    assert_eq!(shown, fs::read("configs/train/tiny.toml").unwrap());
    kinelm().args(["config", "show", "tinny"]).assert().code(2).stderr(contains("did you mean tiny?"));
    for command in ["pretrain", "finetune"] {
        kinelm().args([command, "--help"]).assert().success().stdout(contains("goal").and(contains("--conditions")));
    }
    kinelm().args(["pretrain", "--help"]).assert().success().stdout(contains("two-level"));
    let config = place.config("fields.toml", "steps = 2\n");
    let run = place.at("fields");
    let refused = place.pretrain(&config, &run).args(["--conditions", "mood"]).assert().code(1);
    refused.stderr(contains("no training clip has the label `mood` of train.conditions"));
    let labels = ["--labels", "{genre}.bvh"];
    let (tokenizer, corpus) = (place.at("fields.json"), place.at("fields-corpus"));
    let fit = ["tokenizer", "fit", "--joints", "13", "--out"];
    kinelm().args(fit).arg(&tokenizer).arg(place.at("data")).args(labels).assert().success();
    let mut c = kinelm();
    c.arg("tokenize").arg(place.at("data")).args(labels).arg("--tokenizer").arg(&tokenizer);
    c.arg("--out").arg(&corpus).assert().success();
    let mut c = kinelm();
    c.args(["pretrain", "--conditions", "genre", "--config"]).arg(&config).arg("--corpus").arg(&corpus);
    c.arg("--run").arg(&run).assert().success();
    assert!(fs::read_to_string(run.join("config.toml")).unwrap().contains("conditions = [\"genre\"]"));
    let mut resumed = place.resume(&run);
    resumed.args(["--conditions", "genre"]).assert().code(2).stderr(contains("--conditions"));
}

#[test]
fn dances_on_the_way_change_nothing() {
    let place = place();
    let keys = "eval_every = 3\ncheckpoint_every = 0\nsteps = 12\nema = 0.5\n";
    let (with, without) = (place.at("with"), place.at("without"));
    let sampled = place.config("with.toml", &format!("{keys}sample_every = 2\n"));
    place.pretrain(&sampled, &with).assert().success().stderr(contains("step-00000006.html: a dance of the model"));
    place.pretrain(&place.config("without.toml", keys), &without).assert().success();
    assert_eq!(metrics(&with), metrics(&without));
    let mut names: Vec<String> = fs::read_dir(with.join("samples"))
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, ["step-00000006.bvh", "step-00000006.html", "step-00000012.bvh", "step-00000012.html"]);
    assert!(fs::read_to_string(with.join("samples/step-00000006.html")).unwrap().contains("step 6"));
    kinelm().arg("inspect").arg(with.join("samples/step-00000012.bvh")).assert().success().stdout(contains("100"));
    // where no dance can be written the run goes on
    let broken = place.at("broken");
    place.pretrain(&sampled, &broken).args(["--steps", "1"]).assert().success();
    fs::remove_dir_all(broken.join("samples")).unwrap();
    fs::write(broken.join("samples"), "no folder").unwrap();
    let mut c = place.resume(&broken);
    c.args(["--steps", "12"]).assert().success().stderr(contains("no dance after step 6: "));
}

#[test]
fn a_rate_is_found() {
    let place = place();
    let config = place.config("rate.toml", "");
    let find = |out: &str, more: &[&str]| {
        let mut c = kinelm();
        c.arg("lr-find").arg("--config").arg(&config).arg("--corpus").arg(place.at("corpus"));
        c.arg("--out").arg(place.at(out)).args(["--steps", "60"]).args(more);
        c
    };
    find("lr.svg", &["--to", "100"]).assert().success().stdout(contains("suggestion ").and(contains("1.00e-7")));
    let svg = fs::read_to_string(place.at("lr.svg")).unwrap();
    assert!(svg.contains("turn ") && svg.contains("suggestion ") && svg.contains("smoothed"));
    let output = find("lr.png", &["--to", "100", "--json"]).output().unwrap();
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let turn = found["turn"].as_f64().unwrap();
    assert_eq!(found["suggestion"].as_f64(), Some(turn / 10.0));
    assert_eq!(found["steps"][0]["rate"].as_f64(), Some(1e-7));
    find("lr.gif", &["--to", "100"]).assert().code(2);
    find("lr2.svg", &["--from", "1", "--to", "0.1"]).assert().failure().stderr(contains("--from is 1 and --to 0.1"));
}

#[test]
fn a_wait_is_told_without_a_terminal_and_quiet_silences_it() {
    let place = place();
    let config = place.config("wait.toml", "");
    let find = |quiet: bool| {
        let mut c = std::process::Command::new(assert_cmd::cargo::cargo_bin("kinelm"));
        c.arg("lr-find").arg("--config").arg(&config).arg("--corpus").arg(place.at("corpus"));
        c.arg("--out").arg(place.at("wait.svg")).args(["--steps", "50000"]).args(quiet.then_some("--quiet"));
        let mut child = c.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        (child.stderr.take().unwrap(), child)
    };
    let (stderr, mut child) = find(false);
    // before the first step, on a busy machine, a line can't say how long it takes
    let is_told = |line: &String| line.contains(" of 50000 steps, ") && line.ends_with(" left");
    let told = BufReader::new(stderr).lines().map(Result::unwrap).find(is_told);
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(told.is_some_and(|line| line.starts_with("kinelm: ")));
    let (mut stderr, mut child) = find(true);
    std::thread::sleep(Duration::from_millis(2500));
    child.kill().unwrap();
    child.wait().unwrap();
    let mut said = String::new();
    stderr.read_to_string(&mut said).unwrap();
    assert_eq!(said, "");
}

#[test]
fn a_checkpoint_is_named_and_gone_on_from() {
    let place = place();
    let at = |name: &str| place.at(&format!("chosen/{name}"));
    let call = |words: &str, paths: &[(&str, &str)]| {
        let mut c = kinelm();
        c.args(words.split(' '));
        paths.iter().for_each(|(flag, name)| {
            c.arg(flag).arg(at(name));
        });
        c
    };
    let corpus = place.at("corpus");
    let config = place.config("chosen.toml", "steps = 6\nkeep = \"all\"\ncheckpoint_every = 2\neval_every = 3\n");
    place.pretrain(&config, &at("run")).assert().success();
    // a dance of each: the sidecar has the step, and the same is made again
    let dance = |out: &str, which: &[&str]| {
        call("generate --frames 8", &[("--run", "run"), ("--out", out)]).args(which).assert().success();
        let sidecar = fs::read_to_string(at(&format!("{out}.kinelm.json"))).unwrap();
        serde_json::from_str::<serde_json::Value>(&sidecar).unwrap()["step"].as_u64().unwrap()
    };
    let best: u64 = fs::read_to_string(at("run/best")).unwrap().trim().trim_start_matches("step-").parse().unwrap();
    assert_eq!(dance("two.bvh", &["--checkpoint", "2"]), 2);
    assert_eq!(dance("latest.bvh", &["--checkpoint", "latest"]), 6);
    assert_eq!((dance("best.bvh", &["--checkpoint", "best"]), dance("auto.bvh", &[])), (best, best));
    let bytes = |name: &str| fs::read(at(name)).unwrap();
    assert!(bytes("best.bvh") == bytes("auto.bvh") && bytes("two.bvh") != bytes("latest.bvh"));
    let two = bytes("two.bvh");
    fs::remove_file(at("two.bvh")).unwrap();
    kinelm().arg("again").arg(at("two.bvh.kinelm.json")).assert().success();
    assert!(bytes("two.bvh") == two);
    // what isn't there, with what is
    let pruned = call("generate --frames 8 --checkpoint 5", &[("--run", "run"), ("--out", "x.bvh")]).assert().code(1);
    pruned.stderr(contains("no checkpoint of step 5, expected one of step 5; there are 2, 3, 4, 6"));
    let wrong =
        call("generate --frames 8 --checkpoint first", &[("--run", "run"), ("--out", "x.bvh")]).assert().code(2);
    wrong.stderr(contains("expected a step, latest or best"));
    // other commands
    call("export --checkpoint 4", &[("--run", "run"), ("--out", "own")])
        .assert()
        .success()
        .stderr(contains("after 4 steps"));
    let measured =
        call("evaluate likelihood --json --checkpoint 2", &[("--run", "run")]).arg("--corpus").arg(&corpus).output();
    assert!(String::from_utf8(measured.unwrap().stdout).unwrap().contains("step-00000002"));
    let tuned = |from: &str, run: &str, which: &str| {
        let mut c = call("finetune --config finetune --set train.steps=1 --checkpoint", &[]);
        c.arg(which).arg("--from").arg(at(from)).arg("--run").arg(at(run)).arg("--corpus").arg(&corpus);
        c
    };
    tuned("run", "fine", "2").assert().success();
    assert!(fs::read_to_string(at("fine/config.toml")).unwrap().contains("step = 2"));
    tuned("own", "none", "latest")
        .assert()
        .code(2)
        .stderr(contains("--checkpoint: ").and(contains("an exported folder")));
    // a run that goes on from an earlier one
    let branch = |words: &str| {
        let mut c = kinelm();
        c.args(["pretrain", "resume"]).arg(at("run")).args(words.split(' '));
        c
    };
    branch("--from-step 4").assert().code(2).stderr(contains("--run"));
    let mut other = branch("--from-step 4 --set train.learning_rate=1e-5");
    other.arg("--run").arg(at("branch")).assert().success().stderr(contains("resuming after step 4"));
    let config = fs::read_to_string(at("branch/config.toml")).unwrap();
    assert!(
        config.contains("path = \"../run\"\nstep = 4\n") && config.contains("learning_rate = 0.00001\n"),
        "{config}"
    );
    assert_eq!(metrics(&at("branch")).len(), metrics(&at("run")).len());
    let mut gone = branch("--from-step 1");
    gone.arg("--run").arg(at("none")).assert().code(1).stderr(contains("there are 2, 3, 4, 6"));
    assert!(!at("none").exists());
}
