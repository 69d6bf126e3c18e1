//! The motion root: the joint that a clip's path belongs to. Everything above it is composed into it, still or moving, and
//! joints beside it (IK targets, props) are no part of the clip.

use crate::rig::{FoundMap, SkeletonMap, map_if_any};
use crate::{Clip, EndSite, Quat, Result, Skeleton, Vec3, Warning};
use std::sync::Arc;

/// The lowest joint that all joints of a map descend from: the pelvis, or the common parent of pelvis and spine. `None` if the map
/// fits no joint.
pub(crate) fn of_map(rig: &Skeleton, map: &SkeletonMap) -> Option<usize> {
    let mapped = (0..24).filter_map(|id| rig.find(map.joint(id)?));
    mapped.reduce(|a, b| common(rig, a, b))
}

/// The motion root of a rig that no map fits: the topmost joint that moves in its parent's frame, by `moves`, and has more
/// than a third of the joints below; of several, the one with the most. It goes on down while its only child moves too, so
/// that nothing of that path is lost. Joint 0 if none moves.
pub(crate) fn topmost_mover(rig: &Skeleton, moves: impl Fn(usize) -> bool) -> usize {
    let (mut is_under, mut below) = (vec![false; rig.joints()], vec![1usize; rig.joints()]);
    for (j, parent) in rig.parents().iter().enumerate() {
        is_under[j] = parent.is_some_and(|p| is_under[p] || moves(p));
    }
    for (j, parent) in rig.parents().iter().enumerate().rev() {
        parent.iter().for_each(|&p| below[p] += below[j]);
    }
    // a bone that changes its length carries no body
    let topmost = (0..rig.joints()).filter(|&j| !is_under[j] && moves(j) && 3 * below[j] > rig.joints());
    // of equal ones the first; `max_by_key` alone would take the last
    let Some(mut at) = topmost.max_by_key(|&j| (below[j], std::cmp::Reverse(j))) else { return 0 };
    loop {
        let mut children = rig.children(at);
        match (children.next(), children.next()) {
            (Some(child), None) if moves(child) => at = child,
            _ => return at,
        }
    }
}

fn common(rig: &Skeleton, a: usize, b: usize) -> usize {
    let (mut a, mut b) = (a, b);
    // parents come first: the later of two joints is no ancestor of the other
    while a != b {
        if a > b { a = rig.parents()[a].unwrap_or(0) } else { b = rig.parents()[b].unwrap_or(0) }
    }
    a
}

/// The motion root of a clip of which the map of this name, or none, was `found`: that of the body that the map fits, else
/// the topmost joint that `moves`. Where the caller names a joint it is that of the body below, else the joint.
///
/// # Errors
/// Those of a skeleton map by name or path.
pub(crate) fn choose(
    clip: &Clip,
    joint: Option<usize>,
    found: &mut Option<FoundMap>,
    map: Option<&str>,
    moves: impl Fn(usize) -> bool,
) -> Result<usize> {
    let rig = clip.skeleton();
    let of_body = |found: &Option<FoundMap>| found.as_ref().and_then(|found| of_map(rig, &found.map));
    match (joint, of_body(found)) {
        (None, root) => Ok(root.unwrap_or_else(|| topmost_mover(rig, moves))),
        (Some(joint), Some(root)) if rig.descends(root, joint) => Ok(root),
        (Some(joint), _) => {
            // another figure of the file, or a part of one: a body that is found in it alone
            *found = map_if_any(&from_joint(clip, joint, path_of(clip, joint))?, map)?;
            Ok(of_body(found).unwrap_or(joint))
        }
    }
}

/// The map for a clip without the joints above its body: the one that was found with them, else searched once more.
///
/// # Errors
/// Those of a skeleton map by name or path.
pub(crate) fn map_below(clip: &Clip, found: Option<FoundMap>, map: Option<&str>) -> Result<Option<FoundMap>> {
    found.map_or_else(|| map_if_any(clip, map), |found| Ok(Some(found.on(clip))))
}

/// The part of a clip from `joint` down: the joint takes the whole transform of what is above it, and stands at `root` (F).
///
/// # Errors
/// None for finite numbers.
pub(crate) fn from_joint(clip: &Clip, joint: usize, root: Vec<Vec3>) -> Result<Clip> {
    let rig = clip.skeleton();
    let part: Vec<usize> = (joint..rig.joints()).filter(|&j| rig.descends(j, joint)).collect();
    let place = |j: usize| part.binary_search(&j).ok();
    let skeleton = Skeleton::new(
        part.iter().map(|&j| rig.names()[j].clone()).collect(),
        part.iter().map(|&j| rig.parents()[j].filter(|_| j != joint).and_then(place)).collect(),
        part.iter().map(|&j| rig.offsets()[j]).collect(),
        rig.ends().iter().filter_map(|e| Some(EndSite { parent: place(e.parent)?, offset: e.offset })).collect(),
    )?;
    let mut above: Vec<usize> = std::iter::successors(Some(joint), |&j| rig.parents()[j]).collect();
    above.reverse();
    let mut rotations = Vec::with_capacity(clip.frames() * part.len());
    for f in 0..clip.frames() {
        let pose = clip.pose(f);
        let whole = above.iter().fold(Quat::IDENTITY, |turn, &j| turn * pose[j]);
        rotations.push(whole.normalize());
        rotations.extend(part[1..].iter().map(|&j| pose[j]));
    }
    Clip::new(Arc::new(skeleton), clip.fps(), root, rotations)
}

/// The warning about joints that are neither at `joint` or below it nor above: how many there are, and how far one
/// `moved` (J) at most in its parent's frame, metres. `None` if there are none.
pub(crate) fn beside(rig: &Skeleton, joint: usize, moved: impl Fn(usize) -> f64) -> Option<Warning> {
    let beside: Vec<usize> =
        (0..rig.joints()).filter(|&j| !rig.descends(j, joint) && !rig.descends(joint, j)).collect();
    let furthest = beside.iter().map(|&j| moved(j)).fold(0.0, f64::max);
    let names = beside.iter().take(3).map(|&j| rig.names()[j].as_str()).collect::<Vec<_>>().join(", ");
    let more = if beside.len() > 3 { format!(" and {} more", beside.len() - 3) } else { String::new() };
    let what = format!(
        "{names}{more}: beside the body, and no part of the clip; they move by up to {furthest:.2} m at what they hang from"
    );
    (!beside.is_empty()).then_some(Warning { kind: "joints_beside", what })
}

/// Positions (F) of one joint, metres.
pub(crate) fn path_of(clip: &Clip, joint: usize) -> Vec<Vec3> {
    (0..clip.frames()).map(|f| clip.global_pose(f).positions[joint]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A root with a prop beside a pelvis, which has a leg and a spine.
    fn rig() -> Skeleton {
        let names = ["root", "prop", "pelvis", "spine", "leg", "tip"].map(str::to_owned).to_vec();
        let parents = vec![None, Some(0), Some(0), Some(2), Some(2), Some(1)];
        Skeleton::new(names, parents, vec![Vec3::Y; 6], vec![EndSite { parent: 4, offset: Vec3::X }]).unwrap()
    }

    #[test]
    fn without_a_map_it_is_the_topmost_joint_that_moves() {
        let of = |moving: &[usize]| topmost_mover(&rig(), |j| moving.contains(&j));
        assert_eq!([of(&[]), of(&[0, 2]), of(&[2, 4]), of(&[1, 2, 3]), of(&[1, 5])], [0, 0, 2, 2, 0]);
        let chain = |n: usize| {
            let (names, parents) = ((0..n).map(|j| j.to_string()), (0..n).map(|j| j.checked_sub(1)));
            Skeleton::new(names.collect(), parents.collect(), vec![Vec3::Y; n], vec![]).unwrap()
        };
        assert_eq!(topmost_mover(&chain(5), |j| j == 1 || j == 2), 2, "on to an only child that moves too");
    }

    #[test]
    fn what_is_above_is_composed_and_what_is_beside_left_out() {
        let turns = |f: usize| {
            let turn = Quat::from_rotation_y(0.3 * f as f64);
            [turn, Quat::IDENTITY, Quat::from_rotation_x(0.2), turn, turn, turn]
        };
        let path = (0..4).map(|f| Vec3::X * f as f64).collect();
        let clip = Clip::new(Arc::new(rig()), 10.0, path, (0..4).flat_map(turns).collect()).unwrap();
        let below = from_joint(&clip, 2, path_of(&clip, 2)).unwrap();
        assert_eq!(below.skeleton().names(), ["pelvis", "spine", "leg"]);
        assert_eq!(below.skeleton().ends(), [EndSite { parent: 2, offset: Vec3::X }]);
        for f in 0..4 {
            let (whole, part) = (clip.global_pose(f), below.global_pose(f));
            for (a, b) in [2, 3, 4].into_iter().zip(0..) {
                assert!(whole.positions[a].distance(part.positions[b]) < 1e-12);
                assert!(crate::rotation::angle_between(whole.rotations[a], part.rotations[b]) < 1e-12);
            }
        }
    }
}
