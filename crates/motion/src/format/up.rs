//! The up axis of a file: given by the caller, or inferred from how the body stands.

use super::MirrorAxis;
use crate::rig::SkeletonMap;
use crate::rotation::Mat3;
use crate::{Clip, EndSite, GlobalPose, Quat, Result, Skeleton, Vec3};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

/// A body stands along an axis if their cosine is at least this.
const STANDS: f64 = 0.7;
/// Frames that are examined, evenly spaced.
const FRAMES: usize = 600;

/// The up axis of a file's world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Up {
    /// Inferred from how the body stands for a BVH; defined by the format for other files.
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
    const AXES: [Up; 6] = [Up::Y, Up::Z, Up::X, Up::NegZ, Up::NegX, Up::NegY];

    /// The rotation by quarter turns that brings this axis to +y: x to (-y, x, z), -x to (y, -x, z), -y to (x, -y, -z), z to
    /// (x, z, -y), -z to (x, -z, y).
    fn turn(self) -> Mat3 {
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

    /// The axis as a vector.
    fn axis(self) -> Vec3 {
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

    /// The axes of a clip in its file's own axes, given the requested `up`; with a doubt if they are ambiguous.
    pub(crate) fn of(clip: &Clip, up: Up, map: Option<&SkeletonMap>) -> (Axes, Option<String>) {
        let rest = map.and_then(|map| rest(clip.skeleton(), map));
        if up != Up::Auto {
            // a program that rotates a file rotates its rest pose too, unless that still stands along y
            let rest_too = !rest.is_some_and(|rest| rest.up == Up::Y && rest.cosine >= STANDS);
            return (Axes { up, rest_too, ..Axes::OWN }, None);
        }
        let motion = map.and_then(|map| motion(clip, map));
        let (Some(rest), Some(motion)) = (rest, motion) else {
            return (Axes { by: UpSource::Unknown, ..Axes::OWN }, None);
        };
        if motion.cosine >= STANDS && motion.up == rest.up {
            return (Axes { up: motion.up, by: UpSource::Inferred, ..Axes::OWN }, None);
        }
        // a rest pose that doesn't stand doesn't contradict a motion along y
        if motion.cosine >= STANDS && motion.up == Up::Y && rest.cosine < STANDS {
            return (Axes { by: UpSource::Inferred, ..Axes::OWN }, None);
        }
        let doubt = if motion.cosine < STANDS {
            format!("the body stands along no axis (nearest {}, cosine {:.2})", motion.up, motion.cosine)
        } else {
            format!("the body moves as if {} were up, its rest pose stands along {}", motion.up, rest.up)
        };
        let doubt = format!("{doubt}: read with y up; if another axis is, give `up`: x, -x, -y, z or -z");
        (Axes { by: UpSource::Ambiguous, ..Axes::OWN }, Some(doubt))
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
            let along = |q: &Quat| {
                let v = turn * q.xyz();
                Quat::from_xyzw(v.x, v.y, v.z, q.w)
            };
            (Arc::new(skeleton(clip.skeleton(), turn)?), clip.rotations().iter().map(along).collect())
        } else {
            let q = Quat::from_mat3(&turn);
            let at_root = |(i, &r): (usize, &Quat)| if i % joints == 0 { q * r } else { r };
            (clip.skeleton().clone(), clip.rotations().iter().enumerate().map(at_root).collect())
        };
        Clip::new(skeleton, clip.fps(), root, rotations)
    }
}

/// A skeleton with all bones rotated.
fn skeleton(skeleton: &Skeleton, turn: Mat3) -> Result<Skeleton> {
    let ends = skeleton.ends().iter().map(|e| EndSite { parent: e.parent, offset: turn * e.offset });
    let offsets = skeleton.offsets().iter().map(|&o| turn * o).collect();
    Skeleton::new(skeleton.names().to_vec(), skeleton.parents().to_vec(), offsets, ends.collect())
}

/// The axis of a clip along which its body stands in most frames; `None` where no map shows the body, or without frames.
pub fn standing_axis(clip: &Clip, map: &SkeletonMap) -> Option<Up> {
    motion(clip, map).map(|found| found.up)
}

/// The axis along which a body stands, and how well.
#[derive(Debug, Clone, Copy)]
struct Uprightness {
    up: Up,
    /// The smaller of two cosines with the axis: ankles to pelvis, pelvis to head.
    cosine: f64,
}

/// The axis with the highest score.
fn best(how_well: impl Fn(Up) -> f64) -> Up {
    let mut best = (Up::Y, how_well(Up::Y));
    for up in Up::AXES {
        let it = how_well(up);
        if it > best.1 + 1e-9 {
            best = (up, it);
        }
    }
    best.0
}

/// The joints that show how a body stands.
struct Body {
    pelvis: usize,
    hips: [usize; 2],
    ankles: [usize; 2],
    /// The head, else the neck, else both shoulders.
    top: Vec<usize>,
}

impl Body {
    fn of(skeleton: &Skeleton, map: &SkeletonMap) -> Option<Body> {
        let joint = |id: usize| map.joint(id).and_then(|name| skeleton.find(name));
        let top = match joint(15).or_else(|| joint(12)) {
            Some(top) => vec![top],
            None => vec![joint(16)?, joint(17)?],
        };
        Some(Body { pelvis: joint(0)?, hips: [joint(1)?, joint(2)?], ankles: [joint(7)?, joint(8)?], top })
    }

    /// Directions from the ankles to the pelvis and from the pelvis to the head; zero for a body without length.
    fn bones(&self, positions: &[Vec3]) -> [Vec3; 2] {
        let mean = |joints: &[usize]| joints.iter().map(|&j| positions[j]).sum::<Vec3>() / joints.len() as f64;
        let pelvis = positions[self.pelvis];
        [pelvis - mean(&self.ankles), mean(&self.top) - pelvis].map(Vec3::normalize_or_zero)
    }
}

/// How the reference pose would stand if it were rotated for each axis.
fn rest(rig: &Skeleton, map: &SkeletonMap) -> Option<Uprightness> {
    let body = Body::of(rig, map)?;
    let mut local = vec![Quat::IDENTITY; rig.joints()];
    for (name, rotation) in map.reference() {
        if let Some(j) = rig.find(name) {
            local[j] = rotation;
        }
    }
    let stands = |up: Up| {
        let turned = skeleton(rig, up.turn()).ok()?;
        let positions = GlobalPose::new(&turned, Vec3::ZERO, &local).positions;
        let cosine = body.bones(&positions).into_iter().map(|b| b.y).fold(1.0, f64::min);
        let left = (positions[body.hips[0]] - positions[body.hips[1]]).normalize_or_zero();
        Some((cosine, left.x))
    };
    let stands = Up::AXES.map(|up| (up, stands(up).unwrap_or((-1.0, 0.0))));
    let of = |up: Up| stands.iter().find(|(u, _)| *u == up).map_or((-1.0, 0.0), |s| s.1);
    // if all bones lie along one axis, rotations about it stand equally well, but only one has the left side at +x
    let up = best(|up| {
        let (cosine, left) = of(up);
        if cosine < STANDS { cosine } else { 2.0 + cosine + left }
    });
    Some(Uprightness { up, cosine: of(up).0 })
}

/// How a body stands in the median of a clip's frames; `None` for a clip without frames.
fn motion(clip: &Clip, map: &SkeletonMap) -> Option<Uprightness> {
    let body = Body::of(clip.skeleton(), map)?;
    let mut pose = GlobalPose::default();
    let step = clip.frames().div_ceil(FRAMES).max(1);
    let bones = |f: usize| {
        pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
        body.bones(&pose.positions)
    };
    let bones: Vec<[Vec3; 2]> = (0..clip.frames()).step_by(step).map(bones).collect();
    if bones.is_empty() {
        return None;
    }
    let median = |bone: usize, axis: Vec3| {
        let mut cosines: Vec<f64> = bones.iter().map(|b| b[bone].dot(axis)).collect();
        let middle = cosines.len() / 2;
        *cosines.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let cosine = |up: Up| median(0, up.axis()).min(median(1, up.axis()));
    let up = best(cosine);
    Some(Uprightness { up, cosine: cosine(up) })
}
