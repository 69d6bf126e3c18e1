//! Pitch correction of feet in contact, so that they are flat on the floor or nearly.

use super::contact::Contact;
use super::leg::Leg;
use crate::{Clip, Quat, Vec3};

/// Largest lowering of a raised heel, radians: a stance on the balls of the feet stays one.
const HEEL: f64 = 0.3;
/// Largest lowering of raised toes, radians.
const TOES: f64 = 0.5;
/// A steeper foot is not flattened, radians: the body lies, or stands on tiptoe.
const STEEP: f64 = 0.8;
/// Pitch that is left as it is, radians.
const SLACK: f64 = 0.05;

/// Pitch correction of the foot in a contact, toes up, radians: most of the negative mean pitch over the contact; 0 for a
/// rig with ankles only.
pub fn turn(clip: &Clip, leg: &Leg, contact: &Contact) -> f64 {
    let Some((ball, flat)) = flat(leg) else { return 0.0 };
    let (positions, j) = (clip.positions(), clip.joints());
    let up = |f: usize| pitch(positions[f * j + ball] - positions[f * j + leg.ankle], flat);
    let mean = contact.frames().map(up).sum::<f64>() / contact.frames().len().max(1) as f64;
    if mean.abs() > STEEP {
        return 0.0;
    }
    let over = mean - mean.clamp(-SLACK, SLACK);
    (-over).clamp(-TOES, HEEL)
}

/// The ball of a leg's foot, and how much lower than the ankle it is in a flat foot, metres.
pub fn flat(leg: &Leg) -> Option<(usize, f64)> {
    let rest = |ankle: bool| leg.foot.iter().find(|(j, _)| (*j == leg.ankle) == ankle);
    let (&(ball, of_ball), &(_, of_ankle)) = (rest(false)?, rest(true)?);
    Some((ball, of_ankle - of_ball))
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
