//! A clip as series over time, for schemes whose words are tiles.
//!
//! *Open* series are rotation vectors, three numbers per coded joint (with `heading_delta` only x and z of the pelvis's tilt),
//! made continuous in time. *Closed* series depend on decoded motion: the root's position and, with `heading_delta`, its turn.
//! They are relative to an `Anchor`, the decoded root at the end of the previous tile, so errors don't accumulate.

use super::pelvis::{Split, about_y};
use super::walk::Facing;
use crate::channel::Channels;
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Clip, Quat, Vec3};
use std::f64::consts::TAU;
use std::ops::Range;

/// The number of open series.
pub(crate) fn open_count(channels: &Channels) -> usize {
    3 * channels.joints().len() - usize::from(channels.has_turn())
}

/// The number of closed series: three of the position, and the turn.
pub(crate) fn closed_count(channels: &Channels) -> usize {
    3 + usize::from(channels.has_turn())
}

/// The SMPL joint of each open series.
pub(crate) fn open_joints(channels: &Channels) -> Vec<usize> {
    let tilt = usize::from(channels.has_turn());
    channels.joints().iter().flat_map(|&j| std::iter::repeat_n(j, if j == 0 { 3 - tilt } else { 3 })).collect()
}

/// The open series of `frames` of a clip into `out` (S, n); with fewer than n frames, the last one repeats.
///
/// The first frame's vectors are canonical, at most half a turn long. Each later one is, of all vectors of its rotation, the
/// nearest to the previous frame's.
///
/// # Panics
/// When there are no frames, more than `n`, or `out` has another length.
pub(crate) fn open(channels: &Channels, clip: &Clip, frames: Range<usize>, n: usize, out: &mut [f64]) {
    assert!(!frames.is_empty() && frames.len() <= n && out.len() == open_count(channels) * n, "open series of {n}");
    let mut rows = out;
    for &joint in channels.joints() {
        let tilt = joint == 0 && channels.has_turn();
        let (own, rest) = rows.split_at_mut(if tilt { 2 * n } else { 3 * n });
        rows = rest;
        let mut before = Vec3::ZERO;
        for t in 0..n {
            if t < frames.len() {
                let q = clip.pose(frames.start + t)[joint];
                let v = exp_map::to_vector(if tilt { tilt_of(q) } else { q });
                // continuous within the tile only: a tile must decode without the ones before
                before = if t == 0 { v } else { nearest(v, before) };
            }
            if tilt {
                (own[t], own[n + t]) = (before.x, before.z);
            } else {
                (own[t], own[n + t], own[2 * n + t]) = (before.x, before.y, before.z);
            }
        }
    }
}

/// Of all vectors of a rotation with the canonical vector `v`, the nearest to `before`.
fn nearest(v: Vec3, before: Vec3) -> Vec3 {
    // within 3, less than half of the TAU between two vectors of a rotation, no other can be nearer
    if (v - before).length_squared() < 9.0 {
        return v;
    }
    let angle = v.length();
    // the identity has any axis; that of `before` is the nearest
    let (axis, angle) = if angle > 1e-9 { (v / angle, angle) } else { (before.normalize_or_zero(), 0.0) };
    let turns = ((axis.dot(before) - angle) / TAU).round();
    if turns == 0.0 { v } else { axis * (angle + turns * TAU) }
}

/// The tilt of a rotation; upside down, where the turn is undefined, the rotation itself.
fn tilt_of(q: Quat) -> Quat {
    Split::of(q).map_or(q, |split| split.tilt)
}

/// Sets the coded joints of a pose (24) from frame `t` of open series (S, n) and the turn of the pelvis.
pub(crate) fn set_pose(channels: &Channels, turn: f64, series: &[f64], n: usize, t: usize, pose: &mut [Quat]) {
    let mut at = t;
    for &joint in channels.joints() {
        if joint == 0 && channels.has_turn() {
            pose[0] = about_y(turn) * exp_map::from_vector(Vec3::new(series[at], 0.0, series[at + n]));
            at += 2 * n;
        } else {
            pose[joint] = exp_map::from_vector(Vec3::new(series[at], series[at + n], series[at + 2 * n]));
            at += 3 * n;
        }
    }
}

/// The decoded root at the end of a tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Anchor {
    /// Metres.
    place: Vec3,
    facing: Facing,
    /// Turn of the pelvis about the vertical, radians; 0 when it isn't coded.
    turn: f64,
    /// Origin of heights, metres; `None`: the height here.
    base: Option<f64>,
}

impl Anchor {
    /// The start of every clip: at the origin and this height, heading and turn 0.
    pub(crate) fn new(height: f64) -> Self {
        Anchor { place: Vec3::new(0.0, height, 0.0), facing: Facing::default(), turn: 0.0, base: None }
    }

    /// As [`Anchor::new`], with heights always relative to this height, so that they can't drift.
    pub(crate) fn above_floor(height: f64) -> Self {
        Anchor { base: Some(height), ..Anchor::new(height) }
    }

    /// The closed series of `frames` of a clip relative to this anchor, into `out` (3 or 4, n): the root's position less `start`,
    /// in this heading, and the continuous turn.
    ///
    /// # Panics
    /// As [`open`].
    pub(crate) fn closed(
        &self,
        channels: &Channels,
        clip: &Clip,
        start: Vec3,
        frames: Range<usize>,
        n: usize,
        out: &mut [f64],
    ) {
        let good = !frames.is_empty() && frames.len() <= n && out.len() == closed_count(channels) * n;
        assert!(good, "closed series of {n}");
        let mut turn = 0.0;
        for t in 0..n {
            let f = frames.start + t.min(frames.len() - 1);
            let mut offset = self.facing.turned_in(clip.root()[f] - start - self.place);
            offset.y = clip.root()[f].y - self.base.unwrap_or(self.place.y);
            (out[t], out[n + t], out[2 * n + t]) = (offset.x, offset.y, offset.z);
            if channels.has_turn() {
                // upside down the turn is undefined, and stays
                if let Some(split) = Split::of(clip.pose(f)[0]) {
                    let off = split.turn - self.turn - turn;
                    turn += off - (off / TAU).round() * TAU;
                }
                out[3 * n + t] = turn;
            }
        }
    }

    /// The position and the turn of frame `t` of decoded closed series (3 or 4, n).
    pub(crate) fn apply(&self, channels: &Channels, closed: &[f64], n: usize, t: usize) -> (Vec3, f64) {
        let offset = Vec3::new(closed[t], closed[n + t], closed[2 * n + t]);
        let turn = if channels.has_turn() { self.turn + closed[3 * n + t] } else { 0.0 };
        let mut place = self.place + self.facing.turned_out(offset);
        place.y = self.base.unwrap_or(self.place.y) + offset.y;
        (place, turn)
    }

    /// Moves to the end of a tile: its last position and turn, and the heading of its decoded pelvis.
    pub(crate) fn move_to(&mut self, place: Vec3, turn: f64, pelvis: Quat) {
        self.place = place;
        // within half a turn, so that sums of many tiles lose no digits
        self.turn = turn - (turn / TAU).round() * TAU;
        self.facing.face(pelvis);
    }
}

/// The lever arm of each joint, metres: the RMS distance on the neutral skeleton from the joint to its descendants, at least
/// 2 cm.
pub fn lever_arms() -> [f64; 24] {
    let skeleton = kinelm_motion::smpl::neutral();
    let places = kinelm_motion::GlobalPose::new(&skeleton, Vec3::ZERO, &[Quat::IDENTITY; 24]).positions;
    std::array::from_fn(|j| {
        let below: Vec<f64> = (j + 1..24)
            .filter(|&k| skeleton.descends(k, j))
            .map(|k| (places[k] - places[j]).length_squared())
            .collect();
        // leaves have no descendants and take the least arm
        (below.iter().sum::<f64>() / below.len().max(1) as f64).sqrt().max(SHORTEST)
    })
}

/// The least lever arm, metres.
const SHORTEST: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::RootRotation;
    use crate::contract::wild;
    use kinelm_motion::rotation::angle_between;
    use kinelm_motion::smpl;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn channels(joints: &[usize], root_rotation: RootRotation) -> Channels {
        Channels::new(joints.to_vec(), root_rotation)
    }

    /// What all frames of a clip come back as.
    fn through(c: &Channels, clip: &Clip, n: usize) -> (Vec<Vec3>, Vec<Quat>, Vec<f64>) {
        let frames = 0..clip.frames();
        let (mut series, mut closed) = (vec![9.0; open_count(c) * n], vec![9.0; closed_count(c) * n]);
        open(c, clip, frames.clone(), n, &mut series);
        let mut anchor = Anchor::new(0.5);
        anchor.move_to(Vec3::new(3.0, 0.7, -2.0), 1.0, about_y(2.5));
        anchor.closed(c, clip, Vec3::X, frames, n, &mut closed);
        let (mut root, mut poses) = (vec![], vec![]);
        for t in 0..n {
            let (place, turn) = anchor.apply(c, &closed, n, t);
            root.push(place);
            let mut pose = [Quat::IDENTITY; 24];
            set_pose(c, turn, &series, n, t, &mut pose);
            poses.extend(pose);
        }
        (root, poses, series)
    }

    #[test]
    fn there_and_back() {
        for root_rotation in [RootRotation::Absolute, RootRotation::HeadingDelta] {
            for joints in [vec![0, 4, 17], vec![5], (0..24).collect::<Vec<_>>()] {
                let c = channels(&joints, root_rotation);
                assert_eq!(open_joints(&c).len(), open_count(&c));
                assert_eq!(open_count(&c) + closed_count(&c), c.len());
                let clip = wild(3, 50, 1.5, 0.05);
                let (root, poses, _) = through(&c, &clip, 53);
                for t in 0..53 {
                    let f = t.min(49);
                    assert!((root[t] - (clip.root()[f] - Vec3::X)).length() < 1e-12);
                    for &j in &joints {
                        let miss = angle_between(poses[t * 24 + j], clip.pose(f)[j]);
                        assert!(miss < 1e-9, "{root_rotation:?}, frame {f}, joint {j}: {miss}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_spin_goes_on() {
        let still = |turn: f64| about_y(turn);
        let rotations = (0..100).flat_map(|f| std::iter::repeat_n(still(0.2 * f as f64), 24)).collect();
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y; 100], rotations).unwrap();
        let c = channels(&[0], RootRotation::Absolute);
        let (_, _, series) = through(&c, &clip, 100);
        assert!((series[100 + 99] - 0.2 * 99.0).abs() < 1e-9, "three turns on");
        let c = channels(&[0], RootRotation::HeadingDelta);
        let mut closed = vec![0.0; 400];
        Anchor::new(1.0).closed(&c, &clip, Vec3::ZERO, 0..100, 100, &mut closed);
        assert!((closed[399] - 0.2 * 99.0).abs() < 1e-9);
    }

    #[test]
    fn upside_down_has_no_turn() {
        let over = Quat::from_xyzw(0.6, 0.0, 0.8, 0.0);
        let rotations = [about_y(0.3), over, about_y(0.5)].into_iter().flat_map(|q| [q; 24]).collect();
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y; 3], rotations).unwrap();
        let c = channels(&[0], RootRotation::HeadingDelta);
        let mut closed = vec![0.0; 12];
        Anchor::new(1.0).closed(&c, &clip, Vec3::ZERO, 0..3, 3, &mut closed);
        assert!((closed[9] - 0.3).abs() < 1e-12 && closed[10] == closed[9] && (closed[11] - 0.5).abs() < 1e-12);
    }

    #[test]
    fn the_turn_is_told_from_the_anchor() {
        let rotations = (0..2 * 24).map(|_| about_y(3.0)).collect();
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y; 2], rotations).unwrap();
        let c = channels(&[0], RootRotation::HeadingDelta);
        let mut anchor = Anchor::new(1.0);
        anchor.move_to(Vec3::ZERO, -3.0 + 4.0 * TAU, about_y(-3.0));
        let mut closed = vec![0.0; 8];
        anchor.closed(&c, &clip, Vec3::ZERO, 0..2, 2, &mut closed);
        assert!((closed[6] - (6.0 - TAU)).abs() < 1e-9, "the short way round");
    }

    #[test]
    fn arms_of_a_body() {
        let arms = lever_arms();
        // the hand alone hangs on a wrist, 8 cm away; wrist and hand on an elbow
        assert!((arms[20] - 0.08).abs() < 1e-12 && (arms[21] - 0.08).abs() < 1e-12);
        assert!((arms[18] - ((0.25f64.powi(2) + 0.33f64.powi(2)) / 2.0).sqrt()).abs() < 1e-12);
        assert_eq!((arms[22], arms[15], arms[10]), (0.02, 0.02, 0.02));
        assert!((0..24).all(|j| arms[j] <= 1.0 && arms[0] >= 0.5), "{arms:?}");
    }

    proptest! {
        #[test]
        fn the_nearest_vector_is_the_same_rotation(
            v in prop::array::uniform3(-PI..PI), before in prop::array::uniform3(-20.0..20.0f64), still in any::<bool>()
        ) {
            let v = if still { Vec3::ZERO } else { exp_map::canonical(Vec3::from_array(v)) };
            let before = Vec3::from_array(before);
            let near = nearest(v, before);
            prop_assert!(angle_between(exp_map::from_vector(near), exp_map::from_vector(v)) < 1e-7);
            let axis = if still { before.normalize() } else { v.normalize() };
            for k in -5..=5 {
                prop_assert!((near - before).length() <= (v + axis * (TAU * f64::from(k)) - before).length() + 1e-9);
            }
        }
    }
}
