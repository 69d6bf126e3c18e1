//! The channels of a frame.

use kinelm_motion::joints::Selection;
use kinelm_motion::rotation::Axis;
use kinelm_motion::smpl;
use serde::{Deserialize, Serialize};
use std::fmt;

/// How the pelvis's rotation is coded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RootRotation {
    /// The rotation vector in the world. Words depend on the heading, and the vector jumps when the angle passes half a turn.
    Absolute,
    /// The turn about the vertical as a closed-loop step, and the remaining tilt. Words don't depend on the heading.
    #[default]
    HeadingDelta,
}

/// One number of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Channel {
    /// A coordinate of the root's translation.
    Translation(Axis),
    /// The step of the pelvis's turn about the vertical.
    Turn,
    /// A component, x or z, of the pelvis's tilt.
    Tilt(Axis),
    /// A component of a joint's rotation vector.
    Rotation {
        /// SMPL id.
        joint: usize,
        /// The component.
        axis: Axis,
    },
}

impl Channel {
    /// Whether it belongs to a selection of joints.
    pub fn is_of(self, selection: &Selection) -> bool {
        match self {
            Channel::Translation(Axis::Y) => selection.height,
            Channel::Translation(_) => selection.path,
            Channel::Turn => selection.path || selection.joints.contains(&0),
            Channel::Tilt(_) => selection.tilt || selection.joints.contains(&0),
            Channel::Rotation { joint, .. } => selection.joints.contains(&joint),
        }
    }

    /// The joint that it moves, an SMPL id; the root's channels are the pelvis's.
    pub fn joint(self) -> usize {
        match self {
            Channel::Translation(_) | Channel::Turn | Channel::Tilt(_) => 0,
            Channel::Rotation { joint, .. } => joint,
        }
    }
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let letter = |a: Axis| ["x", "y", "z"][a.index()];
        match *self {
            Channel::Translation(a) => write!(f, "translation {}", letter(a)),
            Channel::Turn => f.write_str("pelvis turn"),
            Channel::Tilt(a) => write!(f, "pelvis tilt {}", letter(a)),
            Channel::Rotation { joint, axis } => write!(f, "{} {}", smpl::NAMES[joint], letter(axis)),
        }
    }
}

/// The C channels of a frame: translation x y z, then each joint's x y z by ascending id; the pelvis's are turn, tilt x
/// and tilt z with [`RootRotation::HeadingDelta`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channels {
    joints: Vec<usize>,
    root_rotation: RootRotation,
}

const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

impl Channels {
    /// The channels of these SMPL joints, which ascend.
    pub(crate) fn new(joints: Vec<usize>, root_rotation: RootRotation) -> Self {
        debug_assert!(joints.is_sorted());
        Channels { joints, root_rotation }
    }

    /// Whether the pelvis is coded as a turn and a tilt.
    pub fn has_turn(&self) -> bool {
        self.root_rotation == RootRotation::HeadingDelta && self.joints.first() == Some(&0)
    }

    /// C, the number of channels: 3, and 3 per joint.
    #[allow(clippy::len_without_is_empty, reason = "there are always three")]
    pub fn len(&self) -> usize {
        3 + 3 * self.joints.len()
    }

    /// The coded joints, SMPL ids ascending.
    pub fn joints(&self) -> &[usize] {
        &self.joints
    }

    /// The channel of a slot; `None` from C on (the space).
    pub fn at(&self, place: usize) -> Option<Channel> {
        let axis = AXES[place % 3];
        match place / 3 {
            0 => Some(Channel::Translation(axis)),
            1 if self.has_turn() => Some([Channel::Turn, Channel::Tilt(Axis::X), Channel::Tilt(Axis::Z)][place % 3]),
            n => self.joints.get(n - 1).map(|&joint| Channel::Rotation { joint, axis }),
        }
    }

    /// All channels in the order of a word.
    pub fn iter(&self) -> impl Iterator<Item = Channel> + '_ {
        (0..self.len()).filter_map(|place| self.at(place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::joints::{self, THIRTEEN};

    fn absolute(joints: &[usize]) -> Channels {
        Channels::new(joints.to_vec(), RootRotation::Absolute)
    }

    #[test]
    fn order_of_a_word() {
        let c = absolute(&THIRTEEN);
        assert_eq!(c.len(), 42);
        assert_eq!(c.at(1), Some(Channel::Translation(Axis::Y)));
        assert_eq!(c.at(3), Some(Channel::Rotation { joint: 0, axis: Axis::X }));
        assert_eq!(c.at(41), Some(Channel::Rotation { joint: 21, axis: Axis::Z }));
        assert_eq!(c.at(42), None);
        assert_eq!(c.at(41).unwrap().to_string(), "right_wrist z");
        assert_eq!(c.iter().count(), 42);
    }

    #[test]
    fn a_turn_and_a_tilt() {
        let names = |joints: &[usize]| {
            let c = Channels::new(joints.to_vec(), RootRotation::HeadingDelta);
            c.iter().skip(3).map(|c| c.to_string()).collect::<Vec<_>>()
        };
        assert_eq!(names(&[0, 4])[..4], ["pelvis turn", "pelvis tilt x", "pelvis tilt z", "left_knee x"]);
        assert_eq!(names(&[4]), ["left_knee x", "left_knee y", "left_knee z"]);
    }

    #[test]
    fn places_of_groups() {
        let c = absolute(&THIRTEEN);
        let of = |list: &str| {
            let selection = joints::parse(list).unwrap();
            c.iter().enumerate().filter(|(_, c)| c.is_of(&selection)).map(|(i, _)| i).collect::<Vec<_>>()
        };
        assert_eq!(of("root"), [0, 1, 2, 3, 4, 5]);
        assert_eq!(of("pelvis"), [3, 4, 5]);
        // shoulder 17, elbow 19 and wrist 21 are the ninth, eleventh and thirteenth joint; collar and hand are not coded
        assert_eq!(of("right_arm"), [27, 28, 29, 33, 34, 35, 39, 40, 41]);
        assert_eq!(of("head"), Vec::<usize>::new());
        assert_eq!(of("13"), (0..42).collect::<Vec<_>>());
        let c = Channels::new(THIRTEEN.to_vec(), RootRotation::HeadingDelta);
        let of = |list: &str| {
            let selection = joints::parse(list).unwrap();
            c.iter().enumerate().filter(|(_, c)| c.is_of(&selection)).map(|(i, _)| i).collect::<Vec<_>>()
        };
        assert_eq!(
            (of("path"), of("height"), of("tilt"), of("pelvis")),
            (vec![0, 2, 3], vec![1], vec![4, 5], vec![3, 4, 5])
        );
        assert_eq!(of("path,height,tilt"), of("root"));
    }
}
