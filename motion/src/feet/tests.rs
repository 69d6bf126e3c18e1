//! Dances that slide and hang, and what is left of that.

use super::*;
use crate::metric::{Ground, Skate, jitter};
use crate::{smpl, synth};

fn map() -> SkeletonMap {
    SkeletonMap::builtin("smpl").unwrap()
}

/// A made-up dance on its floor at y = 0.
fn dance(seed: u64) -> Clip {
    let clip = synth::corpus(seed, 1, 8.0, 30.0).unwrap().remove(0).clip;
    assert_eq!(clip.joints(), 24);
    let feet = Feet::new(clip.skeleton(), &map()).unwrap();
    let floor = feet.floor(&clip).found_m;
    clip.raised(-floor)
}

/// The same, gliding and hanging.
fn spoiled(clip: &Clip) -> Clip {
    let moved = clip.root().iter().enumerate().map(|(f, p)| {
        let t = f as f64 / clip.fps();
        *p + Vec3::new(0.12 * (1.3 * t).sin(), 0.09 + 0.02 * t.sin(), 0.12 * t)
    });
    Clip::new(clip.skeleton().clone(), clip.fps(), moved.collect(), clip.rotations().to_vec()).unwrap()
}

fn skate(clip: &Clip) -> f64 {
    Skate::of(&Feet::new(clip.skeleton(), &map()).unwrap(), clip).cm_s().unwrap()
}

fn ground(clip: &Clip) -> Ground {
    let feet = Feet::new(clip.skeleton(), &map()).unwrap();
    let pelvis: Vec<f64> = clip.root().iter().map(|p| p.y).collect();
    Ground::of(&feet.least(clip), &pelvis, clip.fps())
}

#[test]
fn a_dance_that_slides_and_hangs_stands() {
    for seed in 1..6 {
        let clip = dance(seed);
        let bad = spoiled(&clip);
        let (done, locked) = lock(&bad, &map(), 0.0, Fixed::default()).unwrap();
        assert!(locked.held.len() >= 2, "{locked:?}");
        assert!(ground(&bad).floating_share().unwrap() > 0.5);
        assert!(ground(&done).floating_share().unwrap() < 0.05, "{:?}", ground(&done));
        assert!(ground(&done).penetration_share().unwrap() < 0.02, "{:?}", ground(&done));
        let settled = bad.clone().raised(-0.09);
        assert!(skate(&done) < 0.5 * skate(&settled), "{} of {}", skate(&done), skate(&settled));
        assert!(jitter(&done).unwrap() < jitter(&bad).unwrap() + 15.0);
        // feet that stand have their place to the millimetre
        let places = done.positions();
        for contact in &locked.held {
            for f in contact.frames() {
                let p = places[f * 24 + contact.joint];
                let apart = (p.x - contact.place[0]).hypot(p.z - contact.place[2]);
                assert!(apart < REACH_M + 1e-9, "{apart}");
            }
        }
        // nothing but hips, knees and ankles turns, and feet keep their rotation in the world
        for f in 0..done.frames() {
            let (a, b) = (bad.global_pose(f), done.global_pose(f));
            for j in 0..24 {
                let same = done.pose(f)[j].angle_between(bad.pose(f)[j]) < 1e-6;
                assert!(same || [1, 2, 4, 5, 7, 8].contains(&j), "joint {j} of frame {f}");
            }
            for foot in [7, 8, 10, 11] {
                assert!(a.rotations[foot].angle_between(b.rotations[foot]) < 1e-6);
            }
        }
    }
}

#[test]
fn what_is_given_is_not_touched() {
    let bad = spoiled(&dance(2));
    let (done, locked) =
        lock(&bad, &map(), 0.0, Fixed { root: true, path: false, legs: [false, true], frames: 0 }).unwrap();
    assert_eq!((done.root(), locked.settled_cm), (bad.root(), 0.0));
    assert!(locked.held.iter().all(|c| c.side == 0));
    for f in 0..done.frames() {
        for j in [0, 2, 5, 8, 11] {
            assert_eq!(done.pose(f)[j], bad.pose(f)[j]);
        }
    }
    let (same, locked) =
        lock(&bad, &map(), 0.0, Fixed { root: true, path: false, legs: [true, true], frames: 0 }).unwrap();
    assert_eq!((&same, locked), (&bad, Locked::default()));
}

#[test]
fn a_path_that_is_fixed_goes_where_it_goes_and_the_body_still_comes_to_its_floor() {
    let clip = spoiled(&dance(5));
    let (held, locked) = lock(&clip, &map(), 0.0, Fixed { path: true, ..Fixed::default() }).unwrap();
    assert!(locked.carried_cm == 0.0 && locked.settled_cm > 5.0, "{locked:?}");
    assert!(clip.root().iter().zip(held.root()).all(|(a, b)| (a.x, a.z) == (b.x, b.z)));
}

#[test]
fn a_statue_and_a_frame_stay_as_they_are() {
    let standing = |frames: usize, up: f64| {
        let feet = Feet::new(&smpl::neutral(), &map()).unwrap();
        let root = vec![Vec3::Y * (feet.pelvis_m + up); frames];
        Clip::new(smpl::neutral(), 20.0, root, vec![Quat::IDENTITY; 24 * frames]).unwrap()
    };
    for frames in [0, 1, 40] {
        let clip = standing(frames, 0.0);
        let (done, _) = lock(&clip, &map(), 0.0, Fixed::default()).unwrap();
        for (a, b) in done.positions().iter().zip(clip.positions()) {
            assert!((*a - b).length() < 1e-9, "{frames} frames");
        }
    }
    // straight legs under a body that is too high by what is left to it: the feet are put down
    let (done, _) = lock(&standing(40, 0.015), &map(), 0.0, Fixed::default()).unwrap();
    assert!(ground(&done).penetration_share() == Some(0.0));
    assert!(done.positions().chunks(24).all(|p| (p[7].y - 0.06).abs() < 0.02));
}

#[test]
fn a_leg_bends_to_a_place_and_says_what_is_too_far() {
    let pose = ReferencePose::new(&smpl::neutral(), &map()).unwrap();
    let legs = Leg::both(&pose, &Feet::of(&smpl::neutral(), &pose));
    let clip = dance(4);
    for f in (0..clip.frames()).step_by(7) {
        for leg in &legs {
            for offset in [Vec3::new(0.05, 0.03, -0.04), Vec3::new(-0.1, 0.1, 0.0), Vec3::new(0.0, 0.2, 0.1)] {
                let before = clip.global_pose(f);
                let mut local = clip.pose(f).to_vec();
                let far = leg.bend(clip.skeleton(), &before, offset, &mut local);
                let after = GlobalPose::new(clip.skeleton(), clip.root()[f], &local);
                let apart = (after.positions[leg.ankle] - before.positions[leg.ankle] - offset).length();
                assert!((apart - far).abs() < 1e-6, "{apart} {far}");
                assert!(after.rotations[leg.ankle].angle_between(before.rotations[leg.ankle]) < 1e-6);
            }
        }
    }
    // a metre down is out of reach
    let mut local = clip.pose(0).to_vec();
    let far = legs[0].bend(clip.skeleton(), &clip.global_pose(0), -Vec3::Y, &mut local);
    assert!(far > 0.5, "{far}");
}

#[test]
fn what_is_behind_given_frames_begins_where_they_end() {
    let bad = spoiled(&dance(2));
    let given = 60;
    let (done, _) = lock(&bad, &map(), 0.0, Fixed { frames: given, ..Fixed::default() }).unwrap();
    assert_eq!(done.slice(0..given), bad.slice(0..given));
    let (places, before) = (done.positions(), bad.positions());
    let speed = |all: &[Vec3], f: usize, j: usize| (all[(f + 1) * 24 + j] - all[f * 24 + j]).length() * done.fps();
    for f in given - 1..given + 30 {
        for j in [0, 7, 8] {
            assert!(speed(&places, f, j) < speed(&before, f, j) + 1.0, "joint {j} of frame {f}");
        }
    }
    assert!(ground(&done.slice(90..done.frames())).floating_share().unwrap() < 0.05);
}

#[test]
fn one_who_stands_on_the_hands_or_lies_is_not_set_down() {
    let turned = |by: Quat, up: f64| {
        let mut rotations = vec![Quat::IDENTITY; 24 * 60];
        (0..60).for_each(|f| rotations[24 * f] = by);
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y * up; 60], rotations).unwrap();
        let lowest = clip.positions().iter().map(|p| p.y).fold(f64::MAX, f64::min);
        clip.raised(0.08 - lowest)
    };
    let half = std::f64::consts::PI;
    for clip in [turned(Quat::from_rotation_x(half), 1.2), turned(Quat::from_rotation_x(-half / 2.0), 0.2)] {
        let (done, locked) = lock(&clip, &map(), 0.0, Fixed::default()).unwrap();
        assert!(locked.settled_cm < 1e-6, "{locked:?}");
        let (before, after) = (clip.positions(), done.positions());
        let far = (0..before.len())
            .max_by(|&a, &b| (before[a] - after[a]).length().total_cmp(&(before[b] - after[b]).length()));
        let far = far.unwrap();
        assert!(
            (before[far] - after[far]).length() < 0.08,
            "{} {:?} {:?} {locked:?}",
            far % 24,
            before[far],
            after[far]
        );
    }
}
