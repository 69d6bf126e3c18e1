//! The map of a rig: the one that is given, else the built-in one of these joint names, else by recognition.

use super::recognise::trunk::id_of_one;
use super::recognise::{recognise, stand, turns};
use super::{SkeletonMap, reference};
use crate::{Clip, Error, Result, Skeleton, Warning};
use std::sync::atomic::{AtomicU64, Ordering};

/// The map that was found for a rig, bound to its joint names.
#[derive(Debug, Clone)]
pub struct FoundMap {
    /// The map.
    pub map: SkeletonMap,
    /// How it was found.
    pub by: FoundBy,
    /// Whether its reference pose was made from the clip, because no body stands in the one that it had.
    pub made: bool,
    /// The map before a body had to stand in its reference pose.
    named: SkeletonMap,
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
    /// Stated by the file.
    File,
}

impl FoundMap {
    /// A map with a reference pose in which the body of `rig` stands: its own, else the rest pose, else one made from the
    /// clip. The reference pose of a given map is used unchecked; a recognised rig has none to check.
    pub(super) fn standing(named: SkeletonMap, by: FoundBy, rig: &Skeleton, clip: Option<&Clip>) -> FoundMap {
        let joints = named.joints_of(rig);
        let is_own = match by {
            // a recognised rig's reference pose is always derived anew: its rest pose, or one from the clip
            FoundBy::Shape => false,
            FoundBy::Given if named.has_reference() => true,
            _ => {
                // without all required joints no pose can be judged; `ReferencePose::new` reports what is missing
                !named.missing(rig.names()).is_empty()
                    || (named.has_reference() && stand::is_straight(rig, &named, &joints))
            }
        };
        if is_own {
            return FoundMap { map: named.clone(), by, made: false, named };
        }
        let turns = match by {
            FoundBy::Shape => stand::reference(rig, &joints, clip),
            _ => clip.map(|clip| stand::reference_if_none(rig, &joints, clip)).unwrap_or_default(),
        };
        let made = by != FoundBy::Shape && !turns.is_empty();
        FoundMap { map: named.clone().with_reference(rig, &turns), by, made, named }
    }

    /// The map of a clip's rig whose file states the joints by SMPL id, if it has all that are required.
    pub(crate) fn stated(clip: &Clip, joints: &[Option<usize>; 24]) -> Option<FoundMap> {
        let rig = clip.skeleton();
        let map = SkeletonMap::of_joints(rig, joints, &[]).described("vrm", "as the file states");
        map.missing(rig.names()).is_empty().then(|| FoundMap::standing(map, FoundBy::File, rig, Some(clip)))
    }

    /// The same map for another view of the rig that it was found for: without the joints above its body, along other axes,
    /// of other frames. Nothing is searched; the reference pose is settled anew.
    pub(crate) fn on(&self, clip: &Clip) -> FoundMap {
        let rig = clip.skeleton();
        FoundMap::standing(self.named.bind_any(rig.names()), self.by, rig, Some(clip))
    }

    /// Whether the map or its reference pose comes from the file or from how the clip moves, so that another clip on the rig
    /// might give another one: whatever is derived from the clip has to store it.
    pub fn is_of_clip(&self) -> bool {
        matches!(self.by, FoundBy::Shape | FoundBy::File) || self.made
    }
}

/// The map of a rig: the one given by name or path, else the built-in one that fits the joint names, else the rig is
/// [recognised](recognise()).
///
/// # Errors
/// [`Unsupported`](kinelm_store::Error::Unsupported) when it isn't recognised for sure, with what is missing or doubtful
/// and a TOML to start from; those of [`SkeletonMap::by_name_or_file`].
pub fn map_for(rig: &Skeleton, map: Option<&str>) -> Result<SkeletonMap> {
    found(rig, None, map).map(|found| found.map)
}

/// As [`map_for`], for a rig that is recognised by how it moves too, with how the map was found.
///
/// # Errors
/// Those of [`map_for`].
pub fn find_map(clip: &Clip, map: Option<&str>) -> Result<FoundMap> {
    found(clip.skeleton(), Some(clip), map)
}

/// The map of a clip's rig, given by name or path and bound as far as it fits, else as [`find_map`] finds it, if it does.
///
/// # Errors
/// Those of [`SkeletonMap::by_name_or_file`].
pub(crate) fn map_if_any(clip: &Clip, map: Option<&str>) -> Result<Option<FoundMap>> {
    match (find_map(clip, map), map) {
        (Ok(found), _) => Ok(Some(found)),
        (Err(e), Some(_)) => Err(e),
        (Err(_), None) => Ok(None),
    }
}

/// How many rigs were searched for their map in this process, for tests that a file's is searched once.
#[doc(hidden)]
pub fn map_searches() -> u64 {
    SEARCHES.load(Ordering::Relaxed)
}

static SEARCHES: AtomicU64 = AtomicU64::new(0);

fn found(rig: &Skeleton, clip: Option<&Clip>, map: Option<&str>) -> Result<FoundMap> {
    if let Some(map) = map {
        let map = SkeletonMap::by_name_or_file(map)?.bind_any(rig.names());
        return Ok(FoundMap::standing(map, FoundBy::Given, rig, clip));
    }
    SEARCHES.fetch_add(1, Ordering::Relaxed);
    let named = SkeletonMap::fitting(rig.names());
    let built_in = |map: &SkeletonMap| FoundMap::standing(map.clone(), FoundBy::Names, rig, clip);
    // names identify limbs better than shape does, but rigs with these names differ in their trunks
    let turns = turns(rig, clip);
    if let Some(map) = named.iter().find(|map| covers_trunk(rig, &map.joints_of(rig), &turns)) {
        return Ok(built_in(map));
    }
    let recognised = recognise(rig, clip);
    if let Some(found) = recognised.as_ref().filter(|found| found.is_sure()) {
        let map = found.map.clone();
        return Ok(FoundMap { map: map.clone(), by: FoundBy::Shape, made: false, named: map });
    }
    // a built-in map without the whole trunk has at least the limbs
    let limbs = named.first().map(built_in);
    limbs.ok_or_else(|| reference::unknown_rig(rig.names(), None, recognised.as_ref()))
}

/// The error of a clip whose rig has no map.
pub(crate) fn unknown(clip: &Clip) -> Error {
    let rig = clip.skeleton();
    reference::unknown_rig(rig.names(), None, recognise(rig, Some(clip)).as_ref())
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
    // the neck branches off at the pelvis or above it: there is no trunk between
    if rig.descends(top, pelvis) { trunk } else { Vec::new() }
}

/// The warning about a rig that was recognised, or whose reference pose is made from the clip.
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
