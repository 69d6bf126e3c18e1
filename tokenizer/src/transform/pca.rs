//! Principal components of training motion.

use crate::{Error, Result};
use kinelm_linalg::{Pca, symmetric_eigen};

/// [`Pca::fit`] with this crate's error.
///
/// # Errors
/// [`Error::Nothing`] when numbers are not finite or too large.
pub fn fit(data: &[f64], channels: usize) -> Result<Pca> {
    Pca::fit(data, channels).ok_or_else(out_of_range)
}

/// [`symmetric_eigen`] with this crate's error.
pub(super) fn eigen(n: usize, matrix: &[f64]) -> Result<(Vec<f64>, Vec<f64>)> {
    symmetric_eigen(n, matrix).ok_or_else(out_of_range)
}

fn out_of_range() -> Error {
    Error::Nothing("the covariance of the training motion is out of range; are the units right?".into())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use serde::Deserialize;

    /// What scipy and scikit-learn made of the same numbers; `scripts/reference/transforms.py`.
    #[derive(Deserialize)]
    pub struct Golden {
        pub dct: Vec<DctCase>,
        pub pca: Vec<PcaCase>,
        pub ica: IcaCase,
    }

    #[derive(Deserialize)]
    pub struct DctCase {
        pub input: Vec<f64>,
        pub output: Vec<f64>,
    }

    #[derive(Deserialize)]
    pub struct PcaCase {
        pub channels: usize,
        pub data: Vec<f64>,
        pub mean: Vec<f64>,
        pub components: Vec<f64>,
        pub explained_variance: Vec<f64>,
    }

    #[derive(Deserialize)]
    pub struct IcaCase {
        pub channels: usize,
        pub data: Vec<f64>,
        pub sources: Vec<Vec<f64>>,
    }

    impl Golden {
        pub fn load() -> Golden {
            serde_json::from_str(include_str!("../../tests/golden/transforms.json")).unwrap()
        }
    }

    /// Numbers in -1..1 that don't change from run to run; xorshift, Marsaglia (2003).
    pub fn noise(seed: u64, count: usize) -> Vec<f64> {
        let mut n = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut next = move || {
            n ^= n << 13;
            n ^= n >> 7;
            n ^= n << 17;
            (n >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        (0..count).map(|_| next()).collect()
    }

    pub fn dot(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    fn check_orthonormal(p: &Pca) {
        let c = p.mean.len();
        let row = |i: usize| &p.components[i * c..(i + 1) * c];
        for i in 0..c {
            for j in 0..=i {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((dot(row(i), row(j)) - expected).abs() < 1e-12, "{i} {j}");
            }
            assert!(p.variances[i] >= 0.0 && (i == 0 || p.variances[i] <= p.variances[i - 1]));
        }
    }

    #[test]
    fn as_scikit_learn_has_it() {
        for case in Golden::load().pca {
            let (c, n) = (case.channels, case.data.len() / case.channels);
            let p = fit(&case.data, c).unwrap();
            check_orthonormal(&p);
            for (a, b) in p.mean.iter().zip(&case.mean) {
                assert!((a - b).abs() < 1e-12);
            }
            let largest = case.explained_variance[0];
            for (k, &variance) in case.explained_variance.iter().enumerate() {
                // scikit-learn divides by n - 1
                let ours = p.variances[k] * n as f64 / (n - 1) as f64;
                assert!((ours - variance).abs() < 1e-12 * largest, "{k}: {ours} {variance}");
                if variance > 1e-9 * largest {
                    let (a, b) = (&p.components[k * c..(k + 1) * c], &case.components[k * c..(k + 1) * c]);
                    assert!((dot(a, b).abs() - 1.0).abs() < 1e-9, "{k}: {a:?} {b:?}");
                }
            }
        }
    }

    #[test]
    fn data_of_low_rank() {
        let axes = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        for data in [vec![], vec![5.0, 6.0, 7.0], [5.0, 6.0, 7.0].repeat(10)] {
            let p = fit(&data, 3).unwrap();
            check_orthonormal(&p);
            assert_eq!(p.variances, [0.0; 3]);
            assert!(p.components.iter().all(|x| axes.contains(&x.abs())), "{p:?}");
        }
        // fewer rows than channels, and a channel that never moves
        let mut data = noise(4, 5 * 20);
        data.chunks_exact_mut(20).for_each(|row| row[7] = 3.25);
        let p = fit(&data, 20).unwrap();
        check_orthonormal(&p);
        assert!(p.variances[3] > 1e-3 && p.variances[4..].iter().all(|&v| v < 1e-12), "{:?}", p.variances);
        assert!(fit(&[], 0).unwrap().components.is_empty());
        assert!(fit(&[1e200, -1e200, 1.0, 0.0, 1e199, 5.0], 2).unwrap_err().to_string().contains("units"));
    }
}
