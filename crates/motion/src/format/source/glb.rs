//! What a GLB with a mesh contains beyond its clip: all of it, so that the character can be given another animation.

use crate::format::Axes;
use crate::{Clip, Quat, Skeleton};
use std::sync::Arc;

/// A GLB with a mesh, and where a clip's joints are in it.
#[derive(Debug, Clone, PartialEq)]
pub struct GlbSource {
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
    /// Whether a clip is on this file's rig.
    pub(crate) fn fits(&self, clip: &Clip) -> bool {
        Arc::ptr_eq(clip.skeleton(), &self.skeleton) || **clip.skeleton() == *self.skeleton
    }
}
