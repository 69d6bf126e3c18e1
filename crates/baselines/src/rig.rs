//! The rig of a run: joints by their names and the orders of their angles, without the lengths of bones.

use crate::{Error, Result};
use kinelm_motion::rotation::{Axis, EulerOrder};
use kinelm_motion::{Motion, Skeleton, Source};
use serde::{Deserialize, Serialize};

/// For files without angles: the most frequent order in motion capture.
const DEFAULT_ORDER: EulerOrder = EulerOrder([Axis::Z, Axis::X, Axis::Y]);

/// Names, parents, end sites and orders of angles.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// (J).
    pub names: Vec<String>,
    /// (J - 1) parents of all joints but the root, joint 0.
    pub parents: Vec<usize>,
    /// (E) the parents of the end sites.
    pub ends: Vec<usize>,
    /// (J) as [`order`] reads them.
    pub orders: Vec<String>,
}

impl Rig {
    /// The rig of a motion. Orders are those of its file's channels; of joints without three rotations `ZXY`.
    pub(crate) fn of(motion: &Motion) -> Rig {
        let skeleton = motion.clip.skeleton();
        let own = |joint: usize| match &motion.source {
            Source::Bvh(source) => {
                let node = source.rig.joints.get(joint).and_then(|&node| source.head.nodes.get(node))?;
                let turns = node.channels.iter().filter_map(|c| match c {
                    kinelm_motion::format::bvh::Channel::Rotation(axis) => Some(*axis),
                    kinelm_motion::format::bvh::Channel::Position(_) => None,
                });
                EulerOrder::new(turns.collect::<Vec<_>>().try_into().ok()?)
            }
            _ => None,
        };
        Rig {
            names: skeleton.names().to_vec(),
            parents: skeleton.parents().iter().flatten().copied().collect(),
            ends: skeleton.ends().iter().map(|end| end.parent).collect(),
            orders: (0..skeleton.joints()).map(|j| letters(own(j).unwrap_or(DEFAULT_ORDER))).collect(),
        }
    }

    /// J.
    pub fn joints(&self) -> usize {
        self.names.len()
    }

    /// J + E.
    pub fn points(&self) -> usize {
        self.joints() + self.ends.len()
    }

    /// (J) the orders of angles.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for letters that are no order.
    pub(crate) fn angles(&self) -> Result<Vec<EulerOrder>> {
        self.orders.iter().map(|letters| order(letters)).collect()
    }

    /// Refuses another rig: other joints, another tree or other end sites.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] with the joints that differ; `what` is the motion's file.
    pub fn check(&self, what: &std::path::Path, skeleton: &Skeleton) -> Result<()> {
        let parents: Vec<usize> = skeleton.parents().iter().flatten().copied().collect();
        let ends: Vec<usize> = skeleton.ends().iter().map(|end| end.parent).collect();
        let names = skeleton.names();
        if names == self.names && parents == self.parents && ends == self.ends {
            return Ok(());
        }
        let lacks = |own: &[String], other: &[String]| -> Vec<String> {
            own.iter().filter(|name| !other.contains(name)).take(8).cloned().collect()
        };
        let (missing, more) = (lacks(&self.names, names), lacks(names, &self.names));
        let found = match (missing.is_empty(), more.is_empty()) {
            (true, true) if names == self.names && parents == self.parents => {
                let on = |ends: &[usize]| ends.iter().map(|j| self.names[*j].as_str()).collect::<Vec<_>>().join(", ");
                format!("end sites on {}, not on {}", on(&ends), on(&self.ends))
            }
            (true, true) => "the same joints in another tree".into(),
            (true, false) => format!("joints that the run doesn't know: {}", more.join(", ")),
            (false, true) => format!("no joints {}", missing.join(", ")),
            (false, false) => format!("joints {} and no {}", more.join(", "), missing.join(", ")),
        };
        let help = "take motion of the run's rig, or retarget this with kinelm convert";
        Err(Error::file(what, found, format!("the run's rig of {} joints", self.joints()), help))
    }
}

/// An order as its letters.
fn letters(order: EulerOrder) -> String {
    order.0.iter().map(|axis| ['X', 'Y', 'Z'][axis.index()]).collect()
}

/// The order of three letters, such as `ZXY`: the first turn is the outermost.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] for others.
///
/// ```
/// # use kinelm_baselines::rig::order;
/// assert!(order("ZXY").is_ok());
/// assert!(order("XX").is_err());
/// ```
pub fn order(letters: &str) -> Result<EulerOrder> {
    let axis = |c: char| [Axis::X, Axis::Y, Axis::Z].into_iter().find(|a| c == ['X', 'Y', 'Z'][a.index()]);
    let axes: Option<Vec<Axis>> = letters.chars().map(axis).collect();
    let order = axes.and_then(|axes| EulerOrder::new(axes.try_into().ok()?));
    order.ok_or_else(|| {
        Error::invalid("the order of a joint's angles", format!("{letters:?}"), "three of X, Y and Z, such as ZYX")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::{Clip, Quat, Vec3, smpl};
    use std::path::Path;

    #[test]
    fn another_rig_is_refused_by_its_joints() {
        let clip = Clip::new(smpl::neutral(), 30.0, vec![Vec3::Y], vec![Quat::IDENTITY; 24]).unwrap();
        let motion = Motion::new("a.npz", clip);
        let rig = Rig::of(&motion);
        assert_eq!((rig.joints(), rig.orders[3].as_str()), (24, "ZXY"));
        rig.check(Path::new("a.npz"), motion.clip.skeleton()).unwrap();
        let names = rig.names.iter().map(|n| if n == "left_knee" { "knee".into() } else { n.clone() }).collect();
        let s = motion.clip.skeleton();
        let other = Skeleton::new(names, s.parents().to_vec(), s.offsets().to_vec(), s.ends().to_vec()).unwrap();
        let message = rig.check(Path::new("b.bvh"), &other).unwrap_err().to_string();
        assert!(message.starts_with("b.bvh: found joints knee and no left_knee, expected"), "{message}");
        assert!(order("ZZX").is_err() && order("zyx").is_err() && order("ZY").is_err());
        assert_eq!(letters(order("XYX").unwrap()), "XYX");
    }
}
