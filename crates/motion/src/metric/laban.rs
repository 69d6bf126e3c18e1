//! Proxies of Laban's Effort and Shape: kinematic figures that stand where a movement analyst would judge. No analyst has
//! judged them.
//!
//! Sources: Larboulette and Gibet, "A review of computable expressive descriptors of human motion" (2015), for Effort;
//! Aristidou, Charalambous and Chrysanthou, "Emotion analysis and classification" (2015), for Shape. Formulas and what is
//! ours: docs/measures.md, "Laban".

use super::angular_effort;
use crate::resample::{Method, resample};
use crate::{Clip, Quat, Result, Vec3, smpl};

/// Frames per second of all proxies: jerk grows with the rate.
const FPS: f64 = 30.0;
/// Standard deviation of the Gaussian low pass of positions, frames: 50 ms, half the amplitude at 3.7 Hz.
const SMOOTH: f64 = 1.5;
/// Frames on either side that the low pass takes: four standard deviations.
const REACH: usize = 6;
/// Frames of a window, and from one to the next: the sources' interval T.
const WINDOW: usize = 30;
const HOP: usize = 15;
/// Head, wrists and ankles, the joints of equal weight.
const ENDS: [usize; 5] = [15, 20, 21, 7, 8];
/// A joint with a shorter path in a window has no direction, metres.
const STILL_M: f64 = 0.01;

/// Proxies of a clip, means over its windows of a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Laban {
    /// Effort's weight: the largest mean square speed of the ends in a window, m²/s².
    pub weight: f64,
    /// Effort's time: mean acceleration of the ends, m/s².
    pub time: f64,
    /// Effort's flow: mean jerk of the ends, m/s³.
    pub flow: f64,
    /// Effort's space: displacement over path, 0 (back where it began) to 1 (straight), mean over the ends that move; `None`
    /// where none does.
    pub space: Option<f64>,
    /// Shape's volume: the convex hull of the ends, m³.
    pub volume: f64,
    /// Shape's box: the box around all joints that is upright and faces as the body does, m³.
    pub box_volume: f64,
    /// The dissertation's weight effort: [`angular_effort`] of all joints, rad/s.
    pub angular: f64,
}

impl Laban {
    /// Measures a clip on SMPL-24 at 30 frames per second, positions after a Gaussian low pass. `None` of clips shorter than
    /// a window and what low pass and differences take from their ends, 1.5 s.
    ///
    /// # Errors
    /// Those of [`resample`].
    ///
    /// # Panics
    /// If the clip is on a rig with fewer joints.
    pub fn of(clip: &Clip) -> Result<Option<Laban>> {
        let at_30 = if clip.fps() == FPS { None } else { Some(resample(clip, FPS, Method::Smooth)?) };
        let clip = at_30.as_ref().unwrap_or(clip);
        let j = clip.joints();
        let places = smoothed(&clip.positions(), j);
        // the jerk of a frame takes two frames on either side
        let all = 2..(places.len() / j).saturating_sub(2);
        let windows: Vec<Window> = all
            .clone()
            .step_by(HOP)
            .filter(|first| first + WINDOW <= all.end)
            .map(|f| Window::of(&places, j, f))
            .collect();
        let mean = |of: fn(&Window) -> f64| windows.iter().map(of).sum::<f64>() / windows.len() as f64;
        let spaces: Vec<f64> = windows.iter().filter_map(|window| window.space).collect();
        let frames = || places.chunks_exact(j).skip(2).take(all.len());
        let steps = angular_effort(clip.rotations(), &vec![1.0; j], FPS);
        let over = |sum: f64, n: usize| sum / n as f64;
        Ok((!windows.is_empty()).then(|| Laban {
            weight: mean(|w| w.weight),
            time: mean(|w| w.time),
            flow: mean(|w| w.flow),
            space: (!spaces.is_empty()).then(|| over(spaces.iter().sum(), spaces.len())),
            volume: over(frames().map(|places| hull(&ENDS.map(|end| places[end]))).sum(), all.len()),
            box_volume: over(boxes(frames()), all.len()),
            angular: over(steps.iter().sum(), steps.len()),
        }))
    }
}

/// Effort over one window.
struct Window {
    weight: f64,
    time: f64,
    flow: f64,
    space: Option<f64>,
}

impl Window {
    /// Of places (F, `j`), from frame `first` on.
    fn of(places: &[Vec3], j: usize, first: usize) -> Window {
        // differences over two, three and five frames, as the source has them
        let at = |f: usize, end: usize| places[f * j + end];
        let speed = |f, end| (at(f + 1, end) - at(f - 1, end)) * (FPS / 2.0);
        let acceleration = |f, end| (at(f + 1, end) - at(f, end) * 2.0 + at(f - 1, end)) * FPS.powi(2);
        let jerk = |f, end| {
            (at(f + 2, end) - at(f + 1, end) * 2.0 + at(f - 1, end) * 2.0 - at(f - 2, end)) * (FPS.powi(3) / 2.0)
        };
        let frames = first..first + WINDOW;
        let mean = |of: &dyn Fn(usize) -> f64| ENDS.iter().map(|end| of(*end)).sum::<f64>() / ENDS.len() as f64;
        let over_time = |of: &dyn Fn(usize) -> f64| frames.clone().map(of).sum::<f64>() / WINDOW as f64;
        let straight = |end: usize| {
            let path: f64 = frames.clone().skip(1).map(|f| (at(f, end) - at(f - 1, end)).length()).sum();
            (path >= STILL_M).then(|| (at(frames.end - 1, end) - at(first, end)).length() / path)
        };
        let moving: Vec<f64> = ENDS.into_iter().filter_map(straight).collect();
        Window {
            weight: frames.clone().map(|f| mean(&|end| speed(f, end).length_squared())).fold(0.0, f64::max),
            time: over_time(&|f| mean(&|end| acceleration(f, end).length())),
            flow: over_time(&|f| mean(&|end| jerk(f, end).length())),
            space: (!moving.is_empty()).then(|| moving.iter().sum::<f64>() / moving.len() as f64),
        }
    }
}

/// Places (F, `j`) after the low pass: (F - 12, `j`), nothing where frames beyond an end would count.
fn smoothed(places: &[Vec3], j: usize) -> Vec<Vec3> {
    let weights = (0..=2 * REACH).map(|k| (-0.5 * ((k as f64 - REACH as f64) / SMOOTH).powi(2)).exp());
    let total: f64 = weights.clone().sum();
    let weights: Vec<f64> = weights.map(|w| w / total).collect();
    let count = places.len().saturating_sub(2 * REACH * j);
    (0..count)
        .map(|i| weights.iter().enumerate().fold(Vec3::ZERO, |sum, (k, w)| sum + places[i + k * j] * *w))
        .collect()
}

/// The volume of the convex hull of five points.
///
/// Four of five points of space are the corners of a tetrahedron in five ways, and these cover the hull exactly twice: with
/// a point inside, the whole and its four parts; else the two and the three parts that the hull can be cut into (Radon).
fn hull(points: &[Vec3; 5]) -> f64 {
    let without = |i: usize| {
        let [a, b, c, d] = [1, 2, 3, 4].map(|k| points[(i + k) % 5]);
        (b - a).cross(c - a).dot(d - a).abs() / 6.0
    };
    (0..5).map(without).sum::<f64>() / 2.0
}

/// The sum over frames of the volume of the box around all joints; a frame without a heading has that of the one before.
fn boxes<'a>(frames: impl Iterator<Item = &'a [Vec3]>) -> f64 {
    let (mut heading, mut sum) = (0.0, 0.0);
    for places in frames {
        heading = smpl::heading_of(places).unwrap_or(heading);
        let back = Quat::from_rotation_y(-heading);
        let turned = || places.iter().map(|p| back * *p);
        let extent = turned().fold(Vec3::MIN, Vec3::max) - turned().fold(Vec3::MAX, Vec3::min);
        sum += extent.x * extent.y * extent.z;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::exp_map;
    use crate::synth;
    use serde_json::Value;

    /// A body that dances, by the same formulas as in the golden file's script.
    fn dancing(frames: usize) -> Clip {
        let time = |f: usize| f as f64 / FPS;
        let root = (0..frames).map(time).map(|t| {
            Vec3::new(0.3 * (3.1 * t).sin(), 0.95 + 0.05 * (7.3 * t).cos(), 0.2 * t + 0.02 * (11.0 * t).sin())
        });
        let turn = |t: f64, j: f64| {
            let part =
                |i: f64| 0.3 * ((2.9 + 0.31 * j) * t + 1.3 * i + j).sin() + 0.05 * (17.0 * t + 0.9 * j + 2.1 * i).sin();
            exp_map::from_vector(Vec3::new(part(0.0), part(1.0), part(2.0)))
        };
        let turns = (0..frames).flat_map(|f| (0..24).map(move |j| turn(time(f), f64::from(j))));
        Clip::new(smpl::neutral(), FPS, root.collect(), turns.collect()).unwrap()
    }

    fn all(found: &Laban) -> [f64; 7] {
        let Laban { weight, time, flow, space, volume, box_volume, angular } = *found;
        [weight, time, flow, space.unwrap(), volume, box_volume, angular]
    }

    #[test]
    fn as_numpy_has_it() {
        let golden: Value = serde_json::from_str(include_str!("../../tests/golden/laban.json")).unwrap();
        for case in golden["cases"].as_array().unwrap() {
            let frames = case["frames"].as_u64().unwrap() as usize;
            let found = all(&Laban::of(&dancing(frames)).unwrap().unwrap());
            for (key, found) in ["weight", "time", "flow", "space", "volume", "box", "angular"].iter().zip(found) {
                let expected = case[key].as_f64().unwrap();
                assert!((found / expected - 1.0).abs() < 1e-9, "{frames} frames, {key}: {found}, numpy {expected}");
            }
        }
    }

    #[test]
    fn the_shortest_clip_has_one_window() {
        let shortest = WINDOW + 2 * (REACH + 2);
        assert!(Laban::of(&dancing(shortest)).unwrap().is_some());
        for frames in [0, 1, 11, 12, 13, shortest - 1] {
            assert_eq!(Laban::of(&dancing(frames)).unwrap(), None, "{frames}");
        }
    }

    #[test]
    fn a_body_that_glides_on_a_line_is_direct_and_has_no_acceleration() {
        let root = (0..90).map(|f| Vec3::new(0.0, 1.0, 2.0 * f as f64 / FPS)).collect();
        let clip = Clip::new(smpl::neutral(), FPS, root, vec![Quat::IDENTITY; 24 * 90]).unwrap();
        let [weight, time, flow, space, volume, box_volume, angular] = all(&Laban::of(&clip).unwrap().unwrap());
        assert!((weight - 4.0).abs() < 1e-9 && (space - 1.0).abs() < 1e-9, "{weight} {space}");
        assert!(time < 1e-9 && flow < 1e-7 && angular == 0.0, "{time} {flow} {angular}");
        let places = &clip.positions()[..24];
        let extent =
            places.iter().copied().fold(Vec3::MIN, Vec3::max) - places.iter().copied().fold(Vec3::MAX, Vec3::min);
        assert!((box_volume - extent.x * extent.y * extent.z).abs() < 1e-9 && volume < box_volume);
        let still = Clip::new(clip.skeleton().clone(), FPS, vec![Vec3::Y; 90], clip.rotations().to_vec()).unwrap();
        assert_eq!(Laban::of(&still).unwrap().unwrap().space, None, "nothing moves");
    }

    #[test]
    fn five_points_by_hand() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        let with = |p: Vec3| hull(&[corners[0], corners[1], corners[2], corners[3], p]);
        assert!((with(Vec3::splat(0.1)) - 1.0 / 6.0).abs() < 1e-12, "inside a tetrahedron");
        // mirrored over the face that the axes' ends span: two tetrahedra
        assert!((with(Vec3::splat(2.0 / 3.0)) - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(hull(&[Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X + Vec3::Y, Vec3::X * 3.0]), 0.0, "in a plane");
    }

    #[test]
    fn where_one_dances_and_at_which_rate_changes_little() {
        let fast = synth::corpus(4, 1, 8.0, 120.0).unwrap().remove(0).clip;
        let of = |clip: &Clip| all(&Laban::of(clip).unwrap().unwrap());
        let expected = of(&fast);
        let turn = Quat::from_rotation_y(1.2);
        let root = fast.root().iter().map(|p| turn * *p + Vec3::new(5.0, 0.0, 3.0)).collect();
        let mut rotations = fast.rotations().to_vec();
        rotations.iter_mut().step_by(24).for_each(|pelvis| *pelvis = turn * *pelvis);
        let there = Clip::new(fast.skeleton().clone(), 120.0, root, rotations).unwrap();
        for (a, b) in expected.iter().zip(of(&there)) {
            assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
        }
        for fps in [20.0, 30.0, 60.0] {
            for (i, (a, b)) in expected.iter().zip(of(&resample(&fast, fps, Method::Auto).unwrap())).enumerate() {
                assert!((a / b - 1.0).abs() < 0.05, "{fps} fps, {i}: {a} {b}");
            }
        }
    }
}
