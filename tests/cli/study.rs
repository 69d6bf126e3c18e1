//! `kinelm tokenizer study` as a user runs it.

use crate::support::kinelm;
use assert_cmd::Command;
use kinelm_motion::{Motion, format, synth};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

const ROWS: &str = "[[row]]\nname = \"coarse\"\ngroup = \"uniform\"\nscheme = { type = \"uniform\", bins = 60 }\n\
                    [[row]]\nname = \"fine\"\ngroup = \"uniform\"\nscheme = { type = \"uniform\", bins = 360 }\n\
                    [[row]]\nname = \"slow\"\nfps = 20\njoints = \"24\"\nmerges = 30\n\
                    scheme = { type = \"uniform\", bins = 60 }\n";

/// Ten short dances of 30 frames per second, two of them for test.
struct Data {
    dir: tempfile::TempDir,
}

impl Data {
    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn study(&self, out: &str) -> Command {
        let mut c = kinelm();
        c.args(["tokenizer", "study"]).arg(self.at("data")).arg("--labels").arg(self.at("labels.csv"));
        c.arg("--schemes").arg(self.at("rows.toml")).arg("--out").arg(self.at(out));
        c
    }

    fn report(&self, out: &str) -> Value {
        serde_json::from_slice(&fs::read(self.at(out).join("study.json")).unwrap()).unwrap()
    }
}

fn data() -> &'static Data {
    static DATA: OnceLock<Data> = OnceLock::new();
    DATA.get_or_init(|| {
        let data = Data { dir: tempfile::tempdir().unwrap() };
        fs::create_dir(data.at("data")).unwrap();
        let mut csv = "clip,split\n".to_string();
        for (i, d) in synth::corpus(5, 10, 4.0, 30.0).unwrap().into_iter().enumerate() {
            let path = data.at(&format!("data/{}.bvh", d.name()));
            let motion = Motion::new(&path, d.clip.clone());
            format::write(&path, &motion).unwrap();
            csv += &format!("{},{}\n", d.name(), ["train", "train", "test", "train", "valid"][i % 5]);
        }
        fs::write(data.at("labels.csv"), csv).unwrap();
        fs::write(data.at("rows.toml"), ROWS).unwrap();
        data.study("study").assert().success().stdout(contains("coarse").and(contains("MPJPE, mm")));
        data
    })
}

/// A report without the figures that are not the same twice.
fn steady(mut report: Value) -> Value {
    for row in report["rows"].as_array_mut().unwrap() {
        row.as_object_mut().unwrap().remove("speed").unwrap();
    }
    report
}

fn files(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn tables_pictures_and_a_page() {
    let data = data();
    let expected = ["bins.png", "bins.svg", "page.html", "rate.png", "rate.svg", "rows", "study.json", "study.md"];
    assert_eq!(files(&data.at("study")), expected);
    let report = data.report("study");
    let rows = report["rows"].as_array().unwrap();
    let number =
        |row: usize, part: &str, key: &str| rows[row][part][key].as_f64().unwrap_or_else(|| panic!("{part}.{key}"));
    assert_eq!(
        (&report["fps"], &report["train"]["clips"], &report["test"]["clips"]),
        (&30.0.into(), &6.into(), &2.into())
    );
    for (row, bins) in [(0, 60.0), (1, 360.0)] {
        let width = 360.0 / bins;
        let angle = |key| number(row, "angle", key).to_degrees();
        assert!(angle("mean") < 0.4804 * width && angle("max") < 0.8661 * width, "{}", rows[row]);
        assert!(number(row, "mpjpe", "global") > 0.0 && number(row, "mpjpe", "root") < number(row, "mpjpe", "max"));
        assert_eq!((number(row, "text", "word_mean"), number(row, "text", "word_max")), (42.0, 42.0));
        assert!((number(row, "text", "seconds") - 1024.0 / 43.0 / 30.0).abs() < 1e-12);
        assert_eq!(number(row, "text", "tokens_per_second"), 43.0 * 30.0);
        assert!(number(row, "order0", "bits_per_frame") < 42.0 * bins.log2());
    }
    assert!(number(1, "angle", "mean") * 5.0 < number(0, "angle", "mean"), "errors fall as 1/n");
    assert!(number(2, "text", "word_mean") < number(2, "text", "characters_mean"), "merging shortens words");
    assert_eq!((number(2, "text", "characters_mean"), &rows[2]["row"]["config"]["fps"]), (75.0, &20.0.into()));
    let losses = report["losses"].as_array().unwrap();
    assert_eq!(losses.len(), 2);
    assert_eq!((&losses[0]["rate_mpjpe"], &losses[1]["joints_mpjpe"]), (&0.0.into(), &0.0.into()), "none is lost");
    assert!(losses[0]["joints_mpjpe"].as_f64().unwrap() > 1.0 && losses[1]["rate_mpjpe"].as_f64().unwrap() > 0.01);
    let markdown = fs::read_to_string(data.at("study/study.md")).unwrap();
    assert!(markdown.contains("| fine |") && markdown.contains("at 30 frames per second a tile of 60 frames is 2.0 s"));
}

#[test]
fn bits_are_those_of_the_baselines() {
    let data = data();
    let (tokenizer, corpus) = (data.at("t.json"), data.at("corpus"));
    let mut c = kinelm();
    c.args(["tokenizer", "fit"]).arg(data.at("data")).arg("--labels").arg(data.at("labels.csv"));
    c.args(["--joints", "13", "--fps", "30", "--bins", "60", "--out"]).arg(&tokenizer).assert().success();
    let mut c = kinelm();
    c.arg("tokenize").arg(data.at("data")).arg("--labels").arg(data.at("labels.csv"));
    c.arg("--tokenizer").arg(&tokenizer).arg("--out").arg(&corpus).assert().success();
    let output = kinelm().args(["evaluate", "baselines", "--json", "--corpus"]).arg(&corpus).output().unwrap();
    let floors: Value = serde_json::from_slice(&output.stdout).unwrap();
    let ours = &data.report("study")["rows"][0]["order0"];
    for (key, model) in [("written_bits_per_frame", "a_order0"), ("difference_bits_per_frame", "b_delta")] {
        let (a, b) = (ours[key].as_f64().unwrap(), floors["bits_per_frame"][model].as_f64().unwrap());
        assert!((a - b).abs() < 1e-9, "{model}: {a} here, {b} there");
    }
}

#[test]
fn what_is_finished_is_kept_and_threads_change_nothing() {
    let data = data();
    let whole = data.report("study");
    // a study that was interrupted: one row is missing
    fs::create_dir(data.at("again")).unwrap();
    fs::create_dir(data.at("again/rows")).unwrap();
    for name in files(&data.at("study/rows")).iter().filter(|n| !n.starts_with("fine")) {
        fs::copy(data.at("study/rows").join(name), data.at("again/rows").join(name)).unwrap();
    }
    data.study("again")
        .arg("--threads")
        .arg("1")
        .assert()
        .success()
        .stderr(contains("2 of 3 rows were measured before"));
    assert_eq!(steady(data.report("again")), steady(whole.clone()));
    assert_eq!(data.report("again")["rows"][0], whole["rows"][0], "with its speed: it was not measured again");
    data.study("again").assert().success().stderr(contains("3 of 3 rows were measured before"));
    data.study("again").args(["--force", "--threads", "3"]).assert().success().stderr(contains("before").not());
    assert_eq!(steady(data.report("again")), steady(whole.clone()));
    assert_eq!(data.report("again")["rows"][2]["speed"]["threads"], 3);
}

#[test]
fn wrong_calls_say_what_would_be_right() {
    let data = data();
    let rows = |text: &str| {
        fs::write(data.at("bad.toml"), text).unwrap();
        let mut c = kinelm();
        c.args(["tokenizer", "study"]).arg(data.at("data")).arg("--labels").arg(data.at("labels.csv"));
        c.arg("--schemes").arg(data.at("bad.toml")).arg("--out").arg(data.at("bad")).assert().code(1)
    };
    let bad = ROWS.replace("bins = 360", "bin = 360");
    rows(&bad).stderr(contains("bad.toml:5:1").and(contains("row fine: unknown field `bin`")));
    rows("").stderr(contains("bad.toml").and(contains("row")));
    assert!(!data.at("bad").exists(), "nothing is written");
    data.study("study").args(["--show", "coarse,best"]).assert().code(2).stderr(contains("--show is best; expected"));
    data.study("data").assert().code(1).stderr(contains("no study wrote"));
    let mut c = kinelm();
    c.args(["tokenizer", "study"]).arg(data.at("data/../data")).arg("--schemes").arg(data.at("none.toml"));
    c.arg("--out").arg(data.at("bad")).assert().code(1).stderr(contains("none.toml"));
    data.study("bad").args(["--joints", "wings"]).assert().code(2).stderr(contains("wings"));
}

#[test]
fn the_page_shows_the_rows_that_are_asked_for() {
    let data = data();
    data.study("study").args(["--show", "slow,fine"]).assert().success();
    let page = fs::read_to_string(data.at("study/page.html")).unwrap();
    let title = page.split("<title>").nth(1).unwrap().split("</title>").next().unwrap();
    assert!(title.ends_with(", slow, fine"), "{title}");
}

#[test]
fn channels_are_drawn_with_the_edges_of_their_bins() {
    let data = data();
    data.study("drawn").args(["--channels", "left_knee.x,head.y"]).assert().success().stderr(
        // its edges at 60 bins are 6 degrees apart; only `slow` codes the head
        contains("drawn: study.md").and(contains("channels.png")),
    );
    let svg = fs::read_to_string(data.at("drawn/channels.svg")).unwrap();
    let titles = ["left_knee.x, coarse: 60 bins", "left_knee.x, slow: 60 bins", "head.y, slow: 60 bins"];
    assert!(titles.iter().all(|title| svg.contains(title)) && !svg.contains("head.y, coarse"), "{svg}");
    let said = contains("--channels is left_knee.w; expected JOINT.x").and(contains("left_hip, right_hip"));
    data.study("drawn").args(["--channels", "left_knee.w"]).assert().code(2).stderr(said);
}
