//! Undoing a reflection: files of a left-handed world show bodies in a mirror.

use crate::{Clip, EndSite, Quat, Result, Skeleton, Vec3};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

/// The axis of a file's world along which its bodies are mirrored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum MirrorAxis {
    /// Left and right of the file's world are exchanged along x.
    X,
    /// Along y.
    Y,
    /// Along z.
    Z,
}

impl fmt::Display for MirrorAxis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            MirrorAxis::X => "x",
            MirrorAxis::Y => "y",
            MirrorAxis::Z => "z",
        })
    }
}

impl MirrorAxis {
    /// The reflection: the component along the axis changes its sign.
    fn signs(self) -> Vec3 {
        match self {
            MirrorAxis::X => Vec3::new(-1.0, 1.0, 1.0),
            MirrorAxis::Y => Vec3::new(1.0, -1.0, 1.0),
            MirrorAxis::Z => Vec3::new(1.0, 1.0, -1.0),
        }
    }

    /// A position in the mirror.
    pub(super) fn place(self, place: Vec3) -> Vec3 {
        place * self.signs()
    }

    /// A skeleton in the mirror.
    ///
    /// # Errors
    /// None for a finite skeleton.
    pub(super) fn skeleton(self, skeleton: &Skeleton) -> Result<Skeleton> {
        let ends = skeleton.ends().iter().map(|e| EndSite { parent: e.parent, offset: self.place(e.offset) });
        let offsets = skeleton.offsets().iter().map(|&o| self.place(o)).collect();
        Skeleton::new(skeleton.names().to_vec(), skeleton.parents().to_vec(), offsets, ends.collect())
    }

    /// A clip in the mirror; twice is the same clip again, bit for bit.
    ///
    /// # Errors
    /// None for a finite clip.
    pub(super) fn clip(self, clip: &Clip) -> Result<Clip> {
        // rotations are about pseudovectors
        let turned = |q: &Quat| {
            let v = -self.place(q.xyz());
            Quat::from_xyzw(v.x, v.y, v.z, q.w)
        };
        let root = clip.root().iter().map(|&p| self.place(p)).collect();
        let rotations = clip.rotations().iter().map(turned).collect();
        Clip::new(Arc::new(self.skeleton(clip.skeleton())?), clip.fps(), root, rotations)
    }
}
