//! Fitted weights of the beat tracker's scores.
//!
//! They weight the logarithms of [`super::flux`]'s series relative to their means over a stretch, in a conditional logit over
//! all counts. docs/results/music.md names the pieces that they were fitted to.

use super::flux::SERIES;

/// Positions at and between beats at which the flux is measured, in beats.
pub const PLACES: [f64; 6] = [0.0, 0.25, 1.0 / 3.0, 0.5, 2.0 / 3.0, 0.75];
/// Numbers of beats after which patterns repeat.
pub const RETURNS: [usize; 5] = [1, 2, 3, 4, 8];

/// For the mean at each of [`PLACES`].
pub const PROFILE: [[f32; PLACES.len()]; SERIES] = [
    [0.01, 0.05, -0.01, -0.05, -0.07, -0.17],
    [-0.27, 0.02, 0.0, -0.31, 0.27, -0.43],
    [0.3, -0.15, -0.4, 0.07, -0.11, -0.29],
    [0.46, -0.03, -0.4, 0.0, -0.5, -0.03],
    [0.65, -0.26, -0.74, 0.42, -0.12, 0.14],
    [0.3, -0.34, -0.14, 0.0, -0.14, 0.77],
];
/// For the difference between even and odd beats.
pub const ALTERNATION: [f32; SERIES] = [0.0, 0.37, 0.17, 0.16, -0.49, 0.25];
/// For the median at the beats.
pub const MIDDLE: [f32; SERIES] = [0.21, -0.22, 0.27, 0.5, 0.18, 0.05];
/// For the autocorrelation of rises after [`RETURNS`] beats.
pub const RETURN: [f32; RETURNS.len()] = [1.0, -0.88, 1.07, 0.95, 0.95];
/// For the octaves above 110 beats a minute, and their square.
pub const TEMPO: [f32; 2] = [0.45, -1.7];
