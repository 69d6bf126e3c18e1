//! The root's translation in closed loop, for schemes whose words are frames.

use super::line::Scale;
use crate::{Error, Result};
use kinelm_motion::{Clip, Quat, Vec3};
use serde::{Deserialize, Serialize};

/// How the root's x and z are coded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Travel {
    /// The step from the previous decoded position, relative to the previous decoded heading, over a fitted range.
    #[default]
    Velocity,
    /// The position relative to the clip's start, with the angles' bins read as metres.
    Absolute,
}

/// How the root's height is coded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Height {
    /// The height above the clip's floor, which is subtracted first, over the range of the training clips. It can't drift.
    #[default]
    Floor,
    /// The step from the previous decoded height, over a fitted range.
    Velocity,
    /// The height in the world.
    Absolute,
}

/// The farthest plausible root position from the origin, metres.
pub(crate) const FARTHEST: f64 = 1e6;

/// A heading, as its sine and cosine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Facing(f64, f64);

impl Default for Facing {
    fn default() -> Self {
        Facing(0.0, 1.0)
    }
}

impl Facing {
    /// Takes a pelvis's [`heading`](kinelm_motion::rotation::heading). A pelvis whose +z points straight up or down changes
    /// nothing.
    pub(crate) fn face(&mut self, pelvis: Quat) {
        let z = pelvis * Vec3::Z;
        let along = (z.x * z.x + z.z * z.z).sqrt();
        // closer to the vertical the direction would be rounding noise
        if along > 1e-6 {
            *self = Facing(z.x / along, z.z / along);
        }
    }

    /// A world vector relative to the heading: facing it is facing +z.
    pub(crate) fn turned_in(self, v: Vec3) -> Vec3 {
        let Facing(s, c) = self;
        Vec3::new(v.x * c - v.z * s, v.y, v.x * s + v.z * c)
    }

    /// The inverse of [`Facing::turned_in`].
    pub(crate) fn turned_out(self, v: Vec3) -> Vec3 {
        let Facing(s, c) = self;
        Vec3::new(v.x * c + v.z * s, v.y, v.z * c - v.x * s)
    }
}

/// The decoded root through a clip.
#[derive(Debug, Clone)]
pub(crate) struct Walk {
    at: Vec3,
    facing: Facing,
    /// Of x and z.
    travel: Travel,
    /// Of y.
    height: Height,
    /// The origin of heights above the floor, metres.
    base: f64,
}

impl Walk {
    /// At x = z = 0 and this height, heading 0.
    pub(crate) fn new(base: f64, travel: Travel, height: Height) -> Self {
        Walk { at: Vec3::new(0.0, base, 0.0), facing: Facing::default(), travel, height, base }
    }

    /// The decoded position, metres.
    pub(crate) fn at(&self) -> Vec3 {
        self.at
    }

    /// The codes of the step to a position, each with whether it is clipped; moves to the decoded position.
    pub(crate) fn step(&mut self, bins: &[impl Scale; 3], place: Vec3) -> [(u16, bool); 3] {
        let ahead = self.turned_in(place - self.at);
        let values = self.each(ahead, place, place.y - self.base);
        let coded: [(u16, bool); 3] = std::array::from_fn(|i| bins[i].code(values[i]));
        // closed loop: the next step starts from the decoded position, so errors don't add up
        self.follow(bins, coded.map(|(code, _)| code));
        coded
    }

    /// Moves by decoded codes.
    pub(crate) fn follow(&mut self, bins: &[impl Scale; 3], codes: [u16; 3]) {
        let value = Vec3::from_array(std::array::from_fn(|i| bins[i].value(codes[i])));
        self.at = self.each(self.at + self.facing.turned_out(value), value, value.y + self.base);
    }

    /// Takes the heading of a decoded pelvis.
    pub(crate) fn face(&mut self, pelvis: Quat) {
        self.facing.face(pelvis);
    }

    /// A world vector relative to the heading.
    pub(crate) fn turned_in(&self, v: Vec3) -> Vec3 {
        self.facing.turned_in(v)
    }

    /// What the values of x, y and z are, and the origin of each, metres.
    pub(crate) fn coordinates(&self) -> [(&'static str, f64); 3] {
        let along = if self.travel == Travel::Velocity { "step" } else { "position" };
        let y = match self.height {
            Height::Floor => ("height", self.base),
            Height::Velocity => ("step", 0.0),
            Height::Absolute => ("height", 0.0),
        };
        [(along, 0.0), y, (along, 0.0)]
    }

    /// The coded height of no movement: the base of absolute heights, else 0.
    pub(crate) fn neutral_height(&self) -> f64 {
        if self.height == Height::Absolute { self.base } else { 0.0 }
    }

    /// Selects each coordinate from the vector of its coding; y may be the height above the base.
    fn each(&self, velocity: Vec3, absolute: Vec3, about_base: f64) -> Vec3 {
        let xz = if self.travel == Travel::Velocity { velocity } else { absolute };
        let y = match self.height {
            Height::Floor => about_base,
            Height::Velocity => velocity.y,
            Height::Absolute => absolute.y,
        };
        Vec3::new(xz.x, y, xz.z)
    }
}

/// The ground position of a clip's first frame, which is subtracted from all positions.
pub(crate) fn start(clip: &Clip) -> Vec3 {
    clip.root().first().map_or(Vec3::ZERO, |p| Vec3::new(p.x, 0.0, p.z))
}

/// Refuses a clip with an implausible root position.
pub(crate) fn check_positions(clip: &Clip) -> Result<()> {
    match clip.root().iter().position(|p| p.abs().max_element() > FARTHEST) {
        None => Ok(()),
        Some(frame) => Err(Error::Frame {
            frame,
            joint: "translation".into(),
            what: format!(
                "{} m is an implausible position; expected less than {FARTHEST} m; is the unit right?",
                clip.root()[frame]
            ),
        }),
    }
}

/// Refuses fewer bins than `least`, and more than the alphabet has characters.
pub(crate) fn check_bins(bins: u32, least: u32) -> Result<()> {
    let most = crate::alphabet::SIZE;
    (least..=most)
        .contains(&bins)
        .then_some(())
        .ok_or_else(|| Error::setting("bins", bins, format!("{least} to {most}")))
}

/// Refuses an implausible mean height in a file.
pub(crate) fn check_height(first_height: f64) -> Result<()> {
    // NaN compares false, so it is refused too
    (first_height.abs() <= FARTHEST)
        .then_some(())
        .ok_or_else(|| Error::setting("first_height", first_height, "a height in metres"))
}

/// Refuses a coding of heights that a scheme doesn't have.
pub(crate) fn one_of(height: Height, allowed: &[Height]) -> Result<()> {
    let name = |h: &Height| format!("{h:?}").to_lowercase();
    allowed.contains(&height).then_some(()).ok_or_else(|| {
        Error::setting("height", name(&height), allowed.iter().map(name).collect::<Vec<_>>().join(" or "))
    })
}

#[cfg(test)]
mod tests {
    use super::super::bins::Bins;
    use super::super::line::Line;
    use super::*;
    use kinelm_motion::rotation::exp_map;

    #[test]
    fn in_and_out_are_inverse() {
        let mut walk = Walk::new(1.0, Travel::Velocity, Height::Velocity);
        walk.face(exp_map::from_vector(Vec3::new(0.3, 2.0, -0.4)));
        let v = Vec3::new(0.2, -0.3, 0.7);
        assert!((walk.facing.turned_out(walk.turned_in(v)) - v).length() < 1e-15);
        walk.face(exp_map::from_vector(Vec3::Y * 0.5));
        assert!((walk.facing.turned_out(Vec3::Z) - Vec3::new(0.5f64.sin(), 0.0, 0.5f64.cos())).length() < 1e-15);
        let before = walk.clone().facing;
        walk.face(exp_map::from_vector(Vec3::X * std::f64::consts::FRAC_PI_2));
        assert_eq!(walk.facing, before, "straight down");
    }

    #[test]
    fn errors_never_add_up_in_any_bins() {
        let path = |f: usize| Vec3::new((0.1 * f as f64).sin(), 0.9 + 0.1 * (0.3 * f as f64).cos(), 0.02 * f as f64);
        let line = [Line::fitted(-0.11, 0.11, 60); 3];
        let mut steps: Vec<f64> = (0..500).map(|f| 0.15 * (f as f64 * 0.71).sin()).collect();
        steps.sort_by(f64::total_cmp);
        let bins = [(); 3].map(|()| Bins::fitted_to_steps(&steps, 60));
        let walk = Walk::new(0.9, Travel::Velocity, Height::Velocity);
        let (mut a, mut b) = (walk.clone(), walk);
        for f in 0..400 {
            let turn = exp_map::from_vector(Vec3::Y * (0.05 * f as f64));
            a.step(&line, path(f));
            b.step(&bins, path(f));
            if f > 0 {
                assert!((a.at() - path(f)).length() < 0.75f64.sqrt() * line[0].width, "frame {f}");
                assert!((b.at() - path(f)).length() < 0.02, "frame {f}");
            }
            a.face(turn);
            b.face(turn);
        }
    }
}
