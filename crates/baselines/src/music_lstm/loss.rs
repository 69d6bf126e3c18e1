//! The loss of a batch of frames and its gradient, through the normalisation of quaternions.

use super::config::{Effort, Pose};
use super::effort;
use crate::{Loss, PartWeights, Parts};
use kinelm_motion::Quat;
use rayon::prelude::*;

/// The least length that outputs are divided by: it limits gradients to 1,000 times those of unit outputs.
const SHORTEST: f64 = 1e-3;

/// The terms of a loss.
#[derive(Debug, Clone, Copy)]
pub struct Terms<'a> {
    /// Of poses.
    pub pose: Pose,
    /// Of effort.
    pub effort: Effort,
    /// Of the root's rotation and the other joints', in the loss of poses.
    pub parts: PartWeights,
    /// (J) weights of the joints in [`Effort::Corrected`].
    pub weights: &'a [f64],
}

/// The loss of outputs `found` (T, B, 4J), unnormalised, against `truth` (T, B, 4J), unit quaternions as w, x, y,
/// z; `gradients` (T, B, 4J) becomes its gradient.
///
/// # Panics
/// Slices of other lengths, no whole frames of the weights' joints.
pub fn loss(terms: Terms, batch: usize, found: &[f32], truth: &[f32], gradients: &mut [f32]) -> Loss {
    let j = terms.weights.len();
    let row = batch * 4 * j;
    assert!(found.len() == truth.len() && found.len() == gradients.len(), "as many numbers of each");
    assert!(found.len().is_multiple_of(row), "whole steps of {batch} sequences of {j} joints");
    let all: Vec<(Loss, Vec<f32>)> =
        (0..batch).into_par_iter().map(|b| of_one(terms, batch, b, found, truth)).collect();
    // rows are interleaved, step by step: each sequence has every `batch`-th
    for (b, (_, own)) in all.iter().enumerate() {
        for (to, from) in gradients.chunks_exact_mut(4 * j).skip(b).step_by(batch).zip(own.chunks_exact(4 * j)) {
            to.copy_from_slice(from);
        }
    }
    all.iter().map(|(loss, _)| *loss).fold(Loss::default(), Loss::plus).over(batch as f64)
}

/// Quaternions of sequence `b` of `batch`, (T, J).
fn of_sequence(numbers: &[f32], joints: usize, batch: usize, b: usize) -> Vec<Quat> {
    let frames = numbers.chunks_exact(4 * joints).skip(b).step_by(batch);
    frames.flat_map(|frame| frame.chunks_exact(4).map(of)).collect()
}

fn of(wxyz: &[f32]) -> Quat {
    Quat::from_xyzw(wxyz[1].into(), wxyz[2].into(), wxyz[3].into(), wxyz[0].into())
}

/// Loss and gradients (T, 4J) of one sequence, the gradients over the whole batch.
fn of_one(terms: Terms, batch: usize, b: usize, found: &[f32], truth: &[f32]) -> (Loss, Vec<f32>) {
    let j = terms.weights.len();
    let raw = of_sequence(found, j, batch, b);
    let lengths: Vec<f64> = raw.iter().map(|q| q.length().max(SHORTEST)).collect();
    let own: Vec<Quat> = raw.iter().zip(&lengths).map(|(q, length)| *q * (1.0 / length)).collect();
    let theirs = of_sequence(truth, j, batch, b);
    let scale = 1.0 / batch as f64;
    let mut gradients = vec![Quat::from_xyzw(0.0, 0.0, 0.0, 0.0); own.len()];
    let mut found = Loss::default();
    if terms.pose != Pose::None {
        let n = 4.0 * own.len() as f64;
        for (i, ((q, t), g)) in own.iter().zip(&theirs).zip(&mut gradients).enumerate() {
            let sign = if terms.pose == Pose::Aligned && q.dot(*t) < 0.0 { -1.0 } else { 1.0 };
            let error = *q - *t * sign;
            let Parts { root, rotations, .. } = &mut found.parts;
            let (part, weight) = if i % j == 0 { (root, terms.parts.root) } else { (rotations, terms.parts.rotations) };
            *part += error.length_squared() / n;
            found.loss += weight * (error.length_squared() / n);
            *g = error * (weight * (2.0 * scale / n));
        }
    }
    found.parts.effort = match terms.effort {
        Effort::None => None,
        Effort::Corrected => Some(effort::corrected(&own, &theirs, terms.weights, scale, &mut gradients)),
        Effort::Compat => Some(effort::compat(&own, &theirs, j, scale, &mut gradients)),
    };
    found.loss += found.parts.effort.unwrap_or(0.0);
    let back = gradients.iter().zip(&own).zip(raw.iter().zip(&lengths)).flat_map(|((g, q), (raw, length))| {
        // below the least length, the output is scaled by a constant
        let along = if raw.length() < SHORTEST { 0.0 } else { g.dot(*q) };
        // a normalised vector's slope: the gradient across it, over its length
        let g = (*g - *q * along) * (1.0 / length);
        [g.w as f32, g.x as f32, g.y as f32, g.z as f32]
    });
    (found, back.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_store::random;

    fn numbers(purpose: &str, len: usize) -> Vec<f32> {
        let mut rng = random::stream(1, purpose, 0, 0);
        (0..len).map(|_| random::normal(&mut rng) as f32).collect()
    }

    fn unit(numbers: &[f32]) -> Vec<f32> {
        let of = |q: &[f32]| {
            let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
            q.iter().map(|x| x / length).collect::<Vec<_>>()
        };
        numbers.chunks_exact(4).flat_map(of).collect()
    }

    #[test]
    fn by_hand() {
        let of = |pose, found: &[f32], truth: &[f32]| {
            let terms = Terms { pose, effort: Effort::None, parts: PartWeights::EVEN, weights: &[1.0] };
            loss(terms, 1, found, truth, &mut [7.0; 4]).loss
        };
        // of any length; a quarter of the square of the distance of two unit quaternions
        assert!((of(Pose::Aligned, &[3.0, 0.0, 0.0, 0.0], &[0.0, 1.0, 0.0, 0.0]) - 0.5).abs() < 1e-12);
        assert!(of(Pose::Aligned, &[-2.0, 0.0, 0.0, 0.0], &[1.0, 0.0, 0.0, 0.0]) < 1e-12);
        assert!((of(Pose::Compat, &[-2.0, 0.0, 0.0, 0.0], &[1.0, 0.0, 0.0, 0.0]) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn gradients_are_finite_differences() {
        let (t, b, j) = (12, 3, 2);
        let (found, truth) = (numbers("found", t * b * 4 * j), unit(&numbers("truth", t * b * 4 * j)));
        let weights = [1.0, 0.4];
        for pose in [Pose::Aligned, Pose::Compat, Pose::None] {
            for effort in [Effort::None, Effort::Corrected, Effort::Compat] {
                let terms = Terms { pose, effort, parts: PartWeights { root: 0.5, rotations: 3.0 }, weights: &weights };
                let mut gradients = vec![7.0; found.len()];
                loss(terms, b, &found, &truth, &mut gradients);
                for at in (0..found.len()).step_by(13) {
                    let slope = |by: f32| {
                        let mut moved = found.clone();
                        moved[at] += by;
                        (loss(terms, b, &moved, &truth, &mut vec![0.0; found.len()]).loss, f64::from(moved[at]))
                    };
                    let ((up, x1), (down, x0)) = (slope(1e-3), slope(-1e-3));
                    let (expected, found) = ((up - down) / (x1 - x0), f64::from(gradients[at]));
                    assert!(
                        (found - expected).abs() < 1e-4 * expected.abs().max(0.1),
                        "{terms:?} {at}: {found} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn outputs_of_zero_have_a_finite_loss() {
        for effort in [Effort::Corrected, Effort::Compat] {
            let terms = Terms { pose: Pose::Aligned, effort, parts: PartWeights::EVEN, weights: &[1.0; 2] };
            let truth = [1.0, 0.0, 0.0, 0.0].repeat(2 * 10);
            let mut gradients = vec![f32::NAN; 80];
            assert!(loss(terms, 1, &[0.0; 80], &truth, &mut gradients).loss.is_finite());
            assert!(gradients.iter().all(|g| g.is_finite()));
        }
    }

    #[test]
    fn the_root_and_the_other_joints_are_parts() {
        // two joints: the root's quaternion is at a distance of sqrt(2), the other's at none
        let (found, truth) = ([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        let parts = PartWeights { root: 0.5, rotations: 3.0 };
        let of = |found: &[f32], effort| {
            let terms = Terms { pose: Pose::Aligned, effort, parts, weights: &[1.0, 1.0] };
            loss(terms, 1, found, &truth, &mut [7.0; 8])
        };
        // a quarter of each joint's squared distance, half of it each
        let own = of(&found, Effort::None);
        assert!((own.parts.root - 0.25).abs() < 1e-12 && own.parts.rotations.abs() < 1e-12, "{own:?}");
        assert!((own.loss - 0.125).abs() < 1e-12 && own.parts.effort.is_none(), "{own:?}");
        let with = of(&found, Effort::Compat);
        let effort = with.parts.effort.unwrap();
        assert!((with.loss - (0.125 + effort)).abs() < 1e-12 && with.parts.root == own.parts.root, "{with:?}");
    }
}
