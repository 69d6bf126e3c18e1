//! A basis of series, fitted to a database.
//!
//! The fit holds N^2 numbers and takes time by N^3: for windows, not for whole clips.

use crate::{Error, Result};
use kinelm_linalg::principal_components;
use serde::{Deserialize, Serialize};

/// The principal components of all channels of all windows: series of N numbers, orthonormal, by falling variance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PcaBasis {
    /// (N) the mean series.
    pub mean: Vec<f64>,
    /// (K, N), a component a row. Of a row the largest number is positive (of those within a millionth of the largest size
    /// the first).
    pub components: Vec<f64>,
    /// (K) variance along each, divided by the number of series.
    pub variances: Vec<f64>,
    /// Variance along all N, so that it is known what the K leave out.
    pub total_variance: f64,
}

impl PcaBasis {
    /// Components unless said otherwise.
    pub const KEEP: usize = 16;

    /// N.
    pub fn length(&self) -> usize {
        self.mean.len()
    }

    /// K.
    pub fn kept(&self) -> usize {
        self.variances.len()
    }

    /// The basis without its first components.
    ///
    /// # Panics
    /// When it has fewer.
    pub(crate) fn without_first(mut self, first: usize) -> PcaBasis {
        self.components.drain(..first * self.mean.len());
        self.variances.drain(..first);
        self
    }

    /// The coordinates (K) of a series (N), the mean series taken off.
    ///
    /// # Panics
    /// When the series has another length.
    pub fn forward(&self, series: &[f64]) -> Vec<f64> {
        assert_eq!(series.len(), self.length(), "a series of another length");
        let off: Vec<f64> = series.iter().zip(&self.mean).map(|(x, m)| x - m).collect();
        self.components.chunks_exact(self.length()).map(|row| row.iter().zip(&off).map(|(a, b)| a * b).sum()).collect()
    }

    /// The transposed of the linear part of [`PcaBasis::forward`]: the sum (N) of the components times `coordinates` (K).
    ///
    /// # Panics
    /// When there are not K.
    pub(crate) fn adjoint(&self, coordinates: &[f64]) -> Vec<f64> {
        assert_eq!(coordinates.len(), self.kept(), "other than the kept components");
        let mut series = vec![0.0; self.length()];
        for (x, row) in coordinates.iter().zip(self.components.chunks_exact(self.length())) {
            series.iter_mut().zip(row).for_each(|(s, r)| *s += x * r);
        }
        series
    }

    /// The series (N) nearest to the one that has these coordinates (K).
    ///
    /// # Panics
    /// When there are not K.
    #[cfg(test)]
    pub fn inverse(&self, coordinates: &[f64]) -> Vec<f64> {
        let mut series = self.adjoint(coordinates);
        series.iter_mut().zip(&self.mean).for_each(|(s, m)| *s += m);
        series
    }
}

/// Sums over series that a [`PcaBasis`] is fitted on, so that no series has to be in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct PcaFit {
    length: usize,
    count: u64,
    sum: Vec<f64>,
    /// (N, N) lower triangle of the sum of products.
    products: Vec<f64>,
}

impl PcaFit {
    /// Of series of `length` numbers.
    pub fn new(length: usize) -> PcaFit {
        PcaFit { length, count: 0, sum: vec![0.0; length], products: vec![0.0; length * length] }
    }

    /// Takes the channels (C, N) of a window, or any other series one after the other.
    ///
    /// # Panics
    /// When they are not whole series.
    pub fn add(&mut self, series: &[f64]) {
        assert!(series.len().is_multiple_of(self.length), "series of {}", self.length);
        let n = self.length;
        for x in series.chunks_exact(n) {
            self.count += 1;
            self.sum.iter_mut().zip(x).for_each(|(s, x)| *s += x);
            for (i, &scale) in x.iter().enumerate() {
                // the lower triangle alone: half of the additions, and the rest is its mirror
                self.products[i * n..i * n + i + 1].iter_mut().zip(x).for_each(|(p, x)| *p += scale * x);
            }
        }
    }

    /// Takes what another was fitted on. In a fixed order the sums have the same bytes on any number of threads.
    ///
    /// # Panics
    /// When it is of series of another length.
    pub fn merge(&mut self, other: &PcaFit) {
        assert_eq!(self.length, other.length, "series of another length");
        self.count += other.count;
        self.sum.iter_mut().zip(&other.sum).for_each(|(s, x)| *s += x);
        self.products.iter_mut().zip(&other.products).for_each(|(s, x)| *s += x);
    }

    /// The basis of `keep` components: eigenvectors of the covariance, which are the right singular vectors of the series
    /// laid under each other.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] when there are no series, or more components than numbers of a series, or numbers out of range.
    pub fn finish(&self, keep: usize) -> Result<PcaBasis> {
        let (n, count) = (self.length, self.count as f64);
        if self.count == 0 || keep > n {
            let found = format!("{keep} components from {} series of {n} numbers", self.count);
            return Err(Error::invalid("a basis", found, format!("at least 1 series, at most {n} components")));
        }
        let mean: Vec<f64> = self.sum.iter().map(|s| s / count).collect();
        let mut covariance = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                // one pass: radians of a few turns leave f64 ten digits after the subtraction
                covariance[i * n + j] = self.products[i * n + j] / count - mean[i] * mean[j];
            }
        }
        let (variances, mut components) = principal_components(n, &covariance).ok_or_else(|| {
            Error::invalid("the covariance of the windows", "out of range", "rotations in radians: are they right?")
        })?;
        components.truncate(keep * n);
        // over all N, before the rest is dropped
        let total_variance = variances.iter().sum();
        Ok(PcaBasis { mean, components, variances: variances[..keep].to_vec(), total_variance })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::tests::{Golden, largest_difference, noise};

    #[test]
    fn as_scikit_learn_has_it() {
        let case = Golden::load().pca;
        let (n, rows) = (case.length, case.data.len() / case.length);
        let mut fit = PcaFit::new(n);
        fit.add(&case.data);
        let basis = fit.finish(case.explained_variance.len()).unwrap();
        assert!(largest_difference(&basis.mean, &case.mean) < 1e-12);
        for (k, expected) in case.explained_variance.iter().enumerate() {
            // scikit-learn divides by one less
            let ours = basis.variances[k] * rows as f64 / (rows - 1) as f64;
            assert!((ours - expected).abs() < 1e-12 * case.explained_variance[0], "{k}: {ours} {expected}");
            let (a, b) = (&basis.components[k * n..][..n], &case.components[k * n..][..n]);
            let same: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
            assert!((same.abs() - 1.0).abs() < 1e-9, "{k}: {same}");
            // their sign is theirs
            let of_first = basis.forward(&case.data[..n])[k] * same.signum();
            assert!((of_first - case.first[k]).abs() < 1e-8, "{k}: {of_first} {}", case.first[k]);
        }
    }

    #[test]
    fn pieces_put_together_are_the_whole() {
        let data = noise(8, 32 * 50);
        let (mut whole, mut pieces) = (PcaFit::new(32), PcaFit::new(32));
        whole.add(&data);
        for piece in data.chunks(32 * 25) {
            let mut one = PcaFit::new(32);
            one.add(piece);
            pieces.merge(&one);
        }
        let (a, b) = (whole.finish(32).unwrap(), pieces.finish(32).unwrap());
        assert!(largest_difference(&a.variances, &b.variances) < 1e-12);
        let x = &data[..32];
        assert!(largest_difference(&a.inverse(&a.forward(x)), x) < 1e-12, "all components give the series back");
        assert!((a.total_variance - a.variances.iter().sum::<f64>()).abs() < 1e-12);
    }

    #[test]
    fn nothing_to_fit_is_said() {
        assert!(PcaFit::new(8).finish(4).unwrap_err().to_string().contains("from 0 series"));
        let mut fit = PcaFit::new(8);
        fit.add(&[1e300; 8]);
        assert!(fit.finish(9).is_err());
        assert!(fit.finish(4).unwrap_err().to_string().contains("out of range"));
    }
}
