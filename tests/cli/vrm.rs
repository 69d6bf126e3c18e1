//! VRM: avatars are answered by animations of theirs, and hold one only on purpose.

use crate::support::{kinelm_in, read, save, stdout};
use assert_cmd::Command;
use kinelm_motion::format::{self, ReadOptions, glb};
use kinelm_motion::{Clip, Quat, Source, Vec3, smpl, synth};
use predicates::str::contains;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Where the hips of the avatar are at rest, metres.
const HIPS_M: f64 = 0.98;

/// VRM's names of SMPL's joints, by id.
const BONES: [&str; 22] = [
    "hips",
    "leftUpperLeg",
    "rightUpperLeg",
    "spine",
    "leftLowerLeg",
    "rightLowerLeg",
    "chest",
    "leftFoot",
    "rightFoot",
    "upperChest",
    "leftToes",
    "rightToes",
    "neck",
    "leftShoulder",
    "rightShoulder",
    "head",
    "leftUpperArm",
    "rightUpperArm",
    "leftLowerArm",
    "rightLowerArm",
    "leftHand",
    "rightHand",
];

/// The document of a GLB, and what follows it.
fn parts(bytes: &[u8]) -> (Value, &[u8]) {
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    (serde_json::from_slice(&bytes[20..20 + length]).unwrap(), &bytes[20 + length..])
}

/// A folder with a dance and an avatar, a VRM 1 of SMPL's body.
fn place() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    save(&dir.path().join("dance.bvh"), &synth::corpus(5, 1, 3.0, 30.0).unwrap().remove(0).clip);
    let rest = Clip::new(smpl::neutral(), 30.0, vec![Vec3::Y * HIPS_M], vec![Quat::IDENTITY; 24]).unwrap();
    let bytes = glb::to_bytes(&[("body", &rest)]).unwrap();
    let (mut document, rest) = parts(&bytes);
    document["asset"]["generator"] = "another".into();
    // the first node holds the joints
    let bones: serde_json::Map<String, Value> =
        BONES.iter().enumerate().map(|(id, bone)| ((*bone).to_owned(), json!({"node": 1 + id}))).collect();
    document["extensions"] = json!({"VRMC_vrm": {"specVersion": "1.0", "humanoid": {"humanBones": bones}}});
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let number = |n: usize| (n as u32).to_le_bytes();
    let head = [&b"glTF"[..], &number(2), &number(20 + text.len() + rest.len()), &number(text.len()), b"JSON"].concat();
    fs::write(dir.path().join("hero.vrm"), [&head, &text[..], rest].concat()).unwrap();
    dir
}

fn call(dir: &Path, words: &str) -> Command {
    let mut command = kinelm_in(dir, words);
    command.env("XDG_CACHE_HOME", dir.join("cache"));
    command
}

#[test]
fn an_avatar_is_answered_by_an_animation_of_it() {
    let place = place();
    let dir = place.path();
    call(dir, "convert dance.bvh x.vrma --onto hero.vrm").assert().success();
    call(dir, "convert dance.bvh own.json --onto hero.vrm").assert().success();
    let (animation, own) = (read(&dir.join("x.vrma")), read(&dir.join("own.json")));
    assert_eq!((animation.joints(), animation.frames()), (BONES.len(), own.frames()));
    let (at, of) = (animation.positions(), own.positions());
    // by a constant: where the floor was
    let lower = of[0].y - at[0].y;
    for f in 0..own.frames() {
        for (j, name) in animation.skeleton().names().iter().enumerate() {
            let other = of[f * own.joints() + own.skeleton().find(name).unwrap()] - lower * Vec3::Y;
            assert!(at[f * animation.joints() + j].distance(other) < 1e-5, "{name} in frame {f}");
        }
    }
    let bytes = fs::read(dir.join("x.vrma")).unwrap();
    let (document, _) = parts(&bytes);
    assert_eq!(document["animations"][0]["name"], "x");
    assert!((document["nodes"][0]["translation"][1].as_f64().unwrap() - HIPS_M).abs() < 1e-6);
    // any rig has one, and any format is made of it
    call(dir, "convert dance.bvh plain.vrma").assert().success();
    let said = stdout(&mut call(dir, "inspect plain.vrma"));
    assert!(said.contains("VRM animation"), "{said}");
    call(dir, "convert plain.vrma again.bvh").assert().success();
    // what is no animation is refused under its name
    fs::copy(dir.join("hero.vrm"), dir.join("wrong.vrma")).unwrap();
    call(dir, "inspect wrong.vrma").assert().code(1).stderr(contains("name it .vrm"));
}

#[test]
fn a_dance_goes_into_a_vrm_only_on_purpose() {
    let place = place();
    let dir = place.path();
    let refused = |words: &str, why: &str| drop(call(dir, words).assert().code(2).stderr(contains(why)));
    refused(
        "convert dance.bvh x.vrm --onto hero.vrm",
        "players of VRM ignore an animation inside a .vrm: a .vrma animates it",
    );
    refused("generate --onto hero.vrm --seconds 1 --out x.vrm", "--embed of generate and convert");
    refused("convert dance.bvh x.glb --onto hero.vrm --embed", "it puts a dance into a .vrm");
    refused("convert dance.bvh x.vrm --embed", "--embed needs --onto");
    refused("generate --prompt hero.vrm --joints root --out x.vrm --embed", "add --rig prompt");
    call(dir, "convert dance.bvh x.vrm --onto dance.bvh --embed")
        .assert()
        .failure()
        .stderr(contains("of a .vrm with a mesh"));
    call(dir, "convert dance.bvh x.vrm --onto hero.vrm --embed").assert().success();
    let bytes = fs::read(dir.join("x.vrm")).unwrap();
    let (document, _) = parts(&bytes);
    assert_eq!(document["animations"][0]["name"], "x");
    assert!(document["extensions"]["VRMC_vrm"].is_object());
}

#[test]
fn a_new_dance_of_an_avatar_is_made_again_to_the_byte() {
    let place = place();
    let dir = place.path();
    for (out, more) in [("new.vrma", ""), ("new.vrm", "--embed")] {
        call(dir, &format!("generate --onto hero.vrm --seconds 1 --seed 2 --out {out} {more}")).assert().success();
        let first = fs::read(dir.join(out)).unwrap();
        call(dir, &format!("again {out}.kinelm.json --force")).assert().success();
        assert!(fs::read(dir.join(out)).unwrap() == first, "{out}");
    }
    let sidecar: Value = serde_json::from_slice(&fs::read(dir.join("new.vrma.kinelm.json")).unwrap()).unwrap();
    assert_eq!((&sidecar["read"]["floor"], &sidecar["read"]["map"]), (&json!(0.0), &Value::Null));
    let motion = format::read(&dir.join("new.vrma"), &ReadOptions::default()).unwrap();
    assert!(matches!(motion.source, Source::Vrma(_)) && motion.map().is_some());
    // an edit of it is on its rig
    call(dir, "generate --prompt new.vrma --free left_arm@0.2s:0.6s --out edit.vrma").assert().success();
    assert_eq!(*read(&dir.join("edit.vrma")).skeleton().names(), *motion.clip.skeleton().names());
}
