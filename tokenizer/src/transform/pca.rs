//! Principal components: the directions over the channels in which the data vary most.

use crate::{Error, Result};
use kinelm_linalg::symmetric_eigen;

/// A mean and an orthonormal basis, ordered by the variance along it.
#[derive(Debug, Clone, PartialEq)]
pub struct Pca {
    /// Mean of each channel, (C).
    pub mean: Vec<f64>,
    /// All C directions, (C, C): one a row, by falling variance. Of a row the largest number is positive (of those within
    /// a millionth of the largest size, the first).
    pub components: Vec<f64>,
    /// Variance along each direction, (C), divided by the number of rows.
    pub variances: Vec<f64>,
}

/// Two sizes nearer than this share of the larger count as equal when signs are chosen.
const SAME: f64 = 1e-6;

/// The principal components of `data` (N, C): `channels` is C.
///
/// From the eigenvectors of the covariance, which is summed row by row: the same bytes on any number of threads. Directions
/// in which nothing varies (constant channels, fewer rows than channels) complete the basis, with variance 0. Of no rows
/// the mean is 0 and the basis the axes.
///
/// # Errors
/// [`Error::Nothing`] when numbers are so large that no eigenvectors are found.
///
/// # Panics
/// When `data` isn't whole rows.
pub fn fit(data: &[f64], channels: usize) -> Result<Pca> {
    assert_eq!(data.len() % channels.max(1), 0, "rows of {channels} channels");
    let mean = mean(data, channels);
    let (values, vectors) = eigen(channels, &covariance(data, &mean))?;
    let mut components = vectors;
    components.chunks_exact_mut(channels.max(1)).for_each(largest_positive);
    Ok(Pca { mean, components, variances: values.into_iter().map(|x| x.max(0.0)).collect() })
}

pub(crate) fn mean(data: &[f64], channels: usize) -> Vec<f64> {
    let mut sum = vec![0.0; channels];
    for row in data.chunks_exact(channels.max(1)) {
        sum.iter_mut().zip(row).for_each(|(s, x)| *s += x);
    }
    let n = (data.len() / channels.max(1)).max(1) as f64;
    sum.iter().map(|s| s / n).collect()
}

/// Of the rows' differences from `mean`, divided by the number of rows: the lower triangle of (C, C).
fn covariance(data: &[f64], mean: &[f64]) -> Vec<f64> {
    let c = mean.len();
    let (mut sum, mut off) = (vec![0.0; c * c], vec![0.0; c]);
    for row in data.chunks_exact(c.max(1)) {
        off.iter_mut().zip(row.iter().zip(mean)).for_each(|(o, (x, m))| *o = x - m);
        for i in 0..c {
            let scale = off[i];
            sum[i * c..i * c + i + 1].iter_mut().zip(&off).for_each(|(s, x)| *s += scale * x);
        }
    }
    let n = (data.len() / c.max(1)).max(1) as f64;
    sum.iter_mut().for_each(|s| *s /= n);
    sum
}

/// [`symmetric_eigen`] with our error.
pub(super) fn eigen(n: usize, matrix: &[f64]) -> Result<(Vec<f64>, Vec<f64>)> {
    symmetric_eigen(n, matrix).ok_or_else(|| {
        Error::Nothing("the covariance of the training motion is out of all range; are the units right?".into())
    })
}

/// Turns a direction so that its largest number is positive.
pub(super) fn largest_positive(direction: &mut [f64]) {
    let size = direction.iter().fold(0.0f64, |a, x| a.max(x.abs()));
    let first = direction.iter().find(|x| x.abs() >= size * (1.0 - SAME));
    if first.is_some_and(|&x| x < 0.0) {
        direction.iter_mut().for_each(|x| *x = -*x);
    }
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

    #[test]
    fn the_largest_number_is_positive() {
        let signed = |mut v: [f64; 3]| {
            largest_positive(&mut v);
            v
        };
        assert_eq!(signed([0.1, -0.9, 0.3]), [-0.1, 0.9, -0.3]);
        assert_eq!(signed([0.1, 0.9, -0.3]), [0.1, 0.9, -0.3]);
        assert_eq!(signed([-0.5, 0.500_000_001, 0.0]), [0.5, -0.500_000_001, -0.0]);
        assert_eq!(signed([0.0; 3]), [0.0; 3]);
    }
}
