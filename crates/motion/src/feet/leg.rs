//! A leg of two bones, bent so that its ankle comes to a place.

use crate::joints::LEGS;
use crate::rig::{Feet, ReferencePose};
use crate::{GlobalPose, Quat, Skeleton, Vec3};

/// The joints of a leg.
#[derive(Debug, Clone, PartialEq)]
pub struct Leg {
    /// Where it hangs.
    pub hip: usize,
    /// Its middle.
    pub knee: usize,
    /// Its end.
    pub ankle: usize,
    /// Ankle and ball, as far as the rig has them, and how high each rests, metres.
    pub foot: Vec<(usize, f64)>,
}

/// Shorter than this nothing has a direction, metres.
const SMALLEST_M: f64 = 1e-6;

impl Leg {
    /// Left and right; every map has hips, knees and ankles.
    pub fn both(pose: &ReferencePose, feet: &Feet) -> [Leg; 2] {
        LEGS.map(|[hip, knee, ankle, ball]| {
            let joint = |id: usize| pose.joints[id];
            let foot = [joint(ankle), joint(ball)].into_iter().flatten();
            let foot = foot.filter_map(|j| feet.joints.iter().copied().find(|(foot, _)| *foot == j)).collect();
            let of = |id: usize| joint(id).unwrap_or(0);
            Leg { hip: of(hip), knee: of(knee), ankle: of(ankle), foot }
        })
    }

    fn lengths(&self, pose: &GlobalPose) -> (f64, f64) {
        let [hip, knee, ankle] = [self.hip, self.knee, self.ankle].map(|j| pose.positions[j]);
        ((knee - hip).length(), (ankle - knee).length())
    }

    /// How far the body must go down so that the ankle reaches its place, moved by `offset`, with this share of its length;
    /// metres. As far as it can help.
    pub fn lowering(&self, pose: &GlobalPose, offset: Vec3, share: f64) -> f64 {
        let (upper, lower) = self.lengths(pose);
        let to = pose.positions[self.ankle] + offset - pose.positions[self.hip];
        let now = (pose.positions[self.ankle] - pose.positions[self.hip]).length();
        // a leg that is stretched already may stay so
        let most = (share * (upper + lower)).max(now);
        let across = to.x.hypot(to.z);
        if to.length() <= most || across >= most {
            return 0.0;
        }
        (-to.y - (most * most - across * across).sqrt()).max(0.0)
    }

    /// Turns hip and knee in `local` (J), whose world pose is `pose`, so that the ankle moves by `offset`; the foot keeps its
    /// rotation in the world but for `turn`. How far the ankle stays from there, metres: 0 but for a place that is too far.
    pub fn bend(
        &self,
        skeleton: &Skeleton,
        pose: &GlobalPose,
        (offset, turn): (Vec3, Quat),
        local: &mut [Quat],
    ) -> f64 {
        let [hip, knee, ankle] = [self.hip, self.knee, self.ankle].map(|j| pose.positions[j]);
        let (upper, lower) = self.lengths(pose);
        let (goal, now) = (ankle + offset - hip, ankle - hip);
        if upper < SMALLEST_M || lower < SMALLEST_M || goal.length() < SMALLEST_M || now.length() < SMALLEST_M {
            return offset.length();
        }
        let distance = goal.length().clamp((upper - lower).abs() + SMALLEST_M, upper + lower - SMALLEST_M);
        // a leg is never stretched further than it is, or than nearly straight
        let most = now.length().max(super::STRETCH * (upper + lower));
        let distance = distance.min(most);
        let inside =
            |far: f64| ((upper * upper + lower * lower - far * far) / (2.0 * upper * lower)).clamp(-1.0, 1.0).acos();
        let axis = (knee - hip).cross(ankle - knee);
        let axis = if axis.length() > 1e-9 { axis.normalize() } else { self.forward_axis(pose, now) };
        // more inside the knee is a straighter leg
        let knee_turn = Quat::from_axis_angle(axis, inside(now.length()) - inside(distance));
        let bent = knee - hip + knee_turn * (ankle - knee);
        let hip_turn = Quat::from_rotation_arc(bent.normalize(), goal.normalize());
        let parents = skeleton.parents();
        let world = |j: usize| pose.rotations[j];
        let under = |j: Option<usize>, turned: Quat| j.map_or(Quat::IDENTITY, |j| turned * world(j));
        local[self.hip] =
            (under(parents[self.hip], Quat::IDENTITY).conjugate() * hip_turn * world(self.hip)).normalize();
        let over_knee = under(parents[self.knee], hip_turn);
        local[self.knee] = (over_knee.conjugate() * hip_turn * knee_turn * world(self.knee)).normalize();
        let over_ankle = under(parents[self.ankle], hip_turn * knee_turn);
        local[self.ankle] = (over_ankle.conjugate() * turn * world(self.ankle)).normalize();
        goal.length() - distance
    }

    /// About what a straight leg bends: across the leg and to the side of the foot.
    fn forward_axis(&self, pose: &GlobalPose, along: Vec3) -> Vec3 {
        let foot = self
            .foot
            .iter()
            .find(|(j, _)| *j != self.ankle)
            .map(|(j, _)| pose.positions[*j] - pose.positions[self.ankle]);
        let forward = foot.unwrap_or(pose.rotations[self.ankle] * Vec3::Z);
        // knees go forward: the lower leg turns back about this
        let axis = forward.cross(along);
        if axis.length() > 1e-9 { axis.normalize() } else { Vec3::X }
    }
}
