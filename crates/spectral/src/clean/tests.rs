//! Dances with faults put into them, and real ones.

use super::*;
use kinelm_corpus::samples;
use kinelm_motion::format::{self, RestFrame};
use kinelm_motion::{Motion, Quat, Vec3, synth};
use std::fs;
use std::ops::ControlFlow;

fn fault(clip: &Clip, frames: std::ops::Range<usize>, joint: usize, by: Quat, down: f64) -> Clip {
    let (mut root, mut rotations) = (clip.root().to_vec(), clip.rotations().to_vec());
    for f in frames {
        root[f].y -= down;
        rotations[f * clip.joints() + joint] = rotations[f * clip.joints() + joint] * by;
    }
    Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations).unwrap()
}

/// Cleans these clips, of these splits.
fn cleaned(clips: &[(&str, &str, Clip)]) -> CleaningReport {
    let dir = tempfile::tempdir().unwrap();
    let mut csv = "clip,split\n".to_string();
    fs::create_dir(dir.path().join("data")).unwrap();
    for (name, split, clip) in clips {
        let path = dir.path().join(format!("data/{name}.json"));
        let motion = Motion::new(&path, clip.clone());
        format::write(&path, &motion).unwrap();
        csv += &format!("{name},{split}\n");
    }
    let labels = dir.path().join("labels.csv");
    fs::write(&labels, csv).unwrap();
    let dataset = kinelm_corpus::Dataset::find(&[dir.path().join("data")], &[labels.display().to_string()]).unwrap();
    let mut go = |_: kinelm_corpus::BuildEvent<'_>| ControlFlow::Continue(());
    clean(&dataset, &TokenizerConfig::default(), &BuildOptions::default(), &mut go).unwrap()
}

fn rows(cleaned: &CleaningReport) -> Vec<(&str, f64, Option<f64>, &str)> {
    cleaned.ranges.iter().map(|r| (r.clip.as_str(), r.from_s, r.to_s, r.why.as_str())).collect()
}

#[test]
fn faults_are_listed_where_they_are() {
    let dance = |i: usize| synth::corpus(9, 4, 10.0, 20.0).unwrap().remove(i).clip;
    let turned = Quat::from_rotation_x(2.8);
    let (odd, deep) = (fault(&dance(0), 60..63, 1, turned, 0.0), fault(&dance(1), 100..108, 0, Quat::IDENTITY, 0.4));
    let found = cleaned(&[
        ("a", "train", odd.clone()),
        ("b", "train", deep),
        ("c", "train", dance(2)),
        ("d", "test", odd),
        ("e", "valid", dance(3)),
    ]);
    let listed = rows(&found);
    assert_eq!(listed.len(), 2, "{listed:?}");
    // away at frame 60 and back at 63: one range; and all of clip a is a copy of the test clip d
    let (clip, from_s, to_s, why) = listed[0];
    assert_eq!((clip, from_s, to_s), ("a", 0.0, None));
    assert!(why.contains("left_hip 160 degrees in one frame") && why.contains("as in d"), "{why}");
    let (clip, from_s, to_s, why) = listed[1];
    assert_eq!((clip, from_s, to_s), ("b", 4.95, Some(5.45)));
    assert!(why.contains("root") && why.contains("cm in the floor"), "{listed:?}");
    assert_eq!(
        found.kinds,
        [(Fault::Glitch, [2, 2]), (Fault::Flip, [0, 0]), (Fault::Sinks, [1, 1]), (Fault::Copy, [1, 1])]
    );
    assert_eq!((found.clips, found.seconds), (3, 30.0));
}

#[test]
fn what_jumps_away_and_back_is_one_range() {
    let dance = synth::corpus(9, 1, 10.0, 20.0).unwrap().remove(0).clip;
    let odd = fault(&dance, 60..63, 1, Quat::from_rotation_x(2.8), 0.0);
    let found = cleaned(&[("a", "train", odd)]);
    // frames 59 to 63: those before the step away and after the step back belong to the glitch too
    let (_, from_s, to_s, why) = rows(&found)[0];
    assert_eq!((found.ranges.len(), from_s, to_s), (1, 2.95, Some(3.2)), "{why}");
    assert!((found.left_out_s - 0.25).abs() < 1e-9);
    assert!(
        found.to_string().starts_with(
            "glitches: 1 range of 1 clip\nflips of the hips: 0 ranges of 0 clips\nsinking: 0 ranges of 0 clips\n"
        ),
        "{found}"
    );
    let clean = cleaned(&[("a", "train", dance)]);
    assert_eq!((rows(&clean), clean.left_out_s), (vec![], 0.0));
}

#[test]
fn hips_that_flip_are_named_with_their_frames() {
    let dance = synth::corpus(9, 1, 10.0, 20.0).unwrap().remove(0).clip;
    let clip = dance.clone();
    let (mut rotations, joints) = (clip.rotations().to_vec(), clip.joints());
    (60..80).for_each(|f| rotations[f * joints] = Quat::from_rotation_y(std::f64::consts::PI) * rotations[f * joints]);
    let odd = Clip::new(clip.skeleton().clone(), 20.0, clip.root().to_vec(), rotations).unwrap();
    let found = cleaned(&[("a", "train", odd)]);
    let (_, from_s, to_s, why) = rows(&found)[0];
    // the frame before and the frame after belong to the steps there and back
    assert_eq!((found.ranges.len(), from_s, to_s), (1, 2.95, Some(4.05)), "{why}");
    assert!(why.contains("hips flip by 180 degrees") && found.kinds[1] == (Fault::Flip, [1, 1]), "{why}");
}

#[test]
fn a_copy_in_the_middle_is_found_and_standing_still_is_none() {
    let dance = |i: usize| synth::corpus(5, 2, 12.0, 20.0).unwrap().remove(i).clip;
    // four seconds of the first dance are in the second, not turned, moved by a metre
    let (first, second) = (dance(0), dance(1));
    let (mut root, mut rotations) = (second.root().to_vec(), second.rotations().to_vec());
    let joints = second.joints();
    for f in 0..80 {
        root[100 + f] = first.root()[33 + f] + Vec3::X;
        rotations[(100 + f) * joints..(101 + f) * joints].copy_from_slice(first.pose(33 + f));
    }
    let mixed = Clip::new(second.skeleton().clone(), 20.0, root, rotations).unwrap();
    let found = cleaned(&[("a", "train", first.clone()), ("b", "train", mixed)]);
    let copies: Vec<_> = found.ranges.iter().filter(|r| r.why.contains("as in a")).collect();
    assert_eq!(copies.len(), 1, "{:?}", rows(&found));
    assert!(copies[0].clip == "b" && copies[0].from_s >= 4.9 && copies[0].to_s.unwrap() <= 9.1, "{copies:?}");
    assert!(copies[0].to_s.unwrap() - copies[0].from_s >= 3.0, "{copies:?}");
    // up to its very end, which is between two seconds
    let whole = first.slice(0..216);
    let listed = cleaned(&[("a", "train", first.clone()), ("b", "train", whole)]);
    let listed: Vec<_> = rows(&listed).into_iter().map(|(clip, from_s, to_s, _)| (clip, from_s, to_s)).collect();
    assert_eq!(listed, [("b", 0.0, None)]);
    // two bodies that stand still in the same pose are no copies
    let still = |f: usize| {
        let clip = first.slice(f..f + 1);
        let (root, pose) = (vec![clip.root()[0]; 100], clip.rotations().repeat(100));
        Clip::new(clip.skeleton().clone(), 20.0, root, pose).unwrap()
    };
    assert!(rows(&cleaned(&[("a", "train", still(7)), ("b", "train", still(7))])).is_empty());
}

/// A turning dancer passes half a turn; the part before a copy's beginning changes nothing, nor does a beginning
/// between two frames at the corpus's rate.
#[test]
fn a_copy_without_its_beginning_is_found_over_its_whole_length() {
    let dance = |i: usize| synth::corpus(5, 2, 12.0, 60.0).unwrap().remove(i).clip;
    let first = samples::spinning(&dance(0), 0.3);
    for cut in [141, 142, 143] {
        let copy = first.slice(cut..720);
        let found = cleaned(&[("a", "train", first.clone()), ("b", "train", dance(1)), ("c", "test", copy)]);
        let listed = rows(&found).into_iter().filter(|r| r.3.contains("as in c"));
        // a window begins at every second
        assert_eq!(listed.map(|r| (r.0, r.1, r.2)).collect::<Vec<_>>(), [("a", 3.0, None)], "{:?}", rows(&found));
    }
}

#[test]
fn the_thigh_of_a_real_dance_that_turns_around_is_listed() {
    let Some(dir) = kinelm_shared_data::set("cmu-dance", "clean") else { return };
    let dataset = kinelm_corpus::Dataset::find(&[dir.join("indian/07.bvh")], &[]).unwrap();
    let mut dataset = dataset;
    dataset.items.iter_mut().for_each(|item| item.split = Split::Train);
    let options = BuildOptions {
        read: format::ReadOptions { rest: RestFrame::Drop, ..Default::default() },
        ..BuildOptions::default()
    };
    let mut go = |_: kinelm_corpus::BuildEvent<'_>| ControlFlow::Continue(());
    let found = clean(&dataset, &TokenizerConfig::default(), &options, &mut go).unwrap();
    assert!(found.ranges.iter().any(|r| r.why.contains("_hip 1")), "{:?}", rows(&found));
}
