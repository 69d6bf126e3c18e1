//! Measures: distances between two motions, and quality measures of one.
//!
//! Most measures are accumulators of constant size: clips are added, and accumulators merged. Sums are f64 in the order of
//! the calls, so merging in a fixed order gives the same bits for any number of threads.

pub mod angular;
pub mod balance;
pub mod beat;
pub mod border_jerk;
pub mod contact;
pub mod extremes;
pub mod features;
pub mod geodesic_error;
pub mod ground;
pub mod in_between;
pub mod jitter;
pub mod laban;
pub mod mpjpe;
pub mod path;
pub mod short_term;
pub mod skate;
pub mod vector_angle;

pub use angular::angular_effort;
pub use balance::{Balance, BalanceFrame};
pub use border_jerk::BorderJerk;
pub use contact::FootContact;
pub use extremes::{Extremes, HINGES};
pub use geodesic_error::GeodesicError;
pub use ground::Ground;
pub use in_between::{InBetween, PositionScale, TrueGap};
pub use jitter::{jitter, jitter_of};
pub use laban::Laban;
pub use mpjpe::Mpjpe;
pub use path::JointPath;
pub use short_term::ShortTerm;
pub use skate::Skate;
pub use vector_angle::VectorAngle;

use crate::{Clip, Error, Result};

/// Refuses two clips with different numbers of frames or joints.
fn check_pair(a: &Clip, b: &Clip) -> Result<()> {
    let ([f, g], [j, k]) = ([a.frames(), b.frames()], [a.joints(), b.joints()]);
    if (f, j) != (g, k) {
        let (found, expected) = (format!("one of {g} frames and {k} joints"), format!("{f} frames and {j} joints"));
        return Err(Error::invalid("the second clip", found, format!("{expected}, as the first has")));
    }
    Ok(())
}

/// Refuses joints that a clip lacks.
fn check_joints(joints: &[usize], clip: &Clip) -> Result<()> {
    match joints.iter().find(|&&j| j >= clip.joints()) {
        Some(j) => {
            Err(Error::invalid("a joint to measure", j, format!("less than {}, the clip's joints", clip.joints())))
        }
        None => Ok(()),
    }
}

/// Count, sum and maximum of non-negative numbers.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Tally {
    count: u64,
    sum: f64,
    max: f64,
}

impl Tally {
    fn add(&mut self, x: f64) {
        self.count += 1;
        self.sum += x;
        self.max = self.max.max(x);
    }

    fn merge(&mut self, other: &Tally) {
        self.count += other.count;
        self.sum += other.sum;
        self.max = self.max.max(other.max);
    }

    /// The mean; 0 if nothing was counted.
    fn mean(&self) -> f64 {
        if self.count == 0 { 0.0 } else { self.sum / self.count as f64 }
    }
}

#[cfg(test)]
mod tests;
