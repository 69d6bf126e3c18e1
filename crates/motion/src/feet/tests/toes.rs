//! Rigs whose feet reach beyond their ankles and balls, and how the work grows with a clip.

use super::*;
use crate::pose::tests::COMPUTED;
use crate::rig::Humanoid;
use crate::{EndSite, Skeleton};
use std::sync::Arc;

/// Where the toes of a rig end.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Toes {
    /// In the balls, which are end sites of the ankles.
    InsteadOfBalls,
    /// In end sites beyond the balls.
    BeyondBalls,
    /// In leaf joints beyond the balls.
    Joints,
    /// In the balls; the end sites below them are those that a written BVH needs.
    MadeUp,
}

const KINDS: [Toes; 3] = [Toes::InsteadOfBalls, Toes::BeyondBalls, Toes::Joints];
/// From ball to toe, level in a flat foot.
const BEYOND: Vec3 = Vec3::new(0.0, 0.0, 0.07);

/// A clip of the neutral body on a rig with such toes.
fn on_rig(clip: &Clip, toes: Toes) -> Clip {
    let body = clip.skeleton();
    let kept = |j: &usize| toes != Toes::InsteadOfBalls || ![10, 11].contains(j);
    let joints: Vec<usize> = (0..24).filter(kept).collect();
    let place = |j: usize| joints.iter().position(|k| *k == j);
    let mut names: Vec<String> = joints.iter().map(|&j| body.names()[j].clone()).collect();
    let mut parents: Vec<_> = joints.iter().map(|&j| body.parents()[j].and_then(place)).collect();
    let mut offsets: Vec<Vec3> = joints.iter().map(|&j| body.offsets()[j]).collect();
    let mut ends = Vec::new();
    for (ankle, ball) in [(7, 10), (8, 11)] {
        let end = |parent: Option<usize>, offset| EndSite { parent: parent.unwrap(), offset };
        match toes {
            Toes::InsteadOfBalls => ends.push(end(place(ankle), body.offsets()[ball])),
            Toes::BeyondBalls => ends.push(end(place(ball), BEYOND)),
            Toes::MadeUp => ends.push(end(place(ball), body.offsets()[ball] * crate::rig::MADE_UP_TIP)),
            Toes::Joints => {
                names.push(format!("toe {ball}"));
                parents.push(place(ball));
                offsets.push(BEYOND);
            }
        }
    }
    let more = names.len() - joints.len();
    let pose = |f: usize| joints.iter().map(move |&j| clip.pose(f)[j]).chain(std::iter::repeat_n(Quat::IDENTITY, more));
    let rotations = (0..clip.frames()).flat_map(pose).collect();
    let rig = Arc::new(Skeleton::new(names, parents, offsets, ends).unwrap());
    Clip::new(rig, clip.fps(), clip.root().to_vec(), rotations).unwrap()
}

/// The dance with its feet pitched up and down by up to 0.3 radians, as a model that knows no toes leaves them.
fn pitched(clip: &Clip) -> Clip {
    let mut rotations = clip.rotations().to_vec();
    for (f, pose) in rotations.chunks_mut(24).enumerate() {
        let t = f as f64 / clip.fps();
        pose[7] *= Quat::from_rotation_x(0.3 * (2.1 * t).sin());
        pose[8] *= Quat::from_rotation_x(0.3 * (1.7 * t).cos());
    }
    Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations).unwrap()
}

/// The lowest end of a toe in every frame.
fn lowest_toes(clip: &Clip) -> Vec<f64> {
    let feet = Humanoid::with_map(clip.skeleton(), &map()).feet().unwrap();
    assert_eq!(feet.toes.len(), 2, "{feet:?}");
    let lowest = |f: usize| {
        let pose = clip.global_pose(f);
        let heights = feet.toes.iter().map(|(toe, _)| pose.point(clip.skeleton(), *toe).y);
        heights.fold(f64::MAX, f64::min)
    };
    (0..clip.frames()).map(lowest).collect()
}

#[test]
fn ends_of_toes_stay_above_the_floor() {
    for (seed, kind) in [1, 2, 3].into_iter().flat_map(|seed| KINDS.map(|kind| (seed, kind))) {
        let clip = on_rig(&pitched(&dance(seed)), kind);
        let deep = |clip: &Clip| lowest_toes(clip).iter().filter(|y| **y < -0.02).count();
        assert!(deep(&clip) > clip.frames() / 20, "{kind:?}: {} of {}", deep(&clip), clip.frames());
        let free = FixedParts::default();
        for fixed in [free, FixedParts { root: true, ..free }] {
            let (done, locked) = lock_by(&clip, &map(), 0.0, fixed).unwrap();
            assert!(locked.locked.len() >= 2, "{locked:?}");
            assert_eq!(deep(&done), 0, "{kind:?}, seed {seed}, {fixed:?}");
            let [before, after] = [&clip, &done].map(|clip| jitter(clip).unwrap());
            assert!(after < before + 25.0, "{kind:?}, seed {seed}: {before} to {after}");
        }
    }
}

#[test]
fn toes_that_end_where_balls_would_be_are_locked_as_balls() {
    for seed in 1..4 {
        let bad = spoiled(&dance(seed));
        let (on_joints, _) = lock_by(&bad, &map(), 0.0, FixedParts::default()).unwrap();
        let (on_ends, locked) =
            lock_by(&on_rig(&bad, Toes::InsteadOfBalls), &map(), 0.0, FixedParts::default()).unwrap();
        assert!(locked.locked.iter().any(|contact| contact.point >= 22), "some toe is in contact: {locked:?}");
        // but for what balls may give
        let [a, b] = [on_joints, on_ends].map(|clip| clip.global_pose(clip.frames() / 2).positions[4]);
        assert!(a.distance(b) < 0.03, "{a} and {b}");
    }
}

#[test]
fn toes_in_the_floor_where_given_frames_end_do_not_jump_out() {
    let mut rotations = dance(2).rotations().to_vec();
    rotations.chunks_mut(24).for_each(|pose| [7, 8].iter().for_each(|&j| pose[j] *= Quat::from_rotation_x(0.35)));
    let plain = dance(2);
    let bad = Clip::new(plain.skeleton().clone(), plain.fps(), plain.root().to_vec(), rotations).unwrap();
    let (bad, given) = (on_rig(&bad, Toes::InsteadOfBalls), 60);
    assert!(lowest_toes(&bad)[..given].iter().any(|y| *y < -0.03));
    let (done, _) = lock_by(&bad, &map(), 0.0, FixedParts { frames: given, ..FixedParts::default() }).unwrap();
    assert_eq!(done.slice(0..given), bad.slice(0..given));
    let speed = |clip: &Clip, f: usize, j: usize| {
        let [a, b] = [f, f + 1].map(|f| clip.global_pose(f).positions[j]);
        a.distance(b) * clip.fps()
    };
    for (f, j) in (given - 1..given + 15).flat_map(|f| [(f, 7), (f, 8)]) {
        assert!(speed(&done, f, j) < speed(&bad, f, j) + 0.8, "joint {j} of frame {f}");
    }
    assert!(lowest_toes(&done)[given + 90..].iter().all(|y| *y > -0.02));
}

#[test]
fn tips_that_a_written_bvh_needs_change_nothing() {
    let bad = spoiled(&pitched(&dance(4)));
    let (plain, locked) = lock_by(&bad, &map(), 0.0, FixedParts::default()).unwrap();
    let (with_tips, also) = lock_by(&on_rig(&bad, Toes::MadeUp), &map(), 0.0, FixedParts::default()).unwrap();
    assert_eq!((plain.root(), plain.rotations(), locked), (with_tips.root(), with_tips.rotations(), also));
}

#[test]
fn ends_of_toes_are_measured_and_no_floor() {
    let clip = dance(2);
    for kind in [Toes::BeyondBalls, Toes::Joints] {
        let rig = on_rig(&clip, kind);
        let feet = Humanoid::with_map(rig.skeleton(), &map()).feet().unwrap();
        assert_eq!(
            Humanoid::with_map(rig.skeleton(), &map()).floor(&rig).unwrap(),
            Humanoid::with_map(clip.skeleton(), &map()).floor(&clip).unwrap(),
            "{kind:?}"
        );
        let toes = lowest_toes(&rig);
        assert!(feet.clearance(&rig).iter().zip(&toes).all(|(least, toe)| *least <= toe + 1e-12));
        assert!(feet.clearance(&rig) != Humanoid::with_map(clip.skeleton(), &map()).feet().unwrap().clearance(&clip));
        let mut joints_alone = feet.clone();
        joints_alone.toes.clear();
        assert!(Skate::of(&feet, &rig) != Skate::of(&joints_alone, &rig));
    }
}

#[test]
fn work_grows_with_the_length() {
    let short = spoiled(&pitched(&dance(3)));
    let repeated = |times: usize| {
        let (root, rotations) = (short.root().repeat(times), short.rotations().repeat(times));
        Clip::new(short.skeleton().clone(), short.fps(), root, rotations).unwrap()
    };
    let rigs: [fn(&Clip) -> Clip; 3] =
        [Clip::clone, |clip| on_rig(clip, Toes::InsteadOfBalls), |clip| on_rig(clip, Toes::BeyondBalls)];
    for on in rigs {
        let work = |times: usize| {
            let clip = on(&repeated(times));
            let before = COMPUTED.get();
            let (_, locked) = lock_by(&clip, &map(), 0.0, FixedParts::default()).unwrap();
            (COMPUTED.get() - before, locked.locked.len())
        };
        let ((once, contacts), (eight, more)) = (work(1), work(8));
        assert!(more > 6 * contacts, "{contacts} and {more} contacts");
        assert!(eight <= 10 * once, "{once} and {eight} poses");
    }
}
