//! The nearness of two features, and the options of a search.

use serde::{Deserialize, Serialize};

/// A bound of the relative error of f64 sums of a feature's numbers: far above what their order changes.
const SLACK: f64 = 1e-11;

/// The measure of nearness.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Distance {
    /// Greatest cosine `a.b / (|a||b|)`; 0 where either is zero.
    Cosine,
    /// Least Euclidean distance.
    Euclid,
}

impl Distance {
    /// Its name in tables and flags.
    pub fn name(self) -> &'static str {
        match self {
            Distance::Cosine => "cosine",
            Distance::Euclid => "euclid",
        }
    }

    /// How near two features are: the cosine, or minus the distance. More is nearer.
    pub fn score(self, a: &[f32], b: &[f32]) -> f64 {
        match self {
            Distance::Euclid => -squared_distance(a, b).sqrt(),
            Distance::Cosine => match (dot(a, a) * dot(b, b)).sqrt() {
                size if size > 0.0 => dot(a, b) / size,
                _ => 0.0,
            },
        }
    }

    /// The least or greatest that a rank (the cosine, or minus the squared distance) may be of features of lengths `a` and
    /// `b`, by the least or greatest that their cosine may be.
    pub(super) fn rank(self, cosine: f64, side: Side, a: f64, b: f64) -> f64 {
        let (rank, size) = match self {
            // exactly 0, as `score` has it for a feature of zeros
            Distance::Cosine if a * b == 0.0 => (0.0, 0.0),
            Distance::Cosine => (cosine, 1.0),
            Distance::Euclid => {
                let squares = a * a + b * b;
                // |a - b|^2 by the cosine, which is all that a scan knows
                (2.0 * a * b * cosine - squares, squares)
            }
        };
        // outward, so that rounding never drops a window that is among the nearest
        match side {
            Side::Least => rank - SLACK * size,
            Side::Greatest => rank + SLACK * size,
        }
    }
}

/// Which bound.
#[derive(Debug, Clone, Copy)]
pub(super) enum Side {
    Least,
    Greatest,
}

impl Side {
    fn other(self) -> Side {
        match self {
            Side::Least => Side::Greatest,
            Side::Greatest => Side::Least,
        }
    }
}

/// The options of a search.
#[derive(Debug, Clone, Copy)]
pub struct SearchOptions {
    /// k.
    pub k: usize,
    /// The measure of nearness.
    pub distance: Distance,
    /// Of each clip only its nearest window, or its farthest where the farthest are searched.
    pub one_per_clip: bool,
    /// The k farthest, farthest first, instead of the nearest.
    pub farthest: bool,
}

impl SearchOptions {
    /// As [`Distance::rank`], negated where the farthest windows are searched: a greater one is always found first.
    #[inline]
    pub(super) fn rank(&self, cosine: impl Fn(Side) -> f64, side: Side, a: f64, b: f64) -> f64 {
        match self.farthest {
            false => self.distance.rank(cosine(side), side, a, b),
            true => -self.distance.rank(cosine(side.other()), side.other(), a, b),
        }
    }
}

/// Dot product in f64, always in the same order.
pub fn dot(a: &[f32], b: &[f32]) -> f64 {
    sum_of(a, b, |a, b| a * b)
}

/// The square of the distance, always in the same order.
pub fn squared_distance(a: &[f32], b: &[f32]) -> f64 {
    sum_of(a, b, |a, b| (a - b) * (a - b))
}

fn sum_of(a: &[f32], b: &[f32], term: impl Fn(f64, f64) -> f64) -> f64 {
    // eight sums side by side: one alone waits for each of its additions
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (a, b) in a8.iter().zip(b8) {
        for (s, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *s += term(f64::from(*a), f64::from(*b));
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| term(f64::from(*a), f64::from(*b))).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::tests::noise;

    #[test]
    fn sums_are_those_of_the_definition() {
        let numbers = |seed| noise(seed, 67).iter().map(|&x| x as f32).collect::<Vec<f32>>();
        let (a, b) = (numbers(1), numbers(2));
        for n in [0, 1, 7, 8, 67] {
            let pairs = || a[..n].iter().zip(&b[..n]).map(|(&a, &b)| (f64::from(a), f64::from(b)));
            let expected: f64 = pairs().map(|(a, b)| a * b).sum();
            assert!((dot(&a[..n], &b[..n]) - expected).abs() < 1e-13);
            let expected: f64 = pairs().map(|(a, b)| (a - b).powi(2)).sum();
            assert!((squared_distance(&a[..n], &b[..n]) - expected).abs() < 1e-13);
        }
    }
}
