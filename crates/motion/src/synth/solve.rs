//! From targets to joints: the spine by shares, arms and legs by two-bone inverse kinematics.

use super::control::Control;
use super::steps::Foot;
use crate::rotation::exp_map::from_vector;
use crate::rotation::swing;
use crate::{Quat, Skeleton, Vec3};
use glam::DMat3;

/// The pose of one frame.
pub struct Pose {
    pub root: Vec3,
    pub local: Vec<Quat>,
}

/// The targets of the body at one moment.
pub struct Targets {
    pub control: Control,
    pub feet: [Foot; 2],
    /// Pelvis position: x and z between the feet, y its height, metres.
    pub pelvis: Vec3,
    /// Velocity of the wrists in the control's axes, arm lengths per second: hands lag after it.
    pub wrist_velocity: [Vec3; 2],
}

const HIP: [usize; 2] = [1, 2];
const KNEE: [usize; 2] = [4, 5];
const ANKLE: [usize; 2] = [7, 8];
const TOE: [usize; 2] = [10, 11];
const COLLAR: [usize; 2] = [13, 14];
const SHOULDER: [usize; 2] = [16, 17];
const ELBOW: [usize; 2] = [18, 19];
const WRIST: [usize; 2] = [20, 21];
const SPINE: [(usize, f64); 3] = [(3, 0.3), (6, 0.35), (9, 0.35)];
/// A limb is never quite straight, because a straight one has no bending plane and looks stiff.
const STRAIGHTEST: f64 = 0.988;

/// The pose that meets the targets as far as the limbs reach.
pub fn solve(skeleton: &Skeleton, targets: &Targets) -> Pose {
    let c = &targets.control;
    let heading = Quat::from_rotation_y(c.turn);
    let mut body = Body::new(skeleton);
    body.turn_to(0, heading * from_vector(c.hips));
    body.place[0] = targets.pelvis;
    body.place[0].y = reachable_height(skeleton, targets, body.global[0]);
    for (joint, share) in SPINE {
        body.turn(joint, from_vector(c.spine * share));
    }
    // the head compensates some of the body's lean to look ahead
    let neck = from_vector((c.head - (c.hips + c.spine) * 0.45) * 0.5);
    body.turn(12, neck);
    body.turn(15, neck);
    for side in 0..2 {
        body.arm(side, c.wrists[side], targets.wrist_velocity[side]);
        body.leg(side, &targets.feet[side]);
    }
    Pose { root: body.place[0], local: body.local }
}

/// The pelvis height at which both legs reach their feet without locking a knee.
fn reachable_height(skeleton: &Skeleton, targets: &Targets, pelvis: Quat) -> f64 {
    let mut height = targets.pelvis.y;
    for (side, foot) in targets.feet.iter().enumerate() {
        let length = leg_length(skeleton, side) * STRAIGHTEST;
        let hip = pelvis * skeleton.offsets()[HIP[side]];
        let away = ankle(skeleton, side, foot) - targets.pelvis - hip;
        let across = away.x * away.x + away.z * away.z;
        let highest = targets.pelvis.y + away.y + (length * length - across).max(0.01).sqrt();
        height = soft_min(height, highest, 0.012);
    }
    height
}

/// A smooth minimum that is never above the exact one.
fn soft_min(a: f64, b: f64, width: f64) -> f64 {
    a.min(b) - width * (-(a - b).abs() / width).exp().ln_1p()
}

fn leg_length(skeleton: &Skeleton, side: usize) -> f64 {
    skeleton.offsets()[KNEE[side]].length() + skeleton.offsets()[ANKLE[side]].length()
}

fn foot_rotation(foot: &Foot) -> Quat {
    Quat::from_rotation_y(foot.heading) * Quat::from_rotation_x(foot.pitch)
}

fn ankle(skeleton: &Skeleton, side: usize, foot: &Foot) -> Vec3 {
    foot.toe - foot_rotation(foot) * skeleton.offsets()[TOE[side]]
}

/// A bent two-bone limb from 0 to its target.
struct Bend {
    /// Position of the middle joint.
    middle: Vec3,
    /// Direction of the first bone.
    along: Vec3,
    /// Perpendicular to it, in the limb's plane, on the side of the pole. It stays continuous when a strongly bent limb
    /// brings the bone near the pole.
    across: Vec3,
}

/// Bends a limb of lengths `a`, `b` with its middle joint towards `pole`, by the law of cosines.
fn bend(target: Vec3, a: f64, b: f64, pole: Vec3) -> Bend {
    // neither folded nor straight: both have no bending plane
    let d = target.length().clamp((a - b).abs() + 1e-6, (a + b) * 0.9999);
    let t = target.normalize_or(Vec3::NEG_Y);
    let aside = (pole - t * t.dot(pole)).normalize_or(t.any_orthonormal_vector());
    let cos = ((a * a - b * b + d * d) / (2.0 * d * a)).clamp(-1.0, 1.0);
    let sin = (1.0 - cos * cos).sqrt();
    let along = t * cos + aside * sin;
    Bend { middle: along * a, along, across: aside * cos - t * sin }
}

/// World rotations under construction, parents first.
struct Body<'a> {
    skeleton: &'a Skeleton,
    local: Vec<Quat>,
    global: Vec<Quat>,
    place: Vec<Vec3>,
}

impl<'a> Body<'a> {
    fn new(skeleton: &'a Skeleton) -> Self {
        let n = skeleton.joints();
        Body { skeleton, local: vec![Quat::IDENTITY; n], global: vec![Quat::IDENTITY; n], place: vec![Vec3::ZERO; n] }
    }

    /// Sets a joint's local rotation; its parent must be set already.
    fn turn(&mut self, joint: usize, local: Quat) {
        let local = local.normalize();
        self.local[joint] = local;
        match self.skeleton.parents()[joint] {
            None => self.global[joint] = local,
            Some(p) => {
                self.global[joint] = self.global[p] * local;
                self.place[joint] = self.place[p] + self.global[p] * self.skeleton.offsets()[joint];
            }
        }
    }

    /// Sets a joint's world rotation.
    fn turn_to(&mut self, joint: usize, global: Quat) {
        let parent = self.skeleton.parents()[joint].map_or(Quat::IDENTITY, |p| self.global[p]);
        self.turn(joint, parent.conjugate() * global);
    }

    fn length(&self, joint: usize) -> f64 {
        self.skeleton.offsets()[joint].length()
    }

    /// `wrist` and `velocity` as in [`Control`]: (outward, up, forward) in arm lengths.
    fn arm(&mut self, side: usize, wrist: Vec3, velocity: Vec3) {
        let outward = if side == 0 { 1.0 } else { -1.0 };
        let aside = |v: Vec3| Vec3::new(v.x * outward, v.y, v.z);
        let chest = self.global[9];
        // the shoulder follows the hand up and forward
        self.turn(
            COLLAR[side],
            from_vector(Vec3::new(0.0, -0.16 * outward * (wrist.z - 0.2), 0.2 * outward * wrist.y)),
        );
        self.turn(SHOULDER[side], Quat::IDENTITY);
        let (upper, fore) = (self.length(ELBOW[side]), self.length(WRIST[side]));
        let distance = soft_min(wrist.length(), STRAIGHTEST, 0.03).max(0.25) * (upper + fore);
        let target = chest * aside(wrist.normalize_or(Vec3::NEG_Y) * distance);
        // elbows point back when the hand is low and outward when it is high
        let high = 0.5 + 0.5 * wrist.y;
        let pole = chest * aside(Vec3::new(0.35 + 0.55 * high, -0.5, -0.75 + 0.5 * high));
        // columns: along the bone, the elbow's hinge axis, the inside of the elbow
        let Bend { middle: elbow, along, across } = bend(target, upper, fore, pole);
        let inside = -across;
        let x = along * outward;
        self.turn_to(SHOULDER[side], Quat::from_mat3(&DMat3::from_cols(x, inside.cross(x), inside)));
        let forearm = (target - elbow).normalize();
        let flexion = forearm.dot(inside).atan2(forearm.dot(along));
        self.turn(ELBOW[side], Quat::from_rotation_y(-outward * flexion));
        let drag = aside(velocity) * 0.13;
        // saturates, so that a fast arm doesn't fold its hand back
        let drag = chest * (drag * (1.0 / (1.0 + drag.length())));
        let hand = forearm - (drag - forearm * forearm.dot(drag));
        let hand = self.global[ELBOW[side]].conjugate() * hand;
        self.turn(WRIST[side], swing(Vec3::X * outward, hand));
    }

    fn leg(&mut self, side: usize, foot: &Foot) {
        self.turn(HIP[side], Quat::IDENTITY);
        let (thigh, shin) = (self.length(KNEE[side]), self.length(ANKLE[side]));
        let target = ankle(self.skeleton, side, foot) - self.place[HIP[side]];
        // knees point half-way between body and foot, slightly outward
        let facing = self.global[0] * Vec3::new(if side == 0 { 0.12 } else { -0.12 }, 0.0, 1.0);
        let pole = facing.normalize() + Vec3::new(foot.heading.sin(), 0.0, foot.heading.cos());
        let Bend { middle: knee, along, across: forward } = bend(target, thigh, shin, pole);
        let y = -along;
        self.turn_to(HIP[side], Quat::from_mat3(&DMat3::from_cols(y.cross(forward), y, forward)));
        let shin = self.global[HIP[side]].conjugate() * (target - knee);
        let rest = self.skeleton.offsets()[ANKLE[side]];
        let flexion = (-shin.z).atan2(-shin.y) - (-rest.z).atan2(-rest.y);
        self.turn(KNEE[side], Quat::from_rotation_x(flexion));
        self.turn_to(ANKLE[side], foot_rotation(foot));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GlobalPose, smpl};

    fn targets() -> Targets {
        let foot = |x: f64| Foot { toe: Vec3::new(x, 0.0, 0.1), heading: 0.0, pitch: 0.0 };
        Targets {
            control: Control::REST,
            feet: [foot(0.1), foot(-0.12)],
            pelvis: Vec3::new(0.0, 0.92, 0.0),
            wrist_velocity: [Vec3::ZERO; 2],
        }
    }

    fn positions(w: &Targets) -> Vec<Vec3> {
        let pose = solve(&smpl::neutral(), w);
        GlobalPose::new(&smpl::neutral(), pose.root, &pose.local).positions
    }

    #[test]
    fn hands_and_feet_arrive() {
        let mut w = targets();
        w.control.wrists = [Vec3::new(0.5, 0.4, 0.3), Vec3::new(-0.1, -0.2, 0.6)];
        w.control.spine = Vec3::new(0.2, 0.3, -0.1);
        w.feet[0] = Foot { toe: Vec3::new(0.2, 0.15, 0.3), heading: 0.4, pitch: 0.5 };
        let pose = solve(&smpl::neutral(), &w);
        let g = GlobalPose::new(&smpl::neutral(), pose.root, &pose.local);
        for side in 0..2 {
            assert!((g.positions[TOE[side]] - w.feet[side].toe).length() < 1e-9, "{:?}", g.positions[TOE[side]]);
            let seen = g.rotations[9].conjugate() * (g.positions[WRIST[side]] - g.positions[SHOULDER[side]]) / 0.51;
            let wish = w.control.wrists[side] * Vec3::new(if side == 0 { 1.0 } else { -1.0 }, 1.0, 1.0);
            assert!((seen - wish).length() < 1e-3, "{seen} {wish}");
        }
    }

    #[test]
    fn knees_bend_forward_elbows_back() {
        let p = positions(&targets());
        for side in 0..2 {
            assert!(p[KNEE[side]].z > p[HIP[side]].z && p[KNEE[side]].z > p[ANKLE[side]].z);
            assert!(p[ELBOW[side]].z < p[WRIST[side]].z);
        }
    }

    #[test]
    fn hips_come_down_when_a_foot_is_far() {
        let mut w = targets();
        w.feet[0].toe.x = 0.7;
        let p = positions(&w);
        assert!(p[0].y < 0.85);
        assert!((p[TOE[0]] - w.feet[0].toe).length() < 1e-9);
    }
}
