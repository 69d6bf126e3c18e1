//! Where the floor is under a clip, and how far the feet are above it.
//!
//! A body's *feet* are its ankles and balls (SMPL's 7, 8 and 10, 11), each with its height when the body stands. In a
//! frame the foot that is nearest to the floor is the one of the least height above its own; the floor lies where that
//! least height seldom goes below: at its 5th percentile over the frames. Clips that don't walk on one flat floor are
//! told by the doubts.

use crate::format::ReadOptions;
use crate::format::bvh::MADE_UP_TIP;
use crate::retarget::{ReferencePose, SkeletonMap, map_for};
use crate::{Clip, EndSite, Error, GlobalPose, Motion, Result, Skeleton, Vec3, Warning, smpl};

/// Another joint that lies deeper than this below the floor speaks against it, metres.
const BELOW_M: f64 = 0.1;
/// In more than this share of frames.
const BELOW_SHARE: f64 = 0.02;
/// Feet on the floor are slower than this in the median, metres a second.
const STANDING_M_S: f64 = 0.5;
/// The pelvis is in the median within this part of its standing height.
const PELVIS: std::ops::RangeInclusive<f64> = 0.5..=1.2;
/// A foot is near the floor below this height, metres, and is so in more than a tenth of the frames.
const NEAR_M: f64 = 0.1;
/// A clip that is shorter says too little, seconds.
const SHORT_S: f64 = 1.0;
/// In doubt the floor is y = 0 if the one that was found lies within this part of the body's height of it.
const PART_OF_BODY: f64 = 0.15;

/// The feet of a rig, and how it stands on them.
#[derive(Debug, Clone, PartialEq)]
pub struct Feet {
    /// Ankles and balls, and how high each is when the body stands, metres.
    pub joints: Vec<(usize, f64)>,
    /// The joint of the pelvis.
    pub pelvis: usize,
    /// How high the pelvis is when the body stands, metres.
    pub pelvis_m: f64,
    /// How tall the body stands, joints and end sites, metres.
    pub body_m: f64,
    /// (J) Which joints are feet or hang on one.
    of_foot: Vec<bool>,
}

/// The floor of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Floor {
    /// The floor to take: what was found, or in doubt 0 where that is near; metres.
    pub height_m: f64,
    /// The 5th percentile of the least height, metres.
    pub found_m: f64,
    /// What speaks against it, by name; none for one that is sure.
    pub doubts: Vec<Warning>,
}

/// The floor of a clip on the rig that `map` is for: [`Feet::floor`] of [`Feet::new`].
///
/// # Errors
/// As [`Feet::new`].
pub fn floor(clip: &Clip, map: &SkeletonMap) -> Result<Floor> {
    Ok(Feet::new(clip.skeleton(), map)?.floor(clip))
}

/// Where the floor of a motion is, as `options` tell it or as its feet do; in doubt the doubts join its warnings.
///
/// # Errors
/// As [`map_for`] and [`Feet::new`]; [`Error::Call`] for a floor that is told and isn't finite.
pub fn floor_of(motion: &mut Motion, options: &ReadOptions) -> Result<f64> {
    if let Some(told) = options.floor {
        let what = || format!("a floor at y = {told}; expected a height in metres");
        return if told.is_finite() { Ok(told) } else { Err(Error::Call(what())) };
    }
    let map = map_for(motion.clip.skeleton(), options.map.as_deref())?;
    let floor = floor(&motion.clip, &map)?;
    motion.warnings.extend(floor.doubts);
    Ok(floor.height_m)
}

impl Feet {
    /// The feet of `rig`, whose joints `map` names, in the reference pose of the map.
    ///
    /// The floor of that pose is the lowest of ankles, balls and the tips below them. A rig that has ankles alone stands
    /// as high on them as the SMPL body does (6 cm), times its leg over SMPL's.
    ///
    /// # Errors
    /// As [`ReferencePose::new`].
    pub fn new(rig: &Skeleton, map: &SkeletonMap) -> Result<Self> {
        Ok(Feet::of(rig, &ReferencePose::new(rig, map)?))
    }

    /// [`Feet::new`] of a reference pose that is there already.
    pub fn of(rig: &Skeleton, pose: &ReferencePose) -> Self {
        let joints: Vec<usize> = [7, 8, 10, 11].iter().filter_map(|&id: &usize| pose.joints[id]).collect();
        let of_foot: Vec<bool> = (0..rig.joints()).map(|j| joints.iter().any(|&foot| rig.descends(j, foot))).collect();
        let y = |j: usize| pose.global.positions[j].y;
        // tips: end sites, and joints without children where a file has no end sites
        let ends = || rig.ends().iter().zip(pose.global.ends(rig)).filter(|(end, _)| !is_made_up(rig, end));
        let highest = pose.global.positions.iter().copied().chain(ends().map(|(_, place)| place));
        let highest = highest.fold(f64::MIN, |h, p| h.max(p.y));
        let ends = ends().filter(|(end, _)| of_foot[end.parent]);
        let leaves =
            (0..rig.joints()).filter(|&j| of_foot[j] && !joints.contains(&j) && rig.children(j).next().is_none());
        let tips: Vec<f64> = ends.map(|(_, place)| place.y).chain(leaves.map(y)).collect();
        let lowest = joints.iter().map(|&j| y(j)).chain(tips.iter().copied()).fold(f64::MAX, f64::min);
        let ankles_alone = joints.len() == 2 && tips.is_empty();
        let under = if ankles_alone { smpl_ankle_m() * pose.leg_m() / smpl_leg_m() } else { 0.0 };
        let above = |y: f64| y - lowest + under;
        let pelvis = pose.joints[0].unwrap_or(0);
        Feet {
            joints: joints.into_iter().map(|j| (j, above(y(j)))).collect(),
            pelvis,
            pelvis_m: above(y(pelvis)),
            body_m: above(highest),
            of_foot,
        }
    }

    /// (F) Of each frame the least height of a foot above its own standing height, metres, world: with the floor taken off
    /// it is 0 in a stand, the height of the lower foot in a jump, and negative in the floor.
    ///
    /// # Panics
    /// If the clip is not on a rig of these joints.
    pub fn least(&self, clip: &Clip) -> Vec<f64> {
        self.lowest(clip).into_iter().map(|(least, _)| least).collect()
    }

    /// (F) Of each frame the height of the lowest joint that is no foot and hangs on none, metres, world: of one who lies,
    /// kneels or stands on the hands it is near the floor.
    ///
    /// # Panics
    /// If the clip is not on a rig of these joints.
    pub fn others(&self, clip: &Clip) -> Vec<f64> {
        let lowest = |frame: &[Vec3]| {
            let others = frame.iter().zip(&self.of_foot).filter(|(_, of_foot)| !**of_foot);
            others.map(|(p, _)| p.y).fold(f64::MAX, f64::min)
        };
        clip.positions().chunks_exact(clip.joints()).map(lowest).collect()
    }

    /// [`Feet::least`], and where that foot is.
    fn lowest(&self, clip: &Clip) -> Vec<(f64, usize)> {
        let mut pose = GlobalPose::default();
        let frame = |f: usize| {
            pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
            let heights = self.joints.iter().map(|&(j, rest)| (pose.positions[j].y - rest, j));
            heights.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, 0))
        };
        (0..clip.frames()).map(frame).collect()
    }

    /// The floor of a clip on this rig, as its file has it: before it is retargeted.
    ///
    /// *Found* is the 5th percentile over frames of [`Feet::least`]. It is doubted when another joint lies over 10 cm below
    /// it in over 2 % of the frames (a handstand); when the lowest foot of the lowest tenth of the frames moves faster than
    /// 0.5 m/s in the median (skating, swimming); when the median pelvis is outside 0.5 to 1.2 of its standing height
    /// (sitting, hanging); when a foot is within 10 cm of it in under a tenth of the frames (stairs); when the clip is
    /// under 1 s. In doubt it is y = 0 if what was found is within 15 % of the body's height of it.
    ///
    /// # Panics
    /// If the clip is not on this rig.
    pub fn floor(&self, clip: &Clip) -> Floor {
        let lowest = self.lowest(clip);
        let found_m = quantile(lowest.iter().map(|l| l.0).collect(), 0.05);
        let mut doubts = Vec::new();
        let mut doubt = |kind, what: Option<String>| doubts.extend(what.map(|what| Warning { kind, what }));
        let places = clip.positions();
        doubt("floor_below", self.others_below(clip, &places, found_m));
        doubt("floor_slides", slides(clip, &places, &lowest));
        doubt("floor_pelvis", self.pelvis_off(clip, &places, found_m));
        doubt("floor_far", far(&lowest, found_m));
        let seconds = clip.duration_s();
        doubt("floor_short", (seconds < SHORT_S).then(|| format!("the clip has {seconds:.2} s, under {SHORT_S} s")));
        let near = found_m.abs() <= PART_OF_BODY * self.body_m;
        let height_m = if !doubts.is_empty() && near { 0.0 } else { found_m };
        let found = format!("the floor by the feet is at y = {found_m:.2} m");
        let taken = if height_m == found_m { "taken all the same" } else { "0 is taken" };
        for doubt in &mut doubts {
            doubt.what = format!("{found}, but {}; {taken}; --floor METRES says where it is", doubt.what);
        }
        Floor { height_m, found_m, doubts }
    }

    fn others_below(&self, clip: &Clip, places: &[Vec3], floor_m: f64) -> Option<String> {
        let j = clip.joints();
        let deepest = |frame: &[Vec3]| {
            let others = frame.iter().enumerate().filter(|(joint, _)| !self.of_foot[*joint]);
            others.map(|(joint, p)| (p.y, joint)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::MAX, 0))
        };
        let below: Vec<_> = places.chunks_exact(j).map(deepest).filter(|(y, _)| *y < floor_m - BELOW_M).collect();
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

    fn pelvis_off(&self, clip: &Clip, places: &[Vec3], floor_m: f64) -> Option<String> {
        if clip.frames() == 0 {
            return None;
        }
        let heights = places.chunks_exact(clip.joints()).map(|frame| frame[self.pelvis].y - floor_m).collect();
        let (median, standing) = (quantile(heights, 0.5), self.pelvis_m);
        (!PELVIS.contains(&(median / standing)))
            .then(|| format!("the pelvis is {median:.2} m above it in the median; this body stands at {standing:.2} m"))
    }
}

/// Whether an end site is one that [`crate::format::bvh::BvhSource::plain`] adds where a body has none, since a BVH needs
/// one: it says nothing of the foot, and the floor is the same in a file that has none.
fn is_made_up(rig: &Skeleton, end: &EndSite) -> bool {
    let bone = rig.offsets()[end.parent];
    // to the digits of a file
    rig.parents()[end.parent].is_some() && end.offset.distance(bone * MADE_UP_TIP) < 1e-4 * bone.length()
}

fn slides(clip: &Clip, places: &[Vec3], lowest: &[(f64, usize)]) -> Option<String> {
    let frames = clip.frames();
    if frames < 2 {
        return None;
    }
    let mut order: Vec<usize> = (0..frames).collect();
    order.sort_by(|&a, &b| lowest[a].0.total_cmp(&lowest[b].0));
    order.truncate(frames.div_ceil(10));
    let speed = |f: usize| {
        let (joint, before, after) = (lowest[f].1, f.saturating_sub(1), (f + 1).min(frames - 1));
        let at = |f: usize| places[f * clip.joints() + joint];
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

fn smpl_ankle_m() -> f64 {
    -smpl::neutral().offsets()[10].y
}

fn smpl_leg_m() -> f64 {
    smpl::neutral().offsets()[4].length() + smpl::neutral().offsets()[7].length()
}

/// The `q` quantile, linear between neighbours as NumPy's; 0 of nothing.
pub(crate) fn quantile(mut values: Vec<f64>, q: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.sort_by(f64::total_cmp);
    let at = (values.len() - 1) as f64 * q;
    let below = values[at as usize];
    below + (values[at.ceil() as usize] - below) * at.fract()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Source;
    use crate::format;
    use crate::{Quat, synth};
    use std::f64::consts::FRAC_PI_2;
    use std::sync::Arc;

    const FPS: f64 = 60.0;

    fn smpl_map() -> SkeletonMap {
        SkeletonMap::builtin("smpl").unwrap()
    }

    /// A pose of these local rotations, the others at rest.
    fn posed(turns: &[(usize, Quat)]) -> Vec<Quat> {
        let mut pose = vec![Quat::IDENTITY; 24];
        turns.iter().for_each(|&(j, q)| pose[j] = q);
        pose
    }

    fn flex(radians: f64) -> Quat {
        Quat::from_rotation_x(radians)
    }

    /// A clip of the neutral body in one pose whose pelvis is at `height` of each time.
    fn clip(seconds: f64, pose: &[Quat], height: impl Fn(f64) -> f64) -> Clip {
        let n = (seconds * FPS) as usize;
        let root = (0..n).map(|f| Vec3::new(0.0, height(f as f64 / FPS), 0.0)).collect();
        Clip::new(smpl::neutral(), FPS, root, pose.repeat(n)).unwrap()
    }

    fn kinds(floor: &Floor) -> Vec<&'static str> {
        floor.doubts.iter().map(|d| d.kind).collect()
    }

    fn floor_of(clip: &Clip) -> Floor {
        floor(clip, &smpl_map()).unwrap()
    }

    fn near(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() <= tolerance
    }

    const STAND: f64 = smpl::STANDING_PELVIS_M;

    #[test]
    fn the_feet_of_the_neutral_body() {
        let feet = Feet::new(&smpl::neutral(), &smpl_map()).unwrap();
        let want = [(7, 0.06), (8, 0.06), (10, 0.0), (11, 0.0)];
        for ((joint, rest), (j, r)) in feet.joints.iter().zip(want) {
            assert!(*joint == j && near(*rest, r, 1e-12), "{joint} {rest}");
        }
        assert!(near(feet.pelvis_m, STAND, 1e-12) && near(feet.body_m, 1.58, 0.03), "{feet:?}");
        let stand = clip(2.0, &posed(&[]), |t| STAND + 0.3 * t);
        for (f, least) in feet.least(&stand).iter().enumerate() {
            assert!(near(*least, 0.3 * f as f64 / FPS, 1e-12));
        }
    }

    #[test]
    fn dances_stand_on_it_wherever_it_is() {
        for dance in synth::corpus(1, 12, 8.0, FPS).unwrap() {
            for at in [0.0, -0.3, 1.4] {
                let root = dance.clip.root().iter().map(|p| *p + Vec3::Y * at).collect();
                let moved = Clip::new(smpl::neutral(), FPS, root, dance.clip.rotations().to_vec()).unwrap();
                let floor = floor_of(&moved);
                assert!(near(floor.height_m, at, 0.01), "{} at {at}: {floor:?}", dance.name());
                assert!(floor.doubts.is_empty(), "{}: {floor:?}", dance.name());
            }
        }
    }

    #[test]
    fn jumps() {
        // in the air for four tenths of each second, 20 cm high
        let hop = |t: f64| {
            let air = (t.fract() / 0.4).min(1.0);
            0.5 + STAND + 4.0 * 0.2 * air * (1.0 - air)
        };
        let floor = floor_of(&clip(6.0, &posed(&[]), hop));
        assert!(near(floor.height_m, 0.5, 1e-9) && floor.doubts.is_empty(), "{floor:?}");
    }

    #[test]
    fn stairs() {
        let climb = |steps: f64| clip(20.0, &posed(&[]), move |t| 0.1 + STAND + 0.18 * (t / 20.0 * steps).floor());
        let floor = floor_of(&climb(3.0));
        assert!(near(floor.height_m, 0.1, 1e-9) && floor.doubts.is_empty(), "{floor:?}");
        // so many that no step is stood on for a tenth of the time: said, and y = 0 is taken
        let floor = floor_of(&climb(16.0));
        assert_eq!(kinds(&floor), ["floor_pelvis", "floor_far"], "{floor:?}");
        assert!(near(floor.found_m, 0.1, 1e-9) && floor.height_m == 0.0, "{floor:?}");
        assert!(floor.doubts[1].what.contains("in 6 % of frames only; 0 is taken"), "{floor:?}");
    }

    #[test]
    fn kneeling() {
        // upright on the knees, toes tucked in
        let kneel = posed(&[(4, flex(FRAC_PI_2)), (5, flex(FRAC_PI_2))]);
        let feet = Feet::new(&smpl::neutral(), &smpl_map()).unwrap();
        let down = feet.least(&clip(1.0, &kneel, |_| 0.0))[0];
        let floor = floor_of(&clip(5.0, &kneel, |_| 0.2 - down));
        assert!(near(floor.height_m, 0.2, 1e-9) && floor.doubts.is_empty(), "{floor:?}");
    }

    #[test]
    fn handstand() {
        let arms = [(16, Quat::from_rotation_z(FRAC_PI_2)), (17, Quat::from_rotation_z(-FRAC_PI_2))];
        let upside = posed(&[(0, flex(2.0 * FRAC_PI_2)), arms[0], arms[1]]);
        let floor = floor_of(&clip(5.0, &upside, |_| 1.1));
        assert_eq!(kinds(&floor), ["floor_below", "floor_pelvis"], "{floor:?}");
        assert!(floor.doubts[0].what.contains("hand") && floor.doubts[0].what.contains("100 %"), "{floor:?}");
        assert_eq!(floor.height_m, floor.found_m, "far from 0 it stays, with the doubt");
        // a third of a dance on the hands is no trouble: the feet stand the rest of the time
        let n = 300;
        let pose = |f: usize| if f < n / 3 { upside.clone() } else { posed(&[]) };
        let root = vec![Vec3::Y * STAND; n];
        let mixed = Clip::new(smpl::neutral(), FPS, root, (0..n).flat_map(pose).collect()).unwrap();
        let floor = floor_of(&mixed);
        assert!(near(floor.height_m, 0.0, 1e-9) && floor.doubts.is_empty(), "{floor:?}");
    }

    #[test]
    fn sitting() {
        let sit =
            [1, 2].map(|hip| (hip, flex(-FRAC_PI_2))).into_iter().chain([4, 5].map(|knee| (knee, flex(FRAC_PI_2))));
        let sit = posed(&sit.collect::<Vec<_>>());
        let feet = Feet::new(&smpl::neutral(), &smpl_map()).unwrap();
        let down = feet.least(&clip(1.0, &sit, |_| 0.0))[0];
        // on a seat of its own shin's height the pelvis is at half its standing height and more; on a kerb it isn't
        assert!(floor_of(&clip(5.0, &sit, |_| -down)).doubts.is_empty());
        let low = posed(&[1, 2].map(|hip| (hip, flex(-FRAC_PI_2))));
        let floor = floor_of(&clip(5.0, &low, |_| 0.12));
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
        let feet = Feet::new(&rig, &smpl_map()).unwrap();
        assert!(feet.joints.iter().all(|(_, rest)| near(*rest, 0.12, 1e-12)) && feet.joints.len() == 2, "{feet:?}");
        assert!(near(feet.pelvis_m, 2.0 * STAND, 1e-12));
        let n = 120;
        let stand = Clip::new(Arc::new(rig), FPS, vec![Vec3::Y * (2.0 * STAND + 0.4); n], vec![Quat::IDENTITY; n * 22]);
        let floor = floor_of(&stand.unwrap());
        assert!(near(floor.height_m, 0.4, 1e-12) && floor.doubts.is_empty(), "{floor:?}");
    }

    #[test]
    fn end_sites_are_the_soles() {
        let body = smpl::neutral();
        let ends = [10, 11].map(|parent| crate::EndSite { parent, offset: Vec3::new(0.0, -0.03, 0.08) }).to_vec();
        let parents = body.parents().to_vec();
        let rig = Skeleton::new(body.names().to_vec(), parents, body.offsets().to_vec(), ends).unwrap();
        let feet = Feet::new(&rig, &smpl_map()).unwrap();
        for ((_, rest), want) in feet.joints.iter().zip([0.09, 0.09, 0.03, 0.03]) {
            assert!(near(*rest, want, 1e-12), "{feet:?}");
        }
    }

    #[test]
    fn it_is_the_same_in_a_bvh_which_needs_end_sites() {
        let dance = synth::corpus(1, 1, 8.0, FPS).unwrap().remove(0).clip;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bvh");
        let motion = Motion { path: path.clone(), clip: dance.clone(), source: Source::Plain, warnings: vec![] };
        format::write(&path, &motion).unwrap();
        let back = format::read(&path, &ReadOptions::default()).unwrap().clip;
        assert!(!back.skeleton().ends().is_empty());
        let (floor, want) = (floor_of(&back), floor_of(&dance));
        assert!(near(floor.found_m, want.found_m, 1e-5), "{floor:?} {want:?}");
        let [a, b] = [&back, &dance].map(|clip| Feet::new(clip.skeleton(), &smpl_map()).unwrap());
        assert!(near(a.body_m, b.body_m, 1e-5) && near(a.pelvis_m, b.pelvis_m, 1e-5), "{a:?} {b:?}");
    }

    #[test]
    fn short_clips_and_skating_are_doubted() {
        let floor = floor_of(&clip(0.5, &posed(&[]), |_| STAND + 0.1));
        assert_eq!((kinds(&floor).as_slice(), floor.height_m), (["floor_short"].as_slice(), 0.0));
        assert!(near(floor.found_m, 0.1, 1e-9));
        let n = 180;
        let root = (0..n).map(|f| Vec3::new(0.0, STAND, 0.02 * f as f64)).collect();
        let skating = Clip::new(smpl::neutral(), FPS, root, vec![Quat::IDENTITY; n * 24]).unwrap();
        let floor = floor_of(&skating);
        assert_eq!(kinds(&floor), ["floor_slides"]);
        assert!(floor.doubts[0].what.contains("1.20 m/s"), "{floor:?}");
        let none = floor_of(&clip(0.0, &posed(&[]), |_| 0.0));
        assert_eq!((none.height_m, kinds(&none).as_slice()), (0.0, ["floor_short"].as_slice()));
    }
}
