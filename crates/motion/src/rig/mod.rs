//! What is known of a rig whose joints have names: which SMPL joints they play, how it stands, where its feet are.
//!
//! A [`SkeletonMap`] names the joints, a [`ReferencePose`] is the T or A stand in which bodies are compared, [`Feet`] are
//! what it stands on, and with them the [`Floor`] of a clip is found. It knows clips and skeletons, and no files of motion.

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

/// The map of a rig: the named or given one, else the shipped one whose names are there.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) when none fits, with what the nearest lacks and a TOML to begin with, and those of
/// [`SkeletonMap::by_name_or_file`].
pub fn map_for(rig: &Skeleton, map: Option<&str>) -> Result<SkeletonMap> {
    match map {
        Some(map) => SkeletonMap::by_name_or_file(map),
        None => SkeletonMap::detect(rig.names()).ok_or_else(|| reference::unknown_rig(rig.names(), None)),
    }
}

/// The named or given map as far as it fits these joints, else the shipped one that does, if any.
///
/// # Errors
/// Those of [`SkeletonMap::by_name_or_file`].
pub(crate) fn map_if_any(names: &[String], map: Option<&str>) -> Result<Option<SkeletonMap>> {
    Ok(match map {
        Some(map) => Some(SkeletonMap::by_name_or_file(map)?.bind_any(names)),
        None => SkeletonMap::detect(names),
    })
}
