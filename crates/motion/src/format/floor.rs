//! Where the floor of a motion is, as it was read: said by the caller or the source, else found by the feet.

use super::{Motion, ReadOptions, Source};
use crate::rig::{floor, map_for};
use crate::{Error, Result};

/// Where the floor of a motion is, as `options` tell it or as its feet do; in doubt the doubts join its warnings.
///
/// # Errors
/// As [`map_for`] and [`Feet::new`](crate::rig::Feet::new); [`Invalid`](kinelm_store::Error::Invalid) for a floor that is told and isn't finite.
pub fn resolve_floor(motion: &mut Motion, options: &ReadOptions) -> Result<f64> {
    if let Some(told) = options.floor {
        let fault = || Error::invalid("`floor`", told, "a height in metres");
        return if told.is_finite() { Ok(told) } else { Err(fault()) };
    }
    let map = map_for(motion.clip.skeleton(), options.map.as_deref())?;
    let floor = floor(&motion.clip, &map)?;
    motion.warnings.extend(floor.doubts);
    Ok(floor.height_m)
}

/// Where a motion's floor is, metres: found by the feet ([`mod@crate::rig::floor`]) on the file's own rig; of a motion that
/// was put on another body, where it was found before.
///
/// # Errors
/// A rig that no skeleton map knows, and those of [`Feet::new`](crate::rig::Feet::new).
pub fn floor_height(motion: &Motion, map: Option<&str>) -> Result<f64> {
    match &motion.source {
        Source::Retargeted { floor_m } => return Ok(*floor_m),
        Source::Bvh(bvh) => {
            if let Some(floor_m) = bvh.floor_m {
                return Ok(floor_m);
            }
        }
        _ => {}
    }
    let rig = motion.clip.skeleton();
    Ok(floor(&motion.clip, &map_for(rig, map)?)?.height_m)
}
