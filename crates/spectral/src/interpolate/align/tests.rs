use super::*;
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{smpl, synth};
use std::sync::Arc;

fn motion(name: &str, clip: Clip) -> Motion {
    Motion::new(name, clip)
}

fn dance(seed: u64, seconds: f64, fps: f64) -> Clip {
    synth::corpus(seed, 1, seconds, fps).unwrap().remove(0).clip
}

/// The same clip under other names of its joints, as they are in CMU's files.
fn renamed(clip: &Clip, names: [&str; 24]) -> Clip {
    let s = clip.skeleton();
    let names = names.iter().map(|n| n.to_string()).collect();
    let skeleton = Skeleton::new(names, s.parents().to_vec(), s.offsets().to_vec(), vec![]).unwrap();
    clip.clone().with_skeleton(Arc::new(skeleton)).unwrap()
}

#[test]
fn rates_and_lengths_are_made_one_and_said() {
    let (a, b) = (motion("a.bvh", dance(1, 4.0, 60.0)), motion("b.bvh", dance(2, 3.0, 30.0)));
    let alignment = Alignment { at_s: [0.5, 0.25], ..Alignment::default() };
    let aligned = alignment.of(&a, &b).unwrap();
    assert_eq!((aligned.a.frames(), aligned.b.frames(), aligned.b.fps()), (128, 128, 60.0));
    assert_eq!(aligned.a.root()[0], a.clip.root()[30]);
    assert!(aligned.notes.iter().any(|s| s == "b.bvh: from 30 to 60 fps"), "{:?}", aligned.notes);
    let whole = Alignment { frames: None, ..Alignment::default() }.of(&a, &b).unwrap();
    assert_eq!(whole.a.frames(), 179, "all of the shorter, 90 frames at 30");
    assert!(whole.notes.iter().any(|s| s == "a.bvh: cut to the other's 179 frames"), "{:?}", whole.notes);
    assert_eq!((alignment.low(128), alignment.low(179)), (16, 21));
}

#[test]
fn a_second_dancer_begins_facing_as_the_first() {
    let a = motion("a", dance(1, 3.0, 60.0));
    let b = motion("b", turned(&a.clip, 2.5).unwrap());
    let aligned = Alignment::default().of(&a, &b).unwrap();
    for (p, q) in aligned.a.rotations().iter().zip(aligned.b.rotations()) {
        assert!(angle_between(*p, *q) < 1e-9);
    }
    assert!(aligned.notes[0].contains("turned by -143 degrees"), "{:?}", aligned.notes);
    let kept = Alignment { keep_heading: true, ..Alignment::default() }.of(&a, &b).unwrap();
    assert!(kept.notes.is_empty() && angle_between(kept.a.pose(0)[0], kept.b.pose(0)[0]) > 2.4);
}

#[test]
fn another_rig_is_put_on_the_first_ones() {
    let names = [
        "Hips",
        "LeftUpLeg",
        "RightUpLeg",
        "Spine",
        "LeftLeg",
        "RightLeg",
        "Spine1",
        "LeftFoot",
        "RightFoot",
        "Spine2",
        "LeftToeBase",
        "RightToeBase",
        "Neck",
        "LeftShoulder",
        "RightShoulder",
        "Head",
        "LeftArm",
        "RightArm",
        "LeftForeArm",
        "RightForeArm",
        "LeftHand",
        "RightHand",
        "LeftHandMiddle1",
        "RightHandMiddle1",
    ];
    let (a, b) = (motion("a.bvh", dance(1, 3.0, 60.0)), motion("b.bvh", renamed(&dance(2, 3.0, 60.0), names)));
    let aligned = Alignment { keep_heading: true, ..Alignment::default() }.of(&a, &b).unwrap();
    assert_eq!(aligned.b.skeleton().names(), a.clip.skeleton().names());
    assert_eq!(aligned.notes, ["b.bvh: put on the rig of a.bvh"]);
    let nobody: [String; 24] = std::array::from_fn(|i| format!("bone{i}"));
    let c = motion("c.bvh", renamed(&b.clip, std::array::from_fn(|i| nobody[i].as_str())));
    let message = Alignment::default().of(&a, &c).unwrap_err().to_string();
    assert!(message.starts_with("c.bvh: it can't be put on the rig of a.bvh"), "{message}");
    assert_eq!(smpl::NAMES.len(), 24);
}

#[test]
fn windows_that_are_not_there_are_said() {
    let (a, b) = (motion("a.bvh", dance(1, 3.0, 60.0)), motion("b.bvh", dance(2, 2.0, 60.0)));
    let said = |w: Alignment| w.of(&a, &b).unwrap_err().to_string();
    let d = Alignment::default;
    let short = said(d());
    assert!(short.starts_with("b.bvh: 120 frames at 60 fps, of which 120 lie from 0 s on"), "{short}");
    assert!(short.contains("the 128 of a window"), "{short}");
    assert!(said(Alignment { at_s: [2.0, 0.0], ..d() }).starts_with("a.bvh: 180 frames"));
    assert!(said(Alignment { at_s: [-1.0, 0.0], ..d() }).contains("times from 0 on"));
    assert!(said(Alignment { at_s: [0.0, f64::INFINITY], ..d() }).contains("times from 0 on"));
    assert!(said(Alignment { frames: Some(8), ..d() }).contains("expected 16 to 8192"));
    assert!(said(Alignment { frames: Some(9000), ..d() }).contains("expected 16 to 8192"));
    assert!(said(Alignment { frames: None, at_s: [0.0, 1.9], ..d() }).contains("b.bvh: 120 frames"));
}
