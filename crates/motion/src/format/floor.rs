//! The floor of a motion as it was read: given by the caller or the source, else detected from the feet.

use super::{Motion, ReadOptions, Source};
use crate::rig::{floor, map_of};
use crate::{Error, Result};

/// Resolves the floor of a motion, metres: the one in `options`, else the one detected from the feet. Doubts are added to
/// the motion's warnings.
///
/// # Errors
/// Those of [`map_of`] and [`Feet::new`](crate::rig::Feet::new); [`Invalid`](kinelm_store::Error::Invalid) for a given floor
/// that isn't finite.
pub fn resolve_floor(motion: &mut Motion, options: &ReadOptions) -> Result<f64> {
    if let Some(given) = options.floor {
        let fault = || Error::invalid("`floor`", given, "a height in metres");
        return if given.is_finite() { Ok(given) } else { Err(fault()) };
    }
    let map = map_of(&motion.clip, options.map.as_deref())?;
    let floor = floor(&motion.clip, &map)?;
    motion.warnings.extend(floor.doubts);
    Ok(floor.height_m)
}

/// The floor of a motion, metres: detected from the feet on the file's own rig ([`mod@crate::rig::floor`]), or known from
/// before the motion was retargeted.
///
/// # Errors
/// Those of [`map_of`] and [`Feet::new`](crate::rig::Feet::new).
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
    Ok(floor(&motion.clip, &map_of(&motion.clip, map)?)?.height_m)
}
