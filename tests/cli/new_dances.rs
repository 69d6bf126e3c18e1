//! New dances and dances that follow a clip: at its rate, on y = 0, on its rig; edits keep what their file has.

use crate::support::{kinelm_in, read, save};
use assert_cmd::Command;
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::retarget::{self, Retarget};
use kinelm_motion::rig::{Humanoid, SkeletonMap, map_for};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, Skeleton, smpl, synth};
use predicates::str::contains;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// The rate of the clip, no multiple of the model's 20.
const FPS: f64 = 48.0;
/// The height of the clip's floor, metres.
const FLOOR_M: f64 = 0.4;
const FOLLOWED: &str = "--prompt mine.bvh --joints root,torso,right_arm";

/// A folder with a clip, and with a cache for the ready model.
fn place() -> &'static Path {
    static PLACE: OnceLock<tempfile::TempDir> = OnceLock::new();
    let dir = PLACE.get_or_init(|| {
        let dir = tempfile::tempdir().unwrap();
        save(&dir.path().join("mine.bvh"), &on_a_platform());
        dir
    });
    dir.path()
}

/// A dance of a larger body under Mixamo's names, above y = 0.
fn on_a_platform() -> Clip {
    let (map, body) = (SkeletonMap::builtin("mixamo").unwrap(), smpl::neutral());
    let names = (0..24).map(|id| map.joint(id).unwrap().to_owned()).collect();
    let offsets = body.offsets().iter().map(|offset| *offset * 1.15).collect();
    let rig = Arc::new(Skeleton::new(names, body.parents().to_vec(), offsets, vec![]).unwrap());
    let dance = synth::corpus(5, 1, 4.0, FPS).unwrap().remove(0).clip;
    let way = Retarget::new(&Humanoid::with_map(&rig, &map_for(&rig, None).unwrap()), body).unwrap();
    way.to_rig(&dance).unwrap().raised(FLOOR_M)
}

fn call(words: &str) -> Command {
    let mut command = kinelm_in(place(), words);
    command.env("XDG_CACHE_HOME", place().join("cache"));
    command
}

/// A dance of two seconds, and its sidecar.
fn danced(words: &str, out: &str) -> (Clip, Value) {
    call(&format!("generate {words} --seed 3 --out {out}")).assert().success();
    let sidecar = fs::read(at(&format!("{out}.kinelm.json"))).unwrap();
    (read(&at(out)), serde_json::from_slice(&sidecar).unwrap())
}

fn at(name: &str) -> PathBuf {
    place().join(name)
}

/// Whether a dance made again from its sidecar has the same bytes.
fn is_made_again(out: &str) -> bool {
    call(&format!("again {out}.kinelm.json --out again-{out}")).assert().success();
    fs::read(at(out)).unwrap() == fs::read(at(&format!("again-{out}"))).unwrap()
}

/// The height of the floor under a clip's feet, metres.
fn floor_of(clip: &Clip) -> f64 {
    Humanoid::with_map(clip.skeleton(), &map_for(clip.skeleton(), None).unwrap()).floor(clip).unwrap().height_m
}

#[test]
fn a_dance_has_the_rate_of_its_clip_and_30_without_one() {
    for (words, out, rate, frames) in [
        ("--seconds 2", "free.bvh", 30.0, 60),
        ("--seconds 2 --fps 24", "free-24.bvh", 24.0, 48),
        (&format!("{FOLLOWED} --seconds 2"), "rate-smpl.bvh", FPS, 96),
        (&format!("{FOLLOWED} --seconds 2 --rig prompt"), "rate-own.bvh", FPS, 96),
        (&format!("{FOLLOWED} --seconds 2 --fps 25"), "rate-25.bvh", 25.0, 50),
        ("--prompt mine.bvh --from-frame 1s --seconds 2", "rate-on.bvh", FPS, 96),
        ("--prompt mine.bvh --free left_arm --rig model", "rate-edit.bvh", FPS, 192),
    ] {
        let (clip, sidecar) = danced(words, out);
        assert_eq!((clip.fps(), clip.frames()), (rate, frames), "{words}");
        assert_eq!(sidecar["request"]["fps"], rate, "{words}");
        assert!(is_made_again(out), "{words}");
    }
}

#[test]
fn the_file_is_a_curve_through_the_frames_of_the_model() {
    let words = format!("{FOLLOWED} --seconds 2 --rig prompt --feet off");
    let ((own, _), (model, _)) = (danced(&words, "curve.bvh"), danced(&format!("{words} --fps 20"), "curve-20.bvh"));
    // a quarter of a second is a whole number of frames of both
    for (a, b) in (0..8).map(|n| (12 * n, 5 * n)) {
        assert!(own.root()[a].distance(model.root()[b]) < 1e-5, "frame {a}");
        let apart = own.pose(a).iter().zip(model.pose(b)).map(|(&p, &q)| angle_between(p, q));
        assert!(apart.fold(0.0, f64::max) < 1e-5, "frame {a}");
    }
    // between them it has no kinks: the largest second difference is as small as at the frames
    let bend = |f: usize| (own.root()[f + 1] - own.root()[f] * 2.0 + own.root()[f - 1]).length();
    let all: Vec<f64> = (1..own.frames() - 4).map(bend).collect();
    let step = (1..own.frames()).map(|f| own.root()[f].distance(own.root()[f - 1])).fold(0.0, f64::max);
    assert!(all.iter().all(|bend| *bend < 0.6 * step), "{all:?} of {step}");
}

#[test]
fn new_and_following_dances_stand_on_y_0() {
    let mine = read(&at("mine.bvh"));
    assert!((floor_of(&mine) - FLOOR_M).abs() < 0.03, "{}", floor_of(&mine));
    let on_smpl = {
        let motion = format::read(&at("mine.bvh"), &ReadOptions::default()).unwrap();
        retarget::to_smpl(&motion).unwrap()
    };
    for (words, out, follows) in [
        ("--seconds 2", "y-free.bvh", None),
        (FOLLOWED, "y-smpl.bvh", Some(&on_smpl)),
        (&format!("{FOLLOWED} --rig prompt"), "y-own.bvh", Some(&mine)),
        ("--prompt mine.bvh --from-frame 2s --rig prompt --seconds 3", "y-on.bvh", None),
        ("--prompt mine.bvh --joints right_arm --rig prompt --first-frames 1", "y-arm.bvh", None),
        ("--prompt mine.bvh --rig prompt --seconds 2", "y-new.bvh", None),
    ] {
        let (dance, sidecar) = danced(words, out);
        assert_eq!(sidecar["read"]["floor"], 0.0, "{words}");
        assert!(floor_of(&dance).abs() < 0.04, "{words}: the floor is at {}", floor_of(&dance));
        let higher = |clip: &Clip, f: usize| clip.root()[f].y - dance.root()[f].y;
        if let Some(clip) = follows {
            let frames = (0..dance.frames()).step_by(12);
            let off = frames.map(|f| (higher(clip, f) - floor_of(&mine)).abs()).fold(0.0, f64::max);
            assert!(off < 0.015, "{words}: heights differ by {off} m");
        }
    }
    // a floor that is stated is the one that comes to y = 0
    let (dance, _) = danced(&format!("{FOLLOWED} --rig prompt --floor 0.3 --feet off"), "y-stated.bvh");
    assert!((mine.root()[0].y - dance.root()[0].y - 0.3).abs() < 0.01, "{}", dance.root()[0].y);
}

#[test]
fn heights_that_are_coded_without_a_floor_are_lowered_too() {
    let mut labels = "clip,split\n".to_owned();
    for (i, dance) in synth::corpus(3, 6, 3.0, 30.0).unwrap().iter().enumerate() {
        save(&at(&format!("data/{i}.bvh")), &dance.clip);
        labels += &format!("{i},{}\n", ["train", "train", "train", "train", "valid", "test"][i]);
    }
    fs::write(at("labels.csv"), labels).unwrap();
    fs::write(
        at("c.toml"),
        "[model]\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 160\n\
         [train]\nbatch = 2\nsteps = 2\nwarmup = 1\neval_every = 2\ncheckpoint_every = 2\n",
    )
    .unwrap();
    let mine = read(&at("mine.bvh"));
    for height in ["velocity", "absolute"] {
        let fit = "tokenizer fit data --labels labels.csv --joints 13 --root-rotation absolute";
        call(&format!("{fit} --height {height} --out {height}.json")).assert().success();
        let tokenize = format!("tokenize data --labels labels.csv --tokenizer {height}.json --out {height}-corpus");
        call(&tokenize).assert().success();
        call(&format!("pretrain --config c.toml --corpus {height}-corpus --run {height}")).assert().success();
        for rig in ["prompt", "model"] {
            let words = format!("--run {height} --prompt mine.bvh --joints root,legs --rig {rig} --fps 20");
            let (dance, _) = danced(&words, &format!("{height}-{rig}.bvh"));
            assert!(floor_of(&dance).abs() < 0.05, "{height}, {rig}'s rig: the floor is at {}", floor_of(&dance));
            if rig == "prompt" {
                let off = mine.root()[0].y - FLOOR_M - dance.root()[0].y;
                assert!(off.abs() < 0.05, "{height}: {off} m");
            }
        }
        let (arm, _) =
            danced(&format!("--run {height} --prompt mine.bvh --free left_arm"), &format!("{height}-edit.bvh"));
        assert!((0..20).all(|f| arm.root()[f].distance(mine.root()[f]) < 1e-4), "an edit stays where its file is");
    }
}

/// The lines of a BVH's frames.
fn rows(name: &str) -> Vec<String> {
    let text = fs::read_to_string(at(name)).unwrap();
    text.lines().skip_while(|line| !line.starts_with("Frame Time")).skip(1).map(str::to_owned).collect()
}

#[test]
fn an_edit_and_a_loop_keep_the_floor_and_the_numbers_of_their_file() {
    let mine = rows("mine.bvh");
    for (words, out) in [
        ("--free left_arm@1s:2s", "keeps-arm.bvh"),
        ("--free left_arm@1s:2s --fps 48", "keeps-stated.bvh"),
        ("--free all@1s:2s", "keeps-gap.bvh"),
        ("--loop --loop-over 1", "keeps-loop.bvh"),
    ] {
        let (clip, sidecar) = danced(&format!("--prompt mine.bvh {words}"), out);
        assert_eq!((clip.fps(), clip.frames()), (FPS, 192), "{words}");
        let stated = sidecar["read"]["floor"].as_f64().unwrap();
        assert!((stated - FLOOR_M).abs() < 0.03 && (floor_of(&clip) - FLOOR_M).abs() < 0.05, "{words}: {stated}");
        let own = rows(out);
        assert_eq!(own[..47], mine[..47], "{words}");
        if !words.starts_with("--loop") {
            assert_eq!(own[97..], mine[97..], "{words}");
        }
        assert!(is_made_again(out), "{words}");
    }
    assert_eq!(rows("keeps-arm.bvh"), rows("keeps-stated.bvh"), "its own rate, stated, changes nothing");
    // at another rate the floor stays
    let (slow, _) = danced("--prompt mine.bvh --free left_arm@1s:2s --fps 24", "keeps-slow.bvh");
    assert_eq!((slow.fps(), slow.frames()), (24.0, 96));
    assert!((floor_of(&slow) - FLOOR_M).abs() < 0.03, "{}", floor_of(&slow));
}

#[test]
fn a_new_dance_is_put_on_the_rig_of_a_clip() {
    let words = "--prompt mine.bvh --rig prompt --seconds 2 --feet off";
    let (dance, sidecar) = danced(words, "new.bvh");
    let mine = read(&at("mine.bvh"));
    assert_eq!((dance.fps(), dance.frames(), dance.skeleton().names()), (FPS, 96, mine.skeleton().names()));
    assert_eq!(
        (&sidecar["request"]["uncoded_joints"], &sidecar["request"]["lead_in"]),
        (&"training".into(), &20.into())
    );
    assert!(dance.root()[0].x.abs() < 0.02 && dance.root()[0].z.abs() < 0.02, "it begins where new dances do");
    assert!(is_made_again("new.bvh"));
    // the same dance as on SMPL's body: the rig is nothing that is given
    let (bare, _) = danced("--seconds 2 --feet off --fps 48", "new-smpl.bvh");
    let motion = format::read(&at("new.bvh"), &ReadOptions::default()).unwrap();
    let motion = motion.with_source(kinelm_motion::Source::Retargeted { floor_m: 0.0 });
    let back = retarget::to_smpl(&motion).unwrap();
    let bare = retarget::to_smpl(&motion.with_clip(bare)).unwrap();
    for f in (0..96).step_by(5) {
        assert!(back.root()[f].distance(bare.root()[f]) < 1e-3, "frame {f}");
        let apart = back.pose(f).iter().zip(bare.pose(f)).map(|(&p, &q)| angle_between(p, q).to_degrees());
        assert!(apart.fold(0.0, f64::max) < 0.1, "frame {f}");
    }
    let feet = Humanoid::with_map(dance.skeleton(), &map_for(dance.skeleton(), None).unwrap()).feet().unwrap();
    assert!(feet.clearance(&dance).iter().all(|m| m.abs() < 0.5));
    // what it lends is said, and what it can't give is refused
    call("generate --prompt mine.bvh --seconds 2 --out no.bvh")
        .assert()
        .code(2)
        .stderr(contains("--rig prompt for a new"));
    let follow = call(&format!("generate {words} --uncoded-joints follow --out no.bvh")).assert().code(2);
    follow.stderr(contains("nothing of a prompt is given"));
}

#[test]
fn a_dance_and_its_clip_share_a_floor_on_a_page() {
    danced(&format!("{FOLLOWED} --rig prompt --seconds 2"), "seen.bvh");
    call("view mine.bvh seen.bvh --out seen.html").assert().success();
    let text = fs::read_to_string(at("seen.html")).unwrap();
    let (_, behind) = text.split_once("id=\"figures\"").unwrap();
    let json = behind.split_once('>').unwrap().1.split("</script>").next().unwrap();
    let figures: Vec<Value> = serde_json::from_str(json).unwrap();
    assert_eq!(figures[0]["world"], figures[1]["world"]);
    for figure in &figures {
        let low = figure["low"][1].as_f64().unwrap();
        assert!(low.abs() < 0.1, "{}: {low}", figure["title"]);
    }
}
