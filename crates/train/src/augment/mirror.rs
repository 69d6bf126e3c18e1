//! Mirrored windows: left and right are exchanged.

use crate::Result;
use kinelm_motion::{Clip, mirror};

/// The clip reflected in the plane x = 0 by [`mirror::mirror`].
///
/// # Errors
/// A clip that is not on the 24 SMPL joints, which decoded words are.
pub fn mirrored(clip: &Clip) -> Result<Clip> {
    Ok(mirror::mirror(clip)?)
}
