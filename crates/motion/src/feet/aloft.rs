//! When both feet are in the air, and whether the body falls then.

use std::ops::Range;

/// Both feet are up above this clearance, metres.
pub(crate) const UP_M: f64 = 0.05;
/// In free fall the acceleration is gravity within [`FALL_SLACK`], m/s^2.
const GRAVITY: f64 = 9.81;
const FALL_SLACK: f64 = 3.0;

/// A range of frames in which both feet are more than 5 cm up.
pub(crate) struct Aloft {
    pub frames: Range<usize>,
    /// The number of these frames in which the pelvis is in free fall.
    pub falls: usize,
}

/// The ranges of a clip in which both feet are up: see [`Ground::of`](crate::metric::Ground::of).
pub(crate) fn aloft(least: &[f64], pelvis: &[f64], fps: f64) -> Vec<Aloft> {
    let step = ((0.05 * fps).round() as usize).max(1);
    let falls = |f: usize, start: usize, end: usize| {
        if end - start < 2 * step + 1 {
            return false;
        }
        // at the ends, where the feet push off or land, use the nearest frame whose 0.1 s are inside
        let f = f.clamp(start + step, end - 1 - step);
        let seconds = step as f64 / fps;
        let acceleration = (pelvis[f + step] - 2.0 * pelvis[f] + pelvis[f - step]) / (seconds * seconds);
        (acceleration + GRAVITY).abs() <= FALL_SLACK
    };
    let (mut all, mut start) = (Vec::new(), 0);
    for stretch in least.chunk_by(|a, b| (*a > UP_M) == (*b > UP_M)) {
        let end = start + stretch.len();
        if stretch[0] > UP_M {
            let falls = (start..end).filter(|&f| falls(f, start, end)).count();
            all.push(Aloft { frames: start..end, falls });
        }
        start = end;
    }
    all
}
