//! Feet that stand lie on the floor with their whole flatten, or nearly.

use super::contact::Contact;
use super::leg::Leg;
use crate::{Clip, Quat, Vec3};

/// A heel that is up comes down by so much at most, radians: who stands on the balls of the feet goes on doing so.
const HEEL: f64 = 0.3;
/// Toes that are up come down by so much at most, radians.
const TOES: f64 = 0.5;
/// A foot that points further up or down doesn't stand on its flatten, radians: somebody lies, or stands on the toes' tips.
const STEEP: f64 = 0.8;
/// A foot lies no more exactly than this, radians.
const SLACK: f64 = 0.05;

/// By how much the foot of a contact is to be turned, toes up, radians: most of what its mean over the contact has from flat.
/// 0 of a rig that has ankles alone.
pub fn turn(clip: &Clip, leg: &Leg, contact: &Contact) -> f64 {
    let Some((ball, flat)) = flat(leg) else { return 0.0 };
    let (places, j) = (clip.positions(), clip.joints());
    let up = |f: usize| pitch(places[f * j + ball] - places[f * j + leg.ankle], flat);
    let mean = contact.frames().map(up).sum::<f64>() / contact.frames().len().max(1) as f64;
    if mean.abs() > STEEP {
        return 0.0;
    }
    let over = mean - mean.clamp(-SLACK, SLACK);
    (-over).clamp(-TOES, HEEL)
}

/// The ball of a leg's foot, and how much lower than the ankle it is when the foot is flat, metres.
pub fn flat(leg: &Leg) -> Option<(usize, f64)> {
    let rest = |ankle: bool| leg.foot.iter().find(|(j, _)| (*j == leg.ankle) == ankle);
    let (&(ball, of_ball), &(_, of_ankle)) = (rest(false)?, rest(true)?);
    Some((ball, of_ankle - of_ball))
}

/// How far the toes of a foot point up from where they do when it is flat, radians; `foot` goes from ankle to ball.
pub fn pitch(foot: Vec3, flat: f64) -> f64 {
    let angle = |down: f64| (down / foot.length().max(1e-9)).clamp(-1.0, 1.0).asin();
    angle(flat) - angle(-foot.y)
}

/// The turn in the world by which the toes of `foot` go up by an angle, radians. None of a foot that is upright: it has no axis.
pub fn toes_up(foot: Vec3, angle: f64) -> Quat {
    let axis = foot.cross(Vec3::Y);
    if angle == 0.0 || axis.length() < 1e-6 { Quat::IDENTITY } else { Quat::from_axis_angle(axis.normalize(), angle) }
}
