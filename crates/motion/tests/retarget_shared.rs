//! Retargeting of recorded motion: bone directions agree, nothing jumps, bodies stand, and the inverse is exact.

use kinelm_motion::convert::{self, TargetRig};
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::mirror::{self, Mirror};
use kinelm_motion::retarget::Retarget;
use kinelm_motion::rig::{Humanoid, map_for};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, Motion, Skeleton, Vec3, smpl};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Limb bones, by SMPL ids.
const LIMBS: [(usize, usize); 8] = [(1, 4), (2, 5), (4, 7), (5, 8), (16, 18), (17, 19), (18, 20), (19, 21)];

/// Tolerance in degrees. Retargeting is exact, so the tests use the rounding error.
const MEAN_LIMB_ERROR_DEG: f64 = 1e-5;

/// Whether all frames of all files are tested.
fn all() -> bool {
    std::env::var_os("KINELM_ALL_SHARED_FILES").is_some()
}

/// Every `nth` clip of a set, in path order.
fn clips(set: &str, test: &str, nth: usize) -> Vec<PathBuf> {
    let Some(folder) = kinelm_shared_data::set(set, test) else { return Vec::new() };
    let mut found = Vec::new();
    let mut folders = vec![folder];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "bvh") {
                found.push(path);
            }
        }
    }
    found.sort();
    found.into_iter().step_by(if all() { 1 } else { nth }).collect()
}

/// A file of a set; CMU dances without the first ten frames, in which they settle.
fn read(path: &Path) -> Motion {
    let skip = if path.to_string_lossy().contains("cmu-dance") { 10 } else { 0 };
    format::read(path, &ReadOptions { skip, ..Default::default() }).unwrap()
}

fn retarget(motion: &Motion) -> Retarget {
    let rig = motion.clip.skeleton();
    Retarget::new(&Humanoid::with_map(rig, &map_for(rig, None).unwrap()), smpl::neutral()).unwrap()
}

/// Every `nth` frame, for tests of single frames.
fn thin(clip: &Clip, nth: usize) -> Clip {
    let kept = || (0..clip.frames()).step_by(if all() { 1 } else { nth });
    let root = kept().map(|f| clip.root()[f]).collect();
    Clip::new(clip.skeleton().clone(), clip.fps(), root, kept().flat_map(|f| clip.pose(f).to_vec()).collect()).unwrap()
}

/// Angle between directions, radians, accurate at small angles.
fn between(a: Vec3, b: Vec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// Sum and count of the angles between a rig's limb bones and their images, radians.
fn limb_errors(retarget: &Retarget, on_rig: &Clip, on_smpl: &Clip) -> (f64, usize) {
    let (mut sum, mut n) = (0.0, 0);
    for f in 0..on_rig.frames() {
        let (a, b) = (on_rig.global_pose(f).positions, on_smpl.global_pose(f).positions);
        for (upper, lower) in LIMBS {
            let bone = a[retarget.joint(lower).unwrap()] - a[retarget.joint(upper).unwrap()];
            sum += between(bone, b[lower] - b[upper]);
            n += 1;
        }
    }
    (sum, n)
}

fn check_limbs(paths: &[PathBuf], nth_frame: usize) {
    let (mut there, mut back, mut n) = (0.0, 0.0, 0);
    for path in paths {
        let motion = read(path);
        let retarget = retarget(&motion);
        let clip = thin(&motion.clip, nth_frame);
        let on_smpl = retarget.to_smpl(&clip).unwrap();
        let (sum, count) = limb_errors(&retarget, &clip, &on_smpl);
        there += sum;
        n += count;
        back += limb_errors(&retarget, &retarget.to_rig(&on_smpl).unwrap(), &on_smpl).0;
        // the rig has all joints that move in these files, so its motion is recovered entirely
        let again = retarget.to_rig_over(&on_smpl, Some(&clip)).unwrap();
        for (a, b) in clip.positions().iter().zip(again.positions()) {
            assert!((*a - b).length() < 1e-9, "{}: {a} came back as {b}", path.display());
        }
    }
    if n == 0 {
        return;
    }
    let [there, back] = [there, back].map(|sum| (sum / n as f64).to_degrees());
    println!("{} clips, {n} bones: mean limb error {there:.2e} degrees, on the retarget back {back:.2e}", paths.len());
    assert!(there < MEAN_LIMB_ERROR_DEG && back < MEAN_LIMB_ERROR_DEG, "{there} {back}");
}

#[test]
fn limb_bones_point_alike() {
    check_limbs(&clips("cmu-dance", "limb_bones_point_alike", 1), 20);
    check_limbs(&clips("bandai-1", "limb_bones_point_alike", 10), 5);
    check_limbs(&clips("bandai-2", "limb_bones_point_alike", 60), 5);
}

/// No SMPL joint rotates more in a frame than the rig's joints between its parent's counterpart and its own.
fn check_steps(path: &Path) {
    let motion = read(path);
    let retarget = retarget(&motion);
    let clip = motion.clip.slice(0..motion.clip.frames().min(if all() { usize::MAX } else { 200 }));
    let image = retarget.to_smpl(&clip).unwrap();
    let rig = retarget.rig();
    // the joints whose local rotations make up the rotation of `j` relative to its ancestor `above`
    let between = |j: usize, above: Option<usize>| {
        std::iter::successors(Some(j), |&j| rig.parents()[j]).take_while(move |&j| Some(j) != above)
    };
    for id in 0..24 {
        let Some(joint) = retarget.joint(id) else { continue };
        let above = |id: usize| usize::try_from(smpl::PARENTS[id]).ok();
        let parent = std::iter::successors(above(id), |&p| above(p)).find_map(|p| retarget.joint(p));
        for f in 1..clip.frames() {
            let allowed: f64 =
                between(joint, parent).map(|j| angle_between(clip.pose(f - 1)[j], clip.pose(f)[j])).sum();
            let step = angle_between(image.pose(f - 1)[id], image.pose(f)[id]);
            let (name, path) = (smpl::NAMES[id], path.display());
            assert!(step < allowed + 1e-9, "{path}: {name} turns by {step} in frame {f}, the rig by {allowed}");
        }
    }
}

#[test]
fn nothing_jumps_that_did_not() {
    let test = "nothing_jumps_that_did_not";
    for (set, nth) in [("cmu-dance", 4), ("bandai-1", 20), ("bandai-2", 150)] {
        clips(set, test, nth).iter().for_each(|path| check_steps(path));
    }
}

/// Heading of hips and shoulders, radians; `None` if they are vertical.
fn heading([left_hip, right_hip, left_shoulder, right_shoulder]: [Vec3; 4]) -> Option<f64> {
    let forward = (left_hip - right_hip + left_shoulder - right_shoulder).cross(Vec3::Y);
    (forward.length() > 0.1).then(|| forward.x.atan2(forward.z))
}

/// Bodies stay plausible: same heading, knees and elbows bend the right way, same head height.
fn check_stand(path: &Path) {
    let motion = read(path);
    let retarget = retarget(&motion);
    let clip = thin(&motion.clip, 10);
    let image = retarget.to_smpl(&clip).unwrap();
    let file = path.display();
    let (mut bends, mut turned, mut n) = ([0.0; 4], 0.0, 0);
    for f in 0..clip.frames() {
        let (a, b) = (clip.global_pose(f).positions, image.global_pose(f).positions);
        let on_rig = |id: usize| a[retarget.joint(id).unwrap()];
        let ids = [1, 2, 16, 17];
        if let (Some(a), Some(b)) = (heading(ids.map(on_rig)), heading(ids.map(|id| b[id]))) {
            turned += angle_between(about_y(a), about_y(b));
            n += 1;
        }
        // about the hinge's own axis a knee bends backward (+x), a left elbow forward (-y), a right one (+y)
        let vector = |id: usize| kinelm_motion::rotation::exp_map::to_vector(image.pose(f)[id]);
        let bend = [vector(4).x, vector(5).x, -vector(18).y, vector(19).y];
        bends = std::array::from_fn(|k| bends[k] + bend[k] / clip.frames() as f64);
        let (rise, height) = (b[15].y - b[0].y, (on_rig(15).y - on_rig(0).y) * retarget.scale());
        assert!((rise - height).abs() < 0.2, "{file}: the head rises {rise} m in frame {f}, {height} m on the rig");
    }
    assert!(n == 0 || (turned / n as f64).to_degrees() < 5.0, "{file}: turned by {turned} over {n} frames");
    // some actors overextend a knee by up to 4 degrees
    assert!(bends.iter().all(|&b| b > -0.1), "{file}: knees and elbows bend by {bends:?} on the mean");
}

fn about_y(angle: f64) -> kinelm_motion::Quat {
    kinelm_motion::Quat::from_rotation_y(angle)
}

#[test]
fn people_stay_people() {
    let test = "people_stay_people";
    for (set, nth) in [("cmu-dance", 4), ("bandai-1", 10), ("bandai-2", 60)] {
        clips(set, test, nth).iter().for_each(|path| check_stand(path));
    }
}

#[test]
fn a_dance_survives_a_file_on_its_own_rig() {
    let test = "a_dance_survives_a_file_on_its_own_rig";
    let folder = tempfile::tempdir().unwrap();
    for (set, nth) in [("cmu-dance", 14), ("bandai-1", 60), ("bandai-2", 600)] {
        for path in clips(set, test, nth) {
            let motion = read(&path);
            let retarget = retarget(&motion);
            let x = retarget.to_smpl(&motion.clip.slice(0..motion.clip.frames().min(60))).unwrap();
            // other arms than the file's, as in a generated dance
            let mixed = mirror::mirror(&x).unwrap();
            let file = folder.path().join("out.bvh");
            let out = motion.clone().with_clip(retarget.to_rig(&mixed).unwrap());
            format::write(&file, &out).unwrap();
            // the same retargeting, because a written file doesn't give its floor to the last digit
            let again = retarget.to_smpl(&format::read(&file, &ReadOptions::default()).unwrap().clip).unwrap();
            assert_eq!(again.frames(), mixed.frames());
            for f in 0..mixed.frames() {
                // six decimals of a degree, summed over the chain of joints
                assert!((again.root()[f] - mixed.root()[f]).length() < 1e-6, "{}", path.display());
                for id in 0..24 {
                    let off = angle_between(again.pose(f)[id], mixed.pose(f)[id]);
                    assert!(off < 1e-6, "{}: {} is off by {off}", path.display(), smpl::NAMES[id]);
                }
            }
        }
    }
}

/// Mirroring on a rig: exact if both sides are equally long, else within their difference; and consistent with mirroring
/// on the SMPL body.
#[test]
fn rigs_are_mirrored_through_their_reference_pose() {
    let test = "rigs_are_mirrored_through_their_reference_pose";
    // the Bandai actors' right shins are up to 0.5 mm off the left ones'
    for (set, nth, bound_m, bound_rad) in
        [("cmu-dance", 14, 1e-5, 1e-9), ("bandai-1", 20, 2e-3, 5e-3), ("bandai-2", 200, 2e-3, 5e-3)]
    {
        for path in clips(set, test, nth) {
            let motion = read(&path);
            let retarget = retarget(&motion);
            let clip = thin(&motion.clip, 20);
            let mirror =
                Mirror::new(&Humanoid::with_map(clip.skeleton(), &map_for(clip.skeleton(), None).unwrap())).unwrap();
            let once = mirror.apply(&clip).unwrap();
            let joints = clip.joints();
            let (a, b) = (clip.positions(), once.positions());
            let mut distance: f64 = 0.0;
            // all but the head, which is 2.4 mm beside the CMU dances' neck
            for (id, joint) in (0..24).filter(|&id| id != 15).filter_map(|id| Some((id, retarget.joint(id)?))) {
                assert_eq!(mirror.partner(joint), retarget.joint(smpl::MIRROR[id]));
                let partner = retarget.joint(smpl::MIRROR[id]).unwrap();
                for f in (0..a.len()).step_by(joints) {
                    let image = a[f + partner];
                    distance = distance.max((b[f + joint] - Vec3::new(-image.x, image.y, image.z)).length());
                }
            }
            assert!(distance < bound_m, "{}: the image is {distance} m off", path.display());
            let images = [mirror::mirror(&retarget.to_smpl(&clip).unwrap()).unwrap(), retarget.to_smpl(&once).unwrap()];
            let off = images[0].rotations().iter().zip(images[1].rotations()).map(|(a, b)| angle_between(*a, *b));
            let off = off.fold(0.0, f64::max);
            assert!(off < bound_rad, "{}: SMPL's mirror image is {off} off", path.display());
        }
    }
}

/// 5th and 50th percentile of the clearance of ankles and balls, which SMPL has too, above the floor, metres.
fn heights(clip: &Clip, map: Option<&str>, floor_m: f64) -> [f64; 2] {
    let mut feet = Humanoid::with_map(clip.skeleton(), &map_for(clip.skeleton(), map).unwrap()).feet().unwrap();
    feet.toes.clear();
    let mut least = feet.clearance(clip);
    least.sort_by(f64::total_cmp);
    [0.05, 0.5].map(|q| least[((least.len() - 1) as f64 * q).round() as usize] - floor_m)
}

#[test]
fn feet_stay_on_the_ground_from_and_to_every_rig() {
    let test = "feet_stay_on_the_ground_from_and_to_every_rig";
    let sets = [("cmu-dance", 9), ("bandai-1", 45), ("bandai-2", 300)];
    let paths: Vec<_> = sets.into_iter().flat_map(|(set, nth)| clips(set, test, nth)).collect();
    let first = |set: &str| {
        paths.iter().find(|p| p.to_string_lossy().contains(set)).map(|p| TargetRig::of_motion(read(p)).unwrap())
    };
    let mut rigs: Vec<TargetRig> = sets.iter().filter_map(|(set, _)| first(set)).collect();
    rigs.push(TargetRig::Smpl(smpl::neutral()));
    let mut tall = smpl::neutral().offsets().to_vec();
    // another body: longer shins, lower ankles, lower hips
    for (joint, times) in [(4, 1.2), (5, 1.2), (7, 1.3), (8, 1.3), (10, 0.7), (11, 0.7), (1, 1.4), (2, 1.4)] {
        tall[joint] *= times;
    }
    let body = smpl::neutral();
    rigs.push(TargetRig::Smpl(Arc::new(
        Skeleton::new(body.names().to_vec(), body.parents().to_vec(), tall, vec![]).unwrap(),
    )));
    let mut worst: f64 = 0.0;
    for path in &paths {
        let motion = read(path);
        let thin = thin(&motion.clip, 10);
        let motion = motion.with_clip(thin);
        let floor_m = format::floor_height(&motion).unwrap();
        let before = heights(&motion.clip, None, floor_m);
        for (i, rig) in rigs.iter().enumerate() {
            let on = convert::on_rig(motion.clone(), rig).unwrap();
            let after = heights(&on.clip, None, floor_m);
            let moved = (0..2).map(|q| (after[q] - before[q]).abs()).fold(0.0, f64::max);
            assert!(moved <= 0.03, "{} on rig {i}: {before:?} m above the floor became {after:?}", path.display());
            worst = worst.max(moved);
            // and back: the floor is known from before
            assert_eq!(format::floor_height(&on).unwrap(), floor_m);
            let back = convert::on_rig(on, &TargetRig::of_motion(motion.clone()).unwrap()).unwrap();
            let pelvis = retarget(&motion).joint(0).unwrap();
            let joints = motion.clip.joints();
            for (a, b) in motion.clip.positions().chunks(joints).zip(back.clip.positions().chunks(joints)) {
                assert!(
                    a[pelvis].distance(b[pelvis]) < 1e-4,
                    "{} by rig {i}: {} {}",
                    path.display(),
                    a[pelvis],
                    b[pelvis]
                );
            }
        }
    }
    println!("{} clips, {} rigs: the feet move by at most {:.1} cm", paths.len(), rigs.len(), 100.0 * worst);
}
