//! The rotations of one joint as three numbers that never flip.
//!
//! Every way to write a rotation as three numbers breaks somewhere: rotation vectors where a joint is a full turn from
//! where they are 0, a turn about an axis and what is left of it where the axis is upside down. A [`Chart`] takes the
//! one that stays far from its break on all the paths that it is fitted to.

use crate::filter::continuous;
use kinelm_linalg::principal_components;
use kinelm_motion::rotation::euler::{unwrap_near, wrap};
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Quat, Vec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// How near a path may come to a chart's break, radians, before another chart is chosen.
const ENOUGH: f64 = FRAC_PI_2;

/// How the rotations of one joint become vectors, and vectors rotations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chart {
    /// The mean rotation, whose vector is 0 or along the axis.
    mean: Quat,
    /// The axis about which the joint turns, of length 1. With one, a vector is the turn about it, any number of turns, and
    /// square to it the rotation vector of the swing that comes before. Without, it is the rotation vector from the mean.
    axis: Option<Vec3>,
}

impl Chart {
    /// A chart for paths over time, each in the same frame: about `axis`, if there is one and the paths stay away from
    /// where it is upside down; else from the mean, if the paths stay away from a full turn; else about the axis that
    /// the joint turns about most. If none is good enough, the one whose break is farthest from the paths.
    pub fn fit(paths: &[&[Quat]], axis: Option<Vec3>) -> Chart {
        let mean = mean(paths);
        let about = |axis: Option<Vec3>| Chart { mean, axis };
        let charts = [axis.map(|axis| about(Some(axis))), Some(about(None)), main_axis(paths).map(|a| about(Some(a)))];
        let room = charts.into_iter().flatten().map(|chart| {
            let room = paths.iter().map(|path| chart.room(path)).fold(f64::INFINITY, f64::min);
            // capped, so that of several charts with room enough the first is taken
            (chart, room.min(ENOUGH))
        });
        // of equal ones the first
        room.reduce(|best, next| if next.1 > best.1 { next } else { best }).map_or(about(None), |(chart, _)| chart)
    }

    /// The vectors of a path, continuous over time.
    pub fn vectors(&self, path: &[Quat]) -> Vec<Vec3> {
        let Some(axis) = self.axis else {
            return self.off_mean(path).into_iter().map(from_nearest_turn).collect();
        };
        let mut turn = 0.0;
        let vector = |q: Quat| {
            // counted on from the frame before, so that a dancer who spins gets more than one turn
            turn = unwrap_near(twist(q, axis), turn);
            axis * turn + exp_map::to_vector(swing(q, axis))
        };
        self.off_mean(path).into_iter().map(vector).collect()
    }

    /// Adds to `vectors` the whole turns that bring them nearest to `to`, in the mean.
    pub fn nearest_turns(&self, vectors: &mut [Vec3], to: &[Vec3]) {
        let Some(axis) = self.axis else { return };
        let off = to.iter().zip(vectors.iter()).map(|(to, v)| (*to - *v).dot(axis)).sum::<f64>();
        // one number for the whole path: whole turns per frame would tear it
        let off = off / vectors.len().max(1) as f64;
        vectors.iter_mut().for_each(|v| *v += axis * (off - wrap(off)));
    }

    /// The rotation of a vector.
    pub fn rotation(&self, v: Vec3) -> Quat {
        let turn = self.axis.map_or(Vec3::ZERO, |axis| axis * v.dot(axis));
        exp_map::from_vector(turn) * exp_map::from_vector(v - turn) * self.mean
    }

    /// Radians that a path stays away from where the chart breaks.
    fn room(&self, path: &[Quat]) -> f64 {
        let room = |q: Quat| match self.axis {
            Some(axis) => PI - exp_map::to_vector(swing(q, axis)).length(),
            None => TAU - from_nearest_turn(q).length(),
        };
        self.off_mean(path).into_iter().map(room).fold(TAU, f64::min)
    }

    /// What is left of a path without the mean, its signs continuous, most of it less than half a turn.
    fn off_mean(&self, path: &[Quat]) -> Vec<Quat> {
        let back = self.mean.conjugate();
        let off = continuous(path.iter().map(|&q| q * back));
        // one sign for the path: q and -q are the same rotation, but their vectors go opposite ways round
        let sign = if off.iter().map(|q| q.w).sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
        off.into_iter().map(|q| q * sign).collect()
    }
}

/// The rotation vector of a quaternion by its sign: up to a full turn.
fn from_nearest_turn(q: Quat) -> Vec3 {
    let v = exp_map::to_vector(q);
    if q.w < 0.0 { exp_map::twin(v).unwrap_or(v) } else { v }
}

/// The angle about an axis, -2 PI to 2 PI.
fn twist(q: Quat, axis: Vec3) -> f64 {
    2.0 * q.xyz().dot(axis).atan2(q.w)
}

/// What a rotation does before it turns about an axis: its own axis is square to that one.
fn swing(q: Quat, axis: Vec3) -> Quat {
    Quat::from_axis_angle(axis, -twist(q, axis)) * q
}

/// The mean of rotations, whichever their signs: the main direction of their quaternions.
///
/// Source: Markley et al., "Averaging quaternions" (2007).
fn mean(paths: &[&[Quat]]) -> Quat {
    let main = main_direction(paths.iter().flat_map(|path| path.iter().map(|q| q.to_array())));
    main.map_or(Quat::IDENTITY, |q| Quat::from_array(q).normalize())
}

/// The axis about which paths turn most; `None` where they don't move.
fn main_axis(paths: &[&[Quat]]) -> Option<Vec3> {
    let step = |pair: &[Quat]| exp_map::to_vector(pair[1] * pair[0].conjugate()).to_array();
    let axis = main_direction(paths.iter().flat_map(|path| path.windows(2).map(step)))?;
    Vec3::from_array(axis).try_normalize()
}

/// The direction along which vectors are longest, up to its sign; `None` without any length.
fn main_direction<const N: usize>(vectors: impl Iterator<Item = [f64; N]>) -> Option<[f64; N]> {
    let mut squares = vec![0.0; N * N];
    for v in vectors {
        // products don't see a sign, so q and -q count as the same
        (0..N * N).for_each(|i| squares[i] += v[i / N] * v[i % N]);
    }
    let (sizes, directions) = principal_components(N, &squares)?;
    (sizes[0] > 0.0).then(|| std::array::from_fn(|i| directions[i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::rotation::angle_between;

    fn path(frames: usize, at: impl Fn(f64) -> Quat) -> Vec<Quat> {
        (0..frames).map(|f| at(f as f64 / frames as f64)).collect()
    }

    /// Vectors give their rotations back and go from frame to frame no faster than these.
    fn check(chart: &Chart, path: &[Quat], most: f64) {
        let vectors = chart.vectors(path);
        for (v, q) in vectors.iter().zip(path) {
            assert!(angle_between(chart.rotation(*v), *q) < 1e-7, "{chart:?}");
        }
        let fastest = path.windows(2).map(|p| angle_between(p[0], p[1])).fold(0.0, f64::max);
        let step = vectors.windows(2).map(|v| (v[1] - v[0]).length()).fold(0.0, f64::max);
        assert!(step < most * fastest, "{chart:?}: {step} {fastest}");
    }

    #[test]
    fn a_joint_that_stays_within_a_turn_is_seen_from_its_mean() {
        let swung = path(100, |t| Quat::from_rotation_x(4.0 * t) * Quat::from_rotation_z((6.0 * t).sin()));
        let chart = Chart::fit(&[&swung], None);
        assert_eq!(chart.axis, None);
        check(&chart, &swung, 2.0);
        assert_eq!(chart.vectors(&swung).len(), 100);
    }

    #[test]
    fn turns_of_any_number_are_counted_about_any_axis() {
        let axis = Vec3::new(0.48, 0.6, 0.64);
        let about = |turns: f64| move |t: f64| Quat::from_axis_angle(axis, TAU * turns * t);
        // a wobble that leads vectors past full turns beside the axis
        let wobble = |t: f64| Quat::from_rotation_x(0.3 * (25.0 * t).sin());
        let [left, right] = [2.5, -3.25].map(|turns| path(200, |t| about(turns)(t) * wobble(t)));
        let chart = Chart::fit(&[&left, &right], None);
        assert!(chart.axis.unwrap().dot(axis).abs() > 0.95, "{chart:?}");
        for (path, turns) in [(&left, 2.5), (&right, -3.25)] {
            check(&chart, path, 1.5);
            let vectors = chart.vectors(path);
            let turned = (vectors[199] - vectors[0]).dot(chart.axis.unwrap()) * chart.axis.unwrap().dot(axis).signum();
            assert!((turned - TAU * turns * 0.995).abs() < 1.0, "{turned}");
        }
    }

    #[test]
    fn an_axis_that_is_given_is_kept_until_it_is_upside_down() {
        let up = Some(Vec3::Y);
        let leaning = path(100, |t| Quat::from_rotation_y(20.0 * t) * Quat::from_rotation_x(0.8 * t));
        assert_eq!(Chart::fit(&[&leaning], up).axis, up);
        check(&Chart::fit(&[&leaning], up), &leaning, 1.5);
        // whatever the rest pose of the joint is
        let flipped: Vec<Quat> = leaning.iter().map(|&q| q * Quat::from_rotation_z(PI)).collect();
        assert_eq!(Chart::fit(&[&flipped], up).axis, up);
        check(&Chart::fit(&[&flipped], up), &flipped, 1.5);
        // a somersault is no turn about the vertical
        let over = path(100, |t| Quat::from_rotation_x(TAU * 1.5 * t) * Quat::from_rotation_z(0.1 * (9.0 * t).sin()));
        let chart = Chart::fit(&[&over], up);
        assert!(chart.axis.unwrap().x.abs() > 0.95, "{chart:?}");
        check(&chart, &over, 1.5);
    }

    #[test]
    fn whole_turns_are_added_where_they_bring_paths_together() {
        let [a, b] = [1.0, 9.0].map(|from| path(50, |t| Quat::from_rotation_y(from + 8.0 * t)));
        let chart = Chart::fit(&[&a, &b], Some(Vec3::Y));
        let (to, mut own) = (chart.vectors(&a), chart.vectors(&b));
        chart.nearest_turns(&mut own, &to);
        for (a, b) in to.iter().zip(&own) {
            assert!((b.y - a.y - (8.0 - TAU)).abs() < 1e-9, "{a} {b}");
        }
    }
}
