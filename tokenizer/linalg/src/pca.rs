//! Principal components: the directions in which data vary most.

use crate::symmetric_eigen;

/// Two magnitudes whose relative difference is below this count as equal when signs are chosen.
const SAME: f64 = 1e-6;

/// A mean and an orthonormal basis, ordered by the variance along it.
#[derive(Debug, Clone, PartialEq)]
pub struct Pca {
    /// Mean of each channel, (C).
    pub mean: Vec<f64>,
    /// All C directions, (C, C), one a row, by falling variance. In each row the number of largest magnitude is positive
    /// (of several within a millionth of it, the first).
    pub components: Vec<f64>,
    /// Variance along each direction, (C), divided by the number of rows.
    pub variances: Vec<f64>,
}

impl Pca {
    /// The principal components of `data` (N, C); `channels` is C. `None` when numbers are not finite or too large.
    ///
    /// The covariance is summed row by row on one thread, so the same data give the same bytes. Directions without variance
    /// (constant channels, fewer rows than channels) complete the basis. Without rows the mean is 0 and the basis the axes.
    ///
    /// ```
    /// let pca = kinelm_linalg::Pca::fit(&[1.0, 1.0, 2.0, 2.0, 3.0, 3.0], 2).unwrap();
    /// assert_eq!(pca.mean, [2.0, 2.0]);
    /// assert!((pca.components[0] - 0.5f64.sqrt()).abs() < 1e-12 && pca.variances[1].abs() < 1e-12);
    /// ```
    ///
    /// # Panics
    /// When `data` isn't whole rows.
    pub fn fit(data: &[f64], channels: usize) -> Option<Pca> {
        assert_eq!(data.len() % channels.max(1), 0, "rows of {channels} channels");
        let mean = mean(data, channels);
        let (variances, components) = principal_components(channels, &covariance(data, &mean))?;
        Some(Pca { mean, components, variances })
    }
}

/// The variances (C), falling and not below 0, and the principal components (C, C), as [`Pca`] holds them, of a
/// `covariance` (C, C), of which only the lower triangle is read. `None` when numbers are not finite or too large.
///
/// # Panics
/// When `covariance` isn't `channels` x `channels`.
pub fn principal_components(channels: usize, covariance: &[f64]) -> Option<(Vec<f64>, Vec<f64>)> {
    let (values, mut components) = symmetric_eigen(channels, covariance)?;
    components.chunks_exact_mut(channels.max(1)).for_each(largest_positive);
    Some((values.into_iter().map(|x| x.max(0.0)).collect(), components))
}

/// Mean of each channel of `data` (N, C); 0 without rows.
pub fn mean(data: &[f64], channels: usize) -> Vec<f64> {
    let mut sum = vec![0.0; channels];
    for row in data.chunks_exact(channels.max(1)) {
        sum.iter_mut().zip(row).for_each(|(s, x)| *s += x);
    }
    let n = (data.len() / channels.max(1)).max(1) as f64;
    sum.iter().map(|s| s / n).collect()
}

/// The lower triangle of the covariance (C, C), divided by the number of rows.
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

/// Flips a direction so that its number of largest magnitude is positive.
pub fn largest_positive(direction: &mut [f64]) {
    let size = direction.iter().fold(0.0f64, |a, x| a.max(x.abs()));
    let first = direction.iter().find(|x| x.abs() >= size * (1.0 - SAME));
    if first.is_some_and(|&x| x < 0.0) {
        direction.iter_mut().for_each(|x| *x = -*x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
