//! Evidence of which way is up: feet that bear a body on a floor.

use super::Up;
use crate::rig::SkeletonMap;
use crate::series::nearest_quantile as quantile;
use crate::{Clip, GlobalPose, Skeleton, Vec3};

/// Frames that are examined, evenly spaced.
pub(super) const FRAMES: usize = 600;
/// A joint touches a floor up to this distance from it, as a fraction of the leg's length: 10 cm of an adult.
const NEAR: f64 = 0.12;
/// Feet stand on a floor if they bear the body in at least this share of the frames.
const STANDS: f64 = 0.6;
/// Feet don't stand on a floor if they bear the body in at most this share of the frames.
const STANDS_NOT: f64 = 0.5;
/// A body has no floor along an axis if its lowest joint is near one in at most this share of the frames. Of real clips
/// it is in 96 % and more along the true axis.
const NO_FLOOR: f64 = 0.8;

/// Whether the feet of a clip in its file's axes stand on a floor with `up` up, and with `other` up neither they nor
/// any other joint: a dancer lying down is on the floor too.
pub(super) fn feet_stand(clip: &Clip, map: &SkeletonMap, up: Up, other: Up) -> bool {
    let Some(body) = Body::of(clip.skeleton(), map) else { return false };
    let [up, other] = body.heights(clip, [up, other].map(Up::axis));
    let near = NEAR * body.leg_m;
    up.feet_share(near) >= STANDS && other.feet_share(near) <= STANDS_NOT && other.lowest_share(near) <= NO_FLOOR
}

struct Body {
    /// Ankles and balls.
    feet: Vec<usize>,
    leg_m: f64,
}

/// Heights along an axis of the lowest joint and of the lowest foot in each frame that is examined, metres.
#[derive(Default)]
struct Heights {
    lowest: Vec<f64>,
    feet: Vec<f64>,
}

impl Body {
    fn of(rig: &Skeleton, map: &SkeletonMap) -> Option<Body> {
        let joint = |id: usize| map.joint(id).and_then(|name| rig.find(name));
        let (hip, ankle) = (joint(1)?, joint(7)?);
        let leg = std::iter::successors(Some(ankle), |&j| rig.parents()[j]).take_while(|&j| j != hip);
        let leg_m = leg.map(|j| rig.offsets()[j].length()).sum();
        Some(Body { feet: [7, 8, 10, 11].into_iter().filter_map(joint).collect(), leg_m })
    }

    fn heights(&self, clip: &Clip, axes: [Vec3; 2]) -> [Heights; 2] {
        let mut heights = <[Heights; 2]>::default();
        let mut pose = GlobalPose::default();
        for f in (0..clip.frames()).step_by(clip.frames().div_ceil(FRAMES).max(1)) {
            pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
            for (axis, heights) in axes.iter().zip(&mut heights) {
                let height = |j: usize| pose.positions[j].dot(*axis);
                heights.lowest.push((0..clip.joints()).map(height).fold(f64::MAX, f64::min));
                heights.feet.push(self.feet.iter().copied().map(height).fold(f64::MAX, f64::min));
            }
        }
        heights
    }
}

impl Heights {
    /// The share of frames in which the lowest foot is on the feet's floor and nothing is below it.
    fn feet_share(&self, near: f64) -> f64 {
        let floor = quantile(self.feet.clone(), 0.05);
        let stands = |(foot, lowest): &(&f64, &f64)| **foot - floor < near && **foot - **lowest < near;
        self.feet.iter().zip(&self.lowest).filter(stands).count() as f64 / self.feet.len().max(1) as f64
    }

    /// The share of frames in which the lowest joint is on the floor of the lowest joints.
    fn lowest_share(&self, near: f64) -> f64 {
        let floor = quantile(self.lowest.clone(), 0.05);
        self.lowest.iter().filter(|lowest| **lowest - floor < near).count() as f64 / self.lowest.len().max(1) as f64
    }
}
