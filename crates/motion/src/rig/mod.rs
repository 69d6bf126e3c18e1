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
    if let Some(map) = SkeletonMap::detect(rig.names()) {
        return Ok(map);
    }
    match recognise(rig, clip) {
        Some(found) if found.is_sure() => Ok(found.map),
        found => Err(reference::unknown_rig(rig.names(), None, found.as_ref())),
    }
}

/// The map of a rig that no built-in map fits, as it is [recognised](recognise()) for sure by shape, movement and names.
pub fn recognised_map(clip: &Clip) -> Option<SkeletonMap> {
    if SkeletonMap::detect(clip.skeleton().names()).is_some() {
        return None;
    }
    recognise(clip.skeleton(), Some(clip)).filter(Recognised::is_sure).map(|found| found.map)
}

/// The map given by name or path, bound to these joints as far as it fits, else as [`map_for`] finds it, if it does; `clip`
/// shows how the rig moves.
///
/// # Errors
/// Those of [`SkeletonMap::by_name_or_file`].
pub(crate) fn map_if_any(rig: &Skeleton, clip: Option<&Clip>, map: Option<&str>) -> Result<Option<SkeletonMap>> {
    Ok(match map {
        Some(map) => Some(SkeletonMap::by_name_or_file(map)?.bind_any(rig.names())),
        None => SkeletonMap::detect(rig.names())
            .or_else(|| recognise(rig, clip).filter(Recognised::is_sure).map(|found| found.map)),
    })
}
