//! A masked model fills what is free of a clip.

use crate::edit::{column, differ, source};
use crate::support::{json, kinelm, save};
use assert_cmd::Command;
use kinelm_motion::format::ReadOptions;
use kinelm_motion::synth;
use predicates::str::contains;
use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;

/// A window holds 11 words of 43 tokens, half a second; the clips are of three.
const CONFIG: &str = "[model]\nkind = \"masked\"\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 480\npositions = \"rope\"\n\
                      [train]\nmasking = \"spans\"\nbatch = 2\nsteps = 4\nwarmup = 1\neval_every = 4\ncheckpoint_every = 4\n\
                      sample_every = 1\n";

/// Runs of a few steps, a masked and a causal one.
struct Set {
    dir: tempfile::TempDir,
}

impl Set {
    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn generate(&self, run: &str, more: &[&str], out: &str) -> Command {
        let mut c = kinelm();
        c.arg("generate").arg("--run").arg(self.at(run)).args(more).arg("--out").arg(self.at(out));
        c.current_dir(self.dir.path());
        c
    }

    /// The bytes of an edit of the test clip.
    fn edited(&self, more: &[&str], out: &str) -> Vec<u8> {
        let edit = [&["--prompt", "data/5.bvh", "--tries", "2"], more].concat();
        self.generate("masked", &edit, out).assert().success();
        fs::read(self.at(out)).unwrap()
    }

    fn record(&self, out: &str) -> Value {
        serde_json::from_slice(&fs::read(self.at(&format!("{out}.kinelm.json"))).unwrap()).unwrap()
    }

    fn again(&self, out: &str) -> Vec<u8> {
        let copy = self.at(&format!("again-{out}"));
        let mut c = kinelm();
        c.args(["again"]).arg(self.at(&format!("{out}.kinelm.json"))).arg("--out").arg(&copy);
        c.current_dir(self.dir.path()).assert().success();
        fs::read(copy).unwrap()
    }
}

fn set() -> &'static Set {
    static SET: OnceLock<Set> = OnceLock::new();
    SET.get_or_init(|| {
        let set = Set { dir: tempfile::tempdir().unwrap() };
        let mut labels = "clip,split\n".to_string();
        for (i, dance) in synth::corpus(3, 6, 3.0, 60.0).unwrap().iter().enumerate() {
            save(&set.at(&format!("data/{i}.bvh")), &dance.clip);
            labels += &format!("{i},{}\n", ["train", "train", "train", "train", "valid", "test"][i]);
        }
        fs::write(set.at("labels.csv"), labels).unwrap();
        fs::write(set.at("masked.toml"), CONFIG).unwrap();
        let causal = CONFIG.replace("masked", "causal").replace("masking = \"spans\"\n", "");
        fs::write(set.at("causal.toml"), causal).unwrap();
        for call in [
            "tokenizer fit data --labels labels.csv --joints 13 --out tok.json",
            "tokenize data --labels labels.csv --tokenizer tok.json --out corpus",
            "pretrain --config masked.toml --corpus corpus --run masked",
            "pretrain --config causal.toml --corpus corpus --run causal",
        ] {
            kinelm().current_dir(set.dir.path()).args(call.split(' ')).assert().success();
        }
        set
    })
}

#[test]
fn a_span_is_filled_and_no_other_number_changes() {
    let (set, options) = (set(), ReadOptions::default());
    let old = source(&set.at("data/5.bvh"), &options);
    let arm = ["--free", "left_arm@1s:2s", "--passes", "3"];
    let bytes = set.edited(&arm, "arm.bvh");
    let new = source(&set.at("arm.bvh"), &options);
    let (frames, columns) = differ(&old, &new);
    assert_eq!((frames.first(), frames.last()), (Some(&60), Some(&119)));
    let joints = ["left_shoulder", "left_elbow", "left_wrist"].iter().flat_map(|joint| column(&old, joint));
    let joints: Vec<usize> = joints.collect();
    assert!(!columns.is_empty() && columns.iter().all(|c| joints.contains(c)), "{columns:?} of {joints:?}");
    // the same bytes again, on any number of threads; other ones in another number of passes
    assert_eq!(set.record("arm.bvh")["request"]["passes"], 3);
    assert_eq!(set.again("arm.bvh"), bytes);
    assert_eq!(set.edited(&[&arm[..], &["--threads", "1"]].concat(), "one.bvh"), bytes);
    assert_eq!(set.edited(&[&arm[..], &["--threads", "2"]].concat(), "two.bvh"), bytes);
    assert_ne!(set.edited(&["--free", "left_arm@1s:2s", "--passes", "1"], "once.bvh"), bytes);
}

#[test]
fn gaps_loops_and_dances_longer_than_a_window_are_filled_and_made_again() {
    let set = set();
    for (out, more) in [
        ("gap.bvh", "--prompt data/5.bvh --tries 2 --free all@1s:2s --variations 2"),
        ("given.bvh", "--prompt data/5.bvh --joints root,right_arm --rig prompt"),
        ("round.bvh", "--prompt data/5.bvh --tries 2 --loop --loop-over 1"),
        ("on.bvh", "--prompt data/5.bvh --from-frame 20 --frames 70"),
        ("free.bvh", "--frames 40 --greedy"),
    ] {
        let more: Vec<&str> = more.split(' ').chain(["--passes", "2"]).collect();
        set.generate("masked", &more, out).assert().success();
        let first = if out == "gap.bvh" { "gap-2.bvh" } else { out };
        assert_eq!(set.record(first)["request"].get("first_frames"), None, "{out}: a masked model has no use for them");
        assert_eq!(set.again(first), fs::read(set.at(first)).unwrap(), "{out}");
    }
    let told = |out: &str| set.record(out)["request"]["passes"].clone();
    set.generate("masked", &["--frames", "20"], "default.bvh").assert().success();
    assert_eq!((told("default.bvh"), told("free.bvh")), (8.into(), 2.into()));
    assert!(set.at("masked/samples/step-00000004.bvh").exists(), "dances of its training, too");
}

#[test]
fn gaps_are_measured_for_both_kinds() {
    let set = set();
    let gaps = |run: &str, more: &[&str]| {
        let mut c = kinelm();
        c.args(["evaluate", "gaps", "--frames", "4", "--gaps", "3", "--samples", "2", "--corpus"])
            .arg(set.at("corpus"));
        c.arg("--run").arg(set.at(run)).args(more);
        c
    };
    let [masked, causal] = ["masked", "causal"].map(|run| json(gaps(run, &["--json"]).arg("--quiet")));
    let cm = |found: &Value, row: usize| found["rows"][row]["mean"]["global_cm"].as_f64().unwrap();
    assert!(cm(&masked, 2) > 0.0 && cm(&masked, 4) <= cm(&masked, 2), "{masked}");
    // the same gaps, so the same straight ways
    assert_eq!([cm(&masked, 0), cm(&masked, 1)], [cm(&causal, 0), cm(&causal, 1)]);
    assert_ne!(json(gaps("masked", &["--json", "--passes", "1"]).arg("--quiet")), masked);
    gaps("causal", &["--passes", "4"])
        .assert()
        .code(2)
        .stderr(contains("--passes 4: a causal model reads its tokens once"));
    gaps("masked", &["--frames", "11"]).assert().code(2);
}

#[test]
fn what_does_not_go_with_the_kind_of_a_model_is_refused() {
    let set = set();
    let said = |run: &str, more: &[&str], text: &str| {
        set.generate(run, more, "no.bvh").assert().code(2).stderr(contains(text));
        assert!(!set.at("no.bvh").exists());
    };
    said("causal", &["--frames", "9", "--passes", "2"], "--passes 2: a causal model reads its tokens once");
    said("masked", &["--frames", "9", "--passes", "0"], "--passes");
    said("masked", &["--frames", "9", "--kv", "f16"], "a masked model reads whole windows");
    let given = ["--prompt", "data/5.bvh", "--joints", "right_arm", "--first-frames", "9"];
    said("masked", &given, "a causal model");
}
