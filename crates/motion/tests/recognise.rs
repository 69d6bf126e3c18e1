//! Rigs of many tools are recognised by their names, and by shape and movement where names say nothing.

mod rigs;

use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::joints::EIGHTEEN;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::{Retarget, to_smpl};
use kinelm_motion::rig::recognise::SURE;
use kinelm_motion::rig::{Humanoid, Recognised, SkeletonMap, find_map, recognise};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, GlobalPose, Motion, Skeleton, smpl, synth};
use rigs::{Tree, from_pose, random, tilted, turns, varied};

/// Pelvis, hips, knees, ankles, shoulders, elbows, wrists.
const LIMBS: [usize; 13] = [0, 1, 2, 4, 5, 7, 8, 16, 17, 18, 19, 20, 21];

/// A made-up dance on a body.
fn dance(body: &Skeleton) -> Clip {
    let clip = &synth::corpus(5, 1, 8.0, 10.0).unwrap()[0].clip;
    clip.clone().with_skeleton(body.clone().into()).unwrap()
}

/// Names that say nothing.
fn scrambled(rig: &Skeleton, random: &mut dyn FnMut() -> f64) -> Skeleton {
    let mut names: Vec<String> = (0..rig.joints()).map(|j| format!("b{j}")).collect();
    for i in (1..names.len()).rev() {
        names.swap(i, (random() * (i + 1) as f64) as usize);
    }
    Skeleton::new(names, rig.parents().to_vec(), rig.offsets().to_vec(), rig.ends().to_vec()).unwrap()
}

fn on(rig: &Skeleton, clip: &Clip) -> Clip {
    Clip::new(rig.clone().into(), clip.fps(), clip.root().to_vec(), clip.rotations().to_vec()).unwrap()
}

/// The SMPL joints among `ids` that the rig has and that were given to another joint, or to none.
fn wrong(tree: &Tree, found: &Recognised, ids: &[usize]) -> Vec<String> {
    let truth = tree.joints();
    let off = ids.iter().filter(|&&id| truth[id].is_some() && truth[id] != found.joints[id]);
    off.map(|&id| format!("{}: {}", smpl::NAMES[id], found.joints[id].map_or("none", |j| &tree.nodes[j].name)))
        .collect()
}

/// A rig's clip as commands have it: written as a BVH and read again, everything found out.
fn read(clip: Clip) -> Motion {
    let motion = Motion::new("a.bvh", clip);
    let bytes = format::to_bytes(&motion.path, &motion).unwrap();
    format::parse(&motion.path, &bytes, &ReadOptions::default()).unwrap()
}

#[test]
fn rigs_of_many_tools_are_known_by_their_names() {
    let (mut rigs, mut worst) = (0, 0.0f64);
    for tree in rigs::all() {
        let rig = tree.skeleton(&smpl::neutral());
        let found = recognise(&rig, None).unwrap_or_else(|| panic!("{} is not recognised", tree.rig));
        let all: Vec<usize> = (0..22).collect();
        assert_eq!(wrong(&tree, &found, &all).join(", "), "", "{}", tree.rig);
        assert!(found.is_sure(), "{}: {:?}", tree.rig, found.confidence);
        // built-in maps stand before recognition
        let motion = read(tree.dance(&rig, &dance(&smpl::neutral())));
        let found = find_map(&motion.clip, None).unwrap_or_else(|e| panic!("{}: {e}", tree.rig));
        let joints = tree.joints().map(|j| j.map(|j| tree.nodes[j].name.as_str()));
        for id in (0..22).filter(|&id| joints[id].is_some()) {
            assert_eq!(found.map.joint(id), joints[id], "{}: {}", tree.rig, smpl::NAMES[id]);
        }
        let fit = Humanoid::with_map(motion.clip.skeleton(), &found.map).fit(&motion.clip);
        worst = worst.max(fit.trunk_error_deg.unwrap_or(0.0));
        assert!(fit.stands.is_ok() && fit.toes_ahead.is_none_or(|toes| toes > 0.5), "{}: {fit:?}", tree.rig);
        rigs += 1;
    }
    println!("{rigs} rigs as commands read them: the trunk is off by at most {worst:.1} degrees in the mean");
    assert!(worst < 5.0, "{worst}");
}

/// Of rigs: how many were tried, used without asking, with all limb joints right, with all coded ones; of joints: how many
/// were sure, and wrong.
#[derive(Debug, Default)]
struct Counts {
    rigs: usize,
    used: usize,
    limbs: usize,
    coded: usize,
    sure: usize,
    sure_and_wrong: usize,
}

/// Rigs whose names say nothing, with varied bones and helpers, danced; three draws of each.
fn by_shape(trees: &[Tree]) -> Counts {
    let mut count = Counts::default();
    for tree in trees {
        for seed in 1..=3 {
            let mut random = random(seed);
            let tree = tree.with_helpers(&mut random);
            let body = varied(0.15, &mut random);
            let named = tree.skeleton(&body);
            let rig = scrambled(&named, &mut random);
            let clip = on(&rig, &tree.dance(&named, &dance(&body)));
            count.add(&tree, recognise(&rig, Some(&clip)).as_ref(), seed);
        }
    }
    println!("{count:?}");
    count
}

impl Counts {
    fn add(&mut self, tree: &Tree, found: Option<&Recognised>, seed: u64) {
        self.rigs += 1;
        let Some(found) = found else {
            println!("{} {seed}: not recognised", tree.rig);
            return;
        };
        self.limbs += usize::from(wrong(tree, found, &LIMBS).is_empty());
        let coded = wrong(tree, found, &EIGHTEEN);
        self.coded += usize::from(coded.is_empty());
        if !coded.is_empty() {
            println!("{} {seed}: {}", tree.rig, coded.join(", "));
        }
        self.used += usize::from(found.is_sure());
        if seed == 0 && !found.is_sure() {
            let doubtful = (0..24).filter(|&id| LIMBS.contains(&id) && found.confidence[id] < SURE);
            let doubtful: Vec<String> =
                doubtful.map(|id| format!("{} {:.2}", smpl::NAMES[id], found.confidence[id])).collect();
            println!("{}: doubtful: {}", tree.rig, doubtful.join(", "));
        }
        let truth = tree.joints();
        for id in (0..24).filter(|&id| found.confidence[id] >= SURE) {
            self.sure += 1;
            if truth[id].is_some() && found.joints[id] != truth[id] {
                self.sure_and_wrong += 1;
                println!("{} {seed}: sure of {}, wrongly", tree.rig, smpl::NAMES[id]);
            }
        }
    }
}

fn share(n: usize, of: usize) -> f64 {
    n as f64 / of as f64
}

#[test]
fn shape_and_movement_are_enough() {
    let count = by_shape(&rigs::all());
    assert!(share(count.limbs, count.rigs) >= 0.95 && share(count.coded, count.rigs) >= 0.9, "{count:?}");
    assert!(share(count.sure_and_wrong, count.sure) <= 0.01, "{count:?}");
}

#[test]
fn rigs_that_no_rule_was_made_for_are_recognised() {
    let trees = rigs::held_out();
    let mut named = Counts::default();
    for tree in &trees {
        named.add(tree, recognise(&tree.skeleton(&smpl::neutral()), None).as_ref(), 0);
    }
    println!("by names: {named:?}");
    let unnamed = by_shape(&trees);
    for count in [named, unnamed] {
        assert!(share(count.limbs, count.rigs) >= 0.9 && share(count.coded, count.rigs) >= 0.85, "{count:?}");
        assert!(share(count.sure_and_wrong, count.sure) <= 0.01, "{count:?}");
    }
}

/// Mean angles in degrees between what a clip on a rig becomes on SMPL and what it was there: of limb bones, of feet,
/// of the trunk. Hands are left out: how a palm faces at rest, a dance doesn't tell.
fn off(before: &Clip, rig: &Clip, map: &SkeletonMap) -> [f64; 3] {
    let after = Retarget::new(&Humanoid::with_map(rig.skeleton(), map), smpl::neutral()).unwrap().to_smpl(rig).unwrap();
    let mut sums = [[0.0; 2]; 3];
    for f in 0..before.frames() {
        let (a, b) = (before.global_pose(f), after.global_pose(f));
        let mut add = |kind: usize, angle: f64| {
            sums[kind][0] += angle.to_degrees();
            sums[kind][1] += 1.0;
        };
        for (from, to) in [(1, 4), (4, 7), (2, 5), (5, 8), (16, 18), (18, 20), (17, 19), (19, 21)] {
            let bone = |p: &GlobalPose| p.positions[to] - p.positions[from];
            add(0, bone(&a).angle_between(bone(&b)));
        }
        for id in [7, 8] {
            add(1, angle_between(a.rotations[id], b.rotations[id]));
        }
        for id in [0, 9] {
            add(2, angle_between(a.rotations[id], b.rotations[id]));
        }
    }
    sums.map(|[sum, n]| sum / n)
}

#[test]
fn rest_poses_of_any_kind_are_calibrated() {
    let Some(folder) = kinelm_shared_data::set("cmu-dance", "rest_poses_of_any_kind_are_calibrated") else { return };
    let body = smpl::neutral();
    let options = ReadOptions { skip: 10, fps_source: Some(60.0), ..Default::default() };
    let motion = format::read(&folder.join("salsa/03.bvh"), &options).unwrap();
    let whole = to_smpl(&motion).unwrap();
    let clip = resample(&whole.slice(0..whole.frames().min(900)), 10.0, Method::Smooth).unwrap();
    for tree in rigs::all().iter().filter(|t| ["lafan1", "vrm_humanoid", "ue4_mannequin"].contains(&t.rig.as_str())) {
        let rig = tree.skeleton(&body);
        let on_rig = tree.dance(&rig, &clip);
        let mut random = random(3);
        let turns = turns(rig.joints(), &mut random);
        for (what, moved, most) in [
            ("T", on_rig.clone(), 0.01),
            ("from frame 0", from_pose(&on_rig, 0), 8.0),
            ("from frame 33", from_pose(&on_rig, 33), 8.0),
            ("tilted frames", tilted(&on_rig, &turns), 8.0),
        ] {
            // lafan1's names are those of the built-in map mixamo, which has no reference pose
            for map in [recognise(moved.skeleton(), Some(&moved)).unwrap().map, find_map(&moved, None).unwrap().map] {
                let [limbs, feet, trunk] = off(&clip, &moved, &map);
                println!("{} {what}: limbs {limbs:.2}, feet {feet:.2}, trunk {trunk:.2} degrees", tree.rig);
                assert!(limbs < 0.01 && feet < most && trunk < most, "{} {what}: {limbs} {feet} {trunk}", tree.rig);
            }
        }
    }
}
