//! Detection of the floor below a clip.
//!
//! The floor is the 5th percentile over frames of the lowest height of ankles and balls above their standing heights. The
//! ends of toes don't count: an end site may be an exporter's guess, and the floor changes every height of a clip. Doubts
//! report clips that don't move on one flat floor.

use super::Feet;
use crate::series::linear_quantile as quantile;
use crate::{Clip, Vec3, Warning};

/// A joint other than the feet that is this far below the floor contradicts it, metres.
const BELOW_M: f64 = 0.1;
/// The fraction of frames above which that is a doubt.
const BELOW_SHARE: f64 = 0.02;
/// The median speed of feet on the floor is below this, metres per second.
const STANDING_M_S: f64 = 0.5;
/// The median height of the pelvis, as a fraction of its standing height, is in this range.
const PELVIS: std::ops::RangeInclusive<f64> = 0.5..=1.2;
/// A foot is near the floor below this height, metres; it should be in more than 10 % of the frames.
const NEAR_M: f64 = 0.1;
/// A shorter clip is too short for a floor, seconds.
const SHORT_S: f64 = 1.0;
/// A doubted floor within this fraction of the body's height from y = 0 is replaced by 0.
const PART_OF_BODY: f64 = 0.15;

/// The floor of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Floor {
    /// The floor to use: the detected one, or 0 if that is doubted and near 0; metres.
    pub height_m: f64,
    /// The detected floor, metres.
    pub found_m: f64,
    /// Doubts about the floor; empty if there are none.
    pub doubts: Vec<Warning>,
    /// A floor this near to y = 0 is replaced by it, metres: above 0 for a doubted one, and that of a single pose.
    near_m: f64,
}

impl Floor {
    /// The height that detection would give for the same clip lowered by `by_m` metres.
    pub fn height_when_lowered(&self, by_m: f64) -> f64 {
        let found_m = self.found_m - by_m;
        if found_m.abs() <= self.near_m { 0.0 } else { found_m }
    }
}

impl Feet {
    /// The floor of a clip on this rig, in the world of its file.
    ///
    /// The detected floor is the 5th percentile over frames of the lowest height of ankles and balls above their standing
    /// heights. It is doubted when another joint is more than 10 cm below it in over 2 % of the frames (a handstand); when the
    /// lowest foot moves faster than 0.5 m/s in the median of the lowest 10 % of the frames (skating, swimming); when the
    /// median pelvis is outside 0.5 to 1.2 of its standing height (sitting, hanging); when a foot is within 10 cm of the floor
    /// in under 10 % of the frames (stairs); or when the clip is shorter than 1 s, unless it is a single pose. A doubted floor,
    /// or that of a single pose, within 15 % of the body's height from y = 0 is replaced by 0.
    ///
    /// # Panics
    /// If the clip is not on this rig.
    pub fn floor(&self, clip: &Clip) -> Floor {
        let positions = clip.positions();
        let lowest = self.lowest(&positions);
        // a low percentile, not the minimum: one frame of noise below the floor would move every height of the clip
        let found_m = quantile(lowest.iter().map(|l| l.0).collect(), 0.05);
        let mut doubts = Vec::new();
        let mut doubt = |kind, what: Option<String>| doubts.extend(what.map(|what| Warning { kind, what }));
        doubt("floor_below", self.others_below(clip, &positions, found_m));
        doubt("floor_slides", slides(clip, &positions, &lowest));
        doubt("floor_pelvis", self.pelvis_off(clip, &positions, found_m));
        doubt("floor_far", far(&lowest, found_m));
        let seconds = clip.duration_s();
        // a single pose is no motion and shows no floor, but nothing about it is odd: it lends its rig
        let is_pose = clip.frames() == 1;
        let is_short = !is_pose && seconds < SHORT_S;
        doubt("floor_short", is_short.then(|| format!("the clip has {seconds:.2} s, under {SHORT_S} s")));
        let is_sure = doubts.is_empty() && !is_pose;
        let near_m = if is_sure { 0.0 } else { PART_OF_BODY * self.body_m };
        let height_m = if found_m.abs() <= near_m { 0.0 } else { found_m };
        let found = format!("the floor by the feet is at y = {found_m:.2} m");
        let taken = if height_m == found_m { "taken all the same" } else { "0 is taken" };
        for doubt in &mut doubts {
            doubt.what = format!("{found}, but {}; {taken}; give `floor` if it is elsewhere", doubt.what);
        }
        Floor { height_m, found_m, doubts, near_m }
    }

    fn others_below(&self, clip: &Clip, positions: &[Vec3], floor_m: f64) -> Option<String> {
        let j = clip.joints();
        let deepest = |frame: &[Vec3]| {
            let others = frame.iter().enumerate().filter(|(joint, _)| !self.of_foot[*joint]);
            others.map(|(joint, p)| (p.y, joint)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::MAX, 0))
        };
        let below: Vec<_> = positions.chunks_exact(j).map(deepest).filter(|(y, _)| *y < floor_m - BELOW_M).collect();
        // also the way out of a clip without frames: 0 <= 0, before the division below
        if below.len() as f64 <= BELOW_SHARE * clip.frames() as f64 {
            return None;
        }
        let (y, joint) = below.iter().copied().min_by(|a, b| a.0.total_cmp(&b.0))?;
        let percent = 100.0 * below.len() as f64 / clip.frames() as f64;
        let (name, depth) = (&clip.skeleton().names()[joint], floor_m - y);
        Some(format!(
            "{name} goes {depth:.2} m below it, and joints are over {BELOW_M} m below in {percent:.0} % of frames"
        ))
    }

    fn pelvis_off(&self, clip: &Clip, positions: &[Vec3], floor_m: f64) -> Option<String> {
        if clip.frames() == 0 {
            return None;
        }
        let heights = positions.chunks_exact(clip.joints()).map(|frame| frame[self.pelvis].y - floor_m).collect();
        let (median, standing) = (quantile(heights, 0.5), self.pelvis_m);
        (!PELVIS.contains(&(median / standing)))
            .then(|| format!("the pelvis is {median:.2} m above it in the median; this body stands at {standing:.2} m"))
    }
}

fn slides(clip: &Clip, positions: &[Vec3], lowest: &[(f64, usize)]) -> Option<String> {
    let frames = clip.frames();
    if frames < 2 {
        return None;
    }
    let mut order: Vec<usize> = (0..frames).collect();
    order.sort_by(|&a, &b| lowest[a].0.total_cmp(&lowest[b].0));
    // rounded up, so that a clip of two frames has one to measure
    order.truncate(frames.div_ceil(10));
    let speed = |f: usize| {
        // central difference, one-sided at the ends; with two frames or more, after > before
        let (joint, before, after) = (lowest[f].1, f.saturating_sub(1), (f + 1).min(frames - 1));
        let at = |f: usize| positions[f * clip.joints() + joint];
        at(before).distance(at(after)) / (after - before) as f64 * clip.fps()
    };
    let median = quantile(order.into_iter().map(speed).collect(), 0.5);
    (median > STANDING_M_S)
        .then(|| format!("the feet move at {median:.2} m/s in the lowest tenth of frames; feet that stand do not"))
}

fn far(lowest: &[(f64, usize)], floor_m: f64) -> Option<String> {
    let near = lowest.iter().filter(|(least, _)| least - floor_m < NEAR_M).count();
    (10 * near < lowest.len()).then(|| {
        let percent = 100.0 * near as f64 / lowest.len() as f64;
        format!("a foot is within {NEAR_M} m of it in {percent:.0} % of frames only")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{self, ReadOptions};
    use crate::rig::{Humanoid, SkeletonMap};
    use crate::{Motion, Quat, Skeleton, smpl, synth};
    use std::f64::consts::FRAC_PI_2;
    use std::sync::Arc;

    const FPS: f64 = 60.0;

    fn smpl_map() -> SkeletonMap {
        SkeletonMap::builtin("smpl").unwrap()
    }

    /// A pose with these local rotations, the other joints at rest.
    fn posed(turns: &[(usize, Quat)]) -> Vec<Quat> {
        let mut pose = vec![Quat::IDENTITY; 24];
        turns.iter().for_each(|&(j, q)| pose[j] = q);
        pose
    }

    fn flex(radians: f64) -> Quat {
        Quat::from_rotation_x(radians)
    }

    /// A clip of the neutral body in one pose, with the pelvis at `height(t)`.
    fn clip(seconds: f64, pose: &[Quat], height: impl Fn(f64) -> f64) -> Clip {
        let n = (seconds * FPS) as usize;
        let root = (0..n).map(|f| Vec3::new(0.0, height(f as f64 / FPS), 0.0)).collect();
        Clip::new(smpl::neutral(), FPS, root, pose.repeat(n)).unwrap()
    }

    fn kinds(floor: &Floor) -> Vec<&'static str> {
        floor.doubts.iter().map(|d| d.kind).collect()
    }

    fn resolve_floor(clip: &Clip) -> Floor {
        Humanoid::with_map(clip.skeleton(), &smpl_map()).floor(clip).unwrap()
    }

    fn near(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() <= tolerance
    }

    const STAND: f64 = smpl::STANDING_PELVIS_M;

    #[test]
    fn dances_stand_on_it_wherever_it_is() {
        for dance in synth::corpus(1, 12, 8.0, FPS).unwrap() {
            for at in [0.0, -0.3, 1.4] {
                let root = dance.clip.root().iter().map(|p| *p + Vec3::Y * at).collect();
                let moved = Clip::new(smpl::neutral(), FPS, root, dance.clip.rotations().to_vec()).unwrap();
                let floor = resolve_floor(&moved);
                assert!(near(floor.height_m, at, 0.01), "{} at {at}: {floor:?}", dance.name());
                assert!(floor.doubts.is_empty(), "{}: {floor:?}", dance.name());
            }
        }
    }

    #[test]
    fn jumps() {
        // in the air for 0.4 s of each second, 20 cm high
        let hop = |t: f64| {
            let air = (t.fract() / 0.4).min(1.0);
            0.5 + STAND + 4.0 * 0.2 * air * (1.0 - air)
        };
        let floor = resolve_floor(&clip(6.0, &posed(&[]), hop));
        assert!(near(floor.height_m, 0.5, 1e-9) && floor.doubts.is_empty(), "{floor:?}");
    }

    #[test]
    fn stairs() {
        let climb = |steps: f64| clip(20.0, &posed(&[]), move |t| 0.1 + STAND + 0.18 * (t / 20.0 * steps).floor());
        let floor = resolve_floor(&climb(3.0));
        assert!(near(floor.height_m, 0.1, 1e-9) && floor.doubts.is_empty(), "{floor:?}");
        // 16 steps: the body is on each for 6 % of the time, under the 10 % that a floor needs; y = 0 is used
        let floor = resolve_floor(&climb(16.0));
        assert_eq!(kinds(&floor), ["floor_pelvis", "floor_far"], "{floor:?}");
        assert!(near(floor.found_m, 0.1, 1e-9) && floor.height_m == 0.0, "{floor:?}");
        assert!(floor.doubts[1].what.contains("in 6 % of frames only; 0 is taken"), "{floor:?}");
    }

    #[test]
    fn kneeling() {
        // upright on the knees, toes tucked in
        let kneel = posed(&[(4, flex(FRAC_PI_2)), (5, flex(FRAC_PI_2))]);
        let feet = Humanoid::with_map(&smpl::neutral(), &smpl_map()).feet().unwrap();
        let down = feet.clearance(&clip(1.0, &kneel, |_| 0.0))[0];
        let floor = resolve_floor(&clip(5.0, &kneel, |_| 0.2 - down));
        assert!(near(floor.height_m, 0.2, 1e-9) && floor.doubts.is_empty(), "{floor:?}");
    }

    #[test]
    fn handstand() {
        let arms = [(16, Quat::from_rotation_z(FRAC_PI_2)), (17, Quat::from_rotation_z(-FRAC_PI_2))];
        let upside = posed(&[(0, flex(2.0 * FRAC_PI_2)), arms[0], arms[1]]);
        let floor = resolve_floor(&clip(5.0, &upside, |_| 1.1));
        assert_eq!(kinds(&floor), ["floor_below", "floor_pelvis"], "{floor:?}");
        assert!(floor.doubts[0].what.contains("hand") && floor.doubts[0].what.contains("100 %"), "{floor:?}");
        assert_eq!(floor.height_m, floor.found_m, "far from 0 it stays, with the doubt");
        // a third of a dance on the hands is fine: the feet stand the rest of the time
        let n = 300;
        let pose = |f: usize| if f < n / 3 { upside.clone() } else { posed(&[]) };
        let root = vec![Vec3::Y * STAND; n];
        let mixed = Clip::new(smpl::neutral(), FPS, root, (0..n).flat_map(pose).collect()).unwrap();
        let floor = resolve_floor(&mixed);
        assert!(near(floor.height_m, 0.0, 1e-9) && floor.doubts.is_empty(), "{floor:?}");
    }

    #[test]
    fn sitting() {
        let sit =
            [1, 2].map(|hip| (hip, flex(-FRAC_PI_2))).into_iter().chain([4, 5].map(|knee| (knee, flex(FRAC_PI_2))));
        let sit = posed(&sit.collect::<Vec<_>>());
        let feet = Humanoid::with_map(&smpl::neutral(), &smpl_map()).feet().unwrap();
        let down = feet.clearance(&clip(1.0, &sit, |_| 0.0))[0];
        // on a seat as high as the shin the pelvis is above half its standing height; on a kerb it isn't
        assert!(resolve_floor(&clip(5.0, &sit, |_| -down)).doubts.is_empty());
        let low = posed(&[1, 2].map(|hip| (hip, flex(-FRAC_PI_2))));
        let floor = resolve_floor(&clip(5.0, &low, |_| 0.12));
        assert!(kinds(&floor).contains(&"floor_pelvis"), "{floor:?}");
        assert_eq!(floor.height_m, 0.0);
    }

    #[test]
    fn no_ball_joints() {
        let body = smpl::neutral();
        let lacks = [10, 11];
        let kept: Vec<usize> = (0..24).filter(|j| !lacks.contains(j)).collect();
        let parents = kept.iter().map(|&j| {
            let parent = usize::try_from(smpl::PARENTS[j]).ok()?;
            kept.iter().position(|&k| k == parent)
        });
        let rig = Skeleton::new(
            kept.iter().map(|&j| smpl::NAMES[j].to_owned()).collect(),
            parents.collect(),
            kept.iter().map(|&j| body.offsets()[j] * 2.0).collect(),
            vec![],
        )
        .unwrap();
        let feet = Humanoid::with_map(&rig, &smpl_map()).feet().unwrap();
        assert!(feet.joints.iter().all(|(_, rest)| near(*rest, 0.12, 1e-12)) && feet.joints.len() == 2, "{feet:?}");
        assert!(near(feet.pelvis_m, 2.0 * STAND, 1e-12));
        let n = 120;
        let stand = Clip::new(Arc::new(rig), FPS, vec![Vec3::Y * (2.0 * STAND + 0.4); n], vec![Quat::IDENTITY; n * 22]);
        let floor = resolve_floor(&stand.unwrap());
        assert!(near(floor.height_m, 0.4, 1e-12) && floor.doubts.is_empty(), "{floor:?}");
    }

    #[test]
    fn it_is_the_same_in_a_bvh_which_needs_end_sites() {
        let dance = synth::corpus(1, 1, 8.0, FPS).unwrap().remove(0).clip;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bvh");
        let motion = Motion::new(&path, dance.clone());
        format::write(&path, &motion).unwrap();
        let back = format::read(&path, &ReadOptions::default()).unwrap().clip;
        assert!(!back.skeleton().ends().is_empty());
        let (floor, want) = (resolve_floor(&back), resolve_floor(&dance));
        assert!(near(floor.found_m, want.found_m, 1e-5), "{floor:?} {want:?}");
        let [a, b] = [&back, &dance].map(|clip| Humanoid::with_map(clip.skeleton(), &smpl_map()).feet().unwrap());
        assert!(near(a.body_m, b.body_m, 1e-5) && near(a.pelvis_m, b.pelvis_m, 1e-5), "{a:?} {b:?}");
    }

    #[test]
    fn short_clips_and_skating_are_doubted() {
        let floor = resolve_floor(&clip(0.5, &posed(&[]), |_| STAND + 0.1));
        assert_eq!((kinds(&floor).as_slice(), floor.height_m), (["floor_short"].as_slice(), 0.0));
        assert!(near(floor.found_m, 0.1, 1e-9));
        let n = 180;
        let root = (0..n).map(|f| Vec3::new(0.0, STAND, 0.02 * f as f64)).collect();
        let skating = Clip::new(smpl::neutral(), FPS, root, vec![Quat::IDENTITY; n * 24]).unwrap();
        let floor = resolve_floor(&skating);
        assert_eq!(kinds(&floor), ["floor_slides"]);
        assert!(floor.doubts[0].what.contains("1.20 m/s"), "{floor:?}");
        let none = resolve_floor(&clip(0.0, &posed(&[]), |_| 0.0));
        assert_eq!((none.height_m, kinds(&none).as_slice()), (0.0, ["floor_short"].as_slice()));
    }
}
