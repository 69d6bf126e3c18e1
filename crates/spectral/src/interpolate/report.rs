//! Measures of a blend.

use super::Coordinates;
use crate::Transform;
use serde::Serialize;
use std::fmt;

/// The most jitter that the blend may have, as a multiple of the larger one of the two dances.
pub const JITTER_BOUND: f64 = 1.1;

/// How alike three windows are, by the cosine of their features.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Likeness {
    /// The first and the second.
    pub a_b: f64,
    /// The first and the one between.
    pub a_c: f64,
    /// The one between and the second.
    pub c_b: f64,
}

/// The measures of a blend.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Frames of the window.
    pub frames: usize,
    /// Frames per second.
    pub fps: f64,
    /// C.
    pub channels: usize,
    /// Which numbers of the rotations are blended.
    pub coordinates: Coordinates,
    /// The transform, in words.
    pub transform: String,
    /// Numbers of a feature.
    pub numbers: usize,
    /// The method with its settings, in words.
    pub method: String,
    /// By STFT features of unwound rotation vectors, whatever is blended.
    pub stft: Likeness,
    /// By the features of the transform, of the numbers that are blended.
    pub own: Likeness,
    /// The loss at the beginning and at the end of the way.
    pub loss: [f64; 2],
    /// Jitter of the first, the second and the one between, m/s^3.
    pub jitter: [f64; 3],
    /// Jitter of the one between over the larger of the others'; `None` where these don't move.
    pub jitter_ratio: Option<f64>,
    /// Whether it is between the two by STFT features: nearer to either than they are to each other.
    pub is_between: bool,
    /// Whether it shakes at most a tenth more than the more shaken of the two.
    pub is_smooth: bool,
}

impl Likeness {
    /// Of windows a, b, c.
    pub(super) fn of(transform: &Transform, channels: usize, [a, b, c]: [&Vec<f64>; 3]) -> Likeness {
        let [a, b, c] = [a, b, c].map(|x| transform.feature(x, channels));
        Likeness { a_b: cosine(&a, &b), a_c: cosine(&a, &c), c_b: cosine(&c, &b) }
    }
}

/// The cosine of the angle between two features; 0 where one of them is 0.
fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let size = (dot(a, a) * dot(b, b)).sqrt();
    if size > 0.0 { dot(a, b) / size } else { 0.0 }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Report { method, frames, fps, channels, .. } = self;
        writeln!(f, "{method}, {}; {frames} frames at {fps} fps, {channels} channels", self.coordinates.in_words())?;
        writeln!(f, "loss {:.3e} to {:.3e}", self.loss[0], self.loss[1])?;
        writeln!(f, "{:<14}{:>8}{:>8}{:>8}", "cosine of", "A-B", "A-C", "C-B")?;
        for (name, l) in [("stft 16/8", self.stft), (&self.transform, self.own)] {
            writeln!(f, "{name:<14}{:>8.3}{:>8.3}{:>8.3}", l.a_b, l.a_c, l.c_b)?;
        }
        let [a, b, c] = self.jitter;
        write!(f, "jitter, m/s^3: A {a:.0}, B {b:.0}, C {c:.0}")?;
        if let Some(ratio) = self.jitter_ratio {
            write!(f, ", {ratio:.2} of the larger")?;
        }
        let yes = |is: bool| if is { "yes" } else { "no" };
        write!(f, "\nnearer to both than they are to each other: {}; ", yes(self.is_between))?;
        write!(f, "at most {JITTER_BOUND} of their jitter: {}", yes(self.is_smooth))
    }
}
