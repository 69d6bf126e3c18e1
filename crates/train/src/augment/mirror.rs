//! Windows in a mirror: left and right change places.

use crate::Result;
use kinelm_motion::{Clip, mirror};

/// The clip reflected in the plane x = 0, as [`mirror::mirror`] does. Its places and steps change their x alone.
///
/// # Errors
/// A clip that is not on the 24 SMPL joints, which decoded words are.
pub fn mirrored(clip: &Clip) -> Result<Clip> {
    Ok(mirror::mirror(clip)?)
}
