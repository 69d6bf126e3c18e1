//! The size of a body: which unit its legs indicate, and whether the stated unit gives a plausible body.

use super::Unit;
use crate::rig::{Feet, ReferencePose, SkeletonMap};
use crate::series::nearest_quantile;
use crate::smpl::STANDING_PELVIS_M;
use crate::{Clip, GlobalPose, Skeleton, Vec3, Warning};
use std::ops::RangeInclusive;

/// Ranges of leg lengths, hip to knee to ankle, and the unit in metres that they indicate.
// CMU's unit is an inch divided by 0.45, the length that its ASF files state
const LEGS: [(RangeInclusive<f64>, f64); 5] =
    [(0.6..=1.1, 1.0), (12.0..=19.0, 0.0564444), (23.0..=45.0, 0.0254), (60.0..=110.0, 0.01), (600.0..=1100.0, 0.001)];
/// The legs of children, which are doubted.
// these touch the adults' ranges, which are tried first
const CHILDREN: [(RangeInclusive<f64>, f64); 3] = [(0.25..=0.6, 1.0), (45.0..=60.0, 0.01), (250.0..=600.0, 0.001)];
/// The tallest body that is read in inches: a taller one is smaller than a person, in centimetres.
const TALLEST_M: f64 = 2.1;
/// The help for an unknown unit.
pub(crate) const GIVE_UNIT: &str = "give `unit`: m, dm, cm, mm, in, ft, cmu, or metres as 0.0725 m";
/// Legs of any person, and of an adult, metres.
const BODY_LEGS_M: RangeInclusive<f64> = 0.25..=1.3;
const ADULT_LEGS_M: RangeInclusive<f64> = 0.6..=1.1;
/// The extent of a figure that no map fits, metres.
const ANYTHING_M: RangeInclusive<f64> = 0.2..=5.0;
/// The height of a person, and by how much a body may be taller or shorter.
const PERSON_M: f64 = 1.7;
const AS_A_PERSON: f64 = 1.5;

/// The unit in metres that an adult's leg of this length, hip to knee to ankle, indicates.
pub(crate) fn unit_of_leg(length: f64) -> Option<f64> {
    LEGS.iter().find(|(lengths, _)| lengths.contains(&length)).map(|(_, metres)| *metres)
}

/// The unit in metres of a body whose legs have this length, with a doubt if it isn't an adult's; `height` gives the height
/// of the body in the same unit.
pub(crate) fn unit(leg: f64, height: impl Fn() -> f64) -> Option<(f64, Option<Warning>)> {
    match unit_of_leg(leg) {
        Some(0.0254) if height() * 0.0254 > TALLEST_M => {
            let (inches, centimetres) = (height() * 0.0254, height() * 0.01);
            let what = format!(
                "the body is {centimetres:.2} m tall in centimetres, as a child, and {inches:.2} m in inches: read in \
                 centimetres; if it is no child, give `unit` in"
            );
            Some((0.01, Some(Warning { kind: "unit_assumed", what })))
        }
        Some(metres) => Some((metres, None)),
        None => {
            let (_, metres) = CHILDREN.iter().find(|(lengths, _)| lengths.contains(&leg))?;
            let what = format!(
                "the legs are {:.2} m long, hip to ankle, as a child's: read in {}; if it is no child, give `unit`",
                leg * metres,
                name(*metres)
            );
            Some((*metres, Some(Warning { kind: "unit_assumed", what })))
        }
    }
}

/// The unit in metres in which a body of this extent is most like a person, with a doubt; `None` if there is none.
pub(crate) fn unit_of_extent(extent: f64) -> Option<(f64, Option<Warning>)> {
    let (_, metres) = likeliest(extent)?;
    let what = format!(
        "no leg is known that tells the unit: read in {}, in which the body extends over {:.2} m; if that is wrong, give \
         `unit`",
        name(metres),
        extent * metres
    );
    Some((metres, Some(Warning { kind: "unit_assumed", what })))
}

/// The unit in which `height` is most like a person's, by name and in metres.
fn likeliest(height: f64) -> Option<(&'static str, f64)> {
    // as a ratio: half and twice a person's height are equally unlikely
    let off = |metres: f64| (height * metres / PERSON_M).ln().abs();
    let best = units().min_by(|a, b| off(a.1).total_cmp(&off(b.1)))?;
    (off(best.1) <= AS_A_PERSON.ln()).then_some(best)
}

/// Units with their names, likeliest first.
fn units() -> impl Iterator<Item = (&'static str, f64)> {
    Unit::NAMED.iter().filter_map(|(name, unit)| Some((*name, unit.metres()?)))
}

fn name(metres: f64) -> &'static str {
    units().find(|(_, m)| *m == metres).map_or("metres", |(name, _)| name)
}

/// The joints from below a hip to its ankle under a map, on the left, else on the right.
pub(crate) fn leg(rig: &Skeleton, map: &SkeletonMap) -> Option<Vec<usize>> {
    let joint = |id: usize| rig.find(map.joint(id)?);
    let of = |[hip, knee, ankle]: [usize; 3]| {
        let (hip, knee, ankle) = (joint(hip)?, joint(knee)?, joint(ankle)?);
        let mut bones = Vec::new();
        let mut at = ankle;
        while at != hip {
            bones.push(at);
            at = rig.parents()[at]?;
        }
        bones.contains(&knee).then_some(bones)
    };
    // hip, knee, ankle by SMPL id
    of([1, 4, 7]).or_else(|| of([2, 5, 8]))
}

/// The height of the body as it stands, in the clip's unit: in the reference pose of its map, else as it extends.
pub(crate) fn height(clip: &Clip, map: Option<&SkeletonMap>) -> f64 {
    let standing = map.and_then(|map| ReferencePose::new(clip.skeleton(), map).ok());
    standing.map_or_else(|| extent(clip), |pose| Feet::from_pose(clip.skeleton(), &pose).body_m)
}

/// How far the body extends along the axis that it is longest along, in the median of the frames, in the clip's unit; at rest
/// without frames.
pub(crate) fn extent(clip: &Clip) -> f64 {
    let rig = clip.skeleton();
    let of = |pose: GlobalPose| {
        let all = || pose.positions.iter().copied().chain(pose.ends(rig));
        let (low, high) = all().fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
        (high - low).max_element()
    };
    if clip.frames() == 0 {
        return of(GlobalPose::new(rig, Vec3::ZERO, &vec![crate::Quat::IDENTITY; rig.joints()]));
    }
    let step = clip.frames().div_ceil(FRAMES).max(1);
    nearest_quantile((0..clip.frames()).step_by(step).map(|f| of(clip.global_pose(f))).collect(), 0.5)
}

/// Frames that are examined, evenly spaced.
const FRAMES: usize = 60;

/// The doubt of a clip whose body has no body's size in the unit that was taken for the file's numbers, of `unit_m` metres.
pub(crate) fn doubt(clip: &Clip, map: Option<&SkeletonMap>, unit_m: f64) -> Option<Warning> {
    let legs = map.and_then(|map| leg(clip.skeleton(), map));
    let (what, length, is_body, better_m) = match legs {
        Some(legs) => {
            let length: f64 = legs.iter().map(|&j| clip.skeleton().offsets()[j].length()).sum();
            let numbers = length / unit_m;
            let better = units().find(|(_, metres)| ADULT_LEGS_M.contains(&(numbers * metres)));
            ("the legs are", length, BODY_LEGS_M.contains(&length), better.map(|(_, metres)| metres))
        }
        None => {
            let extent = extent(clip);
            // a rig that no map knows need not be a person
            let is_body = extent == 0.0 || ANYTHING_M.contains(&extent);
            ("the body is", extent, is_body, likeliest(extent / unit_m).map(|p| p.1))
        }
    };
    if is_body {
        return None;
    }
    let better = better_m.map_or(String::new(), |better_m| {
        let unit = name(better_m);
        format!("; read with `unit` {unit}, they would be {:.2} m", length / unit_m * better_m)
    });
    let what = format!("{what} {length:.2} m long in the unit that the file is read in{better}");
    Some(Warning { kind: "size_doubted", what })
}

/// The doubt of a path in another unit than SMPL's metres: the pelvis is so high in the median as one that stands would be in
/// centimetres, millimetres or inches. `unit_m` metres were taken for the path's numbers.
pub(crate) fn path_doubt(clip: &Clip, unit_m: f64) -> Option<Warning> {
    let height = nearest_quantile(clip.root().iter().map(|p| p.y).collect(), 0.5);
    let stands = |metres: f64| (0.6..=1.3).contains(&(height / unit_m * metres / STANDING_PELVIS_M));
    let (unit, metres) = units().skip(1).take(3).find(|(_, metres)| *metres < unit_m && stands(*metres))?;
    let as_it = height / unit_m * metres;
    let what = format!(
        "the pelvis is at y = {height:.2} m in the median, in the unit that the path is read in; with `unit` {unit} at \
         {as_it:.2} m"
    );
    Some(Warning { kind: "size_doubted", what })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{smpl, synth};

    #[test]
    fn a_leg_tells_the_unit_and_a_tall_body_in_inches_is_a_child() {
        assert_eq!(unit(0.85, || 1.7), Some((1.0, None)));
        assert_eq!(unit(33.5, || 67.0), Some((0.0254, None)));
        let (metres, doubt) = unit(35.0, || 87.8).unwrap();
        let what = doubt.unwrap().what;
        assert!(metres == 0.01 && what.contains("0.88 m") && what.contains("2.23 m"), "{what}");
        assert_eq!(unit(0.4, || 0.9).map(|(metres, doubt)| (metres, doubt.is_some())), Some((1.0, true)));
        assert_eq!(unit(8.5, || 17.0), None, "decimetres are stated");
    }

    #[test]
    fn an_extent_proposes_a_unit() {
        for (extent, metres) in [(1.8, 1.0), (165.0, 0.01), (1900.0, 0.001), (70.0, 0.0254), (30.0, 0.0564444)] {
            let (found, doubt) = unit_of_extent(extent).unwrap();
            assert!(found == metres && doubt.unwrap().what.contains("give `unit`"), "{extent}: {found}");
        }
        assert_eq!([0.0, 400.0, f64::INFINITY].map(unit_of_extent), [None, None, None]);
    }

    #[test]
    fn a_path_of_another_unit_is_doubted() {
        let dance = synth::corpus(1, 1, 2.0, 20.0).unwrap().remove(0).clip;
        let at = |factor: f64| {
            let root = dance.root().iter().map(|p| *p * factor).collect();
            let clip = Clip::new(dance.skeleton().clone(), 20.0, root, dance.rotations().to_vec()).unwrap();
            path_doubt(&clip, 1.0).map(|doubt| doubt.what)
        };
        assert_eq!(at(1.0), None);
        for (factor, unit) in [(100.0, "`unit` cm"), (1000.0, "`unit` mm"), (1.0 / 0.0254, "`unit` in")] {
            assert!(at(factor).is_some_and(|what| what.contains(unit)), "{factor}: {:?}", at(factor));
        }
        assert_eq!(path_doubt(&dance.raised(20.0), 1.0), None, "on a roof");
    }

    #[test]
    fn a_body_of_no_size_is_doubted() {
        let dance = synth::corpus(1, 1, 2.0, 20.0).unwrap().remove(0).clip;
        let map = SkeletonMap::builtin("smpl");
        assert_eq!([map.as_ref(), None].map(|map| doubt(&dance, map, 1.0)), [None, None]);
        let giant = dance.clone().scaled(10.0).unwrap();
        for map in [map.as_ref(), None] {
            // millimetres that were taken for centimetres
            let what = doubt(&giant, map, 0.01).unwrap().what;
            assert!(what.contains("`unit` mm"), "{what}");
        }
        assert_eq!(extent(&Clip::new(smpl::neutral(), 20.0, vec![], vec![]).unwrap()), extent(&dance.slice(0..0)));
    }
}
