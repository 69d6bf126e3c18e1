//! A dance without its fast movements: for teaching simpler versions of it.
//!
//! A low pass is made for numbers; rotations have to be made numbers without a break. Unit quaternions whose signs follow
//! each other have none: a turn of any length is a smooth curve of them, where Euler angles jump at 180 degrees and rotation
//! vectors at a full turn. Their four components are filtered each by itself and made unit again, which for small movements
//! is what filtering rotation vectors would do, and for a steady spin changes nothing but its length, that is nothing at all.
//!
//! A spin of n turns a second is a wave of n/2 Hz in quaternions. One beyond the band is taken away like any other
//! movement; where less than half of a joint's quaternion is left, its direction means little, and [`Filtered::too_fast`] counts
//! it.

pub mod butterworth;
mod compat;
pub mod hips;

pub use butterworth::Butterworth;
pub use compat::compat;

use crate::{Error, Result};
use kinelm_motion::rotation::nearest_sign;
use kinelm_motion::{Clip, Quat, Vec3};
use kinelm_tokenizer::transform::dct::Dct;

/// The highest frequency of the low band, Hz: coefficients 0 to 15 of 128 frames at 60 a second.
pub const LOW_HZ: f64 = 15.0 * 60.0 / 256.0;
/// The highest frequency of the low and middle bands together, Hz: coefficients 0 to 31 of 128 frames at 60 a second.
pub const MIDDLE_HZ: f64 = 31.0 * 60.0 / 256.0;

/// A low pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Filter {
    /// The cosine transform over the whole clip, up to the last coefficient that isn't above this frequency, Hz.
    Band {
        /// Hz.
        cutoff_hz: f64,
    },
    /// A number of coefficients of the cosine transform over the whole clip.
    Coefficients {
        /// K: coefficients 0 to K - 1 stay.
        keep: usize,
    },
    /// Butterworth, forth and back.
    Butterworth {
        /// Poles.
        order: usize,
        /// Hz.
        cutoff_hz: f64,
    },
}

/// A filtered clip.
#[derive(Debug, Clone)]
pub struct Filtered {
    /// The clip: the same skeleton, rate and frames.
    pub clip: Clip,
    /// Coefficients that stay, and all; `None` for Butterworth.
    pub coefficients: Option<[usize; 2]>,
    /// (frame, joint) of rotations that turn too fast for the band, of which the filter left less than half: those with
    /// nothing left are as they were.
    pub too_fast: Vec<(usize, usize)>,
}

/// How many coefficients of a cosine transform over `frames` at `fps` aren't above a frequency: those with
/// `k fps / (2 frames) <= cutoff_hz`. 16 for [`LOW_HZ`] and 32 for [`MIDDLE_HZ`] of 128 frames at 60 a second.
pub(crate) fn coefficients(frames: usize, fps: f64, cutoff_hz: f64) -> usize {
    // 1e-9: 256 * 3.515625 / 60 is 15 and may come out just below
    ((2 * frames) as f64 * cutoff_hz / fps + 1e-9).floor() as usize + 1
}

impl Filter {
    /// A clip without movements above a frequency: rotations and the root's path.
    ///
    /// Beyond the clip's ends the cosine transform goes on as if time ran backwards there, Butterworth as if turned by half
    /// a circle about the end. Source: the thesis's figure 3.5 and scipy's `filtfilt` (docs/interpolation.md).
    ///
    /// # Errors
    /// A cut-off that isn't above 0 and below half the rate; more coefficients than frames, or none; for Butterworth what
    /// `Butterworth::new` and `Butterworth::filtfilt` refuse; a clip without frames.
    pub fn apply(&self, clip: &Clip) -> Result<Filtered> {
        if clip.frames() == 0 {
            return Err(Error::missing("frames to filter", "the clip is empty"));
        }
        let pass = Pass::new(clip, self)?;
        let (f, j) = (clip.frames(), clip.joints());
        let axes = [0, 1, 2].map(|i| clip.root().iter().map(|p| p[i]).collect::<Vec<f64>>());
        let [x, y, z] = pass.all(axes)?;
        let root = (0..f).map(|t| Vec3::new(x[t], y[t], z[t])).collect();
        let (mut rotations, mut too_fast) = (clip.rotations().to_vec(), Vec::new());
        for joint in 0..j {
            let own: Vec<Quat> = continuous((0..f).map(|t| clip.rotations()[t * j + joint]));
            let parts = [0, 1, 2, 3].map(|i| own.iter().map(|q| q.to_array()[i]).collect::<Vec<f64>>());
            let [x, y, z, w] = pass.all(parts)?;
            for t in 0..f {
                let q = Quat::from_xyzw(x[t], y[t], z[t], w[t]);
                // a length of 1/2: the filter has taken away half of a unit quaternion
                if q.length_squared() < 0.25 {
                    too_fast.push((t, joint));
                }
                // below it the direction is rounding, and the rotation stays as it was
                if q.length_squared() > 1e-6 {
                    rotations[t * j + joint] = q.normalize();
                }
            }
        }
        let clip = Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)?;
        let coefficients = match pass {
            Pass::Band { keep, .. } => Some([keep, f]),
            Pass::Butterworth(_) => None,
        };
        Ok(Filtered { clip, coefficients, too_fast })
    }
}

/// Rotations of one joint over time, each with the sign that is nearer to the one before.
pub(crate) fn continuous(rotations: impl Iterator<Item = Quat>) -> Vec<Quat> {
    let mut all: Vec<Quat> = Vec::new();
    for q in rotations {
        all.push(all.last().map_or(q, |&before| nearest_sign(q, before)));
    }
    all
}

/// A filter made for one clip.
enum Pass {
    Band { dct: Dct, keep: usize },
    Butterworth(Butterworth),
}

impl Pass {
    fn new(clip: &Clip, filter: &Filter) -> Result<Pass> {
        let (f, fps) = (clip.frames(), clip.fps());
        let band = |keep: usize| Pass::Band { dct: Dct::new(f), keep };
        match *filter {
            Filter::Band { cutoff_hz } if !(cutoff_hz > 0.0 && cutoff_hz < 0.5 * fps) => Err(beyond(cutoff_hz, fps)),
            Filter::Band { cutoff_hz } => Ok(band(coefficients(f, fps, cutoff_hz).min(f))),
            Filter::Coefficients { keep } if keep == 0 || keep > f => {
                Err(Error::invalid_parameter("keep", keep, format!("1 to {f}, the clip's frames")))
            }
            Filter::Coefficients { keep } => Ok(band(keep)),
            Filter::Butterworth { order, cutoff_hz } => Ok(Pass::Butterworth(Butterworth::new(order, cutoff_hz, fps)?)),
        }
    }

    /// Each of some series filtered.
    fn all<const N: usize>(&self, mut series: [Vec<f64>; N]) -> Result<[Vec<f64>; N]> {
        for x in &mut series {
            match self {
                Pass::Band { dct, keep } => {
                    let mut scratch = vec![0.0; dct.scratch_len()];
                    dct.forward(x, &mut scratch);
                    x[*keep..].fill(0.0);
                    dct.inverse(x, &mut scratch);
                }
                Pass::Butterworth(filter) => *x = filter.filtfilt(x)?,
            }
        }
        Ok(series)
    }
}

/// A cut-off that a rate can't hold.
fn beyond(cutoff_hz: f64, fps: f64) -> Error {
    let half = 0.5 * fps;
    let found = format!("{cutoff_hz} Hz at {fps} frames per second");
    Error::invalid_parameter("cutoff", found, format!("above 0 and below half the rate, {half} Hz"))
}

#[cfg(test)]
mod tests;
