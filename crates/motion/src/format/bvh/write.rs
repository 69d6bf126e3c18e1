//! Writing clips as BVH: on the rig they came from, or on a default rig.

use super::frame_time;
use super::print::print;
use crate::format::source::bvh::{BvhSource, Channel};
use crate::{Clip, Error, Motion, Result, Source};
use std::borrow::Cow;

/// The bytes of a motion as BVH: on the rig of its BVH source if the joints are the same, else on a default rig in
/// centimetres. A clip unchanged since reading is written with the file's own numbers.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) or [`Limit`](kinelm_store::Error::Limit) for a clip that a BVH can't hold
/// (nesting, a rate below 1).
pub fn to_bytes(motion: &Motion) -> Result<Vec<u8>> {
    rig_of(motion)?.to_bytes(&motion.clip)
}

/// Like [`to_bytes`], in a unit of `metres`.
///
/// # Errors
/// Those of [`to_bytes`].
pub fn to_bytes_in(motion: &Motion, metres: f64) -> Result<Vec<u8>> {
    rig_of(motion)?.in_unit(metres).to_bytes(&motion.clip)
}

fn rig_of(motion: &Motion) -> Result<Cow<'_, BvhSource>> {
    match &motion.source {
        Source::Bvh(source) if source.fits(&motion.clip) => Ok(Cow::Borrowed(source)),
        _ => BvhSource::for_skeleton(motion.clip.skeleton()).map(Cow::Owned),
    }
}

impl BvhSource {
    /// The same rig in another unit: scales OFFSETs and positions.
    fn in_unit(&self, metres: f64) -> BvhSource {
        let scale = self.rig.unit_m / metres;
        let mut other = self.clone();
        if scale == 1.0 {
            return other;
        }
        other.rig.unit_m = metres;
        other.head.nodes.iter_mut().flat_map(|node| &mut node.offset).for_each(|x| *x *= scale);
        other.head.write_nodes();
        let channels = self.head.nodes.iter().flat_map(|node| &node.channels);
        let lengths: Vec<bool> = channels.map(|channel| matches!(channel, Channel::Position(_))).collect();
        for row in other.numbers.chunks_mut(self.head.width.max(1)) {
            row.iter_mut().zip(&lengths).filter(|(_, is_length)| **is_length).for_each(|(x, _)| *x *= scale);
        }
        other
    }

    /// Whether a clip has this rig's joint names and parents.
    pub fn fits(&self, clip: &Clip) -> bool {
        let (own, its) = (&self.rig.skeleton, clip.skeleton());
        own.names() == its.names() && own.parents() == its.parents()
    }

    /// The bytes of a clip on this rig, at the clip's own rate and with any number of frames.
    ///
    /// Header, names, orders, end sites, unit, axes and line ends are the rig's. What the rig lacks for the clip (another
    /// OFFSET, a rotation channel, position channels of the root) is added to the header, so that no motion is lost. Other
    /// roots keep the rows nearest in time.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the joints differ or the rate is below 1.
    pub fn to_bytes(&self, clip: &Clip) -> Result<Vec<u8>> {
        if !self.fits(clip) {
            let (own, its) = (self.rig.skeleton.joints(), clip.joints());
            let expected = format!("the rig's {own} joints, of the same names and parents");
            return Err(Error::invalid("the clip to write as BVH", format!("one of {its} joints"), expected));
        }
        let (own, same) = (&self.head.frame_time, self.fps() == clip.fps());
        let time = |keep: bool| if keep { Ok(own.clone()) } else { frame_time::text(clip.fps()) };
        // the file's own numbers, without the rounding of a way through quaternions
        if self.is_untouched(clip) {
            return print(&self.head, &time(same)?, clip.frames(), &self.numbers);
        }
        let time = time(same && frame_time::is_exact(own, clip.fps()))?;
        let clip = self.rig.axes.restored(clip)?;
        let rig = self.for_clip(&clip)?;
        let numbers = rig.rows(&clip, self);
        print(&rig.head, &time, clip.frames(), &numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{ReadOptions, Unit, bvh};
    use crate::{Clip, synth};
    use std::path::Path;

    #[test]
    fn another_unit_is_the_same_motion() {
        let dance: Clip = synth::corpus(1, 1, 6.0, 30.0).unwrap().remove(0).clip;
        let motion = Motion::new("a.bvh", dance);
        let centimetres = to_bytes(&motion).unwrap();
        let read = |bytes: &[u8], unit: Unit| {
            bvh::read(Path::new("a.bvh"), bytes, &ReadOptions { unit, ..Default::default() }).unwrap()
        };
        let own = read(&centimetres, Unit::CENTIMETRE);
        assert_eq!(to_bytes_in(&own, 0.01).unwrap(), centimetres);
        for (unit, metres) in [(Unit::METRE, 1.0), (Unit::INCH, 0.0254), (Unit::MILLIMETRE, 0.001)] {
            let other = read(&to_bytes_in(&own, metres).unwrap(), unit);
            let (a, b) = (own.clip.positions(), other.clip.positions());
            let far = a.iter().zip(&b).map(|(a, b)| (*a - *b).length()).fold(0.0, f64::max);
            assert!(a.len() == b.len() && far < 2e-5, "{unit:?}: {far}");
            // inferred from the leg, not given
            assert!(
                (read(&to_bytes_in(&own, metres).unwrap(), Unit::Auto).clip.root()[0] - own.clip.root()[0]).length()
                    < 2e-5
            );
        }
    }
}
