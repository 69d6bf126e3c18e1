//! Angles between rotation vectors, for comparison with a published study of motion tokens.

use super::{Tally, check_joints, check_pair};
use crate::rotation::exp_map;
use crate::{Clip, Result, Vec3};

/// Vectors shorter than this have no direction.
const SHORTEST: f64 = 1e-8;

/// Angles `arccos(a.b / (|a||b|))` between canonical rotation vectors, per joint and over the concatenated vectors of a
/// frame, radians in `0..=PI`.
///
/// It compares directions only: rotations of 10 and of 100 degrees about one axis have error 0. It serves comparison with
/// published tables; [`GeodesicError`](super::GeodesicError) is the better measure. Pairs with a vector shorter than 1e-8
/// are skipped and counted.
#[derive(Debug, Clone, PartialEq)]
pub struct VectorAngle {
    joints: Vec<usize>,
    each: Tally,
    whole: Tally,
    skipped_joints: u64,
    skipped_frames: u64,
}

impl VectorAngle {
    /// Measures these joints.
    pub fn new(joints: Vec<usize>) -> Self {
        let nothing = Tally::default();
        VectorAngle { joints, each: nothing, whole: nothing, skipped_joints: 0, skipped_frames: 0 }
    }

    /// Adds two clips with the same number of frames and joints.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when frames or joints differ, or a chosen joint doesn't exist.
    pub fn add(&mut self, a: &Clip, b: &Clip) -> Result<()> {
        check_pair(a, b)?;
        check_joints(&self.joints, a)?;
        let (mut v, mut w) = (Vec::new(), Vec::new());
        for f in 0..a.frames() {
            vectors(a, f, &self.joints, &mut v);
            vectors(b, f, &self.joints, &mut w);
            for (v, w) in v.iter().zip(&w) {
                match angle(&[*v], &[*w]) {
                    Some(angle) => self.each.add(angle),
                    None => self.skipped_joints += 1,
                }
            }
            match angle(&v, &w) {
                Some(angle) => self.whole.add(angle),
                None => self.skipped_frames += 1,
            }
        }
        Ok(())
    }

    /// Adds the values of another accumulator for the same joints.
    ///
    /// # Panics
    /// If the joints differ.
    pub fn merge(&mut self, other: &VectorAngle) {
        assert_eq!(self.joints, other.joints, "one choice of joints");
        self.each.merge(&other.each);
        self.whole.merge(&other.whole);
        self.skipped_joints += other.skipped_joints;
        self.skipped_frames += other.skipped_frames;
    }

    /// Mean over joints and frames, radians; 0 if no vector has a direction.
    pub fn mean_joint(&self) -> f64 {
        self.each.mean()
    }

    /// Mean over frames of the angle between concatenated vectors, radians; 0 if none has a direction.
    pub fn mean_frame(&self) -> f64 {
        self.whole.mean()
    }

    /// The largest angle of a joint, radians.
    pub fn max_joint(&self) -> f64 {
        self.each.max
    }

    /// The numbers of skipped pairs of joints and of frames.
    pub fn skipped(&self) -> [u64; 2] {
        [self.skipped_joints, self.skipped_frames]
    }
}

fn vectors(clip: &Clip, frame: usize, joints: &[usize], out: &mut Vec<Vec3>) {
    let pose = clip.pose(frame);
    out.clear();
    out.extend(joints.iter().map(|&j| exp_map::to_vector(pose[j])));
}

/// The angle between two vectors, given as lists of 3-vectors; `None` if one has no direction.
///
/// Computed as `2 atan2(|u - v|, |u + v|)` of the unit vectors, which is accurate at all angles. Source: Kahan, "How Futile
/// are Mindless Assessments of Roundoff" (2006).
fn angle(a: &[Vec3], b: &[Vec3]) -> Option<f64> {
    let length = |v: &[Vec3]| v.iter().map(|v| v.length_squared()).sum::<f64>().sqrt();
    let (m, n) = (length(a), length(b));
    if m < SHORTEST || n < SHORTEST {
        return None;
    }
    let (mut difference, mut sum) = (0.0, 0.0);
    for (&v, &w) in a.iter().zip(b) {
        difference += (v / m - w / n).length_squared();
        sum += (v / m + w / n).length_squared();
    }
    Some(2.0 * difference.sqrt().atan2(sum.sqrt()))
}
