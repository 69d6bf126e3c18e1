//! The path of a point in space.

use crate::{Clip, Vec3};

/// The size of a path. All in metres; 0 without positions.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct JointPath {
    /// The sum of the distances from each position to the next. It grows with the rate: noise between frames counts too.
    pub length_m: f64,
    /// The largest distance between two positions.
    pub extent_m: f64,
    /// The sides of the box along x, y and z that holds all positions.
    pub box_m: Vec3,
}

impl JointPath {
    /// Measures positions (F), metres.
    pub fn of(positions: &[Vec3]) -> JointPath {
        let Some(&first) = positions.first() else { return JointPath::default() };
        let (low, high) = positions.iter().fold((first, first), |(low, high), p| (low.min(*p), high.max(*p)));
        JointPath {
            length_m: positions.windows(2).map(|pair| pair[0].distance(pair[1])).sum(),
            extent_m: extent(positions, (low + high) / 2.0),
            box_m: high - low,
        }
    }

    /// Measures a joint of a clip in the world.
    ///
    /// # Panics
    /// When the clip has no such joint.
    pub fn of_joint(clip: &Clip, joint: usize) -> JointPath {
        assert!(joint < clip.joints(), "joint {joint} of {}", clip.joints());
        let positions: Vec<Vec3> = clip.positions().into_iter().skip(joint).step_by(clip.joints()).collect();
        JointPath::of(&positions)
    }
}

/// The largest distance between two positions: pairs in the order of their distances from a middle, until no later pair
/// can be farther apart.
fn extent(positions: &[Vec3], middle: Vec3) -> f64 {
    let mut far: Vec<(f64, Vec3)> = positions.iter().map(|p| (p.distance(middle), *p)).collect();
    far.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut largest = 0.0f64;
    for (i, (radius, p)) in far.iter().enumerate() {
        for (other, q) in &far[i + 1..] {
            // the triangle inequality: two positions are at most as far apart as the middle is from both
            if radius + other < largest {
                break;
            }
            largest = largest.max(p.distance(*q));
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth;
    use std::f64::consts::{PI, TAU};

    #[test]
    fn a_circle() {
        // 40 chords of a circle of radius 0.5 m at a height of 1.2 m, tilted in no way
        let at =
            |i: usize| Vec3::new(3.0 + 0.5 * (TAU * i as f64 / 40.0).cos(), 1.2, 0.5 * (TAU * i as f64 / 40.0).sin());
        let path = JointPath::of(&(0..=40).map(at).collect::<Vec<_>>());
        assert!((path.length_m - 40.0 * (PI / 40.0).sin()).abs() < 1e-12, "{path:?}");
        assert!((path.extent_m - 1.0).abs() < 1e-12 && (path.box_m - Vec3::new(1.0, 0.0, 1.0)).length() < 1e-12);
        // half of it: the same extent, half of the length and of the depth
        let half = JointPath::of(&(0..=20).map(at).collect::<Vec<_>>());
        assert!((half.length_m - path.length_m / 2.0).abs() < 1e-12 && (half.extent_m - 1.0).abs() < 1e-12);
        assert!((half.box_m.z - 0.5).abs() < 1e-12);
        assert_eq!(JointPath::of(&[]), JointPath::default());
        assert_eq!(JointPath::of(&[Vec3::ONE]), JointPath::default());
    }

    #[test]
    fn the_extent_is_that_of_all_pairs() {
        let clip = synth::corpus(3, 1, 4.0, 60.0).unwrap().remove(0).clip;
        for joint in [0, 15, 20, 23] {
            let positions: Vec<Vec3> = clip.positions().into_iter().skip(joint).step_by(clip.joints()).collect();
            let pairs = positions.iter().flat_map(|p| positions.iter().map(|q| p.distance(*q)));
            let path = JointPath::of_joint(&clip, joint);
            assert_eq!(path.extent_m, pairs.fold(0.0, f64::max), "{joint}");
            assert!(path.extent_m <= path.length_m && path.box_m.length() >= path.extent_m - 1e-12);
        }
    }
}
