//! A clip edited: what is free is made anew, and no other number of its file changes.

use crate::support::kinelm;
use assert_cmd::Command;
use kinelm_motion::format::{self, ReadOptions, RestFrame, bvh::BvhSource};
use kinelm_motion::{Motion, Source, synth};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

const CONFIG: &str = "[model]\narchitecture = \"two_level\"\nlayers = 1\nheads = 2\nwidth = 16\nwindow = 32\n\
                      [model.decoder]\nlayers = 1\nheads = 2\nwidth = 16\n\
                      [train]\nbatch = 2\nsteps = 4\nwarmup = 1\neval_every = 4\ncheckpoint_every = 4\n";

/// A run of a few steps on short dances, and one of them at 60 frames a second as a file with long numbers.
struct Set {
    dir: tempfile::TempDir,
}

impl Set {
    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn edit(&self, prompt: &Path, more: &[&str], out: &str) -> Command {
        let mut c = kinelm();
        c.arg("generate").arg("--run").arg(self.at("run")).arg("--prompt").arg(prompt).args(more);
        c.arg("--out").arg(self.at(out));
        c
    }
}

fn set() -> &'static Set {
    static SET: OnceLock<Set> = OnceLock::new();
    SET.get_or_init(|| {
        let set = Set { dir: tempfile::tempdir().unwrap() };
        fs::create_dir(set.at("data")).unwrap();
        let mut labels = "clip,split,skip\n".to_string();
        for (i, d) in synth::corpus(3, 6, 3.0, 60.0).unwrap().iter().enumerate() {
            let path = set.at(&format!("data/{i}.bvh"));
            let motion = Motion::new(&path, d.clip.clone());
            format::write(&path, &motion).unwrap();
            labels += &format!("{i},{}\n", ["train,", "train,", "train,", "train,6", "valid,", "test,"][i]);
        }
        fs::write(set.at("labels.csv"), labels).unwrap();
        // numbers as other programs write them
        let text = fs::read_to_string(set.at("data/5.bvh")).unwrap();
        let rows = text[text.find("Frame Time").unwrap()..].find('\n').unwrap() + text.find("Frame Time").unwrap() + 1;
        let (head, rows) = text.split_at(rows);
        let longer = |row: &str| row.split(' ').map(|n| format!("{n}04")).collect::<Vec<_>>().join("  ");
        let rows: String = rows.lines().map(|row| longer(row) + "\n").collect();
        fs::write(set.at("long.bvh"), head.to_owned() + &rows).unwrap();
        let mut c = kinelm();
        c.args(["tokenizer", "fit"]).arg(set.at("data")).arg("--labels").arg(set.at("labels.csv"));
        c.arg("--out").arg(set.at("tok.json")).assert().success();
        let mut c = kinelm();
        c.arg("tokenize").arg(set.at("data")).arg("--labels").arg(set.at("labels.csv"));
        c.arg("--tokenizer").arg(set.at("tok.json")).arg("--out").arg(set.at("corpus")).assert().success();
        fs::write(set.at("c.toml"), CONFIG).unwrap();
        let mut c = kinelm();
        c.arg("pretrain").arg("--config").arg(set.at("c.toml")).arg("--corpus").arg(set.at("corpus"));
        c.arg("--run").arg(set.at("run")).assert().success();
        set
    })
}

pub fn source(path: &Path, options: &ReadOptions) -> BvhSource {
    let options = ReadOptions { rest: RestFrame::Keep, ..options.clone() };
    let Source::Bvh(source) = format::read(path, &options).unwrap().source else { panic!("a BVH") };
    *source
}

/// The frames and columns of numbers that differ.
pub fn differ(a: &BvhSource, b: &BvhSource) -> (Vec<usize>, Vec<usize>) {
    let width = a.head.width;
    let at = (0..a.numbers.len().min(b.numbers.len())).filter(|&i| a.numbers[i] != b.numbers[i]);
    let (mut frames, mut columns): (Vec<usize>, Vec<usize>) = at.map(|i| (i / width, i % width)).unzip();
    frames.dedup();
    columns.sort_unstable();
    columns.dedup();
    (frames, columns)
}

pub fn column(source: &BvhSource, joint: &str) -> std::ops::Range<usize> {
    let node = source.head.nodes.iter().find(|n| n.name == joint).unwrap();
    node.column..node.column + node.channels.len()
}

#[test]
fn only_what_is_free_has_other_numbers() {
    let (set, options) = (set(), ReadOptions::default());
    let prompt = set.at("data/5.bvh");
    let old = source(&prompt, &options);
    set.edit(&prompt, &["--free", "left_arm@1s:2s"], "arm.bvh").assert().success().stderr(contains(
        "free left_arm@1s:2s: left_collar left_shoulder left_elbow left_wrist; frames 60 to 119 of the file, 1.00 to 2.00 s",
    ));
    let new = source(&set.at("arm.bvh"), &options);
    assert_eq!((new.frames, &new.head.frame_time), (old.frames, &old.head.frame_time));
    let (frames, columns) = differ(&old, &new);
    assert_eq!((frames.first(), frames.last()), (Some(&60), Some(&119)));
    let arm: Vec<usize> =
        ["left_collar", "left_shoulder", "left_elbow", "left_wrist"].iter().flat_map(|j| column(&old, j)).collect();
    assert!(!columns.is_empty() && columns.iter().all(|c| arm.contains(c)), "{columns:?} of {arm:?}");

    // a gap: the ends are given, also in words that this program would not write
    let long = set.at("long.bvh");
    let mut c = set.edit(&long, &["--given", "all@:1s", "--given", "all@-1s:", "--tries", "3"], "gap.bvh");
    c.assert().success().stderr(contains("the gap from 1.00 to 2.00 s ended"));
    let [old_text, new_text] = [long, set.at("gap.bvh")].map(|path| fs::read_to_string(path).unwrap());
    let same: Vec<bool> = old_text.lines().zip(new_text.lines()).map(|(a, b)| a == b).collect();
    let other: Vec<usize> = (0..same.len()).filter(|&i| !same[i]).collect();
    assert_eq!((other.len(), other[59] - other[0]), (60, 59), "a second, and every other line as it was");
}

#[test]
fn frames_left_out_on_reading_come_back_in_their_places() {
    let set = set();
    let prompt = set.at("data/4.bvh");
    let read = ["--skip", "12", "--fps-source", "30"];
    let more = [&read[..], &["--free", "legs@30f:60f"]].concat();
    set.edit(&prompt, &more, "legs.bvh")
        .assert()
        .success()
        .stderr(contains("frames 30 to 59 of the file, 0.60 to 1.60 s"));
    let options = ReadOptions::default();
    let (old, new) = (source(&prompt, &options), source(&set.at("legs.bvh"), &options));
    let (frames, columns) = differ(&old, &new);
    assert_eq!((new.frames, frames.first(), frames.last()), (old.frames, Some(&30), Some(&59)));
    let pelvis = column(&old, "pelvis");
    assert!(columns.iter().all(|c| !pelvis.contains(c)), "the root is given");
    // the file states the rate that was stated, and nothing else of it is another
    assert_eq!((old.fps(), new.fps(), new.head.frame_time.as_str()), (60.0, 30.0, "0.0333333333"));
    let [old_text, new_text] = [prompt, set.at("legs.bvh")].map(|path| fs::read_to_string(path).unwrap());
    let head =
        |text: &str| text.lines().take_while(|line| !line.starts_with("Frame Time")).map(str::to_owned).collect();
    let heads: [Vec<String>; 2] = [head(&old_text), head(&new_text)];
    assert_eq!(heads[0], heads[1]);
    // the program reads it as it read the prompt
    let mut c = kinelm();
    c.args(["evaluate", "dance"]).arg(set.at("legs.bvh")).arg("--real").arg(set.at("corpus")).arg("--json");
    let found = c.assert().success().get_output().stdout.clone();
    let found: serde_json::Value = serde_json::from_slice(&found).unwrap();
    let frames = found["groups"][2]["world"]["frames"].as_u64();
    assert_eq!(frames, Some((old.frames as u64 - 12 - 1) * 20 / 30 + 1), "{found}");
    every_command_reads_it_as_its_sidecar_says(set, old.frames);
}

/// Of `legs.bvh`, which was read without its first 12 frames.
fn every_command_reads_it_as_its_sidecar_says(set: &Set, frames: usize) {
    let legs = set.at("legs.bvh");
    let said = "legs.bvh: read as its sidecar says: skip 12";
    let read = |words: &[&str], more: &[&str]| {
        let mut c = kinelm();
        c.args(words).arg(&legs).args(more).current_dir(set.dir.path()).assert().success()
    };
    for (words, more) in [
        (&["inspect"][..], &[][..]),
        (&["mirror"], &["--out", "mirrored.bvh"]),
        (&["filter"], &["--out", "filtered.bvh"]),
        (&["spectrum"], &["--out", "legs.png"]),
        (&["view"], &["--out", "legs.html"]),
        (&["tokenizer", "text", "--tokenizer", "tok.json"], &[]),
        (&["tokenize", "--tokenizer", "tok.json"], &["--out", "of-legs", "--force"]),
        (&["generate", "--run", "run", "--free", "left_arm@1s:2s", "--prompt"], &["--out", "arm-of-legs.bvh"]),
        (&["query", "build", "--window", "32", "--out", "of-legs-index"], &[]),
    ] {
        let found = String::from_utf8(read(words, more).get_output().stderr.clone()).unwrap();
        assert!(found.contains(said), "{words:?}: {found}");
    }
    let converted = |more: &[&str], said: bool| {
        let assert = read(&["convert"], &[&["legs.json", "--force"], more].concat());
        let found = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
        assert_eq!(found.contains("as its sidecar says"), said, "{found}");
        let clip = format::read(&set.at("legs.json"), &ReadOptions::default()).unwrap().clip;
        (clip.frames(), clip.fps())
    };
    assert_eq!(converted(&[], true), (frames - 12, 30.0));
    // what a call says wins, and of the sidecar the rest holds
    assert_eq!(converted(&["--skip", "0"], false), (frames, 30.0));
    assert_eq!(converted(&["--fps-source", "50"], true), (frames - 12, 50.0));
    // of several files it is said of those that no sidecar tells of
    let mut c = kinelm();
    c.arg("convert")
        .arg(&legs)
        .arg(set.at("data/0.bvh"))
        .arg(set.at("several/"))
        .args(["--skip", "3", "--format", "json"]);
    c.assert().success().stderr(contains(said));
    let [a, b] = ["legs", "0"].map(|name| {
        format::read(&set.at(&format!("several/{name}.json")), &ReadOptions::default()).unwrap().clip.frames()
    });
    assert_eq!((a, b), (frames - 12, 180 - 3));
    // a corpus keeps how a clip was read
    let clips = fs::read_to_string(set.at("of-legs/clips.jsonl")).unwrap();
    let clip: serde_json::Value = serde_json::from_str(clips.trim()).unwrap();
    assert_eq!((&clip["read"]["skip"], &clip["read"]["fps_source"]), (&12.into(), &30.0.into()), "{clip}");
    // a page marks what was made anew: frames 30 to 59 of the file
    let page = fs::read_to_string(set.at("legs.html")).unwrap();
    assert!(page.contains("\"anew\":[[0.6,1.6]]"), "what is new stands on the bar");
}

#[test]
fn a_clip_of_the_runs_corpus_is_read_as_that_read_it() {
    let set = set();
    let prompt = set.at("data/3.bvh");
    fs::copy(&prompt, set.at("a-copy.bvh")).unwrap();
    let sidecar = |out: &str| {
        let text = fs::read_to_string(set.at(&format!("{out}.kinelm.json"))).unwrap();
        serde_json::from_str::<serde_json::Value>(&text).unwrap()
    };
    let free = ["--free", "left_arm@1s:2s"];
    let said = "a-copy.bvh: read as the model's corpus read it: skip 6";
    set.edit(&set.at("a-copy.bvh"), &free, "known.bvh").assert().success().stderr(contains(said));
    assert_eq!(sidecar("known.bvh")["request"]["prompt"]["read"]["skip"], 6);
    let more = [&free[..], &["--skip", "2"]].concat();
    set.edit(&prompt, &more, "told.bvh").assert().success().stderr(contains("model's corpus").not());
    assert_eq!(sidecar("told.bvh")["request"]["prompt"]["read"]["skip"], 2);
    // a run whose corpus is gone
    fs::create_dir(set.at("alone")).unwrap();
    let copy = |from: &Path, to: &Path| {
        for entry in fs::read_dir(from).unwrap().map(Result::unwrap).filter(|entry| entry.path().is_file()) {
            fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
    };
    copy(&set.at("run"), &set.at("alone"));
    let checkpoints: Vec<PathBuf> = fs::read_dir(set.at("run")).unwrap().map(|e| e.unwrap().path()).collect();
    for folder in checkpoints.into_iter().filter(|path| path.is_dir()) {
        let to = set.at("alone").join(folder.file_name().unwrap());
        fs::create_dir(&to).unwrap();
        for entry in fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()) {
            match entry.is_dir() {
                true => {
                    fs::create_dir(to.join(entry.file_name().unwrap())).unwrap();
                    copy(&entry, &to.join(entry.file_name().unwrap()));
                }
                false => drop(fs::copy(&entry, to.join(entry.file_name().unwrap())).unwrap()),
            }
        }
    }
    let config = set.at("alone/config.toml");
    let text = fs::read_to_string(&config).unwrap();
    let corpus = "path = \"../corpus\"";
    assert!(text.contains(corpus), "{text}");
    fs::write(&config, text.replace(corpus, "path = \"../nowhere\"")).unwrap();
    let mut c = kinelm();
    c.arg("generate").arg("--run").arg(set.at("alone")).arg("--prompt").arg(&prompt).args(free);
    let gone =
        "nowhere: the model's corpus can't be read: whether it has these files, and how it read them, isn't known";
    c.arg("--out").arg(set.at("gone.bvh")).assert().success().stderr(contains(gone));
    assert_eq!(sidecar("gone.bvh")["request"]["prompt"]["read"]["skip"], 0);
}

#[test]
fn a_longer_dance_goes_on_behind_the_clip_and_is_made_again_to_the_byte() {
    let set = set();
    let prompt = set.at("data/5.bvh");
    set.edit(&prompt, &["--given", "all", "--seconds", "4.5", "--seed", "9"], "on.bvh").assert().success();
    let (old, new) = (source(&prompt, &ReadOptions::default()), source(&set.at("on.bvh"), &ReadOptions::default()));
    assert_eq!((differ(&old, &new).0.len(), new.frames), (0, 270), "4.5 s: the last frame is held");
    // less is left to chance where all that is drawn has given joints behind it
    for (name, more, top_p) in [
        ("begin", vec!["--free", "all@:1s", "--variations", "2"], 0.97),
        ("keys", vec!["--given", "all@0.5s:0.6s", "--given", "all@2s:2.1s", "--tries", "2"], 0.97),
        ("part", vec!["--free", "left_arm@1s:2s", "--tries", "2"], 0.8),
        ("both", vec!["--free", "left_arm@1s:2s", "--free", "all@2.5s:", "--tries", "2"], 0.97),
        ("model", vec!["--free", "right_arm", "--rig", "model", "--fps", "60"], 0.8),
    ] {
        let out = format!("{name}.bvh");
        set.edit(&prompt, &more, &out).assert().success();
        let first = if name == "begin" { format!("{name}-2.bvh") } else { out };
        let (record, again) = (set.at(&format!("{first}.kinelm.json")), set.at(&format!("again-{name}.bvh")));
        let told: serde_json::Value = serde_json::from_slice(&fs::read(&record).unwrap()).unwrap();
        assert_eq!(told["request"]["sampling"]["top_p"], top_p, "{name}");
        kinelm().args(["again"]).arg(record).arg("--out").arg(&again).assert().success();
        assert_eq!(fs::read(set.at(&first)).unwrap(), fs::read(again).unwrap(), "{name}");
    }
}

#[test]
fn one_grammar_of_times_and_joints_goes_everywhere() {
    let set = set();
    let prompt = set.at("data/5.bvh");
    let bytes = |name: &str| fs::read(set.at(name)).unwrap();
    let make = |more: &[&str], out: &str| set.edit(&prompt, more, out).assert().success();
    make(&["--free", "left_arm@1s:2s", "--blend", "0.2", "--tries", "2"], "t0.bvh");
    make(&["--free", "Left_Arm@60f:40m", "--blend", "12f", "--tries", "2"], "t1.bvh")
        .stderr(contains("free left_arm@60f:40m"));
    assert_eq!(bytes("t0.bvh"), bytes("t1.bvh"));
    for (i, more) in
        [["--seconds", "3.5"], ["--seconds", "3.5s"], ["--seconds", "70f"], ["--frames", "70"], ["--frames", "3.5s"]]
            .iter()
            .enumerate()
    {
        make(&[&["--given", "all"], &more[..]].concat(), &format!("t{}.bvh", i + 2));
        assert_eq!(bytes(&format!("t{}.bvh", i + 2)), bytes("t2.bvh"), "{more:?}");
    }
    make(&["--joints", "13", "--from-frame", "20"], "t7.bvh");
    make(&["--joints", "13", "--from-frame", "1s"], "t8.bvh");
    assert_eq!(bytes("t7.bvh"), bytes("t8.bvh"));
    // joints between given ones
    let arm = "right_collar,right_shoulder,right_elbow,right_wrist";
    make(&["--given", "root,right_wrist@1s:2s", "--tries", "2"], "t9.bvh").stderr(
        contains("spine1, spine3, right_collar, right_shoulder, right_elbow: free, and they move the given joints")
            .and(contains(format!("to give them too: --given root,torso,{arm}@1s:2s"))),
    );
    make(&["--given", "root,torso,right_arm@1s:2s", "--tries", "2"], "t9.bvh").stderr(contains("they move").not());

    let view = |forced: &str| {
        let mut c = kinelm();
        c.arg("view").arg(&prompt).args(["--forced", forced, "--force"]).arg("--out").arg(set.at("t.html"));
        c.assert()
    };
    let page = || fs::read_to_string(set.at("t.html")).unwrap();
    view("left_arm@1s:75f").success();
    assert!(page().contains("\"given_s\":[1.0,1.25]") && page().contains("\"given\":true"));
    view("LEFT_ARM").success();
    assert!(!page().contains("\"given_s\"") && page().contains("\"given\":true"));
    view("left_arm@1-2").code(2).stderr(contains("--forced `left_arm@1-2`: `1-2` is no time"));
    view("left_arm@1s:9s").code(2).stderr(contains("--forced left_arm@1s:9s: 9s lies outside the clip"));
    view("left_wing@1s:2s").code(2).stderr(contains("joint or group \"left_wing\": unknown"));
}

#[test]
fn a_file_asks_for_no_more_frames_than_a_call_may() {
    let set = set();
    set.edit(&set.at("data/5.bvh"), &["--free", "left_arm@1s:1.2s"], "short.bvh").assert().success();
    let text = fs::read_to_string(set.at("short.bvh.kinelm.json")).unwrap();
    for (key, own) in [("frames", "60"), ("lead_in", "0"), ("tries", "8"), ("first_frames", "1")] {
        let told = format!("\"{key}\": {own}");
        let long = format!("\"{key}\": 1099511627796");
        let long = match text.contains(&told) {
            true => text.replace(&told, &long),
            false => text.replace("\"guidance\"", &format!("{long},\n    \"guidance\"")),
        };
        fs::write(set.at("long.json"), long).unwrap();
        let mut c = kinelm();
        c.args(["again"]).arg(set.at("long.json")).arg("--out").arg(set.at("no.bvh"));
        c.assert().failure().stderr(contains("1099511627796").and(contains(if key == "lead_in" {
            "frames"
        } else {
            key
        })));
    }
}

#[test]
fn a_clip_that_goes_round_ends_where_it_begins() {
    let set = set();
    let prompt = set.at("long.bvh");
    let text = fs::read_to_string(&prompt).unwrap();
    let rows =
        |text: &str| text.lines().skip_while(|l| !l.starts_with("Frame Time")).skip(1).map(str::to_owned).collect();
    let old: Vec<String> = rows(&text);
    for (round, name) in [("--loop", "round.bvh"), ("--loop=pose", "on.pose.bvh")] {
        let more = ["--skip", "5", round, "--loop-over", "1", "--tries", "2"];
        let told = "free all@120f:180f";
        set.edit(&prompt, &more, name)
            .assert()
            .success()
            .stderr(contains(told).and(contains("the seam of the loop jerks")));
        let new: Vec<String> = rows(&fs::read_to_string(set.at(name)).unwrap());
        assert_eq!(new.len(), 175, "as long as the clip, without what is skipped");
        assert_eq!(new[..115], old[5..120], "{round}: the words of the file up to the gap");
        assert!((115..175).all(|f| new[f] != old[f + 5]), "{round}: and none of the gap's");
        let clip = format::read(&set.at(name), &ReadOptions::default()).unwrap().clip;
        let (last, first) = (clip.pose(174), clip.pose(0));
        let apart: f64 = (1..clip.joints()).map(|j| last[j].angle_between(first[j])).sum::<f64>() / 23.0;
        assert!(apart < 0.5, "{round}: {apart} rad in the mean from the last pose to the first");
        if round == "--loop" {
            let far = (clip.root()[174] - clip.root()[0]).length();
            assert!(far < 0.06, "{far} m");
        }
        let again = set.at(&format!("again-{name}"));
        let record = set.at(&format!("{name}.kinelm.json"));
        kinelm().args(["again"]).arg(record).arg("--out").arg(&again).assert().success();
        assert_eq!(fs::read(set.at(name)).unwrap(), fs::read(again).unwrap());
    }
    set.edit(&prompt, &["--loop", "--rig", "model"], "model.bvh")
        .assert()
        .failure()
        .stderr(contains("it needs 3 and a"));
    let more = ["--loop", "--loop-over", "1", "--rig", "model", "--fps", "60"];
    set.edit(&prompt, &more, "model.bvh").assert().success();
    assert_eq!(
        format::read(&set.at("model.bvh"), &ReadOptions::default()).unwrap().clip.frames(),
        180,
        "3 s, whose last frames go on into the first"
    );
}

#[test]
fn what_can_t_be_edited_is_told_and_nothing_is_written() {
    let set = set();
    let prompt = set.at("data/5.bvh");
    for (more, told) in [
        (&["--free", "left_arm@2s"][..], "2s is a moment, not a time; expected FROM:TO, or 2s: for all from then on"),
        (&["--free", "left_arm@2s:9s"], "9s lies outside the clip, which has 180 frames, 3.00 s"),
        (&["--free", "left_arm@2s:1s"], "from frame 120 to frame 60 there is nothing"),
        (&["--free", "left_hand"], "the model knows none of these joints; it knows pelvis"),
        (&["--free", "left_wing@1s:2s"], "joint or group \"left_wing\": unknown"),
        (&["--given", "all"], "no free joint"),
        (&["--free", "all@1:2", "--given", "left_arm@1.2:1.4"], "no given joint"),
        (&["--free", "all", "--frames", "20"], "is 20; expected at least the 60 of the prompt"),
        (&["--free", "all", "--joints", "root"], "cannot be used with"),
        (&["--free", "all", "--uncoded-joints", "mean"], "leave it out"),
        (&["--free", "all", "--blend=-1"], "expected a time from 0 on"),
        (&["--free", "all", "--blend", "61s"], "--blend 61s: expected 0 to 60 seconds"),
        (&["--loop", "--loop-over", "2f"], "--loop-over 2f: expected 0.1 to 60 seconds"),
        (&["--free", "left_arm@1-2"], "`1-2` is no time; expected FROM:TO, as in left_arm@4s:8s, each such as 2.5s"),
        (&["--free", "left_arm@1s:x"], "`1s:x` is no time"),
        (&["--free", "all", "--seconds", "4x"], "`4x` is no time; expected 2.5s, 2.5 or 40f"),
        (&["--free", "all", "--frames", "2.5"], "`2.5` is no time; expected 40, 40f or 2.5s"),
        (&["--free", "all", "--frames", "0"], "0f: expected more than nothing"),
        (&["--free", "all", "--seconds", "1e9"], "20000000000 frames, the limit is 1048576"),
        (&["--free", "all", "--seconds", "1e308"], "expected at most 1e9 seconds or frames"),
        (&["--given", "all", "--frames", "2000000f"], "2000000 frames, the limit is 1048576"),
        (&["--free", "all", "--seconds", "4", "--fps", "10000", "--frames", "2000000"], "cannot be used with"),
        (&["--free", "all", "--goal-guidance", "2"], "this model isn't goal-conditioned"),
        (&["--free", "all", "--goal-guidance", "-1"], "expected a number from 0 (not at all) to 10"),
        (&["--free", "all", "--goal-guidance", "1e9"], "expected a number from 0 (not at all) to 10"),
        (&["--free", "all", "--goal-guidance", "NaN"], "expected a number from 0 (not at all) to 10"),
        (&["--loop", "--free", "all"], "cannot be used with"),
        (&["--loop", "--seconds", "4"], "cannot be used with"),
        (&["--loop=there"], "possible values: back, pose"),
        (&["--loop", "--loop-over", "2.5"], "the clip has 3.00 s; with 2.5 s generated it needs 3.5 and a frame"),
        (&[], "what of it is generated (--free, --given)"),
    ] {
        set.edit(&prompt, more, "never.bvh").assert().failure().stderr(contains(told));
    }
    assert!(!set.at("never.bvh").exists());
    set.edit(&prompt, &["--free", "head"], "never.npz").assert().code(2).stderr(contains("add --rig model"));
    let mut c = kinelm();
    c.arg("generate").arg("--run").arg(set.at("run")).args(["--frames", "9", "--free", "all"]);
    c.arg("--out").arg(set.at("x.bvh")).assert().failure().stderr(contains("--prompt"));
}

#[test]
fn gaps_are_measured_beside_straight_ways() {
    let set = set();
    let gaps = |more: &[&str]| {
        let mut c = kinelm();
        c.args(["evaluate", "gaps"]).arg("--run").arg(set.at("run")).arg("--corpus").arg(set.at("corpus")).args(more);
        c.assert()
    };
    let few = ["--frames", "5", "--gaps", "3", "--samples", "2", "--feet"];
    let table =
        gaps(&few).success().stderr(contains("3 gaps of 5 frames (0.2 s) of 1 recordings, 26 frames before each"));
    let table = String::from_utf8(table.get_output().stdout.clone()).unwrap();
    assert!(table.contains("slerp, a straight path") && table.contains("the sample that ends nearest"), "{table}");
    let json = gaps(&[&few[..], &["--json"]].concat()).success();
    let found: serde_json::Value = serde_json::from_slice(&json.get_output().stdout).unwrap();
    let cm = |row: usize| found["rows"][row]["mean"]["global_cm"].as_f64().unwrap();
    assert!(cm(0) > 0.0 && cm(1) > 0.0 && cm(4) <= cm(2), "{found}");
    gaps(&["--frames", "40"]).code(2).stderr(contains("--frames is 40; expected at most 30: the model sees 32"));
}

#[test]
fn features_stand_beside_those_of_real_clips() {
    let set = set();
    let mut c = kinelm();
    c.args(["evaluate", "dance"]).arg(set.at("data/5.bvh")).arg("--real").arg(set.at("corpus")).arg("--features");
    let table = c.assert().success().stdout(contains("kinetic features, fixed")).get_output().stdout.clone();
    let table = String::from_utf8(table).unwrap();
    assert!(table.contains("train with 5 cm of noise") && table.contains("too few"), "{table}");
    let json = c.arg("--json").assert().success().get_output().stdout.clone();
    let found: serde_json::Value = serde_json::from_slice(&json).unwrap();
    // clips of three seconds have no window of five, and one vector each in compat
    let vectors = |table: usize| found["features"][table]["sets"][3][1]["vectors"].as_u64();
    assert_eq!([vectors(0), vectors(2)], [Some(0), Some(1)], "{found}");
}

#[test]
fn real_clips_keep_their_numbers() {
    let set = set();
    for (name, clip, read) in [
        ("cmu-dance", "salsa/07.bvh", &["--fps-source", "60", "--skip", "10"][..]),
        ("bandai-2", "dataset-2_walk_active_001.bvh", &[][..]),
    ] {
        let Some(dir) = kinelm_shared_data::set(name, "real_clips_keep_their_numbers") else { continue };
        let prompt = dir.join(clip);
        let out = format!("{name}.bvh");
        let more = [read, &["--free", "all@0.6s:1s", "--free", "right_arm,head@1.2s:1.4s"]].concat();
        set.edit(&prompt, &more, &out).assert().success();
        let (old, new) = (source(&prompt, &ReadOptions::default()), source(&set.at(&out), &ReadOptions::default()));
        let (frames, _) = differ(&old, &new);
        let (fps, left_out) = if name == "cmu-dance" { (60.0, 10.0) } else { (old.fps(), 0.0) };
        let at = |s: f64| (s * fps).round() + left_out;
        let inside = |f: f64| (at(0.6)..at(1.0)).contains(&f) || (at(1.2)..at(1.4)).contains(&f);
        assert!(frames.len() > 10 && frames.iter().all(|&f| inside(f as f64)), "{name}: {frames:?}");
        // the rate that was stated, where that is another
        let time = if name == "cmu-dance" { "0.0166666667" } else { old.head.frame_time.as_str() };
        assert_eq!((old.frames, time), (new.frames, new.head.frame_time.as_str()));
    }
}

#[test]
fn two_folders_of_dances_are_held_to_each_other() {
    let set = set();
    for folder in ["lock", "off"] {
        std::fs::create_dir_all(set.at(folder)).unwrap();
        for prompt in ["4", "5"] {
            let more = ["--free", "legs@1s:2s", "--feet", folder];
            set.edit(&set.at(&format!("data/{prompt}.bvh")), &more, &format!("{folder}/{prompt}.bvh"))
                .assert()
                .success();
        }
    }
    let compare = |more: &[&str]| {
        let mut c = kinelm();
        c.args(["evaluate", "dance", "--real"]).arg(set.at("corpus")).arg("--compare");
        c.arg(set.at("lock")).arg(set.at("off")).args(more);
        c.assert()
    };
    let text = String::from_utf8(compare(&["--features"]).success().get_output().stdout.clone()).unwrap();
    assert!(text.contains("off, 2 dances of 2 takes\n") && text.contains("takes drawn for both at once"), "{text}");
    assert!(text.contains("\nskating, % of steps") && text.contains("doubt: 2 takes of A, 2 takes of B"), "{text}");
    assert!(text.contains("kinetic") && text.lines().any(|line| line.starts_with("A ")), "{text}");
    let json = compare(&["--json"]).success().get_output().stdout.clone();
    let found: serde_json::Value = serde_json::from_slice(&json).unwrap();
    let row = found["rows"].as_array().unwrap().iter().find(|row| row["what"] == "speed, cm/s").unwrap();
    let [a, b, d] = [&row["sides"][0], &row["sides"][1], &row["difference"]].map(|s| s["mean"].as_f64().unwrap());
    assert!(a > 1.0 && (b - a - d).abs() < 1e-9, "{row}");
    let plot = set.at("measures.svg");
    compare(&["--plot", plot.to_str().unwrap()]).success();
    let drawn = std::fs::read_to_string(&plot).unwrap();
    assert!(drawn.contains("skating, % of steps") && drawn.contains("% of clips with so much or less"));
    let page = set.at("compared.html");
    compare(&["--page", page.to_str().unwrap()]).success();
    let page = std::fs::read_to_string(&page).unwrap();
    assert!(page.contains("Angular jerk") && page.contains("Feet on the floor") && page.contains("fastest: "));
    let text = set.at("lock/4.bvh").with_extension("txt");
    compare(&["--plot", text.to_str().unwrap()]).code(2).stderr(contains("png"));
    compare(&["--copying"]).code(2).stderr(contains("cannot be used with"));
    let mut c = kinelm();
    c.args(["evaluate", "dance", "--real"]).arg(set.at("corpus")).args(["--compare", "none"]).arg(set.at("off"));
    c.assert().code(2).stderr(contains("--compare none: there is no such folder"));
}
