//! `inspect`, `convert` and `view` as a user runs them.

use assert_cmd::Command;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fs;
use std::path::Path;

fn kinelm() -> Command {
    let mut c = Command::cargo_bin("kinelm").unwrap();
    c.env("NO_COLOR", "1");
    c
}

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
    convert(&["d", "e", "both"], &["--format", "json"]).code(2).stderr(contains("would both be written to"));
    assert!(!at("both").exists());
    // a bad file doesn't keep the others from it
    fs::write(at("d/0.bvh"), "no motion").unwrap();
    convert(&["d", "rest"], &[]).code(1).stderr(contains("1 of 3 files could not be converted"));
    assert!(at("rest/salsa/1.bvh").exists() && at("rest/2.bvh").exists());
    // one file, one name: the extension decides, in a folder that isn't there yet
    convert(&["e/2.bvh", "far/away/two.json"], &[]).success();
    assert!(at("far/away/two.json").exists());
    convert(&["e/2.bvh", "two.json"], &["--format", "bvh"]).code(2).stderr(contains("--format bvh, and OUT is"));
    convert(&["e/2.bvh", "d/2.bvh", "two.json"], &[]).code(2).stderr(contains("it is no folder"));
    convert(&["d", "d"], &[]).code(2).stderr(contains("over itself"));
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
        .stderr(contains("not_bvh").and(contains("1 of 2 files")));
    let out = kinelm().args(["inspect", "--json", "--unit", "m"]).arg(two(dir.path())).output().unwrap();
    let line: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((line["schema"].as_u64(), line["frames"].as_u64()), (Some(1), Some(3)));
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
