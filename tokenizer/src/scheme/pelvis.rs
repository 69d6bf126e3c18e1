//! The pelvis's rotation as a turn about the vertical and a tilt: `q = Ry(turn) * tilt`.
//!
//! The tilt's rotation vector has y = 0, so it is two numbers, which don't change when the body turns about the vertical. The
//! turn is coded as a step from the previous decoded turn, modulo a full turn. The decoded turn is always a whole number of
//! bins, so errors don't accumulate and no step is too large.

use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Quat, Vec3};
use std::f64::consts::TAU;

/// A rotation as a turn and a tilt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Split {
    /// About +y, radians in `-PI..=PI`.
    pub turn: f64,
    /// Applied first; its vector's y is 0, and w is at least 0.
    pub tilt: Quat,
}

impl Split {
    /// Splits a rotation; `None` upside down, when w = y = 0 and the turn is undefined.
    pub fn of(q: Quat) -> Option<Split> {
        let w = (q.w * q.w + q.y * q.y).sqrt();
        if w < 1e-12 {
            return None;
        }
        // q and -q give the same tilt, and turns that differ by a full circle
        let turn = 2.0 * q.y.atan2(q.w);
        let (s, c) = (q.y / w, q.w / w);
        let tilt = Quat::from_xyzw(c * q.x - s * q.z, 0.0, c * q.z + s * q.x, w);
        let turn = if turn.abs() > 0.5 * TAU { turn - TAU.copysign(turn) } else { turn };
        Some(Split { turn, tilt })
    }

    /// The rotation.
    #[cfg(test)]
    pub fn join(&self) -> Quat {
        about_y(self.turn) * self.tilt
    }
}

/// The rotation about the vertical, radians.
pub fn about_y(turn: f64) -> Quat {
    let (s, c) = (0.5 * turn).sin_cos();
    Quat::from_xyzw(0.0, s, 0.0, c)
}

/// The tilt left of a rotation after a turn, with its y set to 0.
pub(crate) fn tilt_after(q: Quat, turn: f64) -> Quat {
    let left = about_y(-turn) * q;
    // a tilt is at most half a turn, so its w is not negative
    let left = if left.w < 0.0 { -left } else { left };
    Quat::from_xyzw(left.x, 0.0, left.z, left.w).normalize()
}

/// The decoded turn through a clip, in whole bins of a full turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Turns {
    bins: i64,
    at: i64,
}

impl Turns {
    /// Turn 0, with `bins` bins of a full turn.
    pub(crate) fn new(bins: u32) -> Self {
        Turns { bins: bins.into(), at: 0 }
    }

    /// The code of no step.
    pub(crate) fn neutral(bins: u32) -> u16 {
        (bins / 2) as u16
    }

    /// Bins of a full turn.
    pub(crate) fn bins(&self) -> i64 {
        self.bins
    }

    /// The decoded turn, radians.
    pub(crate) fn radians(&self) -> f64 {
        self.at as f64 * TAU / self.bins as f64
    }

    /// Moves by a decoded step.
    pub(crate) fn follow(&mut self, code: u16) {
        self.at = (self.at + i64::from(code) - self.bins / 2).rem_euclid(self.bins);
    }

    /// The code of the step to a rotation's turn, and the codes of its tilt; moves by the step.
    ///
    /// `tilt` returns the codes of a tilt and the vector that they decode to. If the tilt is within an eighth of a bin of half a
    /// turn, before or after coding, its turn is undefined: then the turn stays, and the tilt is the rest of the rotation. That
    /// loses at most a quarter of a bin as an angle, and decoded rotations encode to themselves.
    pub(crate) fn step<T>(&mut self, q: Quat, tilt: impl Fn(Quat) -> (T, Vec3)) -> (u16, T) {
        if let Some(split) = Split::of(q).filter(|split| !self.upside_down(exp_map::to_vector(split.tilt))) {
            let (codes, decoded) = tilt(split.tilt);
            if !self.upside_down(decoded) {
                // whole bins from the decoded turn, so an error never accumulates
                let step = (split.turn * self.bins as f64 / TAU).round() as i64 - self.at;
                let code = ((step + self.bins / 2).rem_euclid(self.bins)) as u16;
                self.follow(code);
                return (code, codes);
            }
        }
        let (code, left) = self.keep(q);
        (code, tilt(left).0)
    }

    /// The code of no step, and the tilt left of a rotation after the current turn.
    pub(crate) fn keep(&self, q: Quat) -> (u16, Quat) {
        (Turns::neutral(self.bins as u32), tilt_after(q, self.radians()))
    }

    /// Whether the turn of a decoded tilt is undefined.
    pub(crate) fn upside_down(&self, tilt: Vec3) -> bool {
        let n = self.bins as f64;
        let squared = tilt.length_squared() * (n / TAU) * (n / TAU);
        // in bins squared, where decoded vectors are integers: none is near the border
        (squared - 0.25 * n * n).abs() < (0.125 * n).floor() + 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::super::angle::Angles;
    use super::super::angle::Form;
    use super::*;
    use kinelm_motion::rotation::angle_between;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn any_rotation() -> impl Strategy<Value = Quat> {
        // every third one upside down or nearly so
        let near = (-1.0..1.0f64, -1e-3..1e-3f64, -1.0..1.0f64, -1e-3..1e-3f64);
        let far = (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64);
        prop_oneof![2 => far, 1 => near]
            .prop_map(|(x, y, z, w)| Quat::from_xyzw(x, y, z, w))
            .prop_filter("too short", |q| q.length() > 0.01)
            .prop_map(|q| q.normalize())
    }

    /// Codes, moves and gives the decoded rotation.
    fn coded(turns: &mut Turns, angles: &Angles, q: Quat) -> (u16, [u16; 2], Quat) {
        let (step, tilt) = turns.step(q, |tilt| {
            let ([x, y, z], _) = angles.code(tilt);
            ([x, z], angles.vector([x, y, z]))
        });
        let zero = Turns::neutral(turns.bins as u32);
        let decoded = about_y(turns.radians()) * angles.rotation([tilt[0], zero, tilt[1]]);
        (step, tilt, decoded)
    }

    #[test]
    fn known_splits() {
        let q = about_y(2.0) * exp_map::from_vector(Vec3::new(0.3, 0.0, -0.4));
        let split = Split::of(q).unwrap();
        assert!((split.turn - 2.0).abs() < 1e-15);
        assert!((exp_map::to_vector(split.tilt) - Vec3::new(0.3, 0.0, -0.4)).length() < 1e-15);
        assert_eq!(Split::of(Quat::IDENTITY).unwrap(), Split { turn: 0.0, tilt: Quat::IDENTITY });
        assert_eq!(Split::of(Quat::from_xyzw(0.6, 0.0, 0.8, 0.0)), None);
        assert!((Split::of(about_y(PI)).unwrap().turn.abs() - PI).abs() < 1e-15);
    }

    #[test]
    fn steps_go_round_the_circle() {
        let angles = Angles::new(Form::Centred, 360);
        let mut turns = Turns::new(360);
        let steps: Vec<u16> =
            (0..800).map(|d| coded(&mut turns, &angles, about_y(f64::from(d).to_radians())).0).collect();
        assert_eq!(steps[0], 180);
        assert!(steps[1..].iter().all(|&s| s == 181), "whichever way the body faces");
    }

    #[test]
    fn upside_down_keeps_the_turn() {
        let angles = Angles::new(Form::Centred, 360);
        let mut turns = Turns::new(360);
        turns.follow(180 + 37);
        let (step, _, back) = coded(&mut turns, &angles, Quat::from_xyzw(0.6, 0.0, 0.8, 0.0));
        assert_eq!((step, turns.at), (180, 37));
        assert!(angle_between(back, Quat::from_xyzw(0.6, 0.0, 0.8, 0.0)) < 0.5f64.sqrt().to_radians() + 1e-9);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn the_parts_make_the_whole(q in any_rotation(), turn in -10.0..10.0f64) {
            let split = Split::of(q).unwrap();
            prop_assert!(angle_between(split.join(), q) < 1e-14);
            prop_assert!(split.turn.abs() <= PI && split.tilt.y == 0.0 && split.tilt.w >= 0.0);
            let near = |a: Split, b: Split| {
                (a.tilt.x - b.tilt.x).abs() < 1e-9 && (a.tilt.z - b.tilt.z).abs() < 1e-9
            };
            prop_assert!(near(Split::of(-q).unwrap(), split));
            if split.tilt.w > 1e-6 {
                prop_assert!(near(Split::of(about_y(turn) * q).unwrap(), split), "a tilt doesn't turn");
            }
        }

        #[test]
        fn half_a_bin_each_and_coded_again_the_same(
            qs in prop::collection::vec(any_rotation(), 1..20),
            bins in prop::sample::select(&[360u32, 361, 60, 1080, 24, 7, 2][..]),
        ) {
            let angles = Angles::new(Form::Centred, bins);
            let (mut turns, mut again) = (Turns::new(bins), Turns::new(bins));
            // half a bin of turn and of each of two components; second codes near half a turn have a bin
            let bound = (0.5 + 0.5f64.sqrt()) * angles.width() + 1e-9;
            for q in qs {
                let (step, tilt, back) = coded(&mut turns, &angles, q);
                let near_half_turn = Split::of(q).unwrap().tilt.w < angles.width();
                let bound = if near_half_turn { 2.0 * bound } else { bound };
                prop_assert!(angle_between(q, back) <= bound, "{q} {back}");
                let (step_again, tilt_again, _) = coded(&mut again, &angles, back);
                prop_assert_eq!((step, tilt), (step_again, tilt_again));
            }
        }
    }
}
