//! Maps as commands find them: trunks of any length, reference poses that are held to the file, bodies in a mirror.

#[allow(dead_code, reason = "other tests use the rest")]
mod rigs;

use kinelm_motion::convert::{ConvertOptions, TargetRig, convert};
use kinelm_motion::format::{self, MirrorAxis, ReadOptions, Unit};
use kinelm_motion::rig::{FoundBy, Humanoid, ReferencePose, SkeletonMap, find_map, map_for};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, GlobalPose, Motion, Quat, Skeleton, Vec3, smpl};
use rigs::{Tree, from_pose, random, tilted, turns};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Names of collar, upper arm, lower arm, hand, upper leg, lower leg, foot and toes, `{}` for the side.
struct Words {
    pelvis: &'static str,
    neck: &'static str,
    head: &'static str,
    sides: [&'static str; 2],
    limbs: [&'static str; 8],
}

const XSENS: Words = Words {
    pelvis: "Hips",
    neck: "Neck",
    head: "Head",
    sides: ["Left", "Right"],
    limbs: ["{}Collar", "{}Shoulder", "{}Elbow", "{}Wrist", "{}Hip", "{}Knee", "{}Ankle", "{}Toe"],
};
const MOTION_BUILDER: Words =
    Words { limbs: ["{}Shoulder", "{}Arm", "{}ForeArm", "{}Hand", "{}UpLeg", "{}Leg", "{}Foot", "{}ToeBase"], ..XSENS };
const VRM_ADDON: Words = Words {
    pelvis: "hips",
    neck: "neck",
    head: "head",
    sides: ["L", "R"],
    limbs: [
        "shoulder.{}",
        "upper_arm.{}",
        "lower_arm.{}",
        "hand.{}",
        "upper_leg.{}",
        "lower_leg.{}",
        "foot.{}",
        "toes.{}",
    ],
};
const UNREAL: Words = Words {
    pelvis: "pelvis",
    neck: "neck_01",
    head: "head",
    sides: ["l", "r"],
    limbs: ["clavicle_{}", "upperarm_{}", "lowerarm_{}", "hand_{}", "thigh_{}", "calf_{}", "foot_{}", "ball_{}"],
};

/// A body in T-pose, its trunk of these joints, evenly spaced from 8 cm above the pelvis to where collars and neck part, its
/// legs and arms longer by these factors.
fn body(words: &Words, trunk: &[&str], [legs, arms]: [f64; 2]) -> Skeleton {
    let (mut names, mut parents, mut offsets) = (vec![words.pelvis.to_owned()], vec![None], vec![Vec3::ZERO]);
    let mut push = |name: String, parent: usize, offset: Vec3| {
        names.push(name);
        parents.push(Some(parent));
        offsets.push(offset);
        names.len() - 1
    };
    let mut top = 0;
    let step = if trunk.len() > 1 { 0.24 / (trunk.len() - 1) as f64 } else { 0.0 };
    for (i, name) in trunk.iter().enumerate() {
        top = push((*name).to_owned(), top, Vec3::Y * if i == 0 { 0.08 } else { step });
    }
    let height = 0.08 + step * trunk.len().saturating_sub(1) as f64;
    let neck = push(words.neck.into(), top, Vec3::Y * (0.52 - height));
    push(words.head.into(), neck, Vec3::new(0.0, 0.1, 0.01));
    for (side, name) in [1.0, -1.0].into_iter().zip(words.sides) {
        let name = |limb: usize| words.limbs[limb].replace("{}", name);
        let out = |x: f64, y: f64| Vec3::new(side * x, y, 0.0);
        let mut at = top;
        for (limb, offset) in [out(0.03, 0.5 - height), out(0.14, 0.0), out(0.28 * arms, 0.0), out(0.25 * arms, 0.0)]
            .into_iter()
            .enumerate()
        {
            at = push(name(limb), at, offset);
        }
        let mut at = 0;
        let toes = Vec3::new(0.0, -0.07, 0.13);
        for (limb, offset) in
            [out(0.09, -0.04), out(0.0, -0.42 * legs), out(0.0, -0.41 * legs), toes].into_iter().enumerate()
        {
            at = push(name(4 + limb), at, offset);
        }
    }
    Skeleton::new(names, parents, offsets, Vec::new()).unwrap()
}

/// Somebody who bows by up to 50 degrees, evenly over the trunk's joints, walks on the spot, and moves both arms.
fn bowing(words: &Words, trunk: &[&str], rig: Skeleton) -> Clip {
    let height = -GlobalPose::new(&rig, Vec3::ZERO, &vec![Quat::IDENTITY; rig.joints()])
        .positions
        .iter()
        .fold(f64::MAX, |low, p| low.min(p.y));
    let joint = |limb: usize, side: usize| rig.find(&words.limbs[limb].replace("{}", words.sides[side])).unwrap();
    let mut rotations = Vec::new();
    for f in 0..60 {
        let phase = TAU * f as f64 / 60.0;
        let mut pose = vec![Quat::IDENTITY; rig.joints()];
        let bow = 50f64.to_radians() * (0.5 - 0.5 * phase.cos()) / trunk.len() as f64;
        trunk.iter().for_each(|name| pose[rig.find(name).unwrap()] = Quat::from_rotation_x(bow));
        for side in 0..2 {
            let swing = (phase + TAU * 0.5 * side as f64).sin();
            let sign = 1.0 - 2.0 * side as f64;
            pose[joint(1, side)] = Quat::from_rotation_z(-sign * (0.9 + 0.3 * swing));
            pose[joint(2, side)] = Quat::from_rotation_y(-sign * (0.5 + 0.3 * swing));
            pose[joint(4, side)] = Quat::from_rotation_x(-0.3 * swing - 0.3);
            pose[joint(5, side)] = Quat::from_rotation_x(0.5 + 0.3 * swing);
        }
        rotations.extend(pose);
    }
    Clip::new(Arc::new(rig), 30.0, vec![Vec3::Y * height; 60], rotations).unwrap()
}

fn trunk_of(count: usize, words: &Words) -> Vec<String> {
    let (base, first) = if std::ptr::eq(words, &XSENS) { ("Chest", 2) } else { ("Spine", 1) };
    (0..count).map(|i| if i == 0 { base.to_owned() } else { format!("{base}{}", i + first - 1) }).collect()
}

#[test]
fn trunks_of_any_length_are_mapped_from_end_to_end() {
    for words in [&XSENS, &MOTION_BUILDER] {
        for count in 1..=8 {
            let names = trunk_of(count, words);
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let clip = bowing(words, &names, body(words, &names, [1.0; 2]));
            let map = find_map(&clip, None).unwrap().map;
            let spine = [3, 6, 9].map(|id| map.joint(id));
            match names[..] {
                [only] => assert!(spine.contains(&Some(only)), "{only}: {spine:?}"),
                [first, .., last] => assert_eq!((spine[0], spine[2]), (Some(first), Some(last)), "{names:?}"),
                [] => {}
            }
            assert_eq!(spine[1].is_some(), count > 2, "{names:?}: {spine:?}");
            let error = Humanoid::with_map(clip.skeleton(), &map).fit(&clip).trunk_error_deg.unwrap();
            println!("{names:?}: {error:.1} degrees");
            assert!(error < 5.0, "{names:?}: {error}");
        }
    }
}

#[test]
fn a_trunk_that_goes_elsewhere_is_doubted() {
    let names = ["Spine", "Spine1", "Spine2", "Spine3"];
    let clip = bowing(&MOTION_BUILDER, &names, body(&MOTION_BUILDER, &names, [1.0; 2]));
    let folder = tempfile::tempdir().unwrap();
    let file = written(folder.path(), "a.bvh", &clip);
    let read = |map: Option<&str>| format::read(&file, &ReadOptions { map: map.map(Into::into), ..metres() }).unwrap();
    let doubt = |motion: &Motion| motion.warnings.iter().find(|w| w.kind == "trunk_off").map(|w| w.what.clone());
    assert_eq!(doubt(&read(None)), None);
    // a map of the caller's is used as it is
    let doubt = doubt(&read(Some("mixamo"))).unwrap();
    assert!(doubt.contains("Spine, Spine1, Spine2, Spine3 the map has Spine, Spine1, Spine2;"), "{doubt}");
}

fn metres() -> ReadOptions {
    ReadOptions { unit: Unit::METRE, ..ReadOptions::default() }
}

fn plain(clip: &Clip) -> Motion {
    Motion::new("a.json", clip.clone())
}

/// A clip as a BVH in metres.
fn written(folder: &Path, name: &str, clip: &Clip) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, format::bvh::to_bytes_in(&plain(clip), 1.0).unwrap()).unwrap();
    path
}

/// The greatest distance between joints of the same names in two clips, metres; files order joints their own way.
fn off(a: &Clip, b: &Clip) -> f64 {
    let names = a.skeleton().names().iter().enumerate();
    let pairs: Vec<_> = names.map(|(j, name)| (j, b.skeleton().find(name).unwrap())).collect();
    let of = |f: usize| {
        let (a, b) = (a.global_pose(f).positions, b.global_pose(f).positions);
        pairs.iter().map(|&(i, j)| a[i].distance(b[j])).fold(0.0, f64::max)
    };
    assert_eq!((a.frames(), a.joints()), (b.frames(), b.joints()));
    (0..a.frames()).map(of).fold(0.0, f64::max)
}

/// The greatest angle between the rotations of limbs and trunk of two clips on SMPL's body, radians.
fn apart(a: &Clip, b: &Clip) -> f64 {
    let ids = [0, 1, 2, 3, 4, 5, 9, 16, 17, 18, 19];
    let of = |f: usize| {
        let (a, b) = (a.global_pose(f), b.global_pose(f));
        ids.map(|id| angle_between(a.rotations[id], b.rotations[id])).into_iter().fold(0.0, f64::max)
    };
    (0..a.frames()).map(of).fold(0.0, f64::max)
}

fn on_smpl(clip: &Clip, map: Option<&str>) -> Clip {
    let options = ConvertOptions { rig: Some(TargetRig::Smpl(smpl::neutral())), ..ConvertOptions::default() };
    let motion = plain(clip);
    let motion = map.map_or(Ok(motion.clone()), |map| motion.with_map(map)).unwrap();
    convert(motion, &options).unwrap().clip
}

#[test]
fn a_reference_pose_in_which_no_body_stands_is_not_used() {
    let trunk = ["Spine", "Chest"];
    let known = bowing(&MOTION_BUILDER, &trunk, body(&MOTION_BUILDER, &trunk, [1.0; 2]));
    let trunk = ["spine", "chest"];
    let clip = bowing(&VRM_ADDON, &trunk, body(&VRM_ADDON, &trunk, [1.0; 2]));
    // bandai's names, and its reference pose is of bones along x
    let found = find_map(&clip, None).unwrap();
    assert_eq!((found.map.name.as_str(), found.by, found.made), ("bandai", FoundBy::Names, false));
    assert!(apart(&on_smpl(&clip, None), &on_smpl(&known, None)) < 1e-9);
    // with another rest pose, one is made from the clip
    let mut random = random(5);
    let turns = turns(clip.joints(), &mut random);
    let moved = tilted(&clip, &turns);
    let found = find_map(&moved, None).unwrap();
    assert!(found.made && Humanoid::with_map(moved.skeleton(), &found.map).fit(&moved).stands.is_ok(), "{found:?}");
    // and its own is used on bandai's own rest pose
    let own = SkeletonMap::builtin("bandai").unwrap();
    let local: Vec<Quat> = {
        let named = clip.skeleton().names().iter();
        let reference: Vec<(String, Quat)> =
            own.bind_any(clip.skeleton().names()).reference().map(|(n, q)| (n.to_owned(), q)).collect();
        named.map(|n| reference.iter().find(|(r, _)| r == n).map_or(Quat::IDENTITY, |r| r.1)).collect()
    };
    let mut world: Vec<Quat> = Vec::new();
    for (j, q) in local.iter().enumerate() {
        world.push(clip.skeleton().parents()[j].map_or(*q, |p| world[p] * *q));
    }
    let found = find_map(&tilted(&clip, &world), None).unwrap();
    assert!(!found.made && found.map.reference().count() > 5, "{found:?}");
}

#[test]
fn an_own_map_without_a_reference_pose_gets_one_from_the_clip() {
    let trunk = ["Spine", "Chest"];
    let clip = bowing(&MOTION_BUILDER, &trunk, body(&MOTION_BUILDER, &trunk, [1.0; 2]));
    let moved = from_pose(&clip, 20);
    let text = find_map(&clip, None).unwrap().map.to_toml();
    assert!(!text.contains("[reference]"), "{text}");
    let found = find_map(&moved, Some(&text)).unwrap();
    assert!(found.made && found.is_of_clip());
    assert!(ReferencePose::new(moved.skeleton(), &found.map).is_ok());
    let error = Humanoid::with_map(moved.skeleton(), &found.map).fit(&moved).trunk_error_deg.unwrap();
    assert!(error < 5.0, "{error}");
    // written out, it is the map that is used as it is
    let again = find_map(&moved, Some(&found.map.to_toml())).unwrap();
    assert!(!again.made);
    assert!(apart(&on_smpl(&moved, Some(&text)), &on_smpl(&moved, Some(&found.map.to_toml()))) < 1e-9);
    // a rest pose in which the body stands is one
    assert!(!find_map(&clip, Some(&text)).unwrap().made);
}

/// The clip in a mirror at the plane across an axis.
fn in_mirror(clip: &Clip, axis: usize) -> Clip {
    let flip = |v: Vec3| {
        let mut v = v.to_array();
        v[axis] = -v[axis];
        Vec3::from_array(v)
    };
    let rig = clip.skeleton();
    let offsets = rig.offsets().iter().map(|o| flip(*o)).collect();
    let rig = Skeleton::new(rig.names().to_vec(), rig.parents().to_vec(), offsets, Vec::new()).unwrap();
    let turned = |q: &Quat| {
        let v = -flip(q.xyz());
        Quat::from_xyzw(v.x, v.y, v.z, q.w)
    };
    let root = clip.root().iter().map(|p| flip(*p)).collect();
    Clip::new(Arc::new(rig), clip.fps(), root, clip.rotations().iter().map(turned).collect()).unwrap()
}

#[test]
fn a_body_in_a_mirror_is_doubted_and_taken_out_of_it() {
    let trunk = ["Spine", "Chest"];
    let clip = bowing(&MOTION_BUILDER, &trunk, body(&MOTION_BUILDER, &trunk, [1.0; 2]));
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let is_doubted = |motion: &Motion| motion.warnings.iter().any(|w| w.kind == "mirrored");
    assert!(!is_doubted(&format::read(&written(folder.path(), "right.bvh", &clip), &metres()).unwrap()));
    for (i, axis) in [MirrorAxis::X, MirrorAxis::Y, MirrorAxis::Z].into_iter().enumerate() {
        let bvh = written(folder.path(), "left.bvh", &in_mirror(&clip, i));
        let json = path("left.json");
        format::write(&json, &plain(&in_mirror(&clip, i))).unwrap();
        let glb = path("left.glb");
        format::write(&glb, &plain(&in_mirror(&clip, i))).unwrap();
        for file in [bvh, json, glb] {
            let read = |mirror_axis| format::read(&file, &ReadOptions { mirror_axis, ..metres() }).unwrap();
            // upside down, a BVH is stood up again: it is mirrored all the same
            assert!(is_doubted(&read(None)), "{}", file.display());
            let motion = read(Some(axis));
            assert!(!is_doubted(&motion), "{}: {:?}", file.display(), motion.warnings);
            assert!(off(&motion.clip, &clip) < 1e-5, "{}", file.display());
            if file.extension().is_some_and(|e| e == "glb") {
                continue;
            }
            // an unchanged clip is the file again, a changed one is mirrored again
            assert_eq!(format::to_bytes(&file, &motion).unwrap(), std::fs::read(&file).unwrap());
            let raised = motion.clone().with_clip(motion.clip.clone().raised(0.1));
            let out = path(&format!("out.{}", file.extension().unwrap().to_str().unwrap()));
            format::write(&out, &raised).unwrap();
            let again = format::read(&out, &ReadOptions { mirror_axis: Some(axis), ..metres() }).unwrap().clip;
            assert!(off(&again, &raised.clip) < 1e-5, "{}", out.display());
            assert!(is_doubted(&format::read(&out, &metres()).unwrap()));
        }
    }
    #[cfg(feature = "amass")]
    {
        let options = ReadOptions { mirror_axis: Some(MirrorAxis::X), ..ReadOptions::default() };
        let e = format::read(&path("a.npz"), &options).unwrap_err().to_string();
        assert!(e.contains("`mirror_axis` of") && e.contains("SMPL's"), "{e}");
    }
}

#[test]
fn exchanged_sides_are_right_with_a_map_that_exchanges_them() {
    let trunk = ["Spine", "Chest"];
    let swapped = Words { sides: ["Right", "Left"], ..MOTION_BUILDER };
    let right = bowing(&MOTION_BUILDER, &trunk, body(&MOTION_BUILDER, &trunk, [1.0; 2]));
    let clip = bowing(&swapped, &trunk, body(&swapped, &trunk, [1.0; 2]));
    let map = find_map(&clip, None).unwrap().map;
    assert!(Humanoid::with_map(clip.skeleton(), &map).fit(&clip).toes_ahead.unwrap() < -0.9);
    let toml = map.to_toml().replace("left_", "new_").replace("right_", "left_").replace("new_", "right_");
    assert!(
        Humanoid::with_map(clip.skeleton(), &find_map(&clip, Some(&toml)).unwrap().map).fit(&clip).toes_ahead.unwrap()
            > 0.9
    );
    assert!(apart(&on_smpl(&clip, Some(&toml)), &on_smpl(&right, None)) < 1e-9);
}

#[test]
fn a_target_rig_is_read_by_its_own_options() {
    let folder = tempfile::tempdir().unwrap();
    let trunk = ["Spine", "Chest"];
    let clip = bowing(&MOTION_BUILDER, &trunk, body(&MOTION_BUILDER, &trunk, [1.0; 2]));
    let numbered: Vec<String> = (0..clip.joints()).map(|j| format!("q{j}")).collect();
    let own = clip.skeleton();
    let rig = Skeleton::new(numbered.clone(), own.parents().to_vec(), own.offsets().to_vec(), Vec::new()).unwrap();
    let still = Clip::new(Arc::new(rig), 30.0, clip.root()[..1].to_vec(), clip.pose(0).to_vec()).unwrap();
    let file = written(folder.path(), "rig.bvh", &still);
    let name = file.to_str().unwrap();
    let mut map = find_map(&clip, None).unwrap().map.to_toml();
    for (old, new) in own.names().iter().zip(&numbered) {
        map = map.replace(&format!("\"{old}\""), &format!("\"{new}\""));
    }
    let options = ReadOptions { unit: Unit::METRE, ..ReadOptions::default() };
    // one frame of numbered bones tells too little, and the message is about that file
    if let Err(e) = TargetRig::load(name, &options) {
        assert!(e.to_string().starts_with(name), "{e}");
    }
    let rig = TargetRig::load(name, &ReadOptions { map: Some(map), ..options }).unwrap();
    let options = ConvertOptions { rig: Some(rig), ..ConvertOptions::default() };
    // the clip's map is not the rig's
    let clips_map = find_map(&clip, None).unwrap().map.to_toml();
    let on = convert(plain(&clip).with_map(&clips_map).unwrap(), &options).unwrap().clip;
    assert_eq!((on.skeleton().names()[0].as_str(), on.frames()), ("q0", 60));
    let named = Skeleton::new(numbered, own.parents().to_vec(), own.offsets().to_vec(), Vec::new()).unwrap();
    assert!(off(&on, &clip.clone().with_skeleton(Arc::new(named)).unwrap()) < 1e-5);
    let e = TargetRig::load(name, &ReadOptions { map: Some("cmu".into()), ..metres() }).unwrap_err();
    assert!(e.to_string().starts_with(name) && e.to_string().contains("finds no pelvis"), "{e}");
}

#[test]
fn unreal_s_names_are_known_with_short_legs() {
    let trunk = ["spine_01", "spine_03"];
    for (legs, arms) in [(0.6, 1.0), (0.7, 1.0), (0.7, 0.7), (0.7, 1.2), (1.0, 0.7), (1.0, 1.35), (1.3, 0.9)] {
        let clip = bowing(&UNREAL, &trunk, body(&UNREAL, &trunk, [legs, arms]));
        let found = find_map(&clip, None).unwrap_or_else(|e| panic!("legs {legs}, arms {arms}: {e}"));
        assert_eq!((found.map.joint(1), found.map.joint(12)), (Some("thigh_l"), Some("neck_01")));
    }
    let clip = bowing(&UNREAL, &trunk, body(&UNREAL, &trunk, [0.5, 1.0]));
    let question = find_map(&clip, None).unwrap_err().to_string();
    for line in ["left_hip = \"thigh_l\"", "left_knee = \"calf_l\"", "left_ankle = \"foot_l\"", "neck = \"neck_01\""] {
        assert!(question.contains(line), "{question}");
    }
}

/// CMU's own hierarchy on a body whose upper arms, forearms, thighs and shins are longer by these factors; the forearm goes
/// on behind the joint that is called wrist, as CMU's do.
fn cmu_asf(tree: &Tree, [humerus, radius, femur, tibia]: [f64; 4]) -> Skeleton {
    let rig = tree.skeleton(&smpl::neutral());
    let factor = |name: &str| match &name[1..] {
        "radius" => humerus,
        "wrist" => 0.66 * radius,
        "tibia" => femur,
        "foot" => tibia,
        _ => 1.0,
    };
    let offset = |(name, o): (&String, &Vec3)| match &name[1..] {
        "hand" => Vec3::new(o.x.signum() * 0.085 * radius, 0.0, 0.0),
        _ => *o * factor(name),
    };
    let offsets = rig.names().iter().zip(rig.offsets()).map(offset).collect();
    Skeleton::new(rig.names().to_vec(), rig.parents().to_vec(), offsets, Vec::new()).unwrap()
}

#[test]
fn cmu_s_own_skeletons_are_known_whatever_their_lengths() {
    let tree = rigs::all().into_iter().find(|tree| tree.rig == "cmu_asf").unwrap();
    let mut tried = 0;
    for lengths in (0..81).map(|n: usize| [n % 3, n / 3 % 3, n / 9 % 3, n / 27 % 3]) {
        let [humerus, radius] = [0, 1].map(|i| [0.7, 1.0, 1.3][lengths[i]]);
        let [femur, tibia] = [2, 3].map(|i| [0.85, 1.0, 1.15][lengths[i]]);
        let lengths = [humerus, radius, femur, tibia];
        let rig = cmu_asf(&tree, lengths);
        let map = map_for(&rig, None).unwrap_or_else(|e| panic!("{lengths:?}: {e}"));
        let named = [(1, "lfemur"), (4, "ltibia"), (7, "lfoot"), (18, "lradius"), (21, "rwrist"), (22, "lhand")];
        for (id, name) in named {
            assert_eq!(map.joint(id), Some(name), "{lengths:?}");
        }
        tried += 1;
    }
    assert_eq!(tried, 81);
}
