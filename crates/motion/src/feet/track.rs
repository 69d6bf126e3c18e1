//! The track of a foot: where its points are in every frame.

use super::leg::Leg;
use crate::{Clip, GlobalPose, Vec3};

/// World positions of the points of a leg's foot over a clip. Computed once for all contacts of the foot, so that finding
/// and locking them takes time proportional to the clip's length.
#[derive(Debug, Clone)]
pub struct FootTrack<'a> {
    /// The leg.
    pub leg: &'a Leg,
    /// Frames per second.
    pub fps: f64,
    /// (F, N): the [points](Leg::points) of the foot, metres.
    positions: Vec<Vec3>,
}

impl<'a> FootTrack<'a> {
    /// The track of a leg's foot.
    ///
    /// # Panics
    /// If the clip is not on the rig of this leg.
    pub fn new(clip: &Clip, leg: &'a Leg) -> Self {
        let mut positions = Vec::with_capacity(clip.frames() * leg.points().count());
        let mut pose = GlobalPose::default();
        for f in 0..clip.frames() {
            pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
            positions.extend(leg.points().map(|(point, _)| pose.point(clip.skeleton(), point)));
        }
        FootTrack { leg, fps: clip.fps(), positions }
    }

    /// F, the number of frames.
    pub fn frames(&self) -> usize {
        self.positions.len() / self.leg.points().count().max(1)
    }

    /// Where a point of the foot is in a frame, metres, world.
    ///
    /// # Panics
    /// If the foot has no such point, or the clip no such frame.
    pub fn at(&self, frame: usize, point: usize) -> Vec3 {
        let n = self.leg.points().position(|(of_foot, _)| of_foot == point).expect("a point of the foot");
        self.positions[frame * self.leg.points().count() + n]
    }

    /// The points of the foot in a frame, metres, world, with their heights above where they stand on a floor at y = 0.
    ///
    /// # Panics
    /// If the clip has no such frame.
    pub fn heights(&self, frame: usize) -> impl Iterator<Item = (Vec3, f64)> + '_ {
        self.leg
            .points()
            .zip(&self.positions[frame * self.leg.points().count()..])
            .map(|((_, rest), at)| (*at, at.y - rest))
    }

    /// The vector from ankle to ball in a frame; `None` for a foot that is an ankle alone.
    pub fn sole(&self, frame: usize) -> Option<Vec3> {
        self.leg.ball.map(|ball| self.at(frame, ball) - self.at(frame, self.leg.ankle))
    }
}
