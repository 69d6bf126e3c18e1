//! `filter`, `spectrum` and `interpolate` as a user runs them.

use crate::support::{read, save};
use assert_cmd::Command;
use kinelm_motion::metric::jitter;
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, Quat, Skeleton, Vec3, format, synth};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::Value;
use std::f64::consts::PI;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

fn kinelm(command: &str) -> Command {
    let mut c = Command::cargo_bin("kinelm").unwrap();
    c.env("NO_COLOR", "1").arg(command);
    c
}

/// Two dances of 3 s at 60 fps, and one of 30 fps on a rig of other joints.
struct Dances {
    dir: tempfile::TempDir,
}

impl Dances {
    fn new() -> Dances {
        let dances = Dances { dir: tempfile::tempdir().unwrap() };
        for (name, dance) in ["a.bvh", "b.json"].iter().zip(synth::corpus(1, 2, 3.0, 60.0).unwrap()) {
            save(&dances.path(name), &shaken(&dance.clip));
        }
        let clip = synth::corpus(1, 1, 3.0, 30.0).unwrap().remove(0).clip;
        save(&dances.path("stranger.bvh"), &named(&shaken(&clip), |i| format!("bone{i}")));
        dances
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn count(&self) -> usize {
        fs::read_dir(self.dir.path()).unwrap().count()
    }
}

/// A clip whose root goes up and down by 2 mm every frame.
fn shaken(clip: &Clip) -> Clip {
    let by = |f: usize| Vec3::new(0.0, if f.is_multiple_of(2) { 0.002 } else { -0.002 }, 0.0);
    let root = clip.root().iter().enumerate().map(|(f, p)| *p + by(f)).collect();
    Clip::new(clip.skeleton().clone(), clip.fps(), root, clip.rotations().to_vec()).unwrap()
}

fn named(clip: &Clip, name: impl Fn(usize) -> String) -> Clip {
    let s = clip.skeleton();
    let ends = s.ends().to_vec();
    let names = (0..clip.joints()).map(name).collect();
    let skeleton = Skeleton::new(names, s.parents().to_vec(), s.offsets().to_vec(), ends).unwrap();
    clip.clone().with_skeleton(Arc::new(skeleton)).unwrap()
}

#[test]
fn filtered_clips_keep_their_rig_and_shake_less() {
    let d = Dances::new();
    let rig = d.path("stranger.bvh");
    let out = d.path("calm.bvh");
    kinelm("filter")
        .arg(&rig)
        .args(["--unit", "m", "--out"])
        .arg(&out)
        .assert()
        .success()
        .stderr(contains("calm.bvh: 90 frames"));
    let options = format::ReadOptions { unit: format::Unit::METRE, ..Default::default() };
    let [before, after] = [&rig, &out].map(|p| format::read(p, &options).unwrap().clip);
    assert_eq!((after.skeleton().names(), after.fps(), after.frames()), (before.skeleton().names(), before.fps(), 90));
    assert!(jitter(&after).unwrap() < 0.5 * jitter(&before).unwrap());

    let folder = d.path("out");
    fs::create_dir(&folder).unwrap();
    let clips = [d.path("a.bvh"), d.path("b.json")];
    let json =
        kinelm("filter").args(&clips).args(["--level", "middle", "--json", "--out"]).arg(&folder).output().unwrap();
    let lines: Vec<Value> =
        String::from_utf8(json.stdout).unwrap().lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    // 3 s: up to 7.27 Hz
    assert_eq!(lines[1]["kept"], serde_json::json!([44, 180]), "{lines:?}");
    assert_eq!((lines.len(), lines[0]["too_fast"].as_u64()), (2, Some(0)));
    for clip in &clips {
        let out = folder.join(clip.file_name().unwrap());
        assert!(jitter(&read(&out)).unwrap() < 0.5 * jitter(&read(clip)).unwrap());
    }
    let npz = d.path("c.npz");
    let sharp = ["--butterworth", "4", "--cutoff", "6", "--out"];
    kinelm("filter").arg(d.path("a.bvh")).args(sharp).arg(&npz).assert().success();
    kinelm("filter").arg(&npz).args(["--keep", "9", "--out"]).arg(d.path("d.npz")).assert().success();
    assert_eq!(read(&d.path("d.npz")).frames(), 180);
}

#[test]
fn what_can_not_be_filtered_is_said() {
    let d = Dances::new();
    let (a, before) = (d.path("a.bvh"), d.count());
    let said = |args: &[&str], out: &str, code: i32, what: &str| {
        kinelm("filter").arg(&a).args(args).arg("--out").arg(d.path(out)).assert().code(code).stderr(contains(what));
    };
    said(&["--cutoff", "30"], "o.bvh", 2, "below half the rate, 30 Hz");
    said(&["--cutoff", "5", "--butterworth", "9"], "o.bvh", 2, "expected 1 to 8");
    said(&["--keep", "181"], "o.bvh", 2, "expected 1 to 180");
    said(&["--butterworth", "2"], "o.bvh", 2, "--cutoff");
    said(&["--level", "low", "--cutoff", "3"], "o.bvh", 2, "cannot be used with");
    said(&[], "a.bvh/o.bvh", 2, "a.bvh is a file, no folder");
    said(&[], "o.fbx", 2, ".bvh, .npz, .json, .glb or .vrma");
    said(&[], "a.bvh", 2, "this call reads it");
    let both = [&a, &d.path("b.json")];
    kinelm("filter").args(both).arg("--out").arg(d.path("b.json")).assert().code(2).stderr(contains("is no folder"));
    save(&d.path("short.bvh"), &read(&a).slice(0..12));
    let butterworth = ["--butterworth", "3", "--cutoff", "6", "--out"];
    fs::create_dir(d.path("out")).unwrap();
    kinelm("filter")
        .args([&d.path("short.bvh"), &a])
        .args(butterworth)
        .arg(d.path("out"))
        .assert()
        .code(1)
        .stderr(contains("12 frames are too few").and(contains("1 file could not be used")));
    assert_eq!(fs::read_dir(d.path("out")).unwrap().count(), 1, "the other was done");
    assert_eq!(d.count(), before + 2, "nothing half-written");
    // one alone names its file too; a folder that isn't there is made
    let alone = contains("12 frames are too few");
    kinelm("filter").arg(d.path("short.bvh")).args(butterworth).arg(d.path("o.bvh")).assert().code(1).stderr(alone);
    kinelm("filter").args(both).arg("--out").arg(d.path("made")).assert().success();
    assert_eq!(fs::read_dir(d.path("made")).unwrap().count(), 2);
}

#[test]
fn hips_are_turned_back_and_angles_filtered_as_in_the_dissertation() {
    let d = Dances::new();
    let clip = synth::corpus(1, 1, 3.0, 60.0).unwrap().remove(0).clip;
    let mut rotations = clip.rotations().to_vec();
    (50..75).for_each(|f| rotations[f * clip.joints()] = Quat::from_rotation_y(PI) * rotations[f * clip.joints()]);
    let flipped = Clip::new(clip.skeleton().clone(), 60.0, clip.root().to_vec(), rotations).unwrap();
    let [odd, mended, sound] = ["odd.bvh", "mended.bvh", "sound.bvh"].map(|name| d.path(name));
    save(&odd, &flipped);
    save(&sound, &clip);
    let call = || {
        let mut call = kinelm("filter");
        call.arg(&odd).args(["--hips", "--force", "--out"]).arg(&mended);
        call
    };
    call().assert().success().stderr(contains("hips turned back by 180 degrees in frames 50 to 74"));
    let line: Value = serde_json::from_slice(&call().arg("--json").output().unwrap().stdout).unwrap();
    assert_eq!(line["hips"], serde_json::json!([[50, 75]]));
    let (found, expected) = (read(&mended), read(&sound));
    let pairs = found.rotations().iter().zip(expected.rotations());
    let largest = pairs.map(|(a, b)| angle_between(*a, *b).to_degrees()).fold(0.0, f64::max);
    assert!(largest < 1e-4, "{largest} degrees, as far as a BVH has digits");

    // every joint turns two degrees back and forth
    let by = |i: usize| Quat::from_rotation_x(if (i / clip.joints()).is_multiple_of(2) { 0.035 } else { -0.035 });
    let rough = clip.rotations().iter().enumerate().map(|(i, q)| *q * by(i)).collect();
    let rough = Clip::new(clip.skeleton().clone(), 60.0, clip.root().to_vec(), rough).unwrap();
    save(&d.path("rough.bvh"), &rough);
    let compat = ["--butterworth", "2", "--cutoff", "5", "--compat", "--out"];
    kinelm("filter").arg(d.path("rough.bvh")).args(compat).arg(d.path("c.bvh")).assert().success();
    let jitter_of = |path: &str| jitter(&read(&d.path(path))).unwrap();
    let [before, after] = ["rough.bvh", "c.bvh"].map(jitter_of);
    assert!(after < 0.3 * before, "{after} of {before} m/s³");
    let no_angles = contains("no Euler angles");
    kinelm("filter").arg(d.path("b.json")).args(compat).arg(d.path("c.json")).assert().code(1).stderr(no_angles);
}

#[test]
fn spectra_are_drawn() {
    let d = Dances::new();
    for (out, dc) in [("s.png", Some("--no-dc")), ("s.svg", None)] {
        let args = ["--joint", "left_knee", "--at", "0.5", "--seconds", "2", "--out"];
        kinelm("spectrum").arg(d.path("a.bvh")).args(dc).args(args).arg(d.path(out)).assert().success();
    }
    let svg = fs::read_to_string(d.path("s.svg")).unwrap();
    for part in ["Spectrogram of left_knee", "Spectral embedding", "low: 3.5 Hz", "low and middle: 7.3 Hz"] {
        assert!(svg.contains(part), "{part}");
    }
    assert!(fs::read(d.path("s.png")).unwrap().starts_with(b"\x89PNG"));
    let before = d.count();
    let said = |args: &[&str], code: i32, what: &str| {
        kinelm("spectrum").arg(d.path("a.bvh")).args(args).assert().code(code).stderr(contains(what));
    };
    let [out, gif, no] = ["o.png", "o.gif", "a.bvh/o.png"].map(|n| d.path(n).display().to_string());
    said(&["--out", &out, "--joint", "knee"], 1, "joint \"knee\": unknown; there are pelvis, left_hip");
    said(&["--out", &out, "--at", "2.9"], 1, "expected at least 16, a window");
    said(&["--out", &gif], 2, ".png or .svg");
    said(&["--out", &no], 2, "is a file, no folder");
    said(&["--out", &out, "--at=-1"], 2, "a time from 0 on");
    said(&[], 2, "give --out for a picture, --page for a page, or both");
    said(&["--page", &out], 2, "ending in .html");
    assert_eq!(d.count(), before);
}

#[test]
fn spectra_stand_side_by_side() {
    let d = Dances::new();
    let [svg, page] = ["two.svg", "two.html"].map(|name| d.path(name));
    let two = |more: &[&str]| {
        let mut c = kinelm("spectrum");
        c.args([d.path("a.bvh"), d.path("b.json")])
            .args(["--joint", "left_knee", "--seconds", "2", "--no-dc"])
            .args(more);
        c
    };
    two(&["--out", svg.to_str().unwrap()]).assert().success().stderr(contains("a.bvh, ").and(contains("b.json")));
    let text = fs::read_to_string(&svg).unwrap();
    for part in ["Spectrogram of left_knee, a", "Spectrogram of left_knee, b", "Spectral embedding of the body, b"] {
        assert!(text.contains(part), "{part}");
    }
    assert!(text.contains("width=\"1040\" height=\"1080\""), "a column a clip");
    // a page alone
    two(&["--page", page.to_str().unwrap(), "--at", "0.5"]).assert().success();
    let text = fs::read_to_string(&page).unwrap();
    assert_eq!(text.matches("\"kind\":\"bands\"").count(), 4);
    assert!(text.contains("from 0.5 s on") && text.contains("30.0 Hz") && text.contains("\"frames\":120"));
    let nine = vec![d.path("a.bvh"); 9];
    kinelm("spectrum")
        .args(nine)
        .arg("--out")
        .arg(d.path("n.svg"))
        .assert()
        .failure()
        .stderr(contains("8 clips in one"));
}

#[test]
fn a_band_is_blended_and_what_moved_is_plotted() {
    let d = Dances::new();
    let blend = |out: &str, keep: &str, more: &[&str]| {
        let mut c = kinelm("interpolate");
        let call = ["--amount", "0.5", "--keep", keep, "--out"];
        c.args([d.path("a.bvh"), d.path("b.json")]).args(call).arg(d.path(out)).args(more).assert()
    };
    let plot = d.path("d.svg").display().to_string();
    blend("band.bvh", "4..16", &["--plot", &plot]).success().stdout(contains("dct 4..16 of 128"));
    let svg = fs::read_to_string(&plot).unwrap();
    for part in ["Distance of the coefficients", "from 0.9 Hz", "to 3.5 Hz", "the blend"] {
        assert!(svg.contains(part), "{part}");
    }
    blend("first.bvh", "16", &[]).success().stdout(contains("dct 16 of 128"));
    blend("from0.bvh", "0..16", &[]).success().stdout(contains("dct 16 of 128"));
    let [band, first, from0] = ["band.bvh", "first.bvh", "from0.bvh"].map(|name| fs::read(d.path(name)).unwrap());
    assert!(first == from0 && first != band);
    let before = d.count();
    for (keep, what) in [("4..4", "a band as 4..16"), ("4..", "a band as 4..16"), ("4..129", "at most 128")] {
        blend("no.bvh", keep, &[]).code(2).stderr(contains(what));
    }
    blend("no.bvh", "16", &["--plot", "d.gif"]).code(2).stderr(contains(".png or .svg"));
    assert_eq!(d.count(), before, "nothing half-written");
}

#[test]
fn a_dance_between_two() {
    let d = Dances::new();
    let (a, b, out, page) = (d.path("a.bvh"), d.path("b.json"), d.path("c.bvh"), d.path("p.html"));
    let blend = |more: &[&str]| {
        let mut c = kinelm("interpolate");
        c.arg(&a).arg(&b).arg("--out").arg(&out).args(["--at-a", "0.5", "--at-b", "0.6", "--steps", "40"]).args(more);
        c
    };
    blend(&["--page", page.to_str().unwrap()])
        .assert()
        .success()
        .stdout(contains("stft 16/8").and(contains("dct 16 of 128")).and(contains("jitter")));
    let (first, clip) = (fs::read(&out).unwrap(), read(&out));
    assert_eq!((clip.frames(), clip.fps().round()), (128, 60.0));
    assert_eq!(clip.skeleton().names(), read(&a).skeleton().names());
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("<title>a, c, b") || html.contains("a, c, b"), "three dancers");
    // the same bytes again, on another number of threads
    blend(&["--threads", "1", "-q"]).assert().success();
    assert_eq!(fs::read(&out).unwrap(), first);

    let json = blend(&["--force", "--json", "--whole", "--transform", "pca", "--plain", "--strength", "0.5"])
        .output()
        .unwrap();
    let line: Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!((line["schema"].as_u64(), line["frames"].as_u64()), (Some(1), Some(144)), "{line}");
    assert!(line["transform"] == "pca 16" && line["stft"]["a_c"].as_f64() > line["stft"]["a_b"].as_f64());
    assert!(line["notes"].to_string().contains("cut to the other's 144 frames"), "{line}");
    kinelm("interpolate")
        .args([&a, &b])
        .args(["--amount", "1", "--out"])
        .arg(d.path("c.json"))
        .assert()
        .success()
        .stdout(contains("closed form, amount 1, relative rotations"));
    blend(&["--force", "--coordinates", "vectors"]).assert().success().stdout(contains("rotation vectors"));
}

#[test]
fn reading_options_follow_the_name_of_one_file() {
    let d = Dances::new();
    let [slow, out] = ["slow.bvh", "c.bvh"].map(|name| d.path(name));
    // the same frames, stated at half their rate
    let text = fs::read_to_string(d.path("a.bvh")).unwrap();
    let time = text.lines().find(|line| line.starts_with("Frame Time")).unwrap();
    fs::write(&slow, text.replace(time, "Frame Time: 0.0333333")).unwrap();
    let blend = |b: String| {
        let mut c = kinelm("interpolate");
        c.arg(d.path("a.bvh")).arg(b).args(["--amount", "0.5", "--json", "--force", "--out"]).arg(&out);
        c
    };
    let line = |b: String| -> Value { serde_json::from_slice(&blend(b).output().unwrap().stdout).unwrap() };
    let as_stated = line(slow.display().to_string());
    assert!(as_stated["notes"].to_string().contains("slow.bvh: from 30 to 60 fps"), "{as_stated}");
    let read_right = line(format!("{}:fps=60,skip=10", slow.display()));
    assert_eq!(read_right["b"], slow.display().to_string());
    assert!(!read_right["notes"].to_string().contains("from 30 to 60 fps"), "{read_right}");
    // the second dance is the first one ten frames later
    let later = line(format!("{}:fps=60,skip=10", d.path("a.bvh").display()));
    assert_eq!((&read_right["stft"], &read_right["jitter"]), (&later["stft"], &later["jitter"]));
    let before = d.count();
    for (of, what) in [("pace=2", "pace=2: expected one of fps, skip"), ("fps=60,x", "expected KEY=VALUE")] {
        blend(format!("{}:{of}", slow.display())).assert().code(2).stderr(contains(what));
    }
    assert_eq!(d.count(), before);
}

#[test]
fn what_can_not_be_blended_is_said() {
    let d = Dances::new();
    let before = d.count();
    let said = |b: &str, args: &[&str], code: i32, what: &str| {
        let call = kinelm("interpolate").arg(d.path("a.bvh")).arg(d.path(b)).args(args).assert();
        call.code(code).stderr(contains(what));
    };
    let [out, no, page] = ["o.bvh", "a.bvh/o.bvh", "p.txt"].map(|n| d.path(n).display().to_string());
    said("b.json", &["--out", &out, "--at-b", "2"], 1, "b.json: 180 frames at 60 fps, of which 60 lie from 2 s on");
    said("b.json", &["--out", &out, "--keep", "300"], 2, "expected 1 to 128");
    said("b.json", &["--out", &out, "--strength", "1.5"], 2, "expected a number from 0 to 1");
    said("b.json", &["--out", &out, "--transform", "stft", "--amount", "0.5"], 2, "no closed form");
    said("b.json", &["--out", &out, "--window", "9"], 2, "expected 16 to 8192");
    said("b.json", &["--out", &no], 2, "is a file, no folder");
    said("b.json", &["--out", &out, "--page", &page], 2, "ending in .html");
    let stranger = "stranger.bvh: it can't be put on the rig of";
    said("stranger.bvh", &["--out", &out, "--unit", "m"], 1, stranger);
    said("none.bvh", &["--out", &out], 1, "none.bvh");
    assert_eq!(d.count(), before, "nothing half-written");
}
