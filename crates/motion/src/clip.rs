//! The clip: the one type that holds motion.

use crate::{Error, Quat, Result, Skeleton, Vec3};
use std::ops::Range;
use std::sync::Arc;

/// Motion of F frames and J joints on one skeleton.
///
/// ```
/// use kinelm_motion::{Clip, Quat, Vec3, smpl};
///
/// // a second of standing, 20 frames of SMPL's 24 joints
/// let root = Vec3::new(0.0, smpl::STANDING_PELVIS_M, 0.0);
/// let clip = Clip::new(smpl::neutral(), 20.0, vec![root; 20], vec![Quat::IDENTITY; 20 * 24])?;
/// assert_eq!((clip.frames(), clip.joints(), clip.duration_s()), (20, 24, 1.0));
/// let foot = clip.global_pose(0).positions[10];
/// assert!(foot.y.abs() < 1e-9, "on the floor");
/// # Ok::<(), kinelm_motion::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Clip {
    skeleton: Arc<Skeleton>,
    fps: f64,
    root: Vec<Vec3>,
    rotations: Vec<Quat>,
}

impl Clip {
    /// Makes a clip from `root` positions (F), metres, world, and local `rotations` (F, J). Quaternions are normalised.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the lengths don't fit, the rate is not positive and finite, a value is
    /// not finite, or a quaternion is zero; the message names frame and joint.
    pub fn new(skeleton: Arc<Skeleton>, fps: f64, root: Vec<Vec3>, mut rotations: Vec<Quat>) -> Result<Self> {
        let j = skeleton.joints();
        if !(fps.is_finite() && fps > 0.0) {
            return Err(Error::invalid("the rate of a clip", format!("{fps} frames per second"), "a positive number"));
        }
        if rotations.len() != root.len() * j {
            let (r, f) = (rotations.len(), root.len());
            let found = format!("{r} for {f} frames of {j} joints");
            return Err(Error::invalid("the number of rotations", found, (f * j).to_string()));
        }
        if let Some(f) = root.iter().position(|p| !p.is_finite()) {
            return Err(Error::invalid(format!("frame {f}: the root's position"), root[f], "finite numbers"));
        }
        for (i, q) in rotations.iter_mut().enumerate() {
            let n = q.length_squared();
            // negated, so that NaN is refused too
            if !(n.is_finite() && n > 1e-12) {
                let (f, name) = (i / j, &skeleton.names()[i % j]);
                let (what, found) = (format!("frame {f}, joint {name}: the rotation"), format!("{q:?}"));
                return Err(Error::invalid(what, found, "a finite quaternion that is not zero"));
            }
            // a quaternion that is unit to rounding stays as it is, so that making a clip again changes nothing
            if (n - 1.0).abs() > 4.0 * f64::EPSILON {
                *q = q.normalize();
            }
        }
        Ok(Clip { skeleton, fps, root, rotations })
    }

    /// F, the number of frames.
    pub fn frames(&self) -> usize {
        self.root.len()
    }

    /// J, the number of joints.
    pub fn joints(&self) -> usize {
        self.skeleton.joints()
    }

    /// Frames per second.
    pub fn fps(&self) -> f64 {
        self.fps
    }

    /// Seconds from the first frame to the end of the last: F / fps.
    pub fn duration_s(&self) -> f64 {
        self.frames() as f64 / self.fps
    }

    /// The skeleton.
    pub fn skeleton(&self) -> &Arc<Skeleton> {
        &self.skeleton
    }

    /// Root positions (F), metres, world.
    pub fn root(&self) -> &[Vec3] {
        &self.root
    }

    /// Local rotations (F, J), unit quaternions.
    pub fn rotations(&self) -> &[Quat] {
        &self.rotations
    }

    /// Local rotations (J) of one frame.
    pub fn pose(&self, frame: usize) -> &[Quat] {
        let j = self.joints();
        &self.rotations[frame * j..(frame + 1) * j]
    }

    /// A copy of a range of frames.
    ///
    /// # Panics
    /// If the range leaves the clip.
    pub fn slice(&self, frames: Range<usize>) -> Self {
        let j = self.joints();
        Clip {
            skeleton: self.skeleton.clone(),
            fps: self.fps,
            root: self.root[frames.clone()].to_vec(),
            rotations: self.rotations[frames.start * j..frames.end * j].to_vec(),
        }
    }

    /// Leaves these frames alone, in place.
    ///
    /// # Panics
    /// If the range leaves the clip.
    pub(crate) fn keep(&mut self, frames: Range<usize>) {
        let j = self.joints();
        keep(&mut self.root, frames.clone(), 1);
        keep(&mut self.rotations, frames, j);
    }

    /// The same motion with the root raised by `by_m` metres.
    pub fn raised(mut self, by_m: f64) -> Self {
        self.root.iter_mut().for_each(|p| p.y += by_m);
        self
    }

    /// The same motion with all lengths multiplied by `factor`.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when a position is not finite then.
    pub fn scaled(mut self, factor: f64) -> Result<Self> {
        self.skeleton = Arc::new(self.skeleton.scaled(factor));
        self.root.iter_mut().for_each(|p| *p *= factor);
        match self.root.iter().chain(self.skeleton.offsets()).find(|p| !p.is_finite()) {
            None => Ok(self),
            Some(far) => Err(Error::invalid("a position of the scaled clip", far, "finite numbers")),
        }
    }

    /// Whether it is on a rig.
    pub(crate) fn is_on(&self, rig: &Arc<Skeleton>) -> bool {
        // of most clips it is the very same one
        Arc::ptr_eq(&self.skeleton, rig) || self.skeleton == *rig
    }

    /// The same frames at another rate: the motion runs faster or slower, nothing is resampled.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the rate is not positive and finite.
    pub fn with_fps(self, fps: f64) -> Result<Self> {
        Clip::new(self.skeleton, fps, self.root, self.rotations)
    }

    /// The same rotations and root on another skeleton with as many joints.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the number of joints differs.
    pub fn with_skeleton(self, skeleton: Arc<Skeleton>) -> Result<Self> {
        Clip::new(skeleton, self.fps, self.root, self.rotations)
    }
}

/// Leaves these rows of `width` alone.
///
/// # Panics
/// If the range leaves the rows.
pub(crate) fn keep<T>(all: &mut Vec<T>, rows: Range<usize>, width: usize) {
    assert!(rows.end * width <= all.len(), "{rows:?} of {} rows", all.len() / width.max(1));
    all.truncate(rows.end * width);
    all.drain(..rows.start * width);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_joint() -> Arc<Skeleton> {
        Arc::new(Skeleton::new(vec!["a".into()], vec![None], vec![Vec3::ZERO], vec![]).unwrap())
    }

    #[test]
    fn nonsense_is_refused_with_its_place() {
        let bad =
            |fps, root: Vec<Vec3>, rot: Vec<Quat>| Clip::new(one_joint(), fps, root, rot).unwrap_err().to_string();
        assert!(bad(0.0, vec![], vec![]).contains("frames per second"));
        assert!(bad(f64::NAN, vec![], vec![]).contains("frames per second"));
        assert!(bad(20.0, vec![Vec3::ZERO], vec![]).contains("expected 1"));
        assert!(bad(20.0, vec![Vec3::ZERO, Vec3::NAN], vec![Quat::IDENTITY; 2]).contains("frame 1"));
        assert!(bad(20.0, vec![Vec3::ZERO], vec![Quat::from_xyzw(0.0, 0.0, 0.0, 0.0)]).contains("frame 0, joint a"));
    }

    #[test]
    fn no_frames_is_a_clip() {
        let c = Clip::new(one_joint(), 20.0, vec![], vec![]).unwrap();
        assert_eq!((c.frames(), c.duration_s()), (0, 0.0));
    }
}
