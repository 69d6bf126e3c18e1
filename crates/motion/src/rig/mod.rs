//! What is known about a rig from its joint names: corresponding SMPL joints, reference pose, feet, floor.
//!
//! A [`SkeletonMap`] names the joints, a [`ReferencePose`] is the T-pose or A-pose in which bodies are compared, and
//! [`Feet`] find the [`Floor`] of a clip. This module knows clips and skeletons, but no files of motion.

pub mod feet;
pub mod floor;
pub mod map;
pub mod reference;

pub use feet::Feet;
pub(crate) use feet::MADE_UP_TIP;
pub use floor::{Floor, floor};
pub use map::SkeletonMap;
pub use reference::ReferencePose;

use crate::{Result, Skeleton};

/// The map of a rig: the one given by name or path, else the built-in one that fits the joint names.
///
/// # Errors
/// [`Unsupported`](kinelm_store::Error::Unsupported) when none fits, with what the nearest map lacks and a TOML to start
/// from; those of [`SkeletonMap::by_name_or_file`].
pub fn map_for(rig: &Skeleton, map: Option<&str>) -> Result<SkeletonMap> {
    match map {
        Some(map) => SkeletonMap::by_name_or_file(map),
        None => SkeletonMap::detect(rig.names()).ok_or_else(|| reference::unknown_rig(rig.names(), None)),
    }
}

/// The map given by name or path, bound to these joints as far as it fits, else the built-in one that fits, if any.
///
/// # Errors
/// Those of [`SkeletonMap::by_name_or_file`].
pub(crate) fn map_if_any(names: &[String], map: Option<&str>) -> Result<Option<SkeletonMap>> {
    Ok(match map {
        Some(map) => Some(SkeletonMap::by_name_or_file(map)?.bind_any(names)),
        None => SkeletonMap::detect(names),
    })
}
