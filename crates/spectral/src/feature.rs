//! One window to one feature.

use super::{LowDct, PcaBasis, Stft};

/// The feature of a window.
#[derive(Debug, Clone, PartialEq)]
pub enum Transform {
    /// Magnitudes of a short-time Fourier transform.
    Stft(Stft),
    /// Low coefficients of a cosine transform.
    Dct(LowDct),
    /// Coordinates in a fitted basis.
    Pca(PcaBasis),
}

impl Transform {
    /// N, frames of a window.
    pub fn length(&self) -> usize {
        match self {
            Transform::Stft(t) => t.length(),
            Transform::Dct(t) => t.length(),
            Transform::Pca(t) => t.length(),
        }
    }

    /// Numbers that one channel gives.
    pub fn kept(&self) -> usize {
        match self {
            Transform::Stft(t) => t.kept(),
            Transform::Dct(t) => t.kept(),
            Transform::Pca(t) => t.kept(),
        }
    }

    /// The feature (C, kept) of a window (C, N).
    ///
    /// # Panics
    /// When the window isn't `channels` channels of N.
    pub fn feature(&self, window: &[f64], channels: usize) -> Vec<f64> {
        self.each(window, channels, |series, _| match self {
            Transform::Stft(t) => t.magnitudes(series),
            Transform::Dct(t) => t.low(series),
            Transform::Pca(t) => t.forward(series),
        })
    }

    /// The same with a norm of 1; a window of zeros stays zeros.
    ///
    /// # Panics
    /// As [`Transform::feature`].
    pub fn unit_feature(&self, window: &[f64], channels: usize) -> Vec<f64> {
        let mut feature = self.feature(window, channels);
        let norm = feature.iter().map(|x| x * x).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        feature.iter_mut().for_each(|x| *x /= norm);
        feature
    }

    /// The gradient over the window (C, N) of a function of its feature, from the one over the feature (C, kept).
    ///
    /// # Panics
    /// When window or gradient have another shape.
    pub(crate) fn feature_back(&self, window: &[f64], channels: usize, gradient: &[f64]) -> Vec<f64> {
        assert_eq!(gradient.len(), channels * self.kept(), "a gradient of another shape");
        self.each(window, channels, |series, channel| {
            let gradient = &gradient[channel * self.kept()..][..self.kept()];
            match self {
                Transform::Stft(t) => t.magnitudes_back(series, gradient),
                Transform::Dct(t) => t.low_back(gradient),
                // the transpose without the mean, which a gradient doesn't see
                Transform::Pca(t) => t.adjoint(gradient),
            }
        })
    }

    fn each(&self, window: &[f64], channels: usize, make: impl Fn(&[f64], usize) -> Vec<f64>) -> Vec<f64> {
        assert_eq!(window.len(), channels * self.length(), "a window of another shape");
        window.chunks_exact(self.length()).enumerate().flat_map(|(channel, series)| make(series, channel)).collect()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::pca::PcaFit;
    use kinelm_store::random;
    use serde::Deserialize;

    /// Results of scipy and scikit-learn for the same numbers; `scripts/reference/spectral.py`.
    #[derive(Deserialize)]
    pub struct Golden {
        pub stft: Vec<StftCase>,
        pub dct: Vec<DctCase>,
        pub pca: PcaCase,
    }

    #[derive(Deserialize)]
    pub struct StftCase {
        pub window: usize,
        pub hop: usize,
        pub input: Vec<f64>,
        pub real: Vec<f64>,
        pub imaginary: Vec<f64>,
        pub magnitudes: Vec<f64>,
    }

    #[derive(Deserialize)]
    pub struct DctCase {
        pub input: Vec<f64>,
        pub low: Vec<f64>,
    }

    #[derive(Deserialize)]
    pub struct PcaCase {
        pub length: usize,
        pub data: Vec<f64>,
        pub mean: Vec<f64>,
        pub components: Vec<f64>,
        pub explained_variance: Vec<f64>,
        pub first: Vec<f64>,
    }

    impl Golden {
        pub fn load() -> Golden {
            serde_json::from_str(include_str!("../tests/golden/spectral.json")).unwrap()
        }
    }

    /// Numbers in -1..1, the same in every run.
    pub fn noise(seed: u64, count: usize) -> Vec<f64> {
        let mut rng = random::stream(seed, "spectral test", 0, 0);
        (0..count).map(|_| 2.0 * random::unit(&mut rng) - 1.0).collect()
    }

    pub fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    fn transforms() -> Vec<Transform> {
        let mut fit = PcaFit::new(128);
        fit.add(&noise(1, 128 * 40));
        vec![
            Transform::Stft(Stft::new(128, false)),
            Transform::Stft(Stft::new(128, true)),
            Transform::Dct(LowDct::new(128, 16)),
            Transform::Pca(fit.finish(16).unwrap()),
        ]
    }

    #[test]
    fn a_body_gives_as_many_numbers_as_documented() {
        let sizes: Vec<usize> = transforms().iter().map(|t| t.feature(&vec![0.1; 72 * 128], 72).len()).collect();
        assert_eq!(sizes, [9720, 8640, 1152, 1152]);
    }

    #[test]
    fn gradients_are_the_differences() {
        let (x, step) = (noise(2, 3 * 128), 1e-6);
        for t in transforms() {
            let weights = noise(3, 3 * t.kept());
            let value = |x: &[f64]| t.feature(x, 3).iter().zip(&weights).map(|(f, w)| f * w).sum::<f64>();
            let gradient = t.feature_back(&x, 3, &weights);
            for at in [0, 100, 128, 300, 383] {
                let moved = |by: f64| {
                    let mut x = x.clone();
                    x[at] += by;
                    value(&x)
                };
                let slope = (moved(step) - moved(-step)) / (2.0 * step);
                assert!((slope - gradient[at]).abs() < 1e-6, "{t:?} {at}: {slope} {}", gradient[at]);
            }
        }
    }
}
