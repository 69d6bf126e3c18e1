//! Clips to BVH: back onto the rig they came from, or onto a plain one.

use super::print::print;
use super::{BvhSource, frame_time};
use crate::format::atomic;
use crate::{Clip, Error, Motion, Result, Source};
use std::path::Path;

/// Writes a motion: on the rig of its BVH source where the joints are still the same, else on a plain one in centimetres.
///
/// A clip untouched since reading is written from the file's own numbers. The file appears whole or not at all.
///
/// # Errors
/// [`Error::Io`], and [`Error::Call`] for a clip that no BVH can hold (nesting, a rate below 1).
pub fn write(path: &Path, motion: &Motion) -> Result<()> {
    atomic::write(path, &to_bytes(motion)?)
}

/// The bytes that [`write()`] writes.
///
/// # Errors
/// [`Error::Call`] for a clip that no BVH can hold (nesting, a rate below 1).
pub fn to_bytes(motion: &Motion) -> Result<Vec<u8>> {
    match &motion.source {
        Source::Bvh(source) if source.fits(&motion.clip) => source.to_bytes(&motion.clip),
        _ => BvhSource::plain(motion.clip.skeleton())?.to_bytes(&motion.clip),
    }
}

impl BvhSource {
    /// Whether a clip has this rig's joints: the same names and parents.
    pub fn fits(&self, clip: &Clip) -> bool {
        let (own, its) = (&self.rig.skeleton, clip.skeleton());
        own.names() == its.names() && own.parents() == its.parents()
    }

    /// Writes any clip with this rig's joints, at the clip's own rate and with as many frames as it has.
    ///
    /// Header, names, orders, end sites, unit, axes and line ends are the rig's. Where a clip needs what the rig lacks (another
    /// OFFSET, a turn about an axis that a joint has no channel for, a place for a root without position channels), that
    /// is added to the header, so that the motion is never cut. Of other roots the rows nearest in time are kept.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Call`] when the joints are others or the rate is below 1.
    pub fn write_clip(&self, path: &Path, clip: &Clip) -> Result<()> {
        atomic::write(path, &self.to_bytes(clip)?)
    }

    /// The bytes that [`BvhSource::write_clip`] writes.
    ///
    /// # Errors
    /// [`Error::Call`] when the joints are others or the rate is below 1.
    pub fn to_bytes(&self, clip: &Clip) -> Result<Vec<u8>> {
        if !self.fits(clip) {
            let (own, its) = (self.rig.skeleton.joints(), clip.joints());
            return Err(Error::Call(format!(
                "a clip of {its} joints for a rig of {own}; expected the same names and parents"
            )));
        }
        let (own, same) = (&self.head.frame_time, self.fps() == clip.fps());
        let time = |keep: bool| if keep { Ok(own.clone()) } else { frame_time::text(clip.fps()) };
        if self.is_untouched(clip) {
            return Ok(print(&self.head, &time(same)?, clip.frames(), &self.numbers));
        }
        let time = time(same && frame_time::is_exact(own, clip.fps()))?;
        let clip = self.rig.axes.lay_back(clip)?;
        let rig = self.for_clip(&clip)?;
        let numbers = rig.rows(&clip, self);
        not_finite(&numbers, rig.head.width)?;
        Ok(print(&rig.head, &time, clip.frames(), &numbers))
    }
}

/// Refuses rows (F, `width`) with a number that no file can hold.
pub(super) fn not_finite(numbers: &[f64], width: usize) -> Result<()> {
    let Some(at) = numbers.iter().position(|x| !x.is_finite()) else { return Ok(()) };
    let (frame, found) = (at / width.max(1), numbers[at]);
    let expected = "expected numbers, as of a body of some metres";
    Err(Error::Call(format!("frame {frame}: {found} in the unit of a BVH; {expected}")))
}
