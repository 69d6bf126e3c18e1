//! `inspect`, `convert` and `view` as a user runs them.

use crate::support::{kinelm, save};
use kinelm_motion::{Clip, Motion, Vec3, format, synth};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fs;
use std::path::Path;

/// Two joints, three frames; Zrotation 90 lays the child along -x.
const TWO: &str = "HIERARCHY\nROOT a\n{\n  OFFSET 0 0 0\n  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n  JOINT b\n  {\n    OFFSET 0 10 0\n    CHANNELS 3 Zrotation Xrotation Yrotation\n    End Site\n    {\n      OFFSET 0 1 0\n    }\n  }\n}\nMOTION\nFrames: 3\nFrame Time: 0.05\n1 2 3 90 0 0 0 0 0\n1 2 3 90 90 0 0 0 0\n1 2 3 0 0 0 0 0 0\n";

fn two(dir: &Path) -> std::path::PathBuf {
    let path = dir.join("two.bvh");
    fs::write(&path, TWO).unwrap();
    path
}

/// The numbers of one array of an npz, and its shape.
fn array(path: &Path, name: &str) -> (Vec<u64>, Vec<f64>) {
    let mut zip = zip::ZipArchive::new(fs::File::open(path).unwrap()).unwrap();
    let mut bytes = Vec::new();
    std::io::copy(&mut zip.by_name(&format!("{name}.npy")).unwrap(), &mut bytes).unwrap();
    let npy = npyz::NpyFile::new(&bytes[..]).unwrap();
    let shape = npy.shape().to_vec();
    let numbers = match npy.dtype().descr().as_str() {
        "'<f4'" => npy.into_vec::<f32>().unwrap().into_iter().map(f64::from).collect(),
        "'<i4'" => npy.into_vec::<i32>().unwrap().into_iter().map(f64::from).collect(),
        "'<f8'" => npy.into_vec::<f64>().unwrap(),
        other => panic!("{name} is {other}"),
    };
    (shape, numbers)
}

#[test]
fn positions_are_the_file_s_own() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("p.npz");
    kinelm().args(["convert", "--positions", "--unit", "m"]).arg(two(dir.path())).arg(&out).assert().success();
    let (shape, p) = array(&out, "positions");
    assert_eq!(shape, [3, 3, 3], "three frames of a, b and the end of b");
    for (got, want) in p[3..6].iter().zip([-9.0, 2.0, 3.0]) {
        assert!((got - want).abs() < 1e-5, "{p:?}");
    }
    for (got, want) in p[12..15].iter().zip([1.0, 2.0, 13.0]) {
        assert!((got - want).abs() < 1e-5, "{p:?}");
    }
    assert_eq!(array(&out, "parents"), (vec![3], vec![-1.0, 0.0, 1.0]));
    assert_eq!(array(&out, "fps"), (vec![], vec![20.0]));
}

#[test]
fn options_may_stand_between_and_positions_go_with_a_rate_and_a_rig() {
    let dir = tempfile::tempdir().unwrap();
    let dance = synth::corpus(1, 1, 2.0, 60.0).unwrap().remove(0).clip;
    let path = dir.path().join("a.bvh");
    let motion = Motion::new(&path, dance);
    format::write(&path, &motion).unwrap();
    let call = |words: &str| kinelm().current_dir(dir.path()).args(words.split_whitespace()).assert();
    call("convert a.bvh --fps 30 b.bvh").success();
    call("convert a.bvh --fps 30").code(2).stderr(contains("IN OUT"));
    call("convert a.bvh still.bvh --in-place").success();
    call("convert a.bvh start.bvh --at-origin").success();
    call("convert a.bvh none.bvh --at-origin --in-place").code(2);
    call("convert a.bvh c.npz --positions --fps 30 --onto smpl --from 1s").success();
    let (shape, _) = array(&dir.path().join("c.npz"), "positions");
    assert_eq!((shape[0], shape[2]), (30, 3));
    assert_eq!(array(&dir.path().join("c.npz"), "fps").1, [30.0]);
    call("convert a.bvh d.npz --positions --onto b.bvh").success();
    call("convert a.bvh e.npz --positions --write-unit m").code(2);
}

#[test]
fn a_clip_and_the_rig_that_it_goes_to_have_options_of_their_own() {
    let dir = tempfile::tempdir().unwrap();
    let dance = synth::corpus(1, 1, 2.0, 60.0).unwrap().remove(0).clip;
    let path = dir.path().join("a.bvh");
    let motion = Motion::new(&path, dance);
    format::write(&path, &motion).unwrap();
    two(dir.path());
    let call = |words: &str| kinelm().current_dir(dir.path()).args(words.split_whitespace()).assert();
    let renamed = |from: &str, to: &str| {
        let text = fs::read_to_string(dir.path().join(from)).unwrap();
        let words = kinelm_motion::smpl::NAMES.iter().enumerate();
        // longer names first: hand is in left_hand
        let mut words: Vec<_> = words.map(|(id, name)| (*name, format!("q{id}"))).collect();
        words.sort_by_key(|(name, _)| std::cmp::Reverse(name.len()));
        let text = match to.ends_with(".toml") {
            true => words.iter().fold(text, |t, (old, new)| t.replace(&format!("\"{old}\""), &format!("\"{new}\""))),
            false => words.iter().fold(text, |t, (old, new)| t.replace(&format!(" {old}\n"), &format!(" {new}\n"))),
        };
        fs::write(dir.path().join(to), text).unwrap();
    };
    call("inspect a.bvh --map-out own.toml").success();
    renamed("own.toml", "q.toml");
    renamed("a.bvh", "q.bvh");
    call("convert a.bvh one.bvh --to 1f").success();
    // what is of the clip doesn't reach the rig, and the other way round
    call("convert a.bvh b.bvh --skip 10 --fps-source 30 --onto one.bvh").success().stderr(contains("110 frames at 30"));
    call("convert q.bvh c.bvh --map q.toml --onto one.bvh").success();
    call("convert a.bvh d.bvh --onto q.bvh --onto-map q.toml --onto-unit cm --onto-root q0").success();
    call("convert q.bvh e.bvh --map q.toml --onto q.bvh --onto-map own.toml")
        .code(1)
        .stderr(contains("q.bvh: ").and(contains("finds no pelvis")));
    call("convert a.bvh e.bvh --onto two.bvh --onto-unit m")
        .code(1)
        .stderr(contains("two.bvh: a rig of the joints a, b"));
    call("convert a.bvh e.bvh --onto-map q.toml").code(2).stderr(contains("--onto"));
    // what a map makes of a file
    call("inspect q.bvh --map q.toml").success().stdout(contains(
        "map smpl: 24 of SMPL's 24 joints; a body stands in its reference pose; on SMPL's body pelvis to neck is 0.0",
    ));
    let odd = fs::read_to_string(dir.path().join("q.toml")).unwrap().replace("q4\"", "tail\"");
    fs::write(dir.path().join("odd.toml"), odd).unwrap();
    call("inspect q.bvh --map odd.toml").success().stdout(contains("23 of SMPL's 24 joints; missing left_knee, which"));
}

#[test]
fn writing_is_stable_and_json_is_the_clip() {
    let dir = tempfile::tempdir().unwrap();
    let [a, b, j, k] = ["a.bvh", "b.bvh", "c.json", "d.json"].map(|n| dir.path().join(n));
    let convert = |from: &Path, to: &Path| {
        kinelm().args(["convert", "--unit", "m", "-q"]).arg(from).arg(to).assert().success().stderr("");
    };
    convert(&two(dir.path()), &a);
    convert(&a, &b);
    assert_eq!(fs::read(&a).unwrap(), fs::read(&b).unwrap());
    convert(&a, &j);
    convert(&j, &k);
    assert_eq!(fs::read(&j).unwrap(), fs::read(&k).unwrap());
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 5, "no temporary file is left");
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    let dir = tempfile::tempdir().unwrap();
    let bad = dir.path().join("bad.bvh");
    fs::write(&bad, TWO.replace("1 2 3 90 90 0 0 0 0", "1 2 3 90 nan 0 0 0 0")).unwrap();
    let out = dir.path().join("out.bvh");
    kinelm()
        .args(["convert", "--unit", "m"])
        .arg(&bad)
        .arg(&out)
        .assert()
        .code(1)
        .stderr(contains("bad.bvh:20:10: number_bad"))
        .stderr(contains("frame 1, joint \"a\", channel Xrotation"));
    assert!(!out.exists());
    kinelm().arg("convert").arg(two(dir.path())).arg(&out).assert().code(1).stderr(contains("unit_unknown"));
    kinelm()
        .args(["convert", "--unit", "m"])
        .arg(two(dir.path()))
        .arg("out.fbx")
        .assert()
        .code(2)
        .stderr(contains(".fbx"));
    kinelm().args(["convert", "--unit", "yard"]).arg(&bad).arg(&out).assert().code(2);
    kinelm().args(["convert", "--positions"]).arg(&bad).arg(&out).assert().code(2);
    kinelm().arg("convert").arg(dir.path().join("none.bvh")).arg(&out).assert().code(1).stderr(contains("none.bvh"));
}

#[test]
fn a_folder_is_inspected_file_by_file() {
    let dir = tempfile::tempdir().unwrap();
    let inspect = |args: &[&str]| kinelm().current_dir(dir.path()).arg("inspect").args(args).assert();
    fs::create_dir_all(dir.path().join("d/deep")).unwrap();
    inspect(&["d"]).code(1).stderr(contains("d: found no motion file in this folder"));
    fs::write(dir.path().join("d/deep/a.bvh"), TWO).unwrap();
    fs::write(dir.path().join("d/b.bvh"), "no motion").unwrap();
    let said =
        inspect(&["d", "--json"]).code(1).stderr(contains("b.bvh:1:1").and(contains("1 file could not be used")));
    let lines = String::from_utf8(said.get_output().stdout.clone()).unwrap();
    assert_eq!(lines.lines().count(), 2, "{lines}");
}

#[test]
fn folders_are_converted_with_their_paths_and_nothing_is_written_twice() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    for (folder, file) in [("d/salsa", "1.bvh"), ("d", "2.bvh"), ("e", "2.bvh")] {
        fs::create_dir_all(at(folder)).unwrap();
        fs::write(at(folder).join(file), TWO).unwrap();
    }
    let convert = |paths: &[&str], more: &[&str]| {
        let mut c = kinelm();
        c.args(["convert", "--unit", "m"]).args(paths.iter().map(|p| at(p))).args(more);
        c.assert()
    };
    convert(&["d", "new/out"], &["--format", "json"]).success().stderr(contains("2 of 2: "));
    assert!(at("new/out/salsa/1.json").exists() && at("new/out/2.json").exists());
    // two inputs of one output: refused before anything is written
    convert(&["d", "e", "both"], &["--format", "json"]).code(2).stderr(contains("would be written for both"));
    assert!(!at("both").exists());
    // a bad file doesn't keep the others from it
    fs::write(at("d/0.bvh"), "no motion").unwrap();
    convert(&["d", "rest"], &[]).code(1).stderr(contains("1 file could not be used"));
    assert!(at("rest/salsa/1.bvh").exists() && at("rest/2.bvh").exists());
    // one file, one name: the extension decides, in a folder that isn't there yet
    convert(&["e/2.bvh", "far/away/two.json"], &[]).success();
    assert!(at("far/away/two.json").exists());
    convert(&["e/2.bvh", "two.json"], &["--format", "bvh"]).code(2).stderr(contains("--format bvh, and OUT is"));
    convert(&["e/2.bvh", "d/2.bvh", "two.json"], &[]).code(2).stderr(contains("is no folder"));
    convert(&["d", "d"], &[]).code(2).stderr(contains("this call reads"));
}

#[test]
fn inspect_goes_on_after_a_bad_file() {
    let dir = tempfile::tempdir().unwrap();
    let bad = dir.path().join("bad.bvh");
    fs::write(&bad, "PK\u{3}\u{4}junk").unwrap();
    kinelm()
        .arg("inspect")
        .args([&bad, &two(dir.path())])
        .assert()
        .code(1)
        .stdout(contains("3 frames at 20 fps").and(contains("unit_unknown")))
        .stderr(contains("not_bvh").and(contains("1 file could not be used")));
    let out = kinelm().args(["inspect", "--json", "--unit", "m"]).arg(two(dir.path())).output().unwrap();
    let line: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((line["schema"].as_u64(), line["frames"].as_u64()), (Some(1), Some(3)));
}

/// A body that hangs for half the time and then falls, at 60 frames a second, in a file that says 120.
fn falling(path: &Path) {
    let height = |t: f64| if t < 1.0 { 20.0 } else { 20.0 - 0.5 * 9.81 * (t - 1.0) * (t - 1.0) };
    let root = (0..120).map(|f| Vec3::new(0.0, height(f as f64 / 60.0), 0.0)).collect();
    let rotations = vec![kinelm_motion::Quat::IDENTITY; 120 * 24];
    let clip = Clip::new(kinelm_motion::smpl::neutral(), 120.0, root, rotations).unwrap();
    let motion = Motion::new(path, clip);
    format::write(path, &motion).unwrap();
}

#[test]
fn a_doubted_rate_is_said_once_a_call_by_all_that_reads() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::create_dir(at("data")).unwrap();
    falling(&at("data/falls.bvh"));
    for (i, dance) in synth::corpus(1, 2, 4.0, 60.0).unwrap().into_iter().enumerate() {
        let path = at(&format!("data/{i}.bvh"));
        format::write(&path, &Motion::new(&path, dance.clip)).unwrap();
    }
    fs::write(at("labels.csv"), "clip,split\nfalls,train\n0,train\n1,train\n").unwrap();
    fs::write(at("stated.csv"), "clip,split,fps\nfalls,train,120\n0,train,\n1,train,\n").unwrap();
    let call = |words: &str| {
        let mut c = kinelm();
        let assert = c.current_dir(dir.path()).args(words.split(' ')).assert().success();
        String::from_utf8(assert.get_output().stderr.clone()).unwrap()
    };
    let of_all = "1 of 3 files doubts its rate: ";
    let rest = "falls.bvh falls at 4.0 g; if all were exported alike, `--fps-source 60` is for all";
    for words in [
        "tokenizer fit data --labels labels.csv --out t.json",
        "tokenize data --labels labels.csv --tokenizer t.json --out corpus",
        "query build data --window 16 --out index",
        "corpus clean data --out left_out.csv",
        "convert data out --format json",
        "mirror data --out mirrored",
        "filter data --out filtered",
        "view data --out page.html",
    ] {
        let said = call(words);
        assert!(said.contains(of_all) && said.contains(rest), "{words}: {said}");
        assert_eq!(said.matches("4.0 g").count(), 1, "{words}: {said}");
    }
    for words in ["convert data/falls.bvh a.json", "tokenizer text data/falls.bvh --tokenizer t.json"] {
        let said = call(words);
        let of_one = "falls.bvh: rate_doubted: the body falls at 4.0 g (more than 1.8): 120 fps is too fast; if it is wrong, \
                      `--fps-source 60` may be right";
        assert!(said.contains(of_one), "{words}: {said}");
    }
    // who states it ends the doubt
    for words in [
        "convert data/falls.bvh a.json --fps-source 120 --force",
        "tokenizer fit data --labels labels.csv --out u.json --fps-source 60",
        "tokenizer fit data --labels stated.csv --out v.json",
    ] {
        let said = call(words);
        assert!(!said.contains("4.0 g") && !said.contains("doubt"), "{words}: {said}");
    }
}

#[test]
fn a_page_needs_no_network() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("page.html");
    kinelm().args(["view", "--unit", "m"]).arg(two(dir.path())).arg("--out").arg(&out).assert().success();
    let page = fs::read_to_string(&out).unwrap();
    assert!(page.contains("two") && !page.contains("http://") && !page.contains("https://"));
}

#[test]
fn a_page_draws_the_paths_of_joints() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    for (name, dance) in ["a.bvh", "b.bvh", "c.bvh"].iter().zip(synth::corpus(1, 3, 2.0, 30.0).unwrap()) {
        save(&at(name), &dance.clip);
    }
    let view = |more: &[&str]| {
        let mut c = kinelm();
        c.current_dir(dir.path())
            .args(["view", "a.bvh", "b.bvh", "c.bvh", "--out", "p.html", "--force"])
            .args(more)
            .assert()
    };
    let page = || fs::read_to_string(at("p.html")).unwrap();
    view(&["--paths", "left_hand"]).success();
    // a joint of the file is a point of the page
    let hand = format::read(&at("a.bvh"), &format::ReadOptions::default()).unwrap().clip.skeleton().clone();
    let hand = hand.names().iter().position(|name| name == "left_hand").unwrap();
    assert_eq!(page().matches(&format!("\"paths\":[{hand}]")).count(), 3);
    assert!(page().contains("\"kind\":\"facts\"") && page().contains("[\"b\",\"left_hand\","));
    view(&["--paths", "left_hand,head", "--paths", "", "--paths", "rig:pelvis"]).success();
    assert_eq!((page().matches("\"paths\":[").count(), page().matches("\"paths\":[0]").count()), (2, 1));
    view(&[]).success();
    assert!(!page().contains("\"paths\":[") && !page().contains("\"kind\":\"facts\""));
    let before = fs::read(at("p.html")).unwrap();
    view(&["--paths", "left_wing"]).code(2).stderr(contains("left_wing").and(contains("left_hand")));
    view(&["--paths", "head", "--paths", "head"]).code(2).stderr(contains("give one for all, or one a clip"));
    view(&["--paths", "head@1s:2s"]).code(2).stderr(contains("a path is of the whole clip"));
    assert_eq!(fs::read(at("p.html")).unwrap(), before);
}

#[test]
fn a_folder_has_a_page_a_clip_or_one_for_all() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::create_dir_all(at("d/salsa")).unwrap();
    ["d/1.bvh", "d/salsa/2.bvh"].iter().for_each(|name| fs::write(at(name), TWO).unwrap());
    let view = |out: &str| {
        let mut c = kinelm();
        c.args(["view", "--unit", "m"]).arg(at("d")).arg("--out").arg(at(out)).assert()
    };
    view("pages/").success();
    assert!(at("pages/1.html").exists() && at("pages/salsa/2.html").exists());
    view("far/away/all.html").success().stderr(contains("2 dancers"));
    view("all").code(2).stderr(contains(".html"));
}

#[test]
fn the_way_to_amass_and_back_keeps_the_dance() {
    let Some(data) = kinelm_shared_data::set("cmu-dance", "the_way_to_amass_and_back_keeps_the_dance") else { return };
    let dir = tempfile::tempdir().unwrap();
    let [npz, bvh, again] = ["a.npz", "b.bvh", "c.npz"].map(|n| dir.path().join(n));
    let skip = ["convert", "--skip", "10", "--fps-source", "60", "--fps", "20"];
    kinelm().args(skip).arg(data.join("salsa/03.bvh")).arg(&npz).assert().success();
    kinelm().arg("convert").arg(&npz).arg(&bvh).assert().success();
    kinelm().arg("convert").arg(&bvh).arg(&again).assert().success();
    let (a, b) = (array(&npz, "trans"), array(&again, "trans"));
    assert_eq!(a.0, b.0);
    // a BVH in between rounds to 1e-8 m
    assert!(a.1.iter().zip(&b.1).all(|(x, y)| (x - y).abs() < 1e-6));
    let (a, b) = (array(&npz, "poses"), array(&again, "poses"));
    assert_eq!(a.0, [607, 156]);
    let worst = a.1.iter().zip(&b.1).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-5, "{worst}");
}

#[test]
fn up_is_said_in_one_line_and_refused_where_the_format_says_it() {
    let dir = tempfile::tempdir().unwrap();
    let [z, y, json, npz] = ["z.bvh", "y.bvh", "a.json", "a.npz"].map(|n| dir.path().join(n));
    // two legs and a head, in centimetres: along z, with nobody moving
    let joint = |name: &str, [x, y, z]: [f64; 3], inner: &str| {
        format!("JOINT {name}\n{{\nOFFSET {x} {y} {z}\nCHANNELS 3 Zrotation Xrotation Yrotation\n{inner}}}\n")
    };
    let tip = "End Site\n{\nOFFSET 0 0 5\n}\n";
    let limbs = |side: &str, x: f64| {
        let leg = joint(&format!("{side}Foot"), [0.0, 0.0, -40.0], tip);
        let leg = joint(&format!("{side}Leg"), [0.0, 0.0, -42.0], &leg);
        let arm = joint(&format!("{side}Hand"), [2.5 * x, 0.0, 0.0], tip);
        let arm = joint(&format!("{side}ForeArm"), [3.0 * x, 0.0, 0.0], &arm);
        (joint(&format!("{side}UpLeg"), [x, 0.0, -5.0], &leg), joint(&format!("{side}Arm"), [2.0 * x, 0.0, 20.0], &arm))
    };
    let (left, right) = (limbs("Left", 9.0), limbs("Right", -9.0));
    let spine = joint("Spine", [0.0, 0.0, 25.0], &(joint("Head", [0.0, 0.0, 30.0], tip) + &left.1 + &right.1));
    let text = format!(
        "HIERARCHY\nROOT Hips\n{{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n\
         {}{}{spine}}}\nMOTION\nFrames: 2\nFrame Time: 0.05\n10 20 90{zeros}\n10 20 91{zeros}\n",
        left.0,
        right.0,
        zeros = " 0".repeat(45)
    );
    fs::write(&z, text).unwrap();
    kinelm()
        .arg("inspect")
        .arg(&z)
        .assert()
        .success()
        .stdout(contains("up z in the file").and(contains("doubt: up").not()));
    kinelm().args(["inspect", "--json"]).arg(&z).assert().success().stdout(contains("\"up\":\"z\""));
    let said = kinelm().arg("convert").arg(&z).arg(&json).assert().success();
    said.stderr(contains("up_axis: z is up").and(contains("--up")));
    let json_text = fs::read_to_string(&json).unwrap();
    assert!(json_text.contains("[0.1,0.9") && json_text.contains("-0.2]"), "{json_text}");
    // as the file says it is not
    let lies = kinelm().args(["inspect", "--up", "-x"]).arg(&z).assert().success();
    lies.stdout(contains("up -x in the file"));
    kinelm().args(["convert", "-q"]).arg(&z).arg(&y).assert().success();
    assert!(fs::read_to_string(&y).unwrap().contains("10.000000 20.000000 91.000000"));
    kinelm().args(["convert", "-q"]).arg(&z).arg(&npz).assert().success();
    for (up, line) in [("z", "  up z in the file; turned to y up here\n"), ("y", "  up y\n")] {
        kinelm().args(["inspect", "--up", up]).arg(&npz).assert().success().stdout(contains(line));
    }
}

/// A made-up dance of 90 frames at 30 a second.
fn dance(dir: &Path) -> std::path::PathBuf {
    let clip = synth::corpus(3, 1, 3.0, 30.0).unwrap().remove(0).clip;
    let path = dir.join("dance.bvh");
    let motion = Motion::new(&path, clip);
    format::write(&path, &motion).unwrap();
    path
}

fn clip(path: &Path) -> Clip {
    format::read(path, &Default::default()).unwrap().clip
}

#[test]
fn a_piece_is_cut_out_by_seconds_or_frames() {
    let dir = tempfile::tempdir().unwrap();
    let (whole, out) = (dance(dir.path()), dir.path().join("piece.bvh"));
    let cut = |args: &[&str]| {
        let mut c = kinelm();
        c.arg("convert").arg(&whole).arg(&out).arg("--force").args(args).assert()
    };
    for (args, frames) in [
        (&["--from", "0.5s", "--to", "2s"][..], 15..60),
        (&["--from", "10f", "--to", "-1s"], 10..60),
        (&["--from", "-20f"], 70..90),
        (&["--to", "1"], 0..30),
    ] {
        cut(args).success();
        let (piece, expected) = (clip(&out), clip(&whole).slice(frames));
        assert_eq!(piece.frames(), expected.frames(), "{args:?}");
        let apart = |(a, b): (&Vec3, Vec3)| (*a - b).length();
        assert!(piece.positions().iter().zip(expected.positions()).map(apart).all(|d| d < 1e-6), "{args:?}");
    }
    cut(&["--from", "4s"]).code(2).stderr(contains("--from lies outside the clip, which has 90 frames, 3.00 s"));
    cut(&["--from", "2s", "--to", "1s"]).code(2).stderr(contains("nothing lies between"));
    cut(&["--from", "1m"]).code(2).stderr(contains("in frames of a model, and there is none"));
    cut(&["--from", "1x"]).code(2).stderr(contains("is no time"));
}

#[test]
fn a_bvh_is_written_in_the_unit_that_is_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let (first, metres) = (dance(dir.path()), dir.path().join("metres.bvh"));
    kinelm().arg("convert").args([&first, &metres]).args(["--write-unit", "m"]).assert().success();
    let text = |path: &Path| std::fs::read_to_string(path).unwrap();
    let numbers = |path: &Path| -> Vec<f64> {
        text(path).lines().last().unwrap().split_whitespace().map(|x| x.parse().unwrap()).collect()
    };
    let (own, other) = (numbers(&first), numbers(&metres));
    assert!(own[..3].iter().zip(&other).all(|(cm, m)| (cm / 100.0 - m).abs() < 1e-6), "{own:?} {other:?}");
    assert_eq!(own[3..], other[3..], "angles are what they were");
    // in its own unit it is the file itself
    let back = dir.path().join("back.bvh");
    kinelm().arg("convert").args([&first, &back]).args(["--write-unit", "cm"]).assert().success();
    assert_eq!(text(&back), text(&first));
    let json = dir.path().join("a.json");
    let refused = kinelm().arg("convert").args([&first, &json]).args(["--write-unit", "m"]).assert().code(2);
    refused.stderr(contains("all files but a .bvh are in metres"));
    let glb = dir.path().join("both.glb");
    let refused = kinelm().arg("convert").args([&first, &metres, &glb]).args(["--write-unit", "m"]).assert().code(2);
    refused.stderr(contains("a .glb is in metres"));
}

#[test]
fn a_mirrored_clip_is_the_image_and_twice_is_the_clip() {
    let dir = tempfile::tempdir().unwrap();
    let (first, [once, twice]) = (dance(dir.path()), ["once.bvh", "twice.bvh"].map(|n| dir.path().join(n)));
    for (from, to) in [(&first, &once), (&once, &twice)] {
        kinelm().arg("mirror").arg(from).arg("--out").arg(to).assert().success().stderr(contains("90 frames"));
    }
    let [a, b, c] = [&first, &once, &twice].map(|path| clip(path));
    let places = [&a, &b, &c].map(Clip::positions);
    let partner = |joint: usize| {
        let name = &a.skeleton().names()[joint];
        let other = match name.strip_prefix("left_") {
            Some(rest) => format!("right_{rest}"),
            None => name.replacen("right_", "left_", 1),
        };
        a.skeleton().find(&other).unwrap()
    };
    for (i, p) in places[0].iter().enumerate() {
        let (frame, joint) = (i / 24, i % 24);
        let image = places[1][frame * 24 + partner(joint)];
        assert!((Vec3::new(-p.x, p.y, p.z) - image).length() < 1e-4, "joint {joint} of frame {frame}");
        assert!((*p - places[2][i]).length() < 1e-4);
    }
    let said = kinelm().arg("mirror").arg(&first).arg("--out").arg(&first).assert().failure();
    said.stderr(contains("dance.bvh"));
    assert_eq!(clip(&first), a);
}

#[test]
fn a_glb_has_one_dancer_or_several_and_comes_back() {
    let dir = tempfile::tempdir().unwrap();
    let (one, other, out) = (dance(dir.path()), dir.path().join("other.bvh"), dir.path().join("both.glb"));
    std::fs::copy(&one, &other).unwrap();
    let document = |path: &Path| -> serde_json::Value {
        let bytes = std::fs::read(path).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        serde_json::from_slice(&bytes[20..20 + length]).unwrap()
    };
    kinelm().arg("convert").args([&one, &other, &out]).assert().success().stderr(contains("both.glb: 2 dancers"));
    let both = document(&out);
    assert_eq!((both["skins"].as_array().unwrap().len(), both["animations"].as_array().unwrap().len()), (2, 1));
    assert_eq!([&both["nodes"][0]["name"], &both["skins"][1]["name"]], ["dance", "other"]);
    let folder = dir.path().join("glb/");
    kinelm().arg("convert").args([&one, &other, &folder]).args(["--format", "glb"]).assert().success();
    assert_eq!(document(&folder.join("other.glb"))["skins"].as_array().unwrap().len(), 1);
    // what stands there and is no file of ours is left alone
    kinelm()
        .arg("convert")
        .args([&one, &other, &out])
        .arg("--fps")
        .arg("60")
        .assert()
        .failure()
        .stderr(contains("--force"));
    // one figure is read, and which
    let back = dir.path().join("back.bvh");
    let said = kinelm().arg("convert").args([&out, &back]).assert().success();
    said.stderr(contains("2 figures, dance, other; dance is read").and(contains("back.bvh: 90 frames at 30 fps")));
    let second = kinelm().args(["convert", "--root", "other", "--force"]).args([&out, &back]).assert().success();
    second.stderr(contains("several_roots").not());
    let joints = |path: &Path| std::fs::read_to_string(path).unwrap().matches("JOINT").count();
    assert_eq!(joints(&back), joints(&one));
}
