//! The mean pose of training clips, the default of uncoded joints.

use kinelm_motion::{Clip, Quat};
use std::array::from_fn;

/// Sums of `q q^T` of the 24 joints, which are the same for q and -q.
///
/// Integers in units of 2^-40, so that sums don't depend on the order of clips.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PoseSum([[i128; 10]; 24]);

const UNIT: f64 = (1u64 << 40) as f64;

/// The upper triangle of a symmetric 4 x 4 matrix.
const PAIRS: [(usize, usize); 10] = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)];

impl PoseSum {
    pub(crate) fn new() -> Self {
        PoseSum([[0; 10]; 24])
    }

    /// Adds every frame of a clip on the 24 joints.
    pub(crate) fn add(&mut self, clip: &Clip) {
        for f in 0..clip.frames() {
            for (sum, q) in self.0.iter_mut().zip(clip.pose(f)) {
                let q = q.to_array();
                sum.iter_mut().zip(PAIRS).for_each(|(s, (i, j))| *s += (q[i] * q[j] * UNIT).round() as i128);
            }
        }
    }

    pub(crate) fn merge(&mut self, other: &PoseSum) {
        self.0.iter_mut().flatten().zip(other.0.iter().flatten()).for_each(|(s, o)| *s += o);
    }

    /// The mean rotation of each joint, identity for those in `coded`: the eigenvector of the sum with the largest
    /// eigenvalue, which is nearest to all rotations in the squared chord. Source: Markley et al., "Averaging Quaternions"
    /// (2007).
    pub(crate) fn mean(&self, coded: &[usize]) -> [Quat; 24] {
        from_fn(|j| if coded.contains(&j) { Quat::IDENTITY } else { principal(&self.0[j]) })
    }
}

/// The eigenvector with the largest eigenvalue of a sum of `q q^T`; identity without clips.
fn principal(sum: &[i128; 10]) -> Quat {
    let mut m = [[0.0; 4]; 4];
    for (&s, (i, j)) in sum.iter().zip(PAIRS) {
        (m[i][j], m[j][i]) = (s as f64 / UNIT, s as f64 / UNIT);
    }
    // repeated squaring leaves only the largest eigenvalue's part
    // 2^40 multiplications in effect: eigenvalues that differ by a relative 1e-10 are still separated
    for _ in 0..40 {
        let trace: f64 = (0..4).map(|i| m[i][i]).sum();
        if !(trace.is_finite() && trace > 0.0) {
            return Quat::IDENTITY;
        }
        let scaled = m.map(|row| row.map(|x| x / trace));
        m = from_fn(|i| from_fn(|j| (0..4).map(|k| scaled[i][k] * scaled[k][j]).sum()));
    }
    // all rows are multiples of the eigenvector; that of its largest component has the least rounding
    let largest = (0..4).fold(0, |best, i| if m[i][i] > m[best][best] { i } else { best });
    let q = Quat::from_array(m[largest]).normalize();
    if q.w < 0.0 { -q } else { q }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::bent;
    use kinelm_motion::rotation::angle_between;
    use kinelm_motion::{Vec3, smpl};

    fn clip(poses: &[Quat]) -> Clip {
        let rotations = poses.iter().flat_map(|q| [*q; 24]).collect();
        Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y; poses.len()], rotations).unwrap()
    }

    #[test]
    fn between_two_turns_whatever_their_signs() {
        let turn = Quat::from_rotation_y;
        let mut sum = PoseSum::new();
        sum.add(&clip(&[turn(0.2), -turn(0.6)]));
        let mean = sum.mean(&[3]);
        assert!(angle_between(mean[5], turn(0.4)) < 1e-9, "{}", mean[5]);
        assert_eq!(mean[3], Quat::IDENTITY);
        assert_eq!(PoseSum::new().mean(&[]), [Quat::IDENTITY; 24]);
        let mut still = PoseSum::new();
        still.add(&clip(&[Quat::IDENTITY; 3]));
        assert_eq!(still.mean(&[]), [Quat::IDENTITY; 24]);
    }

    #[test]
    fn any_order_and_parts() {
        let clips = [bent(1, 30), bent(2, 50), bent(3, 10)];
        let (mut all, mut a, mut b) = (PoseSum::new(), PoseSum::new(), PoseSum::new());
        clips.iter().for_each(|c| all.add(c));
        a.add(&clips[2]);
        [&clips[1], &clips[0]].into_iter().for_each(|c| b.add(c));
        a.merge(&b);
        assert_eq!(a, all);
    }
}
