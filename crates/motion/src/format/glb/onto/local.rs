//! From a clip's rotations and path to those of the file's nodes, each in the frame of the node above.

use super::super::file::tree::{Tree, split};
use crate::format::source::glb::GlbSource;
use crate::{Quat, Vec3};
use glam::DAffine3;

/// The nodes of a clip's joints.
pub struct Local {
    /// Rotation and place of each node as the file was saved (J).
    pub own: Vec<(Quat, Vec3)>,
    /// What is multiplied before and after a rotation of the clip (J): a joint's rest, and that of the joint above.
    around: Vec<(Quat, Quat)>,
    /// Where the node above the clip's root stands as the file was saved.
    pub above: DAffine3,
    metres: f64,
}

impl Local {
    pub fn of(source: &GlbSource, tree: &Tree) -> Local {
        let stand = tree.world(None);
        let above = |joint: usize| tree.parents[source.nodes[joint]].map_or(DAffine3::IDENTITY, |p| stand[p]);
        let joint = |(j, parent): (usize, &Option<usize>)| {
            let (node, rest) = (source.nodes[j], source.rest[j]);
            let (_, turn, place) = tree.own(node);
            // a scale with a negative sign turns what is seen of a node: that turn is its own, whatever the pose
            let mirrored = turn.inverse() * split(&above(j)).0.inverse() * split(&stand[node]).0;
            let before = parent.map_or(Quat::IDENTITY, |p| source.rest[p].inverse());
            ((turn, place), (before, rest * mirrored.inverse()))
        };
        let (own, around) = source.skeleton.parents().iter().enumerate().map(joint).unzip();
        Local { own, around, above: above(0), metres: source.metres }
    }

    /// The rotation of a joint's node, of its `turn` in the clip; the root's is below `above`.
    pub fn turn(&self, joint: usize, turn: Quat, above: &DAffine3) -> Quat {
        let (before, after) = self.around[joint];
        let before = if joint == 0 { split(above).0.inverse() } else { before };
        (before * turn * after).normalize()
    }

    /// The place of the root's node below `above`, of its `place` in the clip.
    pub fn place(&self, place: Vec3, above: &DAffine3) -> Vec3 {
        above.inverse().transform_point3(place / self.metres)
    }
}
