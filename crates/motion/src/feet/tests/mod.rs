//! Tests of foot locking on dances that slide and float.

mod toes;

use super::*;
use crate::metric::{Ground, Skate, jitter};
use crate::rig::SkeletonMap;
use crate::{smpl, synth};

fn lock_by(clip: &Clip, map: &SkeletonMap, floor_m: f64, fixed: FixedParts) -> Result<(Clip, FootLock)> {
    lock(clip, &Humanoid::with_map(clip.skeleton(), map), floor_m, fixed)
}

fn map() -> SkeletonMap {
    SkeletonMap::builtin("smpl").unwrap()
}

/// A synthetic dance on a floor at y = 0.
fn dance(seed: u64) -> Clip {
    let clip = synth::corpus(seed, 1, 8.0, 30.0).unwrap().remove(0).clip;
    assert_eq!(clip.joints(), 24);
    let feet = Humanoid::with_map(clip.skeleton(), &map()).feet().unwrap();
    let floor = feet.floor(&clip).found_m;
    clip.raised(-floor)
}

/// The same dance, sliding and floating.
fn spoiled(clip: &Clip) -> Clip {
    let moved = clip.root().iter().enumerate().map(|(f, p)| {
        let t = f as f64 / clip.fps();
        *p + Vec3::new(0.12 * (1.3 * t).sin(), 0.09 + 0.02 * t.sin(), 0.12 * t)
    });
    Clip::new(clip.skeleton().clone(), clip.fps(), moved.collect(), clip.rotations().to_vec()).unwrap()
}

fn skate(clip: &Clip) -> f64 {
    Skate::of(&Humanoid::with_map(clip.skeleton(), &map()).feet().unwrap(), clip).cm_s().unwrap()
}

fn ground(clip: &Clip) -> Ground {
    let feet = Humanoid::with_map(clip.skeleton(), &map()).feet().unwrap();
    let pelvis: Vec<f64> = clip.root().iter().map(|p| p.y).collect();
    Ground::of(&feet.clearance(clip), &pelvis, clip.fps())
}

#[test]
fn a_dance_that_slides_and_hangs_stands() {
    for seed in 1..6 {
        let clip = dance(seed);
        let bad = spoiled(&clip);
        let (done, locked) = lock_by(&bad, &map(), 0.0, FixedParts::default()).unwrap();
        assert!(locked.locked.len() >= 2, "{locked:?}");
        assert!(ground(&bad).floating_share().unwrap() > 0.5);
        assert!(ground(&done).floating_share().unwrap() < 0.05, "{:?}", ground(&done));
        assert!(ground(&done).penetration_share().unwrap() < 0.02, "{:?}", ground(&done));
        let settled = bad.clone().raised(-0.09);
        assert!(skate(&done) < 0.5 * skate(&settled), "{} of {}", skate(&done), skate(&settled));
        assert!(jitter(&done).unwrap() < jitter(&bad).unwrap() + 15.0);
        // locked feet keep their position
        let positions = done.positions();
        for contact in &locked.locked {
            for f in contact.frames() {
                let p = positions[f * 24 + contact.point];
                let distance = (p.x - contact.place[0]).hypot(p.z - contact.place[1]);
                assert!(distance < REACH_M + 1e-9, "{distance}");
            }
        }
        // only hips, knees and ankles change, and feet rotate only by their pitch correction
        for f in 0..done.frames() {
            let (a, b) = (bad.global_pose(f), done.global_pose(f));
            for j in 0..24 {
                let same = done.pose(f)[j].angle_between(bad.pose(f)[j]) < 1e-6;
                assert!(same || [1, 2, 4, 5, 7, 8].contains(&j), "joint {j} of frame {f}");
            }
            for (ankle, ball) in [(7, 10), (8, 11)] {
                let turned = b.rotations[ankle] * a.rotations[ankle].conjugate();
                assert!(turned.angle_between(Quat::IDENTITY) < 0.5 + 1e-6);
                assert!(turned.to_scaled_axis().y.abs() < 1e-6, "about what lies level");
                assert!((b.rotations[ball] * a.rotations[ball].conjugate()).angle_between(turned) < 1e-6);
            }
        }
    }
}

#[test]
fn what_is_given_is_not_touched() {
    let bad = spoiled(&dance(2));
    let (done, locked) =
        lock_by(&bad, &map(), 0.0, FixedParts { root: true, path: false, legs: [false, true], frames: 0 }).unwrap();
    assert_eq!((done.root(), locked.settled_cm), (bad.root(), 0.0));
    assert!(locked.locked.iter().all(|c| c.side == 0));
    for f in 0..done.frames() {
        for j in [0, 2, 5, 8, 11] {
            assert_eq!(done.pose(f)[j], bad.pose(f)[j]);
        }
    }
    let (same, locked) =
        lock_by(&bad, &map(), 0.0, FixedParts { root: true, path: false, legs: [true, true], frames: 0 }).unwrap();
    assert_eq!((&same, locked), (&bad, FootLock::default()));
}

#[test]
fn where_the_root_is_given_legs_come_down_to_the_floor() {
    for seed in 1..4 {
        let bad = dance(seed).raised(0.05);
        let fixed = FixedParts { root: true, ..FixedParts::default() };
        let (done, locked) = lock_by(&bad, &map(), 0.0, fixed).unwrap();
        assert_eq!((done.root(), locked.settled_cm), (bad.root(), 0.0));
        let least = |clip: &Clip| {
            let mut least = Humanoid::with_map(clip.skeleton(), &map()).feet().unwrap().clearance(clip);
            least.sort_by(f64::total_cmp);
            least[least.len() / 2]
        };
        assert!(least(&bad) > 0.05 && least(&done) < 0.025, "{} {}", least(&bad), least(&done));
        // a sunken body is raised
        let (done, _) = lock_by(&dance(seed).raised(-0.05), &map(), 0.0, fixed).unwrap();
        assert!(ground(&done).penetration_share().unwrap() < 0.02, "{:?}", ground(&done));
        // the fixed leg may be the stance leg
        let one = FixedParts { root: true, legs: [true, false], ..FixedParts::default() };
        let (done, _) = lock_by(&bad, &map(), 0.0, one).unwrap();
        assert!((0..done.frames()).all(|f| [1, 4, 7].iter().all(|&j| done.pose(f)[j] == bad.pose(f)[j])));
    }
}

#[test]
fn feet_that_stand_lie_flat_and_who_stands_on_the_balls_goes_on() {
    let legs = Leg::of(&Humanoid::with_map(&smpl::neutral(), &map())).unwrap();
    let stands = |pitch: f64| {
        let mut local = vec![Quat::IDENTITY; 24];
        // knees slightly bent, so that heels can come down
        for (leg, [hip, knee, ankle]) in legs.iter().zip([[1, 4, 7], [2, 5, 8]]) {
            (local[hip], local[knee]) = (Quat::from_rotation_x(-0.3), Quat::from_rotation_x(0.6));
            local[ankle] = Quat::from_rotation_x(-0.3);
            let before = GlobalPose::new(&smpl::neutral(), Vec3::Y, &local);
            let foot = before.positions[leg.ball.unwrap()] - before.positions[ankle];
            let turn = flatten::toes_up(foot, pitch);
            let over = before.rotations[ankle] * local[ankle].conjugate();
            local[ankle] = over.conjugate() * turn * before.rotations[ankle];
        }
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y; 40], local.repeat(40)).unwrap();
        let least = Humanoid::with_map(&smpl::neutral(), &map()).feet().unwrap().clearance(&clip)[0];
        clip.raised(-least)
    };
    let pitch = |clip: &Clip, f: usize, leg: &Leg| {
        let sole = leg.sole(clip.skeleton(), &clip.global_pose(f)).unwrap();
        flatten::pitch(sole, flatten::flat_drop_m(leg).unwrap())
    };
    for (before, after) in [(0.0, 0.0), (0.04, 0.04), (-0.2, -0.05), (0.25, 0.05), (-0.6, -0.3), (0.9, 0.9)] {
        let clip = stands(before);
        let (done, locked) = lock_by(&clip, &map(), 0.0, FixedParts::default()).unwrap();
        assert_eq!(locked.locked.len(), 2);
        for leg in &legs {
            assert!((pitch(&clip, 20, leg) - before).abs() < 1e-6);
            assert!((pitch(&done, 20, leg) - after).abs() < 1e-6, "{before}: {}", pitch(&done, 20, leg));
        }
        assert!(ground(&done).penetration_cm().unwrap() < 1e-6, "{before}: {:?}", ground(&done));
        // given frames keep their feet, and the frames after them continue
        let given = FixedParts { frames: 10, ..FixedParts::default() };
        let (done, _) = lock_by(&clip, &map(), 0.0, given).unwrap();
        assert!((pitch(&done, 12, &legs[0]) - before).abs() < 1e-6, "{before}: {}", pitch(&done, 12, &legs[0]));
    }
}

#[test]
fn feet_that_tremble_do_not_shake_the_body() {
    // hips that alternate by a degree in every frame, as decoded codes do
    let still = dance(3).slice(0..1);
    let feet = Humanoid::with_map(still.skeleton(), &map()).feet().unwrap();
    let mut rotations = vec![Quat::IDENTITY; 24 * 80];
    for (f, pose) in rotations.chunks_mut(24).enumerate() {
        let turn = if f % 2 == 0 { 0.01 } else { -0.01 };
        (pose[1], pose[2]) = (Quat::from_rotation_x(turn), Quat::from_rotation_x(turn));
    }
    let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y * feet.pelvis_m; 80], rotations).unwrap();
    let (done, _) = lock_by(&clip, &map(), 0.0, FixedParts::default()).unwrap();
    let jerk = |f: usize| {
        let at = |f: usize| done.root()[f];
        ((at(f + 3) - at(f)) - (at(f + 2) - at(f + 1)) * 3.0).length() * 8000.0
    };
    let furthest = (0..77).map(jerk).fold(0.0, f64::max);
    // averaging over three frames only gives 183 m/s^3
    assert!(furthest < 100.0, "{furthest}");
}

#[test]
fn a_path_that_is_fixed_goes_where_it_goes_and_the_body_still_comes_to_its_floor() {
    let clip = spoiled(&dance(5));
    let (held, locked) = lock_by(&clip, &map(), 0.0, FixedParts { path: true, ..FixedParts::default() }).unwrap();
    assert!(locked.carried_cm == 0.0 && locked.settled_cm > 5.0, "{locked:?}");
    assert!(clip.root().iter().zip(held.root()).all(|(a, b)| (a.x, a.z) == (b.x, b.z)));
}

#[test]
fn a_statue_and_a_frame_stay_as_they_are() {
    let standing = |frames: usize, up: f64| {
        let feet = Humanoid::with_map(&smpl::neutral(), &map()).feet().unwrap();
        let root = vec![Vec3::Y * (feet.pelvis_m + up); frames];
        Clip::new(smpl::neutral(), 20.0, root, vec![Quat::IDENTITY; 24 * frames]).unwrap()
    };
    for frames in [0, 1, 40] {
        let clip = standing(frames, 0.0);
        let (done, _) = lock_by(&clip, &map(), 0.0, FixedParts::default()).unwrap();
        for (a, b) in done.positions().iter().zip(clip.positions()) {
            assert!((*a - b).length() < 1e-9, "{frames} frames");
        }
    }
    // straight legs under a body that is too high within the tolerance: the feet are put down
    let (done, _) = lock_by(&standing(40, 0.015), &map(), 0.0, FixedParts::default()).unwrap();
    assert!(ground(&done).penetration_share() == Some(0.0));
    assert!(done.positions().chunks(24).all(|p| (p[7].y - 0.06).abs() < 0.02));
}

#[test]
fn a_leg_bends_to_a_place_and_says_what_is_too_far() {
    let legs = Leg::of(&Humanoid::with_map(&smpl::neutral(), &map())).unwrap();
    let clip = dance(4);
    for f in (0..clip.frames()).step_by(7) {
        for leg in &legs {
            for offset in [Vec3::new(0.05, 0.03, -0.04), Vec3::new(-0.1, 0.1, 0.0), Vec3::new(0.0, 0.2, 0.1)] {
                let before = clip.global_pose(f);
                let mut local = clip.pose(f).to_vec();
                let far = leg.bend(clip.skeleton(), &before, offset, Quat::IDENTITY, &mut local);
                let after = GlobalPose::new(clip.skeleton(), clip.root()[f], &local);
                let distance = (after.positions[leg.ankle] - before.positions[leg.ankle] - offset).length();
                assert!((distance - far).abs() < 1e-6, "{distance} {far}");
                assert!(after.rotations[leg.ankle].angle_between(before.rotations[leg.ankle]) < 1e-6);
            }
        }
    }
    // a metre down is out of reach
    let mut local = clip.pose(0).to_vec();
    let far = legs[0].bend(clip.skeleton(), &clip.global_pose(0), -Vec3::Y, Quat::IDENTITY, &mut local);
    assert!(far > 0.5, "{far}");
}

#[test]
fn what_is_behind_given_frames_begins_where_they_end() {
    let bad = spoiled(&dance(2));
    let given = 60;
    let (done, _) = lock_by(&bad, &map(), 0.0, FixedParts { frames: given, ..FixedParts::default() }).unwrap();
    assert_eq!(done.slice(0..given), bad.slice(0..given));
    let (positions, before) = (done.positions(), bad.positions());
    let speed = |all: &[Vec3], f: usize, j: usize| (all[(f + 1) * 24 + j] - all[f * 24 + j]).length() * done.fps();
    for f in given - 1..given + 30 {
        for j in [0, 7, 8] {
            assert!(speed(&positions, f, j) < speed(&before, f, j) + 1.0, "joint {j} of frame {f}");
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
        let (done, locked) = lock_by(&clip, &map(), 0.0, FixedParts::default()).unwrap();
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
