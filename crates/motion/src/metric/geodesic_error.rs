//! Geodesic rotation error between two clips.

use super::{Tally, check_joints, check_pair};
use crate::rotation::angle_between;
use crate::{Clip, Result};

/// Geodesic distances of the local rotations of two clips, over chosen joints and all frames, radians in `0..=PI`.
///
/// `q` and `-q` are equal. All values are 0 before any clip is added.
///
/// Source: geodesic distance on SO(3); Huynh, "Metrics for 3D Rotations" (2009).
#[derive(Debug, Clone, PartialEq)]
pub struct GeodesicError {
    joints: Vec<usize>,
    angles: Tally,
    squares: f64,
    frames: u64,
    histogram: Histogram,
}

impl GeodesicError {
    /// Measures these joints.
    pub fn new(joints: Vec<usize>) -> Self {
        GeodesicError { joints, angles: Tally::default(), squares: 0.0, frames: 0, histogram: Histogram::default() }
    }

    /// Adds two clips with the same number of frames and joints.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when frames or joints differ, or a chosen joint doesn't exist.
    pub fn add(&mut self, a: &Clip, b: &Clip) -> Result<()> {
        check_pair(a, b)?;
        check_joints(&self.joints, a)?;
        for f in 0..a.frames() {
            let (p, q) = (a.pose(f), b.pose(f));
            for &j in &self.joints {
                let angle = angle_between(p[j], q[j]);
                self.angles.add(angle);
                self.squares += angle * angle;
                self.histogram.add(angle);
            }
        }
        self.frames += a.frames() as u64;
        Ok(())
    }

    /// Adds the values of another accumulator for the same joints.
    ///
    /// # Panics
    /// If the joints differ.
    pub fn merge(&mut self, other: &GeodesicError) {
        assert_eq!(self.joints, other.joints, "one choice of joints");
        self.angles.merge(&other.angles);
        self.squares += other.squares;
        self.frames += other.frames;
        self.histogram.merge(&other.histogram);
    }

    /// Mean over joints and frames, radians.
    pub fn mean(&self) -> f64 {
        self.angles.mean()
    }

    /// Root mean square, radians.
    pub fn rms(&self) -> f64 {
        if self.angles.count == 0 { 0.0 } else { (self.squares / self.angles.count as f64).sqrt() }
    }

    /// Maximum, radians.
    pub fn max(&self) -> f64 {
        self.angles.max
    }

    /// The 99th percentile, radians: the upper end of a histogram bin, so at most 0.1 % above the exact value (1e-7 rad for
    /// smaller ones).
    pub fn percentile_99(&self) -> f64 {
        self.histogram.quantile(0.99).min(self.angles.max)
    }

    /// Mean over frames of the sum over joints, radians.
    pub fn sum_joints(&self) -> f64 {
        if self.frames == 0 { 0.0 } else { self.angles.sum / self.frames as f64 }
    }
}

/// Bins per power of two.
const STEPS: u64 = 1024;
/// Numbers below 2^-23, 1.2e-7, share the first bin.
const LOWEST: i64 = -23;
/// Powers of two up to 4, which is above PI.
const DOUBLINGS: u64 = 25;

/// A histogram with bins of constant relative width, formed by the leading bits of an f64. It takes no logarithm, so it is
/// exact on every machine.
#[derive(Debug, Clone, Default, PartialEq)]
struct Histogram {
    /// Empty until the first number.
    counts: Vec<u64>,
}

impl Histogram {
    /// Bin 0 ends at 2^LOWEST, the others hold `lower < x <= upper`.
    fn class(x: f64) -> usize {
        if x <= 2f64.powi(LOWEST as i32) {
            return 0;
        }
        // positive doubles sort as their bits do; minus 1, so that a bin's upper end belongs to it
        let leading = (x.to_bits() - 1) >> (52 - STEPS.trailing_zeros());
        let first = ((1023 + LOWEST) as u64) * STEPS;
        (leading - first + 1).min(DOUBLINGS * STEPS) as usize
    }

    fn upper_end(class: usize) -> f64 {
        let leading = ((1023 + LOWEST) as u64) * STEPS + class as u64;
        f64::from_bits(leading << (52 - STEPS.trailing_zeros()))
    }

    fn add(&mut self, x: f64) {
        if self.counts.is_empty() {
            self.counts = vec![0; (DOUBLINGS * STEPS) as usize + 1];
        }
        self.counts[Self::class(x)] += 1;
    }

    fn merge(&mut self, other: &Histogram) {
        if self.counts.is_empty() {
            self.counts.clone_from(&other.counts);
        } else {
            self.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b);
        }
    }

    /// The upper end of the bin with the `q` quantile.
    fn quantile(&self, q: f64) -> f64 {
        let total: u64 = self.counts.iter().sum();
        let rank = (q * total as f64).ceil() as u64;
        let mut seen = 0;
        let class = self.counts.iter().position(|&n| {
            seen += n;
            seen >= rank && seen > 0
        });
        class.map_or(0.0, Self::upper_end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_are_as_narrow_as_stated() {
        assert_eq!((Histogram::class(0.0), Histogram::class(1e-7)), (0, 0));
        for x in [1.3e-7, 1e-6, 0.5, 0.500001, 1.0, 3.0, std::f64::consts::PI] {
            let class = Histogram::class(x);
            let (low, high) = (Histogram::upper_end(class - 1), Histogram::upper_end(class));
            assert!(low < x && x <= high && high - low <= x / 1023.0, "{x}: {low} {high}");
        }
        assert_eq!(Histogram::upper_end(Histogram::class(0.5)), 0.5, "an end belongs to the class below");
    }

    #[test]
    fn the_hundredth_of_a_hundred() {
        let mut h = Histogram::default();
        (1..=100).for_each(|i| h.add(f64::from(i) * 0.01));
        assert!((0.99..0.991).contains(&h.quantile(0.99)), "{}", h.quantile(0.99));
        assert!((1.0..1.001).contains(&h.quantile(1.0)));
        assert_eq!(Histogram::default().quantile(0.99), 0.0);
    }
}
