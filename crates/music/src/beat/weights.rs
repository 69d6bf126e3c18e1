//! What is heard at a beat and between two, weighed: fitted, not thought up.
//!
//! Of a count's stretch the logarithms of [`super::flux`]'s series stand here, each over its mean. The weights are those of
//! a conditional logit: of all counts of a stretch the true one should have the highest sum. They were fitted on half of
//! the pieces named in docs/results/music.md, on the music of another game and on clicks; the other half was not looked at.

use super::flux::SERIES;
use super::level::{PLACES, RETURNS};

/// Of the mean at each of [`PLACES`].
pub const PROFILE: [[f32; PLACES.len()]; SERIES] = [
    [0.01, 0.05, -0.01, -0.05, -0.07, -0.17],
    [-0.27, 0.02, 0.0, -0.31, 0.27, -0.43],
    [0.3, -0.15, -0.4, 0.07, -0.11, -0.29],
    [0.46, -0.03, -0.4, 0.0, -0.5, -0.03],
    [0.65, -0.26, -0.74, 0.42, -0.12, 0.14],
    [0.3, -0.34, -0.14, 0.0, -0.14, 0.77],
];
/// Of the difference between every second beat and the others.
pub const ALTERNATION: [f32; SERIES] = [0.0, 0.37, 0.17, 0.16, -0.49, 0.25];
/// Of the median at the beats.
pub const MIDDLE: [f32; SERIES] = [0.21, -0.22, 0.27, 0.5, 0.18, 0.05];
/// Of how alike what rises is after [`RETURNS`] beats.
pub const RETURN: [f32; RETURNS.len()] = [1.0, -0.88, 1.07, 0.95, 0.95];
/// Of the octaves above 110 beats a minute, and of their square.
pub const TEMPO: [f32; 2] = [0.45, -1.7];
