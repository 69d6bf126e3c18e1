//! Two-bone inverse kinematics of a leg.

use crate::joints::LEGS;
use crate::rig::{Feet, Humanoid, ReferencePose};
use crate::{GlobalPose, Quat, Result, Skeleton, Vec3};

/// The joints of a leg.
#[derive(Debug, Clone, PartialEq)]
pub struct Leg {
    /// The hip.
    pub hip: usize,
    /// The knee.
    pub knee: usize,
    /// The ankle.
    pub ankle: usize,
    /// Ankle and ball, if the rig has them, with their standing heights, metres.
    pub foot: Vec<(usize, f64)>,
    /// Ends of toes, [points](GlobalPose::point) as [`Feet::toes`] has them, with their standing heights, metres.
    pub toes: Vec<(usize, f64)>,
    /// The point to which the foot's pitch is measured from the ankle: the ball, without one the end of the foremost toe.
    pub ball: Option<usize>,
}

/// Shorter vectors have no direction, metres.
const SMALLEST_M: f64 = 1e-6;

impl Leg {
    /// The left and the right leg; every map has hips, knees and ankles.
    pub fn both(rig: &Skeleton, pose: &ReferencePose, feet: &Feet) -> [Leg; 2] {
        LEGS.map(|[hip, knee, ankle, ball]| {
            let [hip, knee, ankle] = [hip, knee, ankle].map(|id| pose.joints[id].unwrap_or(0));
            let ball = pose.joints[ball];
            let is_foot = |joint: usize| joint == ankle || Some(joint) == ball;
            let joints = feet.joints.iter().copied().filter(|(joint, _)| is_foot(*joint));
            let toes = feet.toes.iter().copied().filter(|(point, _)| rig.descends(rig.joint_of(*point), ankle));
            let at = |point: usize| pose.global.point(rig, point);
            let reach = |point: usize| (at(point) - at(ankle)).with_y(0.0).length();
            let longest = toes.clone().max_by(|a, b| reach(a.0).total_cmp(&reach(b.0)));
            let ball = ball.or(longest.map(|(point, _)| point));
            Leg { hip, knee, ankle, foot: joints.collect(), toes: toes.collect(), ball }
        })
    }

    /// [`Leg::both`] of a rig in the reference pose of its map.
    ///
    /// # Errors
    /// Those of [`Humanoid::pose`].
    pub fn of(humanoid: &Humanoid) -> Result<[Leg; 2]> {
        Ok(Leg::both(humanoid.rig(), &*humanoid.pose()?, &humanoid.feet()?))
    }

    /// The [points](GlobalPose::point) of the foot with their standing heights, metres: ankle, ball, ends of toes.
    pub fn points(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.foot.iter().chain(&self.toes).copied()
    }

    fn lengths(&self, pose: &GlobalPose) -> (f64, f64) {
        let [hip, knee, ankle] = [self.hip, self.knee, self.ankle].map(|j| pose.positions[j]);
        ((knee - hip).length(), (ankle - knee).length())
    }

    /// How far the body must be lowered for the ankle, moved by `offset`, to be within `share` of the leg's length, metres; 0
    /// if lowering can't help.
    pub fn lowering(&self, pose: &GlobalPose, offset: Vec3, share: f64) -> f64 {
        let (upper, lower) = self.lengths(pose);
        let to = pose.positions[self.ankle] + offset - pose.positions[self.hip];
        let now = (pose.positions[self.ankle] - pose.positions[self.hip]).length();
        // a leg that is straighter already may stay so
        let most = (share * (upper + lower)).max(now);
        let across = to.x.hypot(to.z);
        if to.length() <= most || across >= most {
            return 0.0;
        }
        (-to.y - (most * most - across * across).sqrt()).max(0.0)
    }

    /// Rotates hip and knee in `local` (J), with world pose `pose`, so that the ankle moves by `offset`. The foot keeps its
    /// world rotation, changed by `turn`. Returns the remaining distance of the ankle, metres; above 0 if out of reach.
    pub fn bend(&self, skeleton: &Skeleton, pose: &GlobalPose, offset: Vec3, turn: Quat, local: &mut [Quat]) -> f64 {
        let [hip, knee, ankle] = [self.hip, self.knee, self.ankle].map(|j| pose.positions[j]);
        let (upper, lower) = self.lengths(pose);
        let (goal, now) = (ankle + offset - hip, ankle - hip);
        if upper < SMALLEST_M || lower < SMALLEST_M || goal.length() < SMALLEST_M || now.length() < SMALLEST_M {
            return offset.length();
        }
        let distance = goal.length().clamp((upper - lower).abs() + SMALLEST_M, upper + lower - SMALLEST_M);
        // a leg is stretched no further than it is, or than nearly straight
        let most = now.length().max(super::STRETCH * (upper + lower));
        let distance = distance.min(most);
        let inside =
            |far: f64| ((upper * upper + lower * lower - far * far) / (2.0 * upper * lower)).clamp(-1.0, 1.0).acos();
        let axis = (knee - hip).cross(ankle - knee);
        let axis = if axis.length() > 1e-9 { axis.normalize() } else { self.forward_axis(skeleton, pose, now) };
        // a larger inner angle of the knee is a straighter leg
        let knee_turn = Quat::from_axis_angle(axis, inside(now.length()) - inside(distance));
        let bent = knee - hip + knee_turn * (ankle - knee);
        // the knee has set the distance from hip to ankle; the hip only has to point the ankle at the goal
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

    /// The vector from ankle to ball; `None` for a foot that is an ankle alone.
    pub fn sole(&self, skeleton: &Skeleton, pose: &GlobalPose) -> Option<Vec3> {
        self.ball.map(|ball| pose.point(skeleton, ball) - pose.positions[self.ankle])
    }

    /// The axis about which a straight leg bends: perpendicular to the leg and to the foot.
    fn forward_axis(&self, skeleton: &Skeleton, pose: &GlobalPose, along: Vec3) -> Vec3 {
        let foot = self.sole(skeleton, pose);
        let forward = foot.unwrap_or(pose.rotations[self.ankle] * Vec3::Z);
        // knees point forward: the lower leg rotates backwards about this axis
        let axis = forward.cross(along);
        if axis.length() > 1e-9 { axis.normalize() } else { Vec3::X }
    }
}
