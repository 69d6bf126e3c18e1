//! Unwound rotation vectors: what is measured of a blend, and what the thesis blends.

use crate::series::outwards;
use crate::{Result, Series};
use kinelm_motion::{Clip, Vec3};
use std::f64::consts::TAU;

/// Rotation vectors of every joint of a clip, without jumps through any number of turns.
///
/// # Errors
/// Errors of [`Series::of`].
pub fn unwound(clip: &Clip) -> Result<Series> {
    let mut series = Series::of(clip, &[], clip.fps(), true)?;
    for joint in 0..series.channels.len() / 3 {
        let mut vectors = vectors(&series, joint);
        // turns of any number, where `Series::window` knows one
        outwards(&mut vectors, nearest);
        put(&mut series, joint, &vectors);
    }
    Ok(series)
}

/// Every joint's vectors begun with another number of turns where that brings them nearer to `to`'s.
pub fn to_nearest_branches(series: &mut Series, to: &Series) {
    for joint in 0..series.channels.len() / 3 {
        let (own, other) = (vectors(series, joint), vectors(to, joint));
        let off = |path: &[Vec3]| path.iter().zip(&other).map(|(a, b)| (*a - *b).length_squared()).sum::<f64>();
        let begun = |from: &[Vec3], turns: f64| -> Vec<Vec3> {
            let mut path = from.to_vec();
            path[0] = path[0] + path[0].normalize_or_zero() * (TAU * turns);
            for f in 1..path.len() {
                path[f] = nearest(path[f], path[f - 1]);
            }
            path
        };
        let mut best = own;
        // a turn at a time, while it helps; more turns than frames no body makes
        for _ in 0..series.frames {
            let paths = [-1.0, 1.0].map(|turns| begun(&best, turns));
            let Some(path) = paths.into_iter().find(|path| off(path) < off(&best)) else { break };
            best = path;
        }
        put(series, joint, &best);
    }
}

/// Of all vectors of a rotation, `v + 2 PI k v/|v|`, the one nearest to another.
fn nearest(v: Vec3, to: Vec3) -> Vec3 {
    let angle = v.length();
    // no axis to add turns along
    if angle < 1e-9 {
        return v;
    }
    let axis = v / angle;
    axis * (angle + TAU * ((to.dot(axis) - angle) / TAU).round())
}

fn vectors(series: &Series, joint: usize) -> Vec<Vec3> {
    let axis = |i: usize| series.channel(3 * joint + i);
    (0..series.frames).map(|f| Vec3::new(axis(0)[f], axis(1)[f], axis(2)[f])).collect()
}

fn put(series: &mut Series, joint: usize, vectors: &[Vec3]) {
    for (f, v) in vectors.iter().enumerate() {
        for axis in 0..3 {
            series.numbers[(3 * joint + axis) * series.frames + f] = v[axis];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::Skeleton;
    use kinelm_motion::rotation::exp_map;
    use std::sync::Arc;

    /// Two dancers on either side of half a turn are near each other.
    #[test]
    fn vectors_stand_on_one_branch() {
        let one = |from: f64, speed: f64| {
            let s = Skeleton::new(vec!["a".into()], vec![None], vec![Vec3::ZERO], vec![]).unwrap();
            let at = |f: usize| exp_map::from_vector(Vec3::new(0.0, from + speed * f as f64, 0.0));
            let clip = Clip::new(Arc::new(s), 60.0, vec![Vec3::Y; 128], (0..128).map(at).collect()).unwrap();
            unwound(&clip).unwrap()
        };
        let near = |mut series: Series, to: &Series| {
            to_nearest_branches(&mut series, to);
            series
        };
        let still = one(3.0, 0.0);
        let beside = near(one(3.3, 0.0), &still);
        assert!((still.channel(1)[5] - 3.0).abs() < 1e-9 && (beside.channel(1)[5] - 3.3).abs() < 1e-9);
        // three turns, counted on from frame 125, which is nearest to whole turns; the other from frame 123
        let spin = one(0.1, 0.15);
        for (s, from) in [(&spin, 0.1), (&near(one(0.4, 0.15), &spin), 0.4)] {
            for f in [0, 125, 127] {
                let at = s.channel(1)[f];
                assert!((at - (from + 0.15 * f as f64 - 3.0 * TAU)).abs() < 1e-6, "{f}: {at}");
            }
        }
    }
}
