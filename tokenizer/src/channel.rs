//! What stands at each place of a word.

use kinelm_motion::joints::Selection;
use kinelm_motion::rotation::Axis;
use kinelm_motion::smpl;
use std::fmt;

/// One number of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Channel {
    /// A coordinate of the root's translation.
    Translation(Axis),
    /// A component of a joint's rotation vector.
    Rotation {
        /// SMPL id.
        joint: usize,
        /// The component.
        axis: Axis,
    },
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let letter = |a: Axis| ["x", "y", "z"][a.index()];
        match *self {
            Channel::Translation(a) => write!(f, "translation {}", letter(a)),
            Channel::Rotation { joint, axis } => write!(f, "{} {}", smpl::NAMES[joint], letter(axis)),
        }
    }
}

/// The C channels of a frame: translation x y z, then each joint's x y z by ascending id.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channels {
    joints: Vec<usize>,
}

const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

impl Channels {
    /// The channels of these SMPL joints, which ascend.
    pub(crate) fn new(joints: Vec<usize>) -> Self {
        debug_assert!(joints.is_sorted());
        Channels { joints }
    }

    /// C, the number of channels: 3 and 3 for each joint.
    #[allow(clippy::len_without_is_empty, reason = "there are always three")]
    pub fn len(&self) -> usize {
        3 + 3 * self.joints.len()
    }

    /// The coded joints, SMPL ids ascending.
    pub fn joints(&self) -> &[usize] {
        &self.joints
    }

    /// The channel at a place; `None` from C on (the space).
    pub fn at(&self, place: usize) -> Option<Channel> {
        let axis = AXES[place % 3];
        match place / 3 {
            0 => Some(Channel::Translation(axis)),
            n => self.joints.get(n - 1).map(|&joint| Channel::Rotation { joint, axis }),
        }
    }

    /// All channels in the order of a word.
    pub fn iter(&self) -> impl Iterator<Item = Channel> + '_ {
        (0..self.len()).filter_map(|place| self.at(place))
    }

    /// The places of the selected joints' characters, ascending, with the translation's if it is selected; joints that
    /// are not coded have none.
    pub fn places_of(&self, selection: &Selection) -> Vec<usize> {
        let wanted = |channel: Channel| match channel {
            Channel::Translation(_) => selection.translation,
            Channel::Rotation { joint, .. } => selection.joints.contains(&joint),
        };
        self.iter().enumerate().filter(|&(_, c)| wanted(c)).map(|(place, _)| place).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::joints::{self, THIRTEEN};

    #[test]
    fn order_of_a_word() {
        let c = Channels::new(THIRTEEN.to_vec());
        assert_eq!(c.len(), 42);
        assert_eq!(c.at(1), Some(Channel::Translation(Axis::Y)));
        assert_eq!(c.at(3), Some(Channel::Rotation { joint: 0, axis: Axis::X }));
        assert_eq!(c.at(41), Some(Channel::Rotation { joint: 21, axis: Axis::Z }));
        assert_eq!(c.at(42), None);
        assert_eq!(c.at(41).unwrap().to_string(), "right_wrist z");
        assert_eq!(c.iter().count(), 42);
    }

    #[test]
    fn places_of_groups() {
        let c = Channels::new(THIRTEEN.to_vec());
        let of = |list: &str| c.places_of(&joints::parse(list).unwrap());
        assert_eq!(of("root"), [0, 1, 2, 3, 4, 5]);
        assert_eq!(of("pelvis"), [3, 4, 5]);
        // shoulder 17, elbow 19 and wrist 21 are the ninth, eleventh and thirteenth joint; collar and hand are not coded
        assert_eq!(of("right_arm"), [27, 28, 29, 33, 34, 35, 39, 40, 41]);
        assert_eq!(of("head"), Vec::<usize>::new());
        assert_eq!(of("13"), (0..42).collect::<Vec<_>>());
    }
}
