//! Pitch correction of feet in contact, so that they are flat on the floor or nearly.

use super::leg::Leg;
use super::track::FootTrack;
use crate::{Quat, Vec3};
use std::ops::Range;

/// Largest lowering of a raised heel, radians: a stance on the balls of the feet stays one.
const HEEL: f64 = 0.3;
/// Largest lowering of raised toes, radians.
const TOES: f64 = 0.5;
/// A steeper foot is not flattened, radians: the body lies, or stands on tiptoe.
const STEEP: f64 = 0.8;
/// Pitch that is left as it is, radians.
const SLACK: f64 = 0.05;

/// Pitch correction of a foot that is in contact in these frames, toes up, radians: most of the negative mean pitch
/// over the contact; 0 for a rig with ankles only.
pub fn turn(track: &FootTrack, contact: Range<usize>) -> f64 {
    let Some(flat) = flat_drop_m(track.leg) else { return 0.0 };
    // one angle for the whole contact: a correction per frame would remove the roll from heel to toe
    let up = |f: usize| track.sole(f).map_or(0.0, |sole| pitch(sole, flat));
    let mean = contact.clone().map(up).sum::<f64>() / contact.len().max(1) as f64;
    if mean.abs() > STEEP {
        return 0.0;
    }
    let over = mean - mean.clamp(-SLACK, SLACK);
    (-over).clamp(-TOES, HEEL)
}

/// How much lower than the ankle the ball is in a flat foot, metres; `None` for a foot that is an ankle alone.
pub fn flat_drop_m(leg: &Leg) -> Option<f64> {
    let rest = |point: usize| leg.points().find(|(of_foot, _)| *of_foot == point).map(|(_, rest)| rest);
    Some(rest(leg.ankle)? - rest(leg.ball?)?)
}

/// Pitch of a foot, toes up, radians; 0 when it is flat. `foot` is the vector from ankle to ball.
pub fn pitch(foot: Vec3, flat: f64) -> f64 {
    let angle = |down: f64| (down / foot.length().max(1e-9)).clamp(-1.0, 1.0).asin();
    angle(flat) - angle(-foot.y)
}

/// The world rotation that raises the toes of `foot` by `angle` radians; identity for a vertical foot, which has no axis.
pub fn toes_up(foot: Vec3, angle: f64) -> Quat {
    let axis = foot.cross(Vec3::Y);
    if angle == 0.0 || axis.length() < 1e-6 { Quat::IDENTITY } else { Quat::from_axis_angle(axis.normalize(), angle) }
}
