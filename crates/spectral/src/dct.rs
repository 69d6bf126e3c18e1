//! The low coefficients of a cosine transform, or a band of them.

use kinelm_tokenizer::transform::dct::Dct;
use std::ops::Range;

/// The first coefficients of the orthonormal DCT-II of series of N numbers, or K neighbouring ones.
///
/// `X_k = c_k sum_n x_n cos(PI (n + 1/2) k / N)` with `c_0 = sqrt(1/N)`, else `sqrt(2/N)`. Coefficient k is a wave of `k / (2 N)`
/// turns a frame: at 128 frames and 60 frames per second, k times 0.234 Hz.
#[derive(Debug, Clone)]
pub struct LowDct {
    all: Dct,
    band: Range<usize>,
}

impl PartialEq for LowDct {
    fn eq(&self, other: &Self) -> bool {
        // a transform is its length: the tables follow from it
        (self.all.len(), &self.band) == (other.all.len(), &other.band)
    }
}

impl LowDct {
    /// Coefficients by default: up to 3.5 Hz at 60 frames per second.
    pub const KEEP: usize = 16;

    /// For series of `length` numbers, `keep` coefficients.
    ///
    /// # Panics
    /// When the length is 0 or less than `keep`.
    pub fn new(length: usize, keep: usize) -> LowDct {
        LowDct::of_band(length, 0..keep)
    }

    /// For series of `length` numbers, the coefficients of a band.
    ///
    /// # Panics
    /// When the length is 0 or the band leaves it.
    pub fn of_band(length: usize, band: Range<usize>) -> LowDct {
        assert!(band.end <= length && band.start <= band.end, "{band:?} of {length} coefficients");
        LowDct { all: Dct::new(length), band }
    }

    /// N.
    pub fn length(&self) -> usize {
        self.all.len()
    }

    /// K, the number of coefficients.
    pub fn kept(&self) -> usize {
        self.band.len()
    }

    /// All coefficients (N) of a series (N).
    ///
    /// # Panics
    /// When the series has another length.
    pub fn forward(&self, series: &[f64]) -> Vec<f64> {
        let mut numbers = series.to_vec();
        self.all.forward(&mut numbers, &mut vec![0.0; self.all.scratch_len()]);
        numbers
    }

    /// The series (N) of all its coefficients (N): the inverse of [`LowDct::forward`], and its transpose.
    ///
    /// # Panics
    /// When there are not N.
    pub(crate) fn inverse(&self, coefficients: &[f64]) -> Vec<f64> {
        let mut numbers = coefficients.to_vec();
        self.all.inverse(&mut numbers, &mut vec![0.0; self.all.scratch_len()]);
        numbers
    }

    /// The K coefficients.
    ///
    /// # Panics
    /// When the series has another length.
    pub fn low(&self, series: &[f64]) -> Vec<f64> {
        self.forward(series)[self.band.clone()].to_vec()
    }

    /// The series (N) of these coefficients and no others: the transposed of [`LowDct::low`].
    ///
    /// # Panics
    /// When there are not K.
    pub(crate) fn low_back(&self, coefficients: &[f64]) -> Vec<f64> {
        assert_eq!(coefficients.len(), self.kept(), "other than the kept coefficients");
        let mut all = vec![0.0; self.length()];
        all[self.band.clone()].copy_from_slice(coefficients);
        self.inverse(&all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::tests::{Golden, largest_difference, noise};

    #[test]
    fn as_scipy_has_it() {
        for case in Golden::load().dct {
            let dct = LowDct::new(case.input.len(), case.low.len());
            assert!(largest_difference(&dct.low(&case.input), &case.low) < 1e-12);
        }
    }

    #[test]
    fn by_hand_and_back() {
        let dct = LowDct::new(128, LowDct::KEEP);
        let constant = dct.forward(&[1.0; 128]);
        assert!((constant[0] - 11.3137).abs() < 1e-4 && constant[1..].iter().all(|x| x.abs() < 1e-12));
        let x = noise(5, 128);
        assert!(largest_difference(&dct.inverse(&dct.forward(&x)), &x) < 1e-12);
        let low = dct.low_back(&dct.low(&x));
        let kept = dct.forward(&low);
        assert!(largest_difference(&kept[..16], &dct.low(&x)) < 1e-12);
        assert!(kept[16..].iter().all(|x| x.abs() < 1e-12));
        let band = LowDct::of_band(128, 4..16);
        assert_eq!(band.low(&x), dct.low(&x)[4..]);
        let kept = band.forward(&band.low_back(&band.low(&x)));
        assert!(largest_difference(&kept[4..16], &band.low(&x)) < 1e-12);
        assert!(kept[..4].iter().chain(&kept[16..]).all(|x| x.abs() < 1e-12));
    }
}
