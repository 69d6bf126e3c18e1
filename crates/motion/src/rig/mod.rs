//! What is known about a rig: corresponding SMPL joints, reference pose, feet, floor.
//!
//! A [`SkeletonMap`] names the joints; rigs without one are [recognised](recognise()) by shape and names. A [`ReferencePose`] is the T-pose or A-pose in which bodies are compared, and
//! [`Feet`] find the [`Floor`] of a clip. This module knows clips and skeletons, but no files of motion.

pub mod feet;
pub mod floor;
pub mod map;
pub mod recognise;
pub mod reference;

pub use feet::Feet;
pub(crate) use feet::MADE_UP_TIP;
pub use floor::{Floor, floor};
pub use map::SkeletonMap;
pub use recognise::{Recognised, recognise};
pub use reference::ReferencePose;

use crate::{Clip, Result, Skeleton};

/// The map of a rig: the one given by name or path, else the built-in one that fits the joint names, else the rig is
/// [recognised](recognise()).
///
/// # Errors
/// [`Unsupported`](kinelm_store::Error::Unsupported) when it isn't recognised for sure, with what is missing or doubtful
/// and a TOML to start from; those of [`SkeletonMap::by_name_or_file`].
pub fn map_for(rig: &Skeleton, map: Option<&str>) -> Result<SkeletonMap> {
    find_map(rig, None, map)
}

/// As [`map_for`], for a rig that is recognised by how it moves too.
///
/// # Errors
/// Those of [`map_for`].
pub fn map_of(clip: &Clip, map: Option<&str>) -> Result<SkeletonMap> {
    find_map(clip.skeleton(), Some(clip), map)
}

fn find_map(rig: &Skeleton, clip: Option<&Clip>, map: Option<&str>) -> Result<SkeletonMap> {
    if let Some(map) = map {
        return SkeletonMap::by_name_or_file(map);
    }
    if let Some(map) = built_in(rig, clip) {
        return Ok(map);
    }
    match recognise(rig, clip) {
        Some(found) if found.is_sure() => Ok(found.map),
        found => Err(reference::unknown_rig(rig.names(), None, found.as_ref())),
    }
}

/// The built-in map that fits the joint names. If it has no reference pose, and no body stands in the rest pose, it gets the
/// one that the clip shows.
fn built_in(rig: &Skeleton, clip: Option<&Clip>) -> Option<SkeletonMap> {
    SkeletonMap::detect(rig.names()).map(|map| standing(map, rig, clip))
}

fn standing(map: SkeletonMap, rig: &Skeleton, clip: Option<&Clip>) -> SkeletonMap {
    let turns = clip.filter(|_| !map.has_reference()).map(|clip| {
        let joints = std::array::from_fn(|id| map.joint(id).and_then(|name| rig.find(name)));
        recognise::stand::reference_if_none(rig, &joints, clip)
    });
    match turns {
        Some(turns) => map.with_reference(rig, &turns),
        None => map,
    }
}

/// The map of a rig that shows only in how it moves, wholly or its reference pose: one that no built-in map fits and that
/// is [recognised](recognise()) for sure, or one whose rest pose is none to compare bodies in.
pub fn recognised_map(clip: &Clip) -> Option<SkeletonMap> {
    if let Some(map) = SkeletonMap::detect(clip.skeleton().names()) {
        return made_to_stand(map, clip);
    }
    recognise(clip.skeleton(), Some(clip)).filter(Recognised::is_sure).map(|found| found.map)
}

/// A built-in map that gets its reference pose from the clip; `None` if it needs none.
pub(crate) fn made_to_stand(map: SkeletonMap, clip: &Clip) -> Option<SkeletonMap> {
    let has_own = map.has_reference();
    Some(standing(map, clip.skeleton(), Some(clip))).filter(|map| !has_own && map.has_reference())
}

/// The map given by name or path, bound to these joints as far as it fits, else as [`map_for`] finds it, if it does; `clip`
/// shows how the rig moves.
///
/// # Errors
/// Those of [`SkeletonMap::by_name_or_file`].
pub(crate) fn map_if_any(rig: &Skeleton, clip: Option<&Clip>, map: Option<&str>) -> Result<Option<SkeletonMap>> {
    Ok(match map {
        Some(map) => Some(SkeletonMap::by_name_or_file(map)?.bind_any(rig.names())),
        None => built_in(rig, clip).or_else(|| recognise(rig, clip).filter(Recognised::is_sure).map(|found| found.map)),
    })
}
