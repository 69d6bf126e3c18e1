//! Motion files to a generated dance, as a user goes.

use crate::support::{kinelm, save};
use assert_cmd::Command;
use kinelm_motion::format::resolve_floor;
use kinelm_motion::{format, synth};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

const CONFIG: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 32\ncontext = 130\n\
                      [train]\nbatch = 2\nsteps = 4\nwarmup = 1\neval_every = 2\ncheckpoint_every = 2\n";

/// Twelve short dances in folders by genre, a tokenizer, a corpus, and a run of four steps.
struct Way {
    dir: tempfile::TempDir,
}

impl Way {
    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// A dance that no file of the corpus is.
    fn prompt(&self) -> PathBuf {
        self.at("prompt.bvh")
    }

    fn generate(&self, out: &str) -> Command {
        let mut c = kinelm();
        c.arg("generate").arg("--run").arg(self.at("run")).arg("--prompt").arg(self.prompt());
        c.args(["--joints", "root,right_arm", "--out"]).arg(self.at(out));
        c
    }

    /// The words of the prompt.
    fn prompted(&self) -> Vec<Vec<char>> {
        let options = format::ReadOptions { rest: format::RestFrame::Drop, ..Default::default() };
        let mut prompt = format::read(&self.prompt(), &options).unwrap();
        self.words_above(&self.prompt(), resolve_floor(&mut prompt, &options).unwrap())
    }

    /// The words of a dance.
    fn words(&self, name: &str) -> Vec<Vec<char>> {
        self.words_above(&self.at(name), 0.0)
    }

    fn words_above(&self, clip: &Path, floor_m: f64) -> Vec<Vec<char>> {
        let mut c = kinelm();
        c.args(["tokenizer", "text"]).arg(clip).arg("--tokenizer").arg(self.at("t.json"));
        let text = c.args(["--floor", &floor_m.to_string()]).output().unwrap();
        let text = String::from_utf8(text.stdout).unwrap();
        assert_eq!(text.lines().count(), 1);
        text.trim_end().split(' ').map(|w| w.chars().collect()).collect()
    }
}

fn way() -> &'static Way {
    static WAY: OnceLock<Way> = OnceLock::new();
    WAY.get_or_init(|| {
        let way = Way { dir: tempfile::tempdir().unwrap() };
        for d in synth::corpus(3, 12, 3.0, 30.0).unwrap() {
            save(&way.at(&format!("data/{}/{}.bvh", d.genre, d.name())), &d.clip);
        }
        save(&way.prompt(), &synth::corpus(8, 1, 3.0, 30.0).unwrap()[0].clip);
        fs::write(way.at("c.toml"), CONFIG).unwrap();
        let labels = way.at("labels.csv");
        fs::write(&labels, labels_of(&way.at("data"))).unwrap();
        let data = |c: &mut Command| {
            c.arg(way.at("data")).arg("--labels").arg(&labels);
        };
        let mut c = kinelm();
        data(c.args(["tokenizer", "fit", "--joints", "13"]));
        c.arg("--out").arg(way.at("t.json")).assert().success().stdout("");
        let mut c = kinelm();
        data(c.arg("tokenize"));
        c.arg("--tokenizer").arg(way.at("t.json")).arg("--out").arg(way.at("corpus")).assert().success().stdout("");
        pretrain(&way, "run").assert().success().stderr(contains("bits/frame"));
        way
    })
}

/// The first dance of every genre is for test, the second for validation.
fn labels_of(data: &Path) -> String {
    let mut csv = "clip,split,genre\n".to_string();
    for genre in sorted(data) {
        for (i, clip) in sorted(&genre).iter().enumerate() {
            let name = clip.with_extension("").strip_prefix(data).unwrap().display().to_string();
            let split = ["test", "valid", "train"][i.min(2)];
            csv += &format!("{name},{split},{}\n", genre.file_name().unwrap().to_str().unwrap());
        }
    }
    csv
}

fn sorted(dir: &Path) -> Vec<PathBuf> {
    let mut all: Vec<_> = fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).collect();
    all.sort();
    all
}

fn pretrain(way: &Way, run: &str) -> Command {
    let mut c = kinelm();
    c.arg("pretrain").arg("--config").arg(way.at("c.toml")).arg("--corpus").arg(way.at("corpus"));
    c.arg("--run").arg(way.at(run));
    c
}

/// Places of root (translation and pelvis) and of the right arm's three coded joints in a word of the thirteen.
fn given() -> Vec<usize> {
    (0..6).chain(27..30).chain(33..36).chain(39..42).collect()
}

#[test]
fn a_dance_of_seconds_is_written_at_the_rate_wanted() {
    let way = way();
    // feet are held at the rate that is written
    let slow = ["--seconds", "1.5", "--feet", "off"];
    way.generate("slow.bvh")
        .args(slow)
        .args(["--fps", "20"])
        .assert()
        .success()
        .stderr(contains("30 frames at 20 fps"));
    way.generate("own.bvh").args(slow).assert().success().stderr(contains("45 frames at 30 fps"));
    way.generate("fast.bvh").args(slow).args(["--fps", "60"]).assert().success().stderr(contains("90 frames at 60"));
    let read = |name: &str| format::read(&way.at(name), &Default::default()).unwrap().clip;
    let (slow, fast) = (read("slow.bvh"), read("fast.bvh"));
    for f in 0..slow.frames() {
        assert!((slow.root()[f] - fast.root()[3 * f]).length() < 1e-6, "frame {f}");
        let apart =
            slow.pose(f).iter().zip(fast.pose(3 * f)).map(|(&a, &b)| kinelm_motion::rotation::angle_between(a, b));
        assert!(apart.fold(0.0, f64::max) < 1e-6, "frame {f}");
    }
    // on the prompt's rig its own frames are read back from among them
    let mut own = way.generate("own60.bvh");
    own.args(["--fps", "60", "--rig", "prompt"])
        .assert()
        .success()
        .stderr(contains("read back from the prompt's rig, 0."));
    let first = fs::read(way.at("own60.bvh")).unwrap();
    let sidecar = way.at("own60.bvh.kinelm.json");
    kinelm().args(["again"]).arg(&sidecar).assert().success();
    assert_eq!(fs::read(way.at("own60.bvh")).unwrap(), first);
    let mut bad = way.generate("bad.bvh");
    bad.args(["--frames", "9", "--seconds", "2"]).assert().code(2);
    way.generate("bad.bvh").args(["--fps", "1e9"]).assert().failure().stderr(contains("at most"));
    // joints as the prompt's rig names them, and a slip of the hand
    let joints = |list: &str| {
        let mut c = kinelm();
        c.arg("generate").arg("--run").arg(way.at("run")).arg("--prompt").arg(way.prompt());
        c.args(["--joints", list, "--frames", "9", "--out"]).arg(way.at("names.bvh"));
        c.assert()
    };
    joints("root,rigth_arm").code(2).stderr(contains("did you mean right_arm?"));
}

#[test]
fn given_joints_come_out_exactly_on_the_model_s_rig() {
    let way = way();
    way.generate("a.bvh").args(["--frames", "40", "--fps", "20"]).assert().success().stdout("");
    let (prompt, dance) = (way.prompted(), way.words("a.bvh"));
    assert_eq!(dance.len(), 40);
    for (f, (p, d)) in prompt.iter().zip(&dance).enumerate() {
        assert_eq!(d.len(), 42);
        for place in given() {
            assert_eq!(p[place], d[place], "frame {f}, place {place}");
        }
    }
    assert!(prompt.iter().zip(&dance).any(|(p, d)| p != d), "the rest is invented");
}

#[test]
fn given_joints_come_out_exactly_on_the_prompt_s_rig() {
    let way = way();
    way.generate("b.bvh")
        .args(["--frames", "30", "--fps", "20", "--rig", "prompt", "--uncoded-joints", "mean"])
        .assert()
        .success()
        .stderr(contains("0.0000 % of the given characters differ"));
}

#[test]
fn a_seed_is_a_dance_whatever_the_threads() {
    let way = way();
    let make = |out: &str, more: &[&str]| {
        way.generate(out).args(["--frames", "12"]).args(more).assert().success();
        fs::read(way.at(out)).unwrap()
    };
    let one = make("s1.json", &["--seed", "5"]);
    assert_eq!(one, make("s2.json", &["--seed", "5", "--threads", "1"]));
    assert_ne!(one, make("s3.json", &["--seed", "6"]));
    assert_eq!(one, make("s6.json", &["--seed", "5", "--guesses", "3"]));
    way.generate("v.json").args(["--frames", "12", "--seed", "5", "--variations", "3"]).assert().success();
    let variations = ["v-1.json", "v-2.json", "v-3.json"].map(|name| fs::read(way.at(name)).unwrap());
    assert_eq!(one, variations[0]);
    assert!(variations[1] != one && variations[2] != one && variations[1] != variations[2]);
    make("s7.json", &["--weights", "int8", "--kv", "f16"]);
    let both = way.generate("no.json").args(["--greedy", "--variations", "2"]).assert();
    both.code(2).stderr(contains("always the same"));
    let greedy = make("s4.json", &["--greedy"]);
    assert_eq!(greedy, make("s5.json", &["--greedy", "--seed", "9"]));
}

#[test]
fn a_dance_goes_on_from_a_frame_and_follows_joints() {
    let way = way();
    way.generate("on.bvh").args(["--frames", "40", "--from-frame", "10", "--fps", "20"]).assert().success();
    let (prompt, dance) = (way.prompted(), way.words("on.bvh"));
    assert_eq!(prompt[..10], dance[..10]);
    for (p, d) in prompt.iter().zip(&dance) {
        assert!(given().into_iter().all(|place| p[place] == d[place]));
    }
    assert!(prompt[10..].iter().zip(&dance[10..]).any(|(p, d)| p != d), "the rest is invented");
}

#[test]
fn a_dance_tells_where_it_is_from_and_can_be_made_again() {
    let way = way();
    let again = |file: &str, more: &[&str]| {
        let mut c = kinelm();
        c.args(["again"]).arg(way.at(file)).args(more).assert()
    };
    let prompt = way.at("told-prompt.bvh");
    fs::copy(way.prompt(), &prompt).unwrap();
    let mut c = kinelm();
    c.arg("generate").arg("--run").arg(way.at("run")).arg("--prompt").arg(&prompt).args(["--joints", "legs"]);
    c.args(["--frames", "10", "--seed", "3", "--variations", "2", "--top-k", "20", "--min-p", "0.01"]);
    c.args(["--repetition-penalty", "1.5", "--rig", "prompt", "--out"]).arg(way.at("told.bvh")).assert().success();
    let sidecar = fs::read(way.at("told-2.bvh.kinelm.json")).unwrap();
    let told: serde_json::Value = serde_json::from_slice(&sidecar).unwrap();
    let request = &told["request"];
    assert_eq!(
        (&told["variation"], &request["seed"], &request["sampling"]["top_k"]),
        (&2.into(), &3.into(), &20.into())
    );
    assert_eq!((&request["frames"], &request["prompt"]["joints"]), (&10.into(), &"legs".into()));
    assert!(
        told["weights_sha256"].as_str().unwrap().len() == 64 && told["prompt_sha256"].as_str().unwrap().len() == 64
    );

    let bytes = fs::read(way.at("told-2.bvh")).unwrap();
    fs::remove_file(way.at("told-2.bvh")).unwrap();
    again("told-2.bvh.kinelm.json", &[]).success().stdout("");
    assert!(fs::read(way.at("told-2.bvh")).unwrap() == bytes);
    assert!(fs::read(way.at("told-2.bvh.kinelm.json")).unwrap() == sidecar);
    let elsewhere = way.at("told-elsewhere.bvh").display().to_string();
    again("told-2.bvh.kinelm.json", &["--out", &elsewhere, "--threads", "1"]).success();
    assert!(fs::read(&elsewhere).unwrap() == bytes);
    again("told-elsewhere.bvh.kinelm.json", &[]).success();

    // what has changed is named, and nothing is written
    let said = contains("the prompt is SHA-256 ").and(contains("it has changed since the dance was made"));
    fs::write(&prompt, [fs::read(&prompt).unwrap(), b"\n".to_vec()].concat()).unwrap();
    again("told-2.bvh.kinelm.json", &["--out", &elsewhere]).code(1).stderr(said);
    pretrain(way, "told-run").args(["--seed", "9"]).assert().success();
    let (run, prompt) = (way.at("told-run").display().to_string(), way.prompt().display().to_string());
    again("told-2.bvh.kinelm.json", &["--run", &run, "--prompt", &prompt])
        .code(1)
        .stderr(contains("the weights at step"));
    again("told-2.bvh.kinelm.json", &["--seed", "4"]).code(2).stderr(contains("unexpected argument '--seed'"));

    // a file of the user's own is left alone
    fs::write(way.at("mine.bvh.kinelm.json"), "{}").unwrap();
    way.generate("mine.bvh").args(["--frames", "2"]).assert().code(2).stderr(contains("--force"));
    assert_eq!(fs::read(way.at("mine.bvh.kinelm.json")).unwrap(), b"{}");
    assert!(!way.at("mine.bvh").exists());
}

#[test]
fn labels_in_front_and_guidance_make_other_dances() {
    let way = way();
    // enough for labels to matter
    let config = CONFIG.replace("steps = 4\n", "steps = 30\nlearning_rate = 1e-2\n") + "conditions = [\"genre\"]\n";
    fs::write(way.at("labelled.toml"), config.replace("context = 130\n", "context = 140\n")).unwrap();
    let mut c = kinelm();
    c.arg("pretrain").arg("--config").arg(way.at("labelled.toml")).arg("--corpus").arg(way.at("corpus"));
    c.arg("--run").arg(way.at("labelled")).args(["--form", "plain"]).assert().success();
    let genres: Vec<String> =
        sorted(&way.at("data")).iter().map(|g| g.file_name().unwrap().to_str().unwrap().to_string()).collect();
    let dance = |out: &str, more: &[&str]| {
        let mut c = kinelm();
        c.arg("generate")
            .arg("--run")
            .arg(way.at("labelled"))
            .args(["--frames", "8", "--out"])
            .arg(way.at(out))
            .args(more);
        c.assert()
    };
    let bytes = |out: &str, more: &[&str]| {
        dance(out, more).success();
        fs::read(way.at(out)).unwrap()
    };
    let label = format!("genre={}", genres[0]);
    let plain = bytes("l0.json", &[]);
    let told = bytes("l1.json", &["--label", &label, "--guidance", "1"]);
    let guided = bytes("l2.json", &["--label", &label, "--guidance", "40"]);
    assert!(plain != told && told != guided && plain != guided);
    assert_eq!(bytes("l3.json", &["--label", &label]), bytes("l5.json", &["--label", &label, "--guidance", "2"]));
    dance("l4.json", &["--label", &label, "--guidance", "40", "--variations", "2"]).success();
    assert_eq!(fs::read(way.at("l4-1.json")).unwrap(), guided);
    let again = kinelm().args(["again"]).arg(way.at("l4-2.json.kinelm.json")).assert();
    again.success();
    dance("no.json", &["--label", "genre=house"])
        .code(2)
        .stderr(contains(genres[0].as_str()).and(contains(genres[1].as_str())));
    dance("no.json", &["--label", "mood=x"]).code(2).stderr(contains("this model knows genre"));
    dance("no.json", &["--label", &label, "--label", &label]).code(2).stderr(contains("twice"));
    dance("no.json", &["--guidance", "2"]).code(2).stderr(contains("there are neither labels nor music to follow"));
    way.generate("no.json").args(["--guidance", "2"]).assert().code(2).stderr(contains("this model knows no labels"));
}

#[test]
fn dances_are_held_to_real_ones() {
    let way = way();
    way.generate("held.json").args(["--frames", "60", "--fps", "20"]).assert().success();
    way.generate("held-30.json").args(["--frames", "60"]).assert().success();
    let mut c = kinelm();
    c.args(["evaluate", "dance", "--json", "--copying", "--real"]).arg(way.at("corpus"));
    c.args(["held.json", "held-30.json"].map(|name| way.at(name)));
    let output = c.output().unwrap();
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let names: Vec<&str> = found["groups"].as_array().unwrap().iter().map(|g| g["name"].as_str().unwrap()).collect();
    assert!(names[..3] == ["train", "valid", "dances"] && names[3].ends_with("held.json"), "{names:?}");
    assert_eq!(found["prompted"][0][1]["mismatch"], 0.0, "given characters come out as they went in");
    assert!(found["prompted"][1][1]["mismatch"].is_null(), "at 30 fps a file lacks the frames that were sampled");
    assert!(found["prompted"][0][1]["coordination"]["effect"].is_number() && found["copied"]["copy_rate"].is_number());
    // a corpus of other words says so, and compares no characters
    let mut c = kinelm();
    c.args(["tokenizer", "fit", "--joints", "13", "--bins", "60"])
        .arg(way.at("data"))
        .arg("--labels")
        .arg(way.at("labels.csv"));
    c.arg("--out").arg(way.at("coarse.json")).assert().success();
    let mut c = kinelm();
    c.arg("tokenize").arg(way.at("data")).arg("--labels").arg(way.at("labels.csv"));
    c.arg("--tokenizer").arg(way.at("coarse.json")).arg("--out").arg(way.at("coarse")).assert().success();
    let evaluate = |more: &[&str]| {
        let mut c = kinelm();
        c.args(["evaluate", "dance", "--real"]).arg(way.at("coarse")).arg(way.at("held.json")).args(more);
        String::from_utf8(c.assert().success().get_output().stdout.clone()).unwrap()
    };
    let other = "the corpus has another tokenizer (";
    let text = evaluate(&[]);
    assert!(text.contains(&format!("its characters are not compared: {other}")) && !text.contains("differ"), "{text}");
    let found: serde_json::Value = serde_json::from_str(&evaluate(&["--json"])).unwrap();
    let prompted = &found["prompted"][0][1];
    assert!(prompted["mismatch"].is_null() && prompted["not_compared"].as_str().unwrap().starts_with(other), "{found}");
    let mut c = kinelm();
    c.args(["evaluate", "dance", "--real"]).arg(way.at("data")).arg(way.at("held.json"));
    c.assert().code(2).stderr(contains("no corpus.json"));
}

#[test]
fn the_next_400_ms_and_the_bits_of_every_joint() {
    let way = way();
    let json = |c: &mut Command| -> serde_json::Value { serde_json::from_slice(&c.output().unwrap().stdout).unwrap() };
    let mut c = kinelm();
    c.args(["evaluate", "prediction", "--json", "--samples", "2", "--run"]).arg(way.at("run")).arg(way.at("data"));
    let found = json(c.arg("--labels").arg(way.at("labels.csv")));
    let names: Vec<&str> = found["rows"].as_array().unwrap().iter().map(|r| r["name"].as_str().unwrap()).collect();
    let model = ["the model, greedy", "the model, samples", "the model, best of 2 samples"];
    assert_eq!(names, [["zero velocity", "constant velocity"].as_slice(), &model].concat());
    // of the 15 joints the thirteen have eight
    assert!(found["rows"].as_array().unwrap().iter().all(|r| r["joints"] == 8 && r["windows"].as_u64() > Some(0)));
    let angle = |row: usize| found["rows"][row]["up_to"][3]["angle"].as_f64().unwrap();
    assert!(angle(0) > 0.0 && angle(4) <= angle(3), "the best of two samples is no worse than both: {found}");

    let still = |more: &[&str]| {
        let mut c = kinelm();
        c.args(["evaluate", "prediction"]).args(more).arg(way.at("data")).arg("--labels").arg(way.at("labels.csv"));
        c
    };
    let alone = json(&mut still(&["--json", "--fps", "20"]));
    let rows: Vec<_> =
        alone["rows"].as_array().unwrap().iter().map(|r| (&r["name"], &r["joints"], &r["fps"])).collect();
    assert_eq!(rows[0], (&"zero velocity".into(), &15.into(), &20.0.into()), "without a run all 15 joints count");
    assert_eq!(rows.len(), 2);
    still(&["--fps", "240"]).assert().code(1).stderr(contains("at 240 fps or more; give --fps"));

    let mut c = kinelm();
    c.args(["evaluate", "likelihood", "--per-joint", "--json", "--run"]).arg(way.at("run"));
    let found = json(c.arg("--corpus").arg(way.at("corpus")));
    let bits = found["bits_per_frame"].as_f64().unwrap();
    let parts: f64 = found["parts"].as_object().unwrap().values().map(|x| x.as_f64().unwrap()).sum();
    assert!((parts / bits - 1.0).abs() < 1e-9 && found["places"].as_array().unwrap().len() == 43, "{parts} {bits}");
    let all = found["all_frames"].as_f64().unwrap();
    assert!((found["bits"]["model"].as_f64().unwrap() / (bits * all) - 1.0).abs() < 1e-9);
}

#[test]
fn beyond_the_prompt_the_dance_is_free_and_a_line_says_so() {
    let way = way();
    let p = way.prompted().len();
    let frames = (p + 5).to_string();
    let said = format!("the prompt ends after {p} frames; the 5 that follow are generated free");
    way.generate("long.bvh").args(["--frames", &frames, "--fps", "20"]).assert().success().stderr(contains(said));
    assert_eq!(way.words("long.bvh").len(), p + 5);
}

#[test]
fn wrong_calls_say_what_would_be_right() {
    let way = way();
    let bad = |args: &[&str]| {
        let mut c = kinelm();
        c.arg("generate").arg("--prompt").arg(way.prompt()).args(args).arg("--out").arg(way.at("no.bvh"));
        c.assert()
    };
    let run = way.at("run").display().to_string();
    bad(&["--run", &run, "--joints", "left_wing"]).code(2).stderr(contains("left_wing").and(contains("right_arm")));
    bad(&["--run", &run, "--joints", "head"]).code(2).stderr(contains("none of these joints is coded"));
    bad(&["--run", "nowhere", "--joints", "root"]).code(1).stderr(contains("nowhere"));
    bad(&["--run", &run, "--joints", "root", "--temperature", "0"]).code(2);
    bad(&["--run", &run, "--joints", "root", "--top-p", "2"])
        .code(2)
        .stderr(contains("is 2; expected a number above 0 and up to 1"));
    bad(&["--run", &run, "--joints", "root", "--greedy", "--top-k", "3"]).code(2);
    bad(&["--run", &run]).code(2).stderr(contains("--from-frame N"));
    bad(&["--run", &run, "--from-frame", "10", "--frames", "4000000000"])
        .code(2)
        .stderr(contains("expected at most 1e9 seconds or frames"));
    bad(&["--run", &run, "--from-frame", "10", "--frames", "10"])
        .code(2)
        .stderr(contains("nothing is left to generate"));
    bad(&["--run", &run, "--from-frame", "9999", "--frames", "99999"])
        .code(2)
        .stderr(contains("--from-frame is 9999; expected a frame of the prompt"));
    bad(&["--run", &run, "--joints", "root", "--label", "genre"]).code(2).stderr(contains("FIELD=VALUE"));
    bad(&["--run", &run, "--joints", "root", "--label", "genre=a"])
        .code(2)
        .stderr(contains("this model knows no labels"));
    assert!(!way.at("no.bvh").exists());
    pretrain(way, "run").assert().code(2).stderr(contains("run").and(contains("resume it")));
}

#[test]
fn words_decode_to_the_clip_they_came_from() {
    let way = way();
    let text = kinelm()
        .args(["tokenizer", "text"])
        .arg(way.prompt())
        .arg("--tokenizer")
        .arg(way.at("t.json"))
        .output()
        .unwrap();
    fs::write(way.at("w.txt"), &text.stdout).unwrap();
    let mut c = kinelm();
    c.args(["tokenizer", "decode"]).arg(way.at("w.txt")).arg(way.at("w.bvh")).arg("--tokenizer").arg(way.at("t.json"));
    c.assert().success();
    // words know no floor: decoded it is at 0
    assert_eq!(way.words_above(&way.at("w.bvh"), 0.0), way.prompted(), "encode(decode(codes)) = codes");
    fs::write(way.at("bad.txt"), "not words of ours").unwrap();
    let mut c = kinelm();
    c.args(["tokenizer", "decode"])
        .arg(way.at("bad.txt"))
        .arg(way.at("x.bvh"))
        .arg("--tokenizer")
        .arg(way.at("t.json"));
    c.assert().code(1).stderr(contains("bad.txt").and(contains("word")));
}

#[test]
fn shards_merge_to_the_same_bytes() {
    let way = way();
    let tokenize = |out: &str, more: &[&str]| {
        let mut c = kinelm();
        c.arg("tokenize").arg(way.at("data")).arg("--labels").arg(way.at("labels.csv"));
        c.arg("--tokenizer").arg(way.at("t.json")).arg("--out").arg(way.at(out)).args(more).assert().success();
    };
    tokenize("s0", &["--shard", "0/2"]);
    tokenize("s1", &["--shard", "1/2"]);
    let mut c = kinelm();
    c.args(["corpus", "merge"])
        .args([way.at("s1"), way.at("s0")])
        .arg("--out")
        .arg(way.at("merged"))
        .assert()
        .success();
    for file in ["corpus.json", "tokens.u16", "clips.jsonl", "tokenizer.json"] {
        assert!(
            fs::read(way.at("merged").join(file)).unwrap() == fs::read(way.at("corpus").join(file)).unwrap(),
            "{file}"
        );
    }
    kinelm().args(["corpus", "stats"]).arg(way.at("merged")).assert().success().stdout(contains("12 clips"));
}

#[test]
fn a_bad_file_among_good_ones_is_named() {
    let way = way();
    let data = tempfile::tempdir().unwrap();
    for name in ["a.bvh", "b.bvh"] {
        fs::copy(way.prompt(), data.path().join(name)).unwrap();
    }
    fs::write(data.path().join("c.bvh"), "HIERARCHY\njunk").unwrap();
    let tokenize = |strict: bool| {
        let mut c = kinelm();
        c.arg("tokenize").arg(data.path()).arg("--tokenizer").arg(way.at("t.json"));
        c.arg("--out").arg(data.path().join(if strict { "strict" } else { "corpus" }));
        if strict {
            c.arg("--strict");
        }
        c.assert().stderr(contains("c.bvh:2:1").and(contains("unexpected_word")))
    };
    tokenize(false).code(1);
    assert!(data.path().join("corpus/corpus.json").exists(), "the rest is done");
    tokenize(true).code(1);
    assert!(!data.path().join("strict").exists(), "nothing half-written");
}

#[test]
fn a_seed_is_a_model_and_a_run_goes_on() {
    let way = way();
    let weights = |run: &str| {
        let latest = fs::read_to_string(way.at(run).join("latest")).unwrap();
        fs::read(way.at(run).join("checkpoints").join(latest.trim()).join("model.safetensors")).unwrap()
    };
    pretrain(way, "again").args(["--threads", "1"]).assert().success();
    assert_eq!(weights("again"), weights("run"), "the same seed gives the same bytes");
    pretrain(way, "other").args(["--seed", "7"]).assert().success();
    assert_ne!(weights("other"), weights("run"));
    pretrain(way, "half").args(["--steps", "2"]).assert().success();
    let mut c = kinelm();
    c.args(["pretrain", "resume", "--steps", "4"]).arg(way.at("half")).assert().success();
    assert!(fs::read_to_string(way.at("half/latest")).unwrap().contains("step-00000004"));
    let mut c = kinelm();
    c.args(["evaluate", "likelihood", "--json", "--run"]).arg(way.at("run")).arg("--corpus").arg(way.at("corpus"));
    let line: serde_json::Value = serde_json::from_slice(&c.output().unwrap().stdout).unwrap();
    // four steps of a tiny model: somewhere near every character equally likely
    assert!((200.0..420.0).contains(&line["bits_per_frame"].as_f64().unwrap()), "{line}");
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_a_checkpoint_that_generate_takes() {
    let way = way();
    let config = CONFIG.replace("steps = 4", "steps = 1000000");
    fs::write(way.at("endless.toml"), config).unwrap();
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("kinelm"));
    child.arg("pretrain").arg("--config").arg(way.at("endless.toml")).arg("--corpus").arg(way.at("corpus"));
    let mut child = child.arg("--run").arg(way.at("endless")).stderr(std::process::Stdio::piped()).spawn().unwrap();
    let metrics = way.at("endless").join("metrics.jsonl");
    while fs::metadata(&metrics).map_or(true, |m| m.len() == 0) {
        assert!(child.try_wait().unwrap().is_none(), "the run ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(130) && said.contains("pretrain resume "), "{said}");
    let mut c = kinelm();
    c.arg("generate").arg("--run").arg(way.at("endless")).arg("--prompt").arg(way.prompt());
    c.args(["--joints", "legs", "--frames", "5", "--out"]).arg(way.at("stopped.bvh")).assert().success();
}

#[test]
fn a_device_that_is_not_there_is_named_before_anything_is_written() {
    let way = way();
    pretrain(way, "none").args(["--device", "gpu"]).assert().code(2).stderr(contains("expected cpu, or cuda:N"));
    let no_card = || contains("--device cuda:7: ").and(contains("or cpu").or(contains("or use cpu")));
    pretrain(way, "none").args(["--device", "cuda:7"]).assert().code(2).stderr(no_card());
    assert!(!way.at("none").exists());
    way.generate("none.bvh").args(["--device", "cuda:7"]).assert().code(2).stderr(no_card());
    let mut c = kinelm();
    c.args(["evaluate", "likelihood", "--device", "cuda:7", "--run"]).arg(way.at("run"));
    c.arg("--corpus").arg(way.at("corpus")).assert().code(2).stderr(no_card());
    kinelm().current_dir(way.dir.path()).args(["demo", "--device", "cuda:7"]).assert().code(2).stderr(no_card());
    assert!(!way.at("demo").exists());
}

#[test]
fn the_plain_form_is_there_on_request() {
    let way = way();
    pretrain(way, "plain").args(["--form", "plain", "--steps", "1"]).assert().success();
    way.generate("plain.bvh").args(["--form", "plain", "--frames", "2"]).assert().success();
    way.generate("plain.bvh").args(["--form", "fast"]).assert().code(2).stderr(contains("expected auto or plain"));
}
