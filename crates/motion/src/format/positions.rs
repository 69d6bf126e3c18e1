//! Positions of joints and end sites, for programs that need no rotations.

#[cfg(feature = "amass")]
use super::npz::{Values, Writer};
use crate::{Clip, Vec3};
#[cfg(feature = "amass")]
use crate::{Error, Result};
#[cfg(feature = "amass")]
use std::path::Path;

/// World positions of N joints and end sites over F frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Positions {
    /// Names (N); an end site is `{parent}_end`.
    pub joints: Vec<String>,
    /// Parents (N); -1 for a root.
    pub parents: Vec<i32>,
    /// Frames per second.
    pub fps: f64,
    /// Positions (F, N), metres.
    pub positions: Vec<Vec3>,
}

impl Positions {
    /// The positions of a clip's joints, then of its end sites.
    ///
    /// A second end site of the same joint is named `{parent}_end2`, and so on.
    pub fn from_clip(clip: &Clip) -> Self {
        let skeleton = clip.skeleton();
        let mut joints = skeleton.names().to_vec();
        let mut parents: Vec<i32> = skeleton.parents().iter().map(|p| p.map_or(-1, |p| p as i32)).collect();
        let mut ends_of = vec![0; skeleton.joints()];
        for end in skeleton.ends() {
            ends_of[end.parent] += 1;
            let name = format!("{}_end", skeleton.names()[end.parent]);
            joints.push(if ends_of[end.parent] == 1 { name } else { format!("{name}{}", ends_of[end.parent]) });
            parents.push(end.parent as i32);
        }
        let mut positions = Vec::with_capacity(clip.frames() * joints.len());
        for f in 0..clip.frames() {
            let pose = clip.global_pose(f);
            positions.extend_from_slice(&pose.positions);
            positions.extend(pose.ends(skeleton));
        }
        Positions { joints, parents, fps: clip.fps(), positions }
    }

    /// F, the number of frames.
    pub fn frames(&self) -> usize {
        self.positions.len().checked_div(self.joints.len()).unwrap_or(0)
    }

    /// Saves [`Positions::write`] to a file, atomically.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`], and those of [`Positions::write`].
    #[cfg(feature = "amass")]
    pub fn save(&self, path: &Path) -> Result<()> {
        Ok(kinelm_store::files::write_whole(path, &self.write()?)?)
    }

    /// An `.npz` of `positions` (F, N, 3) float32 in metres, `joints` (N) text, `parents` (N) int32, `fps` a 0-d float64.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) for positions beyond 32-bit floats, and when the lengths don't fit.
    #[cfg(feature = "amass")]
    pub fn write(&self) -> Result<Vec<u8>> {
        let n = self.joints.len();
        if let Some(i) = self.positions.iter().position(|p| !p.as_vec3().is_finite()) {
            let (frame, joint) = (i / n, &self.joints[i % n]);
            let found = format!("{} m", self.positions[i]);
            return Err(Error::invalid(
                format!("frame {frame}, {joint}: the position"),
                found,
                "finite 32-bit numbers",
            ));
        }
        let flat: Vec<f32> = self.positions.iter().flat_map(|p| p.as_vec3().to_array()).collect();
        let mut npz = Writer::new();
        npz.add("positions", &[self.frames(), n, 3], Values::F32(&flat))?;
        npz.add("joints", &[n], Values::Text(&self.joints))?;
        npz.add("parents", &[n], Values::I32(&self.parents))?;
        npz.add("fps", &[], Values::F64(&[self.fps]))?;
        npz.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EndSite, Quat, Skeleton, smpl};
    use std::sync::Arc;

    #[test]
    fn a_standing_body() {
        let root = Vec3::new(0.0, smpl::STANDING_PELVIS_M, 0.0);
        let clip = Clip::new(smpl::neutral(), 20.0, vec![root], vec![Quat::IDENTITY; 24]).unwrap();
        let p = Positions::from_clip(&clip);
        assert_eq!((p.joints.len(), p.parents[0], p.parents[23], p.fps), (24, -1, 21, 20.0));
        assert!(p.positions[10].y.abs() < 1e-12);
    }

    #[test]
    fn end_sites_follow_the_joints() {
        let end = |y| EndSite { parent: 0, offset: Vec3::new(0.0, y, 0.0) };
        let s = Skeleton::new(vec!["a".into()], vec![None], vec![Vec3::ZERO], vec![end(1.0), end(2.0)]).unwrap();
        let clip = Clip::new(Arc::new(s), 20.0, vec![Vec3::X], vec![Quat::IDENTITY]).unwrap();
        let p = Positions::from_clip(&clip);
        assert_eq!(p.joints, ["a", "a_end", "a_end2"]);
        assert_eq!(p.parents, [-1, 0, 0]);
        assert_eq!(p.positions[2], Vec3::new(1.0, 2.0, 0.0));
    }
}
