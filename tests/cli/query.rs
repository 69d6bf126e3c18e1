//! `kinelm query` as a user runs it.

use crate::support::{json, kinelm};
use assert_cmd::Command;
use kinelm_motion::{Clip, Motion, Quat, format, synth};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

const TRAIN: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 32\ncontext = 60\n\
                     [train]\nbatch = 2\nsteps = 2\nwarmup = 1\neval_every = 2\ncheckpoint_every = 2\n";

/// Six short dances of two genres in three takes, and one that is too short.
struct Data(tempfile::TempDir);

impl Data {
    fn new() -> Data {
        let data = Data(tempfile::tempdir().unwrap());
        fs::create_dir(data.at("data")).unwrap();
        let mut csv = "clip,split,genre,take\n".to_string();
        for (i, dance) in synth::corpus(4, 7, 4.0, 30.0).unwrap().into_iter().enumerate() {
            let path = data.at(&format!("data/d{i}.bvh"));
            let clip = if i == 6 { dance.clip.slice(0..30) } else { dance.clip };
            let motion = Motion::new(&path, clip);
            format::write(&path, &motion).unwrap();
            let split = ["train", "train", "valid", "test"][i % 4];
            csv += &format!("d{i},{split},{},t{}\n", ["salsa", "waltz"][i % 2], i / 2);
        }
        fs::write(data.at("labels.csv"), csv).unwrap();
        data
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A call on all clips with their labels, behind the command's name.
    fn call(&self, words: &[&str]) -> Command {
        let flags = words.iter().position(|w| w.starts_with('-')).unwrap_or(words.len());
        let mut c = kinelm();
        c.args(&words[..flags]).arg(self.at("data")).arg("--labels").arg(self.at("labels.csv")).args(&words[flags..]);
        c
    }

    fn find(&self, clip: &str, index: &str) -> Command {
        let mut c = kinelm();
        c.args(["query", "find"]).arg(self.at(clip)).arg("--index").arg(self.at(index));
        c
    }
}

fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn an_index_a_question_and_a_page() {
    let data = Data::new();
    let index = data.at("index");
    for (transform, of) in [("stft", "stft"), ("pca", "pca"), ("dct", "dct")] {
        let mut c = data.call(&["query", "build", "--transform", transform, "--joints", "root,legs", "--out"]);
        let _ = fs::remove_dir_all(&index);
        c.arg(&index).assert().success().stderr(
            contains(format!("6 clips, 12 windows added, 12 in all; {of}, 128 frames at 60 fps"))
                .and(contains("1 clips are shorter than a window of 2.133 s"))
                .and(contains("joints pelvis left_hip right_hip")),
        );
        let found = json(data.find("data/d2.bvh", "index").args(["-k", "3", "--json"]));
        assert_eq!(
            (&found["schema"], &found["transform"], &found["query"]["clip"]),
            (&1.into(), &of.into(), &"d2".into())
        );
        let list = found["matches"].as_array().unwrap();
        assert_eq!(list.len(), 3);
        for (i, one) in list.iter().enumerate() {
            assert_eq!(one["rank"], i + 1);
            assert!(one["value"].as_f64().unwrap() <= 1.0 && one["take"] != "t1" && one["labels"]["genre"].is_string());
        }
    }
    assert_eq!(names(&index), ["index.json", "part-0001"]);
    assert_eq!(
        names(&index.join("part-0001")),
        ["clips.jsonl", "features.f32", "heads.i8", "order.u32", "rests.i8", "scales.f32", "sizes.f64",]
    );

    // the same again adds nothing; threads change nothing
    let before = fs::read(index.join("index.json")).unwrap();
    let more = contains("6 clips are in the index already").and(contains("0 windows added, 12 in all"));
    data.call(&["query", "build", "--out"]).arg(&index).assert().success().stderr(more);
    assert_eq!(fs::read(index.join("index.json")).unwrap(), before);
    let mut again = data.call(&["query", "build", "--threads", "1", "--joints", "root,legs", "--out"]);
    again.arg(data.at("one")).assert().success();
    assert_eq!(fs::read(data.at("one/index.json")).unwrap(), before);

    // the eight that the take leaves, from the least similar up
    let all = json(data.find("data/d2.bvh", "index").args(["-k", "10", "--json"]));
    let found = json(data.find("data/d2.bvh", "index").args(["-k", "2", "--lowest", "2", "--json"]));
    assert_eq!(all["lowest"], serde_json::json!([]));
    for (rank, lowest) in found["lowest"].as_array().unwrap().iter().enumerate() {
        let same = &all["matches"][7 - rank];
        assert_eq!(
            (&lowest["rank"], &lowest["clip"], &lowest["start"]),
            (&(rank + 1).into(), &same["clip"], &same["start"])
        );
    }
    let mut c = data.find("data/d2.bvh", "index");
    c.args(["-k", "1", "--lowest", "1"]).assert().success().stdout(contains("lowest, the least similar first:"));

    let page = data.at("page.html");
    let mut c = data.find("data/d0.bvh", "index");
    c.args(["--at", "1", "--distance", "euclid", "--exclude", "none", "--one-per-clip", "-k", "2", "--page"])
        .arg(&page);
    let table = contains("euclid").and(contains("1.07 to 3.20")).and(contains("genre salsa"));
    c.assert().success().stdout(table).stderr(contains("d0 from 1.00 to 3.13 s among 12 windows by dct"));
    assert!(fs::read_to_string(page).unwrap().contains("query: d0"));
}

/// Builds an index of one clip, cuts the window at frame `start` out into a file of six decimals, and holds what is found for
/// the piece to the window itself.
fn finds_itself(clip: &Path, start: usize, read: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    let (index, piece) = (dir.path().join("index"), dir.path().join("piece.bvh"));
    kinelm()
        .args(["query", "build"])
        .arg(clip)
        .args(read)
        .arg("--keep-rest")
        .arg("--out")
        .arg(&index)
        .assert()
        .success();
    let mut cut = kinelm();
    cut.arg("convert").arg(clip).arg(&piece).args(read).args(["--from", &format!("{start}f"), "--to"]);
    cut.arg(format!("{}f", start + 128)).assert().success();
    let mut find = kinelm();
    find.args(["query", "find"]).arg(&piece).args(["--index"]).arg(&index).args(["--fps-source", "60", "--at", "0"]);
    let found = json(find.args(["--exclude", "none", "--keep-rest", "--distance", "euclid", "-k", "2", "--json"]));
    let [first, second] = [0, 1].map(|i| &found["matches"][i]);
    assert_eq!(first["start"], start, "{found}");
    let [near, next] = [first, second].map(|f| f["value"].as_f64().unwrap());
    assert!(near < 1e-3 && next > 0.1, "{found}");
}

#[test]
fn a_window_cut_out_finds_itself() {
    // a dancer who turns a fifth of a turn a second: windows begin on both sides of half a turn
    let dir = tempfile::tempdir().unwrap();
    let dance = synth::corpus(3, 1, 10.0, 60.0).unwrap().remove(0).clip;
    let mut rotations = dance.rotations().to_vec();
    for (f, pose) in rotations.chunks_exact_mut(dance.joints()).enumerate() {
        pose[0] = Quat::from_rotation_y(0.2 * std::f64::consts::TAU * f as f64 / 60.0) * pose[0];
    }
    let clip = Clip::new(dance.skeleton().clone(), 60.0, dance.root().to_vec(), rotations).unwrap();
    let path = dir.path().join("turning.bvh");
    let motion = Motion::new(&path, clip);
    format::write(&path, &motion).unwrap();
    for start in [0, 128, 192, 256, 384] {
        finds_itself(&path, start, &["--fps-source", "60"]);
    }
}

#[test]
fn a_window_of_a_salsa_finds_itself() {
    let Some(dir) = kinelm_shared_data::set("cmu-dance", "query") else { return };
    finds_itself(&dir.join("salsa/24.bvh"), 2368, &["--fps-source", "60"]);
}

#[test]
fn a_models_own_embedding() {
    let data = Data::new();
    let (tokenizer, corpus, run) = (data.at("t.json"), data.at("corpus"), data.at("run"));
    fs::write(data.at("c.toml"), TRAIN).unwrap();
    data.call(&["tokenizer", "fit", "--joints", "root,left_knee", "--out"]).arg(&tokenizer).assert().success();
    data.call(&["tokenize", "--tokenizer"]).arg(&tokenizer).arg("--out").arg(&corpus).assert().success();
    let mut c = kinelm();
    c.arg("pretrain").arg("--config").arg(data.at("c.toml")).arg("--corpus").arg(&corpus).arg("--run").arg(&run);
    c.assert().success();
    let mut c = data.call(&["query", "build", "--out"]);
    c.arg(data.at("index")).arg("--run").arg(&run).assert().success().stderr(contains("12 in all; model"));
    let mut c = data.find("data/d1.bvh", "index");
    let found = json(c.args(["-k", "1", "--exclude", "none", "--at", "0", "--json"]));
    let first = &found["matches"][0];
    assert_eq!((&first["clip"], &first["start"]), (&"d1".into(), &0.into()));
    // the same window read alone or beside others
    assert!((first["value"].as_f64().unwrap() - 1.0).abs() < 1e-6, "{first}");
    let mut c = data.call(&["query", "evaluate", "-k", "2", "--transform", "model,dct", "--run"]);
    c.arg(&run).assert().success().stdout(contains("model, cosine").and(contains("2 at random")));
    let mut c = data.call(&["query", "build", "--joints", "legs", "--transform", "model", "--run"]);
    c.arg(&run).arg("--out").arg(data.at("no")).assert().code(1).stderr(contains("its own tokenizer"));
    // trained on: other weights
    let checkpoint = fs::read_to_string(run.join("latest")).unwrap();
    fs::write(run.join("checkpoints").join(checkpoint.trim()).join("model.safetensors"), "cut").unwrap();
    data.find("data/d1.bvh", "index").assert().code(1);
}

#[test]
fn an_evaluation_as_tables_and_json() {
    let data = Data::new();
    let mut c = data.call(&["query", "evaluate", "-k", "2", "--transform", "stft,dct,pca"]);
    let table = contains("genre: 2 values").and(contains("stft, euclid")).and(contains("exclude overlap: %"));
    c.assert().success().stdout(table).stderr(contains("6 clips of 3 recordings"));
    let report = json(data.call(&["query", "evaluate", "-k", "2", "--transform", "dct"]).arg("--json"));
    // two distances, chance, five exclusions, two phases
    assert_eq!((&report["schema"], report["rows"].as_array().unwrap().len()), (&1.into(), 30));
    let mut c = data.call(&["query", "evaluate", "-k", "2", "--transform", "dct", "--markdown", "--save"]);
    c.arg(data.at("saved.json")).assert().success().stdout(contains("| dct, cosine |"));
    let saved: Value = serde_json::from_slice(&fs::read(data.at("saved.json")).unwrap()).unwrap();
    assert_eq!(saved, report);
}

#[test]
fn what_is_wrong_is_said_and_nothing_is_left() {
    let data = Data::new();
    let before = names(data.0.path());
    let wrong = |words: &[&str], code: i32, says: &str| {
        data.call(words).arg("--out").arg(data.at("no")).assert().code(code).stderr(contains(says));
    };
    wrong(&["query", "build", "--joints", "tail"], 2, "joint or group \"tail\": unknown");
    wrong(&["query", "build", "--transform", "model"], 2, "needs --run");
    wrong(&["query", "build", "--keep", "3", "--transform", "stft"], 2, "--keep");
    wrong(&["query", "build", "--keep", "129"], 2, "expected 1 to 128");
    wrong(&["query", "build", "--window", "400"], 1, "no clip as long as a window of 400 frames");
    fs::create_dir(data.at("empty")).unwrap();
    let mut c = kinelm();
    c.args(["query", "build"]).arg(data.at("empty")).arg("--out").arg(data.at("no"));
    c.assert().code(1).stderr(contains("no motion in"));
    fs::remove_dir(data.at("empty")).unwrap();
    let evaluate = |words: &[&str], says: &str| {
        data.call(&["query", "evaluate"]).args(words).assert().code(1).stderr(contains(says));
    };
    evaluate(&["--fields", "dancer"], "no label `dancer` on 6 of 6 clips");
    evaluate(&["--only", "genre=polka"], "no clip with the labels genre=polka");
    evaluate(&["--exclude", "choreography"], "no clip with the label `choreography`");
    data.find("data/d0.bvh", "data").assert().code(1).stderr(contains("no index.json").and(contains("query build")));
    assert_eq!(names(data.0.path()), before);

    data.call(&["query", "build", "--out"]).arg(data.at("index")).assert().success();
    data.find("data/d6.bvh", "index")
        .assert()
        .code(1)
        .stderr(contains("d6.bvh").and(contains("at least 128 (2.13 s)")));
    data.find("data/d0.bvh", "index").args(["--at", "9"]).assert().code(1).stderr(contains("a window from 9 s on"));
    data.find("data/d0.bvh", "index").args(["--exclude", "me"]).assert().code(2).stderr(contains("self, overlap"));
    let mut c = data.call(&["query", "build", "--hop", "32", "--out"]);
    c.arg(data.at("index"))
        .assert()
        .code(1)
        .stderr(contains("hop 64 frames").and(contains("hop 32 frames, as requested")));
    let path = data.at("index/index.json");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("\"version\": 5", "\"version\": 9")).unwrap();
    let says = contains("found version 9").and(contains("expected version 5; build the index again"));
    data.find("data/d0.bvh", "index").assert().code(1).stderr(says);
    assert_eq!(names(&data.at("index")), ["index.json", "part-0001"]);
}

#[test]
fn a_description_that_cannot_be_is_said() {
    let data = Data::new();
    data.call(&["query", "build", "--out"]).arg(data.at("index")).assert().success();
    let path = data.at("index/index.json");
    let text = fs::read_to_string(&path).unwrap();
    for (from, to, says) in [
        ("\"keep\": 16", "\"keep\": 17", "features of 1152 numbers, expected 1224, by its options"),
        ("\"frames\": 128", "\"frames\": 0", "`window` is 0"),
        ("\"hop\": 64", "\"hop\": 0", "`hop` is 0"),
        ("part-0001", "../part-0001", "a part `../part-0001`"),
    ] {
        assert_eq!(text.matches(from).count(), 1, "{text}");
        fs::write(&path, text.replace(from, to)).unwrap();
        let says = contains(says).and(contains("build the index again"));
        data.find("data/d0.bvh", "index").assert().code(1).stderr(says);
    }
}

#[test]
fn a_page_goes_over_nothing_else_and_lost_clips_are_said() {
    let data = Data::new();
    data.call(&["query", "build", "--out"]).arg(data.at("index")).assert().success();
    for (page, says) in [("data/d0.bvh", ".html"), ("index/index.json", ".html"), ("data/d0.bvh/a.html", "is a file")] {
        let before = fs::read(data.at(page)).ok();
        let mut c = data.find("data/d0.bvh", "index");
        c.arg("--page").arg(data.at(page)).assert().code(2).stderr(contains(says));
        assert_eq!(fs::read(data.at(page)).ok(), before);
    }
    data.find("data/d0.bvh", "index").args(["-k", "0"]).assert().code(2).stderr(contains("from 1 on"));
    data.find("data/d0.bvh", "index").args(["--at", "-1"]).assert().code(2).stderr(contains("a time from 0 on"));
    fs::remove_file(data.at("data/d1.bvh")).unwrap();
    let mut c = data.find("data/d0.bvh", "index");
    c.args(["--exclude", "none", "--page"]).arg(data.at("p.html"));
    c.assert().success().stderr(contains("d1.bvh").and(contains("left out of the page"))).stdout(contains("d1"));
}

#[test]
fn the_same_motion_is_indexed_once() {
    let data = Data::new();
    let build = || {
        let mut c = kinelm();
        c.args(["query", "build"]).arg(data.at("data")).arg("--out").arg(data.at("index"));
        c
    };
    build().assert().success().stderr(contains("12 windows added"));
    // the rate that the files state
    build().args(["--fps-source", "30"]).assert().success().stderr(contains("6 clips are in the index already"));
    let twice = contains("6 clips are in the index already, read at another rate").and(contains("24 in all").not());
    build().args(["--fps-source", "24"]).assert().success().stderr(twice);
}
