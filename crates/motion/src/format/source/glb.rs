//! What a GLB with a mesh contains beyond its clip: all of it, so that the character can be given another animation.

use super::vrm::TPose;
use crate::format::Axes;
use crate::{Quat, Skeleton, Vec3};
use std::path::PathBuf;
use std::sync::Arc;

/// A GLB with a mesh, and where a clip's joints are in it.
#[derive(Debug, Clone, PartialEq)]
pub struct GlbSource {
    /// Its name, as the user gave it.
    pub(crate) path: PathBuf,
    /// The file.
    pub(crate) bytes: Arc<[u8]>,
    /// The rig of its clip.
    pub(crate) skeleton: Arc<Skeleton>,
    /// The node of each joint (J).
    pub(crate) nodes: Vec<usize>,
    /// The rotation in the file's world at which each joint is at rest (J).
    pub(crate) rest: Vec<Quat>,
    /// Metres that a metre of the file really is.
    pub(crate) metres: f64,
    /// How the file's axes are rotated to the clip's.
    pub(crate) axes: Axes,
    /// The animation that the clip is.
    pub(crate) played: Option<Played>,
    /// The floor found before a clip was put on this rig, metres; retargeting doesn't move it.
    pub(crate) floor_m: Option<f64>,
    /// Of a VRM, its T-pose.
    pub(crate) vrm: Option<TPose>,
    /// Whether a VRM may be written with an animation in it.
    pub embed: bool,
    /// The animation, by name, whose place and name the next one takes; `None` adds one.
    pub replace: Option<String>,
}

/// An animation of a file that was read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Played {
    /// Its number.
    pub animation: usize,
    /// The second of its first frame.
    pub begin_s: f64,
    /// Frames per second of its own time.
    pub fps: f64,
    /// Its frames.
    pub frames: usize,
}

impl GlbSource {
    /// The matrix (4 x 4, column by column) from the file's world to the clip's: y up, metres.
    pub fn world(&self) -> [f64; 16] {
        let turn = |axis: Vec3| self.axes.position_to_y_up(axis) * self.metres;
        let columns = [Vec3::X, Vec3::Y, Vec3::Z].map(turn);
        let [x, y, z] = columns.map(|c| [c.x, c.y, c.z, 0.0]);
        let all = [x, y, z, [0.0, 0.0, 0.0, 1.0]].concat();
        std::array::from_fn(|i| all[i])
    }
}
