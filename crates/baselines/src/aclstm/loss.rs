//! The error of predicted frames, in each form's own measure, and its gradient.
//!
//! Positions: the mean square over all channels. Angles: the mean square of the hip's channels plus the mean of 1 - cos of
//! the differences. Quaternions: the same of the hip plus the mean over joints of the angle 2 arccos |q.q'| between the
//! normalised ones, radians. All are means, over rows and channels or joints; the three can't be compared.

use crate::form::Form;
use crate::{Loss, PartWeights, Parts};
use rayon::prelude::*;

/// The arc cosine has no derivative at 1: products of quaternions are clamped to this.
const NEAREST: f64 = 1.0 - 1e-7;
/// The least length that quaternions are divided by, as in PyTorch's `normalize`.
const SHORTEST: f64 = 1e-12;
/// Channels of the hip.
const HIP: usize = 3;
/// Rows of a parallel piece.
const ROWS: usize = 64;

/// The loss of `found` (R, C) against `truth` (R, C) by parts: the hip's channels, and the others; `gradients` (R, C) becomes
/// the gradient of their weighted sum.
///
/// # Panics
/// Slices of other lengths, no whole rows.
pub fn loss(
    form: Form,
    weights: PartWeights,
    channels: usize,
    found: &[f32],
    truth: &[f32],
    gradients: &mut [f32],
) -> Loss {
    assert!(found.len() == truth.len() && found.len() == gradients.len(), "as many numbers of each");
    assert!(channels >= 3 && found.len().is_multiple_of(channels), "whole rows of {channels}");
    let rows = (found.len() / channels).max(1) as f64;
    let piece = ROWS * channels;
    let pieces = found.par_chunks(piece).zip(truth.par_chunks(piece)).zip(gradients.par_chunks_mut(piece));
    let sums: Vec<Loss> = pieces
        .map(|((found, truth), gradients)| {
            let all = found.chunks_exact(channels).zip(truth.chunks_exact(channels));
            all.zip(gradients.chunks_exact_mut(channels))
                .map(|((y, t), g)| of_row(form, weights, y, t, g, rows))
                .fold(Loss::default(), Loss::plus)
        })
        .collect();
    sums.into_iter().fold(Loss::default(), Loss::plus).over(rows)
}

fn of_row(form: Form, weights: PartWeights, found: &[f32], truth: &[f32], gradients: &mut [f32], rows: f64) -> Loss {
    let squared = if form == Form::Positional { found.len() } else { HIP };
    let (found, others) = found.split_at(squared);
    let (truth, true_others) = truth.split_at(squared);
    let (gradients, d_others) = gradients.split_at_mut(squared);
    let squares = squares(weights, found, truth, gradients, rows);
    let others = match form {
        Form::Positional => return squares,
        Form::Euler => angles(weights.rotations, others, true_others, d_others, rows),
        Form::Quaternion => quaternions(weights.rotations, others, true_others, d_others, rows),
    };
    let parts = Parts { rotations: others, ..squares.parts };
    Loss { loss: squares.loss + weights.rotations * others, parts }
}

/// Mean squares over channels, of which the first are the hip's.
fn squares(weights: PartWeights, found: &[f32], truth: &[f32], gradients: &mut [f32], rows: f64) -> Loss {
    let n = found.len() as f64;
    let mut sum = Loss::default();
    for (i, ((y, t), g)) in found.iter().zip(truth).zip(gradients).enumerate() {
        let d = (y - t) as f64;
        let (part, weight) = match i < HIP {
            true => (&mut sum.parts.root, weights.root),
            false => (&mut sum.parts.rotations, weights.rotations),
        };
        *part += d * d;
        sum.loss += weight * d * d;
        *g = (weight * (2.0 * d / (n * rows))) as f32;
    }
    sum.over(n)
}

fn angles(weight: f64, found: &[f32], truth: &[f32], gradients: &mut [f32], rows: f64) -> f64 {
    let n = found.len() as f64;
    let mut sum = 0.0;
    for ((y, t), g) in found.iter().zip(truth).zip(gradients) {
        let (sin, cos) = (*y as f64 - *t as f64).sin_cos();
        sum += 1.0 - cos;
        *g = (weight * (sin / (n * rows))) as f32;
    }
    sum / n
}

fn quaternions(weight: f64, found: &[f32], truth: &[f32], gradients: &mut [f32], rows: f64) -> f64 {
    let n = (found.len() / 4) as f64;
    let mut sum = 0.0;
    for ((y, t), g) in found.chunks_exact(4).zip(truth.chunks_exact(4)).zip(gradients.chunks_exact_mut(4)) {
        let (y, length) = unit(y);
        let (t, _) = unit(t);
        let product: f64 = y.iter().zip(&t).map(|(y, t)| y * t).sum();
        let near = product.abs().min(NEAREST);
        sum += 2.0 * near.acos();
        // the clamped arc cosine is constant, and its slope 0
        let slope = match product.abs() < NEAREST {
            true => -2.0 * weight * product.signum() / (1.0 - near * near).sqrt() / (n * rows * length),
            false => 0.0,
        };
        for (g, (y, t)) in g.iter_mut().zip(y.iter().zip(&t)) {
            *g = (slope * (t - product * y)) as f32;
        }
    }
    sum / n
}

/// A normalised quaternion, and its original length.
fn unit(q: &[f32]) -> ([f64; 4], f64) {
    let q: [f64; 4] = std::array::from_fn(|i| q[i] as f64);
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt().max(SHORTEST);
    (q.map(|x| x / length), length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_store::random;

    const FORMS: [(Form, usize); 3] = [(Form::Positional, 12), (Form::Euler, 9), (Form::Quaternion, 11)];

    /// None of 1, so that a part without its weight is found.
    const WEIGHTS: PartWeights = PartWeights { root: 0.5, rotations: 3.0 };

    fn numbers(purpose: &str, len: usize) -> Vec<f32> {
        let mut rng = random::stream(1, purpose, 0, 0);
        (0..len).map(|_| random::normal(&mut rng) as f32).collect()
    }

    #[test]
    fn by_hand() {
        let of = |form, found: &[f32], truth: &[f32]| {
            loss(form, PartWeights::EVEN, found.len(), found, truth, &mut vec![0.0; found.len()]).loss
        };
        assert!((of(Form::Positional, &[1.0, 0.0, 0.0, 2.0], &[0.0; 4]) - 1.25).abs() < 1e-12);
        let angles = of(Form::Euler, &[3.0, 0.0, 0.0, 1.0, 1.0, 7.0], &[0.0, 0.0, 0.0, 1.0, 1.0, 7.0]);
        assert!((angles - 3.0).abs() < 1e-12);
        // half a turn about x, of any length, and the same with the other sign
        let q = of(Form::Quaternion, &[0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0], &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        assert!((q - std::f64::consts::PI).abs() < 1e-12);
        let q = of(Form::Quaternion, &[0.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0], &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        assert!(q < 1e-3, "{q}");
    }

    #[test]
    fn gradients_are_finite_differences() {
        for (form, c) in FORMS {
            let (found, truth) = (numbers("found", 70 * c), numbers("truth", 70 * c));
            let mut gradients = vec![7.0; found.len()];
            loss(form, WEIGHTS, c, &found, &truth, &mut gradients);
            for at in (0..found.len()).step_by(13) {
                let slope = |by: f32| {
                    let mut moved = found.clone();
                    moved[at] += by;
                    (loss(form, WEIGHTS, c, &moved, &truth, &mut vec![0.0; found.len()]).loss, moved[at] as f64)
                };
                let ((up, x1), (down, x0)) = (slope(1e-3), slope(-1e-3));
                let expected = (up - down) / (x1 - x0);
                assert!((gradients[at] as f64 - expected).abs() < 1e-5, "{form:?} {at}: {} {expected}", gradients[at]);
            }
        }
    }

    #[test]
    fn the_true_frame_has_no_gradient() {
        for (form, c) in FORMS {
            let truth = numbers("truth", 3 * c);
            let mut gradients = vec![7.0; truth.len()];
            loss(form, WEIGHTS, c, &truth, &truth, &mut gradients);
            assert!(gradients.iter().all(|g| *g == 0.0), "{form:?}");
        }
    }

    #[test]
    fn parts_add_up_by_their_weights() {
        for (form, c) in FORMS {
            let (found, truth) = (numbers("found", 5 * c), numbers("truth", 5 * c));
            let of = |weights| loss(form, weights, c, &found, &truth, &mut vec![0.0; found.len()]);
            let (even, weighted) = (of(PartWeights::EVEN), of(WEIGHTS));
            let Parts { root, rotations, effort } = even.parts;
            assert!(root > 0.0 && rotations > 0.0 && effort.is_none() && weighted.parts == even.parts, "{form:?}");
            assert!((even.loss - (root + rotations)).abs() < 1e-12, "{form:?}");
            assert!((weighted.loss - (0.5 * root + 3.0 * rotations)).abs() < 1e-12, "{form:?}");
        }
        // by hand: the hip is a metre off, one of two joints is right and the other half a turn off
        let (found, truth) = ([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0]);
        let truth = [&truth[..], &[1.0, 0.0, 0.0, 0.0], &[1.0, 0.0, 0.0, 0.0]].concat();
        let parts = loss(Form::Quaternion, WEIGHTS, 11, &found, &truth, &mut [0.0; 11]).parts;
        assert!((parts.root - 1.0 / 3.0).abs() < 1e-12, "{parts:?}");
        // the clamped arc cosine is 2 arccos(1 - 1e-7) for the joint that is right
        assert!((parts.rotations - (std::f64::consts::PI + 2.0 * NEAREST.acos()) / 2.0).abs() < 1e-9, "{parts:?}");
    }
}
