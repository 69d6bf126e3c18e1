//! Geometric features: fractions of frames in which relations between joints hold, such as a bent knee or feet wide apart.
//!
//! Source: Müller, Röder, Clausen, "Efficient content-based retrieval of motion capture data" (2005); the code of fairmotion
//! and its descendants.

use super::{Formulas, JointPositions, Lengths};
use crate::Vec3;

/// The number of relations.
pub const GEOMETRIC: usize = 32;

/// Joint ids by the names used in the relations.
mod id {
    pub const ROOT: usize = 0;
    pub const LHIP: usize = 1;
    pub const RHIP: usize = 2;
    pub const BELLY: usize = 3;
    pub const LKNEE: usize = 4;
    pub const RKNEE: usize = 5;
    pub const LANKLE: usize = 7;
    pub const RANKLE: usize = 8;
    pub const CHEST: usize = 9;
    pub const LTOES: usize = 10;
    pub const RTOES: usize = 11;
    pub const NECK: usize = 12;
    pub const LSHOULDER: usize = 16;
    pub const RSHOULDER: usize = 17;
    pub const LELBOW: usize = 18;
    pub const RELBOW: usize = 19;
    pub const LWRIST: usize = 20;
    pub const RWRIST: usize = 21;
}

/// Shorter normals have no direction.
const NO_NORMAL: f64 = 1e-8;
/// Frames per second in published code, twice the rate of its data.
const COMPAT_RATE: f64 = 120.0;

/// The fraction of frames, from the second on, in which each relation holds.
pub fn geometric(positions: &JointPositions, form: Formulas) -> [f64; GEOMETRIC] {
    let (lengths, fps) = match form {
        Formulas::Compat => (Lengths::COMPAT, COMPAT_RATE),
        Formulas::Fixed => (positions.lengths, positions.fps),
    };
    let mut shares = [0.0; GEOMETRIC];
    // from the second frame on, because velocities need the one before
    for frame in 1..positions.frames() {
        let holds = At { positions, frame, fps }.relations(lengths, form);
        shares.iter_mut().zip(holds).for_each(|(share, holds)| *share += f64::from(u8::from(holds)));
    }
    let frames = (positions.frames() - 1) as f64;
    shares.map(|share| share / frames)
}

/// A frame.
struct At<'a> {
    positions: &'a JointPositions,
    frame: usize,
    fps: f64,
}

impl At<'_> {
    fn p(&self, joint: usize) -> Vec3 {
        self.positions.at(self.frame, joint)
    }

    /// Velocity, m/s.
    fn u(&self, joint: usize) -> Vec3 {
        (self.p(joint) - self.positions.at(self.frame - 1, joint)) * self.fps
    }

    fn relations(
        &self,
        Lengths { humerus: hl, shoulders: sw, hips: hw }: Lengths,
        form: Formulas,
    ) -> [bool; GEOMETRIC] {
        use id::*;
        let lowest = (0..24).map(|joint| self.p(joint).y).fold(f64::INFINITY, f64::min);
        let above = |joint: usize| self.p(joint).y - lowest;
        let [chest_right, chest_left, together, right_in, left_in] = match form {
            Formulas::Compat => [
                self.moves(BELLY, CHEST, CHEST),
                self.moves(BELLY, CHEST, CHEST),
                self.moves(LWRIST, RWRIST, RWRIST),
                self.moves(RWRIST, ROOT, LWRIST),
                self.moves(LWRIST, ROOT, RWRIST),
            ],
            Formulas::Fixed => [
                self.along(RWRIST, CHEST, self.p(CHEST) - self.p(BELLY)),
                self.along(LWRIST, CHEST, self.p(CHEST) - self.p(BELLY)),
                self.along(LWRIST, RWRIST, self.p(RWRIST) - self.p(LWRIST)),
                self.along(RWRIST, ROOT, self.p(ROOT) - self.p(RWRIST)),
                self.along(LWRIST, ROOT, self.p(ROOT) - self.p(LWRIST)),
            ],
        };
        let up = self.p(ROOT) - self.p(NECK);
        let bent = |a: usize, b: usize, c: usize| within(self.p(b) - self.p(a), self.p(c) - self.p(a), 0.0, 110.0);
        let raised = |a: usize, b: usize, from: f64| within(up, self.p(b) - self.p(a), from, 180.0);
        let fast = |joint: usize, limit: f64| self.u(joint).length() > limit * hl;
        [
            self.past(RWRIST, NECK, self.normal(NECK, RHIP, LHIP)) > 1.8 * hl,
            self.past(LWRIST, NECK, self.normal(NECK, LHIP, RHIP)) > 1.8 * hl,
            self.beyond(RWRIST, NECK, self.p(NECK) - self.p(CHEST)) > 0.2 * hl,
            self.beyond(LWRIST, NECK, self.p(NECK) - self.p(CHEST)) > 0.2 * hl,
            chest_right > 1.8 * hl,
            chest_left > 1.8 * hl,
            bent(RELBOW, RSHOULDER, RWRIST),
            bent(LELBOW, LSHOULDER, LWRIST),
            self.beyond(RWRIST, LWRIST, self.p(RSHOULDER) - self.p(LSHOULDER)) > 2.5 * sw,
            together > 1.4 * hl,
            right_in > 1.4 * hl,
            left_in > 1.4 * hl,
            fast(RWRIST, 2.5),
            fast(LWRIST, 2.5),
            self.beyond(RANKLE, ROOT, self.normal(ROOT, LHIP, LTOES)) > 0.38 * hl,
            self.beyond(LANKLE, ROOT, self.normal(ROOT, RHIP, RTOES)) > 0.38 * hl,
            above(RANKLE) > 1.2 * hl,
            above(LANKLE) > 1.2 * hl,
            self.beyond(RANKLE, LANKLE, self.p(RHIP) - self.p(LHIP)) > 2.1 * hw,
            bent(RKNEE, RHIP, RANKLE),
            bent(LKNEE, LHIP, LANKLE),
            fast(RANKLE, 2.5),
            fast(LANKLE, 2.5),
            raised(RSHOULDER, RELBOW, 25.0),
            raised(LSHOULDER, LELBOW, 25.0),
            raised(RHIP, RKNEE, 50.0),
            raised(LHIP, LKNEE, 50.0),
            self.beyond(ROOT, RANKLE, self.normal(RANKLE, NECK, LANKLE)) > 0.5 * hl,
            within(up, Vec3::Y, 70.0, 110.0),
            -above(RWRIST) > -1.2 * hl,
            -above(LWRIST) > -1.2 * hl,
            fast(ROOT, 2.3),
        ]
    }

    /// The normal of the plane through three joints.
    fn normal(&self, a: usize, b: usize, c: usize) -> Vec3 {
        (self.p(c) - self.p(a)).cross(self.p(b) - self.p(a))
    }

    /// Distance of a joint from another along a direction.
    fn beyond(&self, joint: usize, from: usize, direction: Vec3) -> f64 {
        part(self.p(joint) - self.p(from), direction)
    }

    /// Speed of a joint relative to another along a direction.
    fn along(&self, joint: usize, against: usize, direction: Vec3) -> f64 {
        part(self.u(joint) - self.u(against), direction)
    }

    /// Speed of a joint through a plane that contains another joint.
    fn past(&self, joint: usize, against: usize, normal: Vec3) -> f64 {
        self.along(joint, against, normal)
    }

    /// The published `move`: speed of a joint relative to `a` along the direction from `a` to `b`.
    fn moves(&self, a: usize, b: usize, joint: usize) -> f64 {
        self.along(joint, a, self.p(b) - self.p(a))
    }
}

/// The component of a vector along a direction; minus infinity for a zero direction, so that no relation holds.
fn part(vector: Vec3, direction: Vec3) -> f64 {
    let length = direction.length();
    if length < NO_NORMAL { f64::NEG_INFINITY } else { vector.dot(direction) / length }
}

/// Whether the angle between two vectors is between these limits, degrees.
fn within(a: Vec3, b: Vec3, low: f64, high: f64) -> bool {
    // NaN for a zero vector, for which no comparison below holds
    let degrees = a.angle_between(b).to_degrees();
    low < degrees && degrees < high
}
