//! The exponential moving average of the weights over a run, and weighted sums of gradients over batches.
//!
//! The average after update n is the mean of the weights after updates 1..=n, those of update i counting decay^(n - i):
//! Adam's bias correction, so that the first weights of the run have no part in it. It is stored as a running mean,
//! `average += share * (weights - average)`, and needs no correction when it is read.

use rayon::prelude::*;

/// Numbers of a parallel piece.
const CHUNK: usize = 65_536;

/// The share of the way to the weights that the average moves in update `update`, counted from 1: 1 at first, falling to
/// `1 - decay`.
///
/// ```
/// # use kinelm_train::ema::share;
/// assert_eq!(share(0.5, 1), 1.0);
/// assert!((share(0.5, 100) - 0.5).abs() < 1e-12);
/// ```
pub fn share(decay: f64, update: u64) -> f64 {
    (1.0 - decay) / (1.0 - decay.powf(update as f64))
}

/// Moves `average` by `share` of the way to `x`.
///
/// # Panics
/// Slices of different lengths.
pub(crate) fn towards(average: &mut [f32], x: &[f32], share: f32) {
    assert_eq!(average.len(), x.len(), "an average of other numbers");
    average.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).for_each(|(average, x)| {
        for (a, x) in average.iter_mut().zip(x) {
            *a += share * (x - *a);
        }
    });
}

/// Adds `share` times `x` to `sum`; the `first` addition overwrites it.
///
/// # Panics
/// Slices of different lengths.
pub(crate) fn add(sum: &mut [f32], x: &[f32], share: f32, first: bool) {
    assert_eq!(sum.len(), x.len(), "a sum of other numbers");
    sum.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).for_each(|(sum, x)| {
        for (s, x) in sum.iter_mut().zip(x) {
            // overwritten rather than zeroed before: the buffer may hold another step's gradients
            *s = if first { share * x } else { *s + share * x };
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_average_is_the_weighted_mean_of_all_updates() {
        let decay = 0.9f64;
        let weights = [3.0, -1.0, 4.0, 1.5, -9.25];
        let mut average = vec![f32::MAX; 70_000];
        average.fill(0.0);
        for (n, x) in (1..).zip(weights) {
            towards(&mut average, &vec![x as f32; 70_000], share(decay, n) as f32);
            let aged = (0..n).map(|i| (decay.powi((n - 1 - i) as i32), weights[i as usize]));
            let (sum, total) = aged.fold((0.0, 0.0), |(s, t), (w, x)| (s + w * x, t + w));
            assert!(average.iter().all(|a| (*a as f64 - sum / total).abs() < 1e-6), "{n}: {}", average[0]);
        }
        assert_eq!(share(0.9, 1), 1.0);
        assert!((share(0.9, 1000) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn parts_are_summed_by_their_shares() {
        let mut sum = vec![f32::NAN; 3];
        add(&mut sum, &[1.0, 2.0, 3.0], 0.5, true);
        add(&mut sum, &[4.0, -4.0, 0.0], 0.25, false);
        assert_eq!(sum, [1.5, 0.0, 1.5]);
    }
}
