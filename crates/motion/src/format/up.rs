//! The up axis of a file, and the rotation of its clip to y up.

use super::MirrorAxis;
use crate::rotation::Mat3;
use crate::{Clip, EndSite, Quat, Result, Skeleton, Vec3};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

/// The up axis of a file's world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Up {
    /// Inferred from how the body stands for BVH and AMC; defined by the format for other files.
    #[default]
    #[serde(rename = "auto")]
    Auto,
    /// +x.
    #[serde(rename = "x")]
    X,
    /// -x.
    #[serde(rename = "-x")]
    #[cfg_attr(feature = "clap", value(name = "-x"))]
    NegX,
    /// +y.
    #[serde(rename = "y")]
    Y,
    /// -y.
    #[serde(rename = "-y")]
    #[cfg_attr(feature = "clap", value(name = "-y"))]
    NegY,
    /// +z.
    #[serde(rename = "z")]
    Z,
    /// -z.
    #[serde(rename = "-z")]
    #[cfg_attr(feature = "clap", value(name = "-z"))]
    NegZ,
}

impl fmt::Display for Up {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Up::Auto => "auto",
            Up::X => "x",
            Up::NegX => "-x",
            Up::Y => "y",
            Up::NegY => "-y",
            Up::Z => "z",
            Up::NegZ => "-z",
        })
    }
}

impl Up {
    /// The six axes; of two that fit equally well the first is used.
    pub(super) const AXES: [Up; 6] = [Up::Y, Up::Z, Up::X, Up::NegZ, Up::NegX, Up::NegY];

    /// The rotation by quarter turns that brings this axis to +y: x to (-y, x, z), -x to (y, -x, z), -y to (x, -y, -z), z to
    /// (x, z, -y), -z to (x, -z, y).
    pub(super) fn turn(self) -> Mat3 {
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        // the columns are the images of the file's x, y and z
        let [a, b, c] = match self {
            Up::Auto | Up::Y => [x, y, z],
            Up::NegY => [x, -y, -z],
            Up::X => [y, -x, z],
            Up::NegX => [-y, x, z],
            Up::Z => [x, -z, y],
            Up::NegZ => [x, z, -y],
        };
        Mat3::from_cols(a, b, c)
    }

    /// The axis of a file with this up axis that points along `clip`, an axis of its clip.
    pub(super) fn in_file(self, clip: Up) -> Up {
        let axis = self.turn().transpose() * clip.axis();
        // dot products of two axes are -1, 0 or 1
        Up::AXES.into_iter().find(|up| up.axis().dot(axis) > 0.5).unwrap_or(self)
    }

    /// The axis as a vector.
    pub(super) fn axis(self) -> Vec3 {
        self.turn().transpose() * Vec3::Y
    }
}

/// How a file's axes are rotated to a clip's, where y is up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Axes {
    /// The file's up axis, never [`Up::Auto`].
    pub up: Up,
    /// Whether the bones of the rest pose stand along that axis too, as when a program rotated the whole file. If not, they
    /// stand along y and only the motion was rotated.
    pub rest_too: bool,
    /// Where the up axis is known from.
    pub by: UpSource,
    /// The axis along which the file's world is mirrored, if the caller says so.
    pub mirror: Option<MirrorAxis>,
}

/// How an up axis was determined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UpSource {
    /// Given by the caller or the format.
    Given,
    /// Inferred: rest pose and motion agree.
    Inferred,
    /// Inferred: rest pose and motion disagree, and the feet stand on a floor along this axis alone.
    Feet,
    /// Ambiguous: rest pose and motion disagree, or the body doesn't stand.
    Ambiguous,
    /// Unknown: no skeleton map fits the joints.
    Unknown,
}

impl Axes {
    /// y up, as in a clip.
    pub const OWN: Axes = Axes { up: Up::Y, rest_too: true, by: UpSource::Given, mirror: None };

    /// The same axes in a world that is mirrored, if it is.
    pub(crate) fn mirrored(self, mirror: Option<MirrorAxis>) -> Axes {
        Axes { mirror, ..self }
    }

    /// Rotates a clip from the file's axes to y up, out of the mirror first.
    ///
    /// # Errors
    /// None for a finite clip.
    pub(crate) fn to_y_up(self, clip: Clip) -> Result<Clip> {
        let clip = match self.mirror {
            Some(axis) => axis.clip(&clip)?,
            None => clip,
        };
        if self.up == Up::Y { Ok(clip) } else { self.turned(&clip, self.up.turn()) }
    }

    /// Rotates a clip with y up to the file's axes.
    ///
    /// # Errors
    /// None for a finite clip.
    pub(crate) fn restored<'a>(&self, clip: &'a Clip) -> Result<Cow<'a, Clip>> {
        let turned = match self.up {
            Up::Y => Cow::Borrowed(clip),
            up => Cow::Owned(self.turned(clip, up.turn().transpose())?),
        };
        match self.mirror {
            Some(axis) => axis.clip(&turned).map(Cow::Owned),
            None => Ok(turned),
        }
    }

    /// Rotates a clip's skeleton to the file's axes.
    ///
    /// # Errors
    /// None for a finite skeleton.
    pub(crate) fn skeleton_from_y_up(&self, own: &Arc<Skeleton>) -> Result<Arc<Skeleton>> {
        let turned = match self.up == Up::Y || !self.rest_too {
            true => own.clone(),
            false => Arc::new(skeleton(own, self.up.turn().transpose())?),
        };
        match self.mirror {
            Some(axis) => axis.skeleton(&turned).map(Arc::new),
            None => Ok(turned),
        }
    }

    /// Rotates a position of the file's world to y up.
    pub(crate) fn position_to_y_up(&self, place: Vec3) -> Vec3 {
        self.up.turn() * self.mirror.map_or(place, |axis| axis.place(place))
    }

    fn turned(&self, clip: &Clip, turn: Mat3) -> Result<Clip> {
        let root = clip.root().iter().map(|&p| turn * p).collect();
        let joints = clip.joints();
        let (skeleton, rotations) = if self.rest_too {
            // conjugation by the turn rotates only the vector part; a quarter turn then exchanges exact numbers
            let along = |q: &Quat| {
                let v = turn * q.xyz();
                Quat::from_xyzw(v.x, v.y, v.z, q.w)
            };
            (Arc::new(skeleton(clip.skeleton(), turn)?), clip.rotations().iter().map(along).collect())
        } else {
            let q = Quat::from_mat3(&turn);
            // other joints rotate relative to the root, so they turn with it
            let at_root = |(i, &r): (usize, &Quat)| if i % joints == 0 { q * r } else { r };
            (clip.skeleton().clone(), clip.rotations().iter().enumerate().map(at_root).collect())
        };
        Clip::new(skeleton, clip.fps(), root, rotations)
    }
}

/// A skeleton with all bones rotated.
pub(super) fn skeleton(skeleton: &Skeleton, turn: Mat3) -> Result<Skeleton> {
    let ends = skeleton.ends().iter().map(|e| EndSite { parent: e.parent, offset: turn * e.offset });
    let offsets = skeleton.offsets().iter().map(|&o| turn * o).collect();
    Skeleton::new(skeleton.names().to_vec(), skeleton.parents().to_vec(), offsets, ends.collect())
}
