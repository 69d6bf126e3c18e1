//! The discrete cosine transform over time.

use rustdct::{DctPlanner, TransformType2And3};
use std::fmt;
use std::sync::Arc;

/// The orthonormal DCT-II of n numbers and its inverse.
///
/// `X_k = c_k sum_t x_t cos(pi (t + 1/2) k / n)` with `c_0 = sqrt(1/n)`, else `sqrt(2/n)`. It is orthonormal, so an error of
/// the coefficients has the same length in time. Coefficient k has a frequency of `k / (2 n)` cycles per frame.
///
/// ```
/// use kinelm_tokenizer::transform::dct::Dct;
///
/// let dct = Dct::new(4);
/// let (mut series, mut scratch) = ([1.0; 4], vec![0.0; dct.scratch_len()]);
/// dct.forward(&mut series, &mut scratch);
/// assert!((series[0] - 2.0).abs() < 1e-12 && series[1..].iter().all(|x| x.abs() < 1e-12));
/// ```
#[derive(Clone)]
pub struct Dct {
    fast: Arc<dyn TransformType2And3<f64>>,
}

impl fmt::Debug for Dct {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Dct({})", self.len())
    }
}

impl Dct {
    /// For `n` numbers.
    ///
    /// # Panics
    /// When `n` is 0.
    pub fn new(n: usize) -> Self {
        assert!(n > 0, "a transform of no numbers");
        Dct { fast: DctPlanner::new().plan_dct2(n) }
    }

    /// n, the length of a series.
    #[allow(clippy::len_without_is_empty, reason = "there is always one")]
    pub fn len(&self) -> usize {
        self.fast.len()
    }

    /// Length of the scratch buffer.
    pub fn scratch_len(&self) -> usize {
        self.fast.get_scratch_len()
    }

    /// Replaces a series (n) by its coefficients. `scratch` is overwritten.
    ///
    /// # Panics
    /// When `series` isn't n long or `scratch` shorter than [`Dct::scratch_len`].
    pub fn forward(&self, series: &mut [f64], scratch: &mut [f64]) {
        self.fast.process_dct2_with_scratch(series, scratch);
        let n = series.len() as f64;
        let scale = (2.0 / n).sqrt();
        series.iter_mut().for_each(|x| *x *= scale);
        // coefficient 0 has its own norm, sqrt(1/n)
        series[0] = series[0] * (1.0 / n).sqrt() / scale;
    }

    /// Replaces coefficients (n) by their series; the inverse of [`Dct::forward`].
    ///
    /// # Panics
    /// As [`Dct::forward`].
    pub fn inverse(&self, coefficients: &mut [f64], scratch: &mut [f64]) {
        let n = coefficients.len() as f64;
        let scale = (2.0 / n).sqrt();
        coefficients.iter_mut().for_each(|x| *x *= scale);
        // rustdct halves the first number of a DCT-III
        coefficients[0] *= 2.0 * (1.0 / n).sqrt() / scale;
        self.fast.process_dct3_with_scratch(coefficients, scratch);
    }
}

/// The transform as it is defined, number by number: what [`Dct::forward`] is checked against.
#[cfg(test)]
pub(crate) fn naive_forward(series: &[f64]) -> Vec<f64> {
    let n = series.len();
    (0..n).map(|k| factor(k, n) * (0..n).map(|t| series[t] * wave(k, t, n)).sum::<f64>()).collect()
}

/// The inverse as it is defined: the transposed matrix.
#[cfg(test)]
pub(crate) fn naive_inverse(coefficients: &[f64]) -> Vec<f64> {
    let n = coefficients.len();
    (0..n).map(|t| (0..n).map(|k| factor(k, n) * coefficients[k] * wave(k, t, n)).sum()).collect()
}

#[cfg(test)]
fn factor(k: usize, n: usize) -> f64 {
    ((if k == 0 { 1.0 } else { 2.0 }) / n as f64).sqrt()
}

#[cfg(test)]
fn wave(k: usize, t: usize, n: usize) -> f64 {
    // 4 n is a full turn: the argument is kept small, where the cosine is exact
    let quarter = (2 * t + 1) * k % (4 * n);
    (std::f64::consts::PI * quarter as f64 / (2 * n) as f64).cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transform::pca::tests::{Golden, noise};

    /// Relative to the series' length: what n additions of f64 may lose.
    const CLOSE: f64 = 1e-13;

    fn length(x: &[f64]) -> f64 {
        x.iter().map(|x| x * x).sum::<f64>().sqrt()
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn every_length_against_the_definition() {
        for n in 1..=200 {
            let dct = Dct::new(n);
            assert_eq!(dct.len(), n);
            let mut scratch = vec![1e100; dct.scratch_len()];
            let x = noise(n as u64, n);
            let mut y = x.clone();
            dct.forward(&mut y, &mut scratch);
            let miss = distance(&y, &naive_forward(&x)) / length(&x);
            assert!(miss < CLOSE, "{n}: {miss}");
            assert!((length(&y) / length(&x) - 1.0).abs() < CLOSE, "{n}");

            scratch.fill(-1e100);
            let mut back = y.clone();
            dct.inverse(&mut back, &mut scratch);
            assert!(distance(&back, &naive_inverse(&y)) / length(&x) < CLOSE, "{n}");
            assert!(distance(&back, &x) / length(&x) < CLOSE, "{n}");
        }
    }

    #[test]
    fn a_constant_has_one_coefficient() {
        for n in [1, 15, 60, 120] {
            let dct = Dct::new(n);
            let mut x = vec![0.7; n];
            dct.forward(&mut x, &mut vec![0.0; dct.scratch_len()]);
            assert!((x[0] - 0.7 * (n as f64).sqrt()).abs() < 1e-13 * n as f64);
            assert!(x[1..].iter().all(|x| x.abs() < 1e-14 * n as f64));
        }
    }

    #[test]
    fn as_scipy_has_it() {
        for case in Golden::load().dct {
            let dct = Dct::new(case.input.len());
            let mut x = case.input.clone();
            dct.forward(&mut x, &mut vec![0.0; dct.scratch_len()]);
            assert!(distance(&x, &case.output) / length(&case.input) < CLOSE, "{}", x.len());
        }
    }
}
