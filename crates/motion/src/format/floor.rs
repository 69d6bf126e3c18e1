//! The floor of a motion as it was read: given by the caller or the source, else detected from the feet.

use super::{Motion, ReadOptions, Source};
use crate::{Error, Result, Warning};

/// Resolves the floor of a motion, metres: the one in `options`, else the one detected from the feet. Doubts are added to
/// the motion's warnings.
///
/// # Errors
/// Those of [`Motion::floor`]; [`Invalid`](kinelm_store::Error::Invalid) for a given floor that isn't finite.
pub fn resolve_floor(motion: &mut Motion, options: &ReadOptions) -> Result<f64> {
    let (height_m, doubts) = floor_and_doubts(motion, options)?;
    motion.warnings.extend(doubts);
    Ok(height_m)
}

/// [`resolve_floor`] of a motion that stays as it is, with the doubts beside it.
///
/// # Errors
/// Those of [`resolve_floor`].
pub fn floor_and_doubts(motion: &Motion, options: &ReadOptions) -> Result<(f64, Vec<Warning>)> {
    if let Some(given) = options.floor {
        let fault = || Error::invalid_parameter("floor", given, "a height in metres");
        return if given.is_finite() { Ok((given, Vec::new())) } else { Err(fault()) };
    }
    let floor = motion.floor()?;
    Ok((floor.height_m, floor.doubts.clone()))
}

/// The floor of a motion, metres: detected from the feet on the file's own rig ([`mod@crate::rig::floor`]), or known from
/// before the motion was retargeted.
///
/// # Errors
/// Those of [`Motion::floor`].
pub fn floor_height(motion: &Motion) -> Result<f64> {
    known_floor(motion).map_or_else(|| Ok(motion.floor()?.height_m), Ok)
}

/// The floor of a motion that was retargeted, metres.
pub(crate) fn known_floor(motion: &Motion) -> Option<f64> {
    match &motion.source {
        Source::Retargeted { floor_m } => Some(*floor_m),
        Source::Bvh(bvh) => bvh.floor_m,
        Source::Glb(glb) => glb.floor_m,
        Source::Vrma(vrma) => vrma.floor_m,
        _ => None,
    }
}
