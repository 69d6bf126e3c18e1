//! Kinetic features: speeds and accelerations of joints.
//!
//! Source: Onuma, Faloutsos, Hodgins, "FMDistance: a fast and effective distance function for motion capture data" (2008);
//! the code of fairmotion and its descendants.

use super::{COMPAT_FPS, Formulas, JointPositions};
use crate::Vec3;

/// Three per joint: mean square of the horizontal speed, of the vertical speed, and mean acceleration.
pub const KINETIC: usize = 72;

/// Frames on each side over which a speed is averaged.
const REACH: i64 = 2;

/// The features, joint by joint. `Compat` takes a frame as 1/60 s at any rate; `Fixed` returns ln(x + 0.001).
pub fn kinetic(positions: &JointPositions, form: Formulas) -> [f64; KINETIC] {
    let mut features = [0.0; KINETIC];
    let fps = if form == Formulas::Compat { COMPAT_FPS } else { positions.fps };
    let steps = positions.frames() - 1;
    for joint in 0..24 {
        let [along, upward, faster] = [0, 1, 2].map(|i| 3 * joint + i);
        for frame in 1..positions.frames() {
            let v = speed(positions, joint, frame) * fps;
            features[along] += v.x * v.x + v.z * v.z;
            features[upward] += v.y * v.y;
            features[faster] += acceleration(positions, joint, frame, fps, form).length();
        }
        features[3 * joint..3 * joint + 3].iter_mut().for_each(|x| *x /= steps as f64);
    }
    if form == Formulas::Fixed {
        // energies span powers of ten; 0.001 bounds the logarithm of a joint that stands still
        features.iter_mut().for_each(|x| *x = (*x + 1e-3).ln());
    }
    features
}

/// The mean of `of` over the frames around `frame` whose neighbours from `-1` to `ahead` are in the clip.
fn mean(positions: &JointPositions, frame: usize, lookahead: i64, of: impl Fn(usize) -> Vec3) -> Vec3 {
    let around = (-REACH..=REACH).map(|d| frame as i64 + d);
    let within = around.filter(|i| *i >= 1 && i + lookahead < positions.frames() as i64);
    let (sum, n) = within.fold((Vec3::ZERO, 0.0), |(sum, n), i| (sum + of(i as usize), n + 1.0));
    sum / f64::max(n, 1.0)
}

/// Speed in metres per frame.
fn speed(positions: &JointPositions, joint: usize, frame: usize) -> Vec3 {
    mean(positions, frame, 0, |i| positions.at(i, joint) - positions.at(i - 1, joint))
}

fn acceleration(positions: &JointPositions, joint: usize, frame: usize, fps: f64, form: Formulas) -> Vec3 {
    mean(positions, frame, 1, |i| {
        let [before, now, next] = [i - 1, i, i + 1].map(|i| positions.at(i, joint));
        match form {
            // published code misplaces a bracket: only the position before is divided, so positions count instead of differences
            Formulas::Compat => ((next - now) * fps - (now - before * fps)) * fps,
            Formulas::Fixed => (next - now * 2.0 + before) * fps * fps,
        }
    })
}
