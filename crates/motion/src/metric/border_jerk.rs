//! Visibility of the borders between tiles.

use super::mpjpe::check_places;
use super::{Tally, check_pair};
use crate::{Clip, Result, Vec3};

/// Jerk at the borders of tiles relative to jerk elsewhere, compared with the same quotient of the original motion.
///
/// With positions p(t), `j(t) = p(t+3) - 3 p(t+2) + 3 p(t+1) - p(t)`; a border at frame b affects t = b-3, b-2, b-1. Borders
/// are at the multiples of `hop` frames inside a clip. `|j|` is averaged over joints, frames and clips; a ratio of 1 is
/// an invisible border.
#[derive(Debug, Clone, PartialEq)]
pub struct BorderJerk {
    hop: usize,
    original: [Tally; 2],
    decoded: [Tally; 2],
}

impl BorderJerk {
    /// Borders every `hop` frames.
    ///
    /// # Panics
    /// If `hop` is 0.
    pub fn new(hop: usize) -> Self {
        assert!(hop > 0, "borders are at least a frame apart");
        BorderJerk { hop, original: [Tally::default(); 2], decoded: [Tally::default(); 2] }
    }

    /// Adds a clip and its decoded version with the same number of frames and joints.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when frames or joints differ.
    pub fn add(&mut self, original: &Clip, decoded: &Clip) -> Result<()> {
        check_pair(original, decoded)?;
        self.add_positions(&original.positions(), &decoded.positions(), original.joints())
    }

    /// Adds positions (F, J), metres, that start at a border.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the numbers of positions differ, or they make no whole frames.
    pub fn add_positions(&mut self, original: &[Vec3], decoded: &[Vec3], joints: usize) -> Result<()> {
        check_places(original, decoded, joints)?;
        for (positions, tallies) in [(original, &mut self.original), (decoded, &mut self.decoded)] {
            let last = (positions.len() / joints).saturating_sub(3);
            for t in 0..last {
                // a border between t and t + 3: four positions from both tiles
                let touches = (t + 3) / self.hop > t / self.hop;
                for j in 0..joints {
                    let p = |k: usize| positions[(t + k) * joints + j];
                    let jerk = p(3) - p(2) * 3.0 + p(1) * 3.0 - p(0);
                    tallies[usize::from(touches)].add(jerk.length());
                }
            }
        }
        Ok(())
    }

    /// Adds the values of another accumulator with the same hop.
    ///
    /// # Panics
    /// If the hops differ.
    pub fn merge(&mut self, other: &BorderJerk) {
        assert_eq!(self.hop, other.hop, "borders at the same frames");
        self.original.iter_mut().zip(&other.original).for_each(|(a, b)| a.merge(b));
        self.decoded.iter_mut().zip(&other.decoded).for_each(|(a, b)| a.merge(b));
    }

    /// [Mean at borders / mean elsewhere] of the decoded motion, divided by that of the original. `None` if a mean is
    /// missing or 0: tiles of at most three frames, clips of one tile, bodies that don't move.
    pub fn ratio(&self) -> Option<f64> {
        Some(quotient(&self.decoded)? / quotient(&self.original)?)
    }

    /// Mean at borders / mean elsewhere of the decoded motion alone.
    pub fn decoded(&self) -> Option<f64> {
        quotient(&self.decoded)
    }

    /// Mean at borders / mean elsewhere of the original motion alone.
    pub fn original(&self) -> Option<f64> {
        quotient(&self.original)
    }
}

fn quotient([inside, touching]: &[Tally; 2]) -> Option<f64> {
    (inside.sum > 0.0 && touching.sum > 0.0).then(|| touching.mean() / inside.mean())
}
