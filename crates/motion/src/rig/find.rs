//! The map of a rig: the one that is given, else the built-in one of these joint names, else by recognition.

use super::recognise::trunk::id_of_one;
use super::recognise::{recognise, stand, turns};
use super::{SkeletonMap, reference};
use crate::{Clip, Result, Skeleton, Warning};

/// The map that was found for a rig, bound to its joint names.
#[derive(Debug, Clone)]
pub struct FoundMap {
    /// The map.
    pub map: SkeletonMap,
    /// How it was found.
    pub by: FoundBy,
    /// Whether its reference pose was made from the clip, because no body stands in the one that it had.
    pub made: bool,
}

/// How a map was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FoundBy {
    /// Given by the caller.
    Given,
    /// Built in, by the joint names.
    Names,
    /// [Recognised](recognise()), by shape, movement and names.
    Shape,
}

impl FoundMap {
    /// Whether the map or its reference pose comes from how the clip moves, so that another clip on the rig might give
    /// another one: what is made of the clip has to keep it.
    pub fn is_of_clip(&self) -> bool {
        self.by == FoundBy::Shape || self.made
    }
}

/// The map of a rig: the one given by name or path, else the built-in one that fits the joint names, else the rig is
/// [recognised](recognise()).
///
/// # Errors
/// [`Unsupported`](kinelm_store::Error::Unsupported) when it isn't recognised for sure, with what is missing or doubtful
/// and a TOML to start from; those of [`SkeletonMap::by_name_or_file`].
pub fn map_for(rig: &Skeleton, map: Option<&str>) -> Result<SkeletonMap> {
    find(rig, None, map).map(|found| found.map)
}

/// As [`map_for`], for a rig that is recognised by how it moves too.
///
/// # Errors
/// Those of [`map_for`].
pub fn map_of(clip: &Clip, map: Option<&str>) -> Result<SkeletonMap> {
    find_map(clip, map).map(|found| found.map)
}

/// As [`map_of`], with how the map was found.
///
/// # Errors
/// Those of [`map_for`].
pub fn find_map(clip: &Clip, map: Option<&str>) -> Result<FoundMap> {
    find(clip.skeleton(), Some(clip), map)
}

/// The map given by name or path, bound to these joints as far as it fits, else as [`map_for`] finds it, if it does; `clip`
/// shows how the rig moves.
///
/// # Errors
/// Those of [`SkeletonMap::by_name_or_file`].
pub(crate) fn map_if_any(rig: &Skeleton, clip: Option<&Clip>, map: Option<&str>) -> Result<Option<SkeletonMap>> {
    let found = find(rig, clip, map);
    match map {
        Some(_) => found.map(|found| Some(found.map)),
        None => Ok(found.ok().map(|found| found.map)),
    }
}

fn find(rig: &Skeleton, clip: Option<&Clip>, map: Option<&str>) -> Result<FoundMap> {
    if let Some(map) = map {
        let map = SkeletonMap::by_name_or_file(map)?.bind_any(rig.names());
        let (map, made) = if map.has_reference() { (map, false) } else { standing(map, rig, clip) };
        return Ok(FoundMap { map, by: FoundBy::Given, made });
    }
    let named = SkeletonMap::fitting(rig.names());
    let built_in = |map: SkeletonMap| {
        let (map, made) = standing(map, rig, clip);
        FoundMap { map, by: FoundBy::Names, made }
    };
    let turns = turns(rig, clip);
    if let Some(map) = named.iter().find(|map| covers_trunk(rig, &map.joints_of(rig), &turns)) {
        return Ok(built_in(map.clone()));
    }
    match (recognise(rig, clip), named.into_iter().next()) {
        (Some(found), _) if found.is_sure() => Ok(FoundMap { map: found.map, by: FoundBy::Shape, made: false }),
        // it has at least the limbs
        (_, Some(map)) => Ok(built_in(map)),
        (found, None) => Err(reference::unknown_rig(rig.names(), None, found.as_ref())),
    }
}

/// A map with a reference pose in which the body stands: its own, else the rest pose, else one made from the clip. True if
/// it was made.
fn standing(map: SkeletonMap, rig: &Skeleton, clip: Option<&Clip>) -> (SkeletonMap, bool) {
    let joints = map.joints_of(rig);
    if !map.missing(rig.names()).is_empty() || (map.has_reference() && stand::is_straight(rig, &map, &joints)) {
        return (map, false);
    }
    let map = map.with_reference(rig, &[]);
    let turns = clip.map(|clip| stand::reference_if_none(rig, &joints, clip)).unwrap_or_default();
    let made = !turns.is_empty();
    (map.with_reference(rig, &turns), made)
}

/// Whether a map with these joints by SMPL id has the whole trunk: no joint that `turns` (J) between pelvis and neck is
/// below its spine1 or above its spine3. The only such joint of a trunk is the one that is nearer.
fn covers_trunk(rig: &Skeleton, joints: &[Option<usize>; 24], turns: &[bool]) -> bool {
    let trunk: Vec<usize> = trunk(rig, joints).into_iter().filter(|&j| turns[j]).collect();
    let (Some(&first), Some(&last)) = (trunk.first(), trunk.last()) else { return true };
    let spine = [3, 6, 9].map(|id| joints[id]);
    let (lowest, highest) = match spine {
        [Some(low), _, Some(high)] => (low, high),
        _ if first == last => {
            let neck = joints[12].or(rig.parents()[joints[16].unwrap_or(0)]).unwrap_or(0);
            return joints[id_of_one(rig, joints[0].unwrap_or(0), first, neck)] == Some(first);
        }
        _ => return false,
    };
    rig.descends(first, lowest) && rig.descends(highest, last)
}

/// The joints between the pelvis and the neck of a map with these joints by SMPL id, lowest first; without a neck, up to
/// where the shoulders part. Empty for a map without pelvis or shoulders.
pub(super) fn trunk(rig: &Skeleton, joints: &[Option<usize>; 24]) -> Vec<usize> {
    let (Some(pelvis), Some(left), Some(right)) = (joints[0], joints[16], joints[17]) else { return Vec::new() };
    let upwards = |j: usize| std::iter::successors(Some(j), |&j| rig.parents()[j]);
    let parting = upwards(left).find(|&j| rig.descends(right, j)).unwrap_or(0);
    let top = joints[12].map_or(parting, |neck| rig.parents()[neck].unwrap_or(0));
    let mut trunk: Vec<usize> = upwards(top).take_while(|&j| j != pelvis).collect();
    trunk.reverse();
    // a neck that hangs from no trunk
    if rig.descends(top, pelvis) { trunk } else { Vec::new() }
}

/// What is said of a rig that is recognised for sure, or whose reference pose is made from the clip.
pub(super) fn warning(found: &FoundMap) -> Option<Warning> {
    if found.by == FoundBy::Shape {
        let joints = (0..24).filter(|&id| found.map.joint(id).is_some()).count();
        let what = format!(
            "{joints} of SMPL's 24 joints, by shape and names; `kinelm inspect FILE --map-out my.toml` writes them"
        );
        return Some(Warning { kind: "rig_recognised", what });
    }
    let what = format!(
        "no body stands in the rig's rest pose, as the map {} needs it: its reference pose is made from the clip",
        found.map.name
    );
    found.made.then_some(Warning { kind: "rest_pose", what })
}
