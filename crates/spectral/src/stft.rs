//! Short-time Fourier transforms of series.
//!
//! Frequencies are multiples of the rate over the window: with 16 numbers at 60 a second 3.75 Hz, so that slow
//! movements share the lowest two.

use std::f64::consts::PI;

/// The short-time Fourier transform of series of N numbers: a Hann window (periodic) moved over them, no padding.
///
/// Letters: w numbers of a Hann window, T = (N - w) / hop + 1 places of it, B = w/2 + 1 frequencies from 0 to half the rate.
/// `X[t, b] = sum_n x[t hop + n] hann[n] exp(-2 PI i b n / w)` with `hann[n] = (1 - cos(2 PI n / w)) / 2`; not scaled.
#[derive(Debug, Clone, PartialEq)]
pub struct Stft {
    length: usize,
    window: usize,
    hop: usize,
    no_dc: bool,
    /// (B, w) waves under the Hann window: real and imaginary parts.
    real: Vec<f64>,
    imaginary: Vec<f64>,
}

impl Stft {
    /// Numbers of a Hann window unless said otherwise: 267 ms at 60 frames per second.
    pub const WINDOW: usize = 16;
    /// From a window to the next unless said otherwise.
    pub const HOP: usize = 8;

    /// For series of `length` numbers, with windows of 16 and hop 8. `no_dc` leaves the magnitude at 0 Hz out, which holds
    /// the mean pose.
    ///
    /// # Panics
    /// When the series is shorter than a window.
    pub(crate) fn new(length: usize, no_dc: bool) -> Stft {
        Stft::with(length, Stft::WINDOW, Stft::HOP, no_dc)
    }

    /// With windows of `window` numbers, which is even, and any hop.
    ///
    /// # Panics
    /// When the series is shorter than a window, the window is 0 or odd, the hop 0.
    pub fn with(length: usize, window: usize, hop: usize, no_dc: bool) -> Stft {
        assert!(
            window > 0 && window.is_multiple_of(2) && length >= window,
            "windows of {window} in series of {length}"
        );
        assert!(hop > 0, "a hop of 0");
        // n mod w first: the wave repeats, and small angles are exact
        let turn = |n: usize| 2.0 * PI * (n % window) as f64 / window as f64;
        let under_window = |b: usize, n: usize, wave: fn(f64) -> f64| 0.5 * (1.0 - turn(n).cos()) * wave(turn(b * n));
        let table = |wave: fn(f64) -> f64| -> Vec<f64> {
            (0..=window / 2)
                .flat_map(|b| (0..window).map(move |n| (b, n)))
                .map(|(b, n)| under_window(b, n, wave))
                .collect()
        };
        Stft { length, window, hop, no_dc, real: table(f64::cos), imaginary: table(|x| -x.sin()) }
    }

    /// N.
    pub fn length(&self) -> usize {
        self.length
    }

    /// T, the places of the window.
    pub fn frames(&self) -> usize {
        (self.length - self.window) / self.hop + 1
    }

    /// B, the frequencies, with the one at 0 Hz.
    pub fn bins(&self) -> usize {
        self.window / 2 + 1
    }

    /// Numbers of `Stft::magnitudes`: T times B, or T times B - 1.
    pub fn kept(&self) -> usize {
        self.frames() * (self.bins() - usize::from(self.no_dc))
    }

    /// A series (N) into (T, B) real and imaginary parts, 0 Hz always among them.
    ///
    /// # Panics
    /// When the series has another length.
    pub fn forward(&self, series: &[f64]) -> (Vec<f64>, Vec<f64>) {
        assert_eq!(series.len(), self.length, "a series of another length");
        let part = |table: &[f64]| -> Vec<f64> {
            let places = (0..self.frames()).map(|t| &series[t * self.hop..][..self.window]);
            places.flat_map(|x| table.chunks_exact(self.window).map(move |wave| dot(x, wave))).collect()
        };
        (part(&self.real), part(&self.imaginary))
    }

    /// The transposed of [`Stft::forward`] as a linear map of real numbers: from (T, B) parts to a series (N). It turns a
    /// gradient over parts into one over the series; it is not the inverse.
    ///
    /// # Panics
    /// When there are not T times B of each part.
    pub(crate) fn adjoint(&self, real: &[f64], imaginary: &[f64]) -> Vec<f64> {
        let count = self.frames() * self.bins();
        assert_eq!((real.len(), imaginary.len()), (count, count), "parts of another shape");
        let mut series = vec![0.0; self.length];
        for (parts, table) in [(real, &self.real), (imaginary, &self.imaginary)] {
            for (t, row) in parts.chunks_exact(self.bins()).enumerate() {
                let place = &mut series[t * self.hop..][..self.window];
                for (part, wave) in row.iter().zip(table.chunks_exact(self.window)) {
                    place.iter_mut().zip(wave).for_each(|(x, w)| *x += part * w);
                }
            }
        }
        series
    }

    /// (T, B) magnitudes of a series (N), without those at 0 Hz where `no_dc` says so.
    ///
    /// # Panics
    /// When the series has another length.
    pub(crate) fn magnitudes(&self, series: &[f64]) -> Vec<f64> {
        let (real, imaginary) = self.forward(series);
        let all = real.iter().zip(&imaginary).map(|(re, im)| re.hypot(*im));
        all.enumerate().filter(|(i, _)| self.keeps(*i)).map(|(_, x)| x).collect()
    }

    /// The gradient over the series (N) of a function of its magnitudes, from the one over those. A magnitude of 0 has none and
    /// gives 0.
    ///
    /// # Panics
    /// When the series has another length, or there are not [`Stft::kept`] numbers.
    pub(crate) fn magnitudes_back(&self, series: &[f64], gradient: &[f64]) -> Vec<f64> {
        assert_eq!(gradient.len(), self.kept(), "a gradient of another shape");
        let (mut real, mut imaginary) = self.forward(series);
        let mut gradient = gradient.iter();
        for (i, (re, im)) in real.iter_mut().zip(&mut imaginary).enumerate() {
            let size = re.hypot(*im);
            let slope = if self.keeps(i) { gradient.next().copied().unwrap_or(0.0) } else { 0.0 };
            // a length has no gradient at 0, where slope / size would be NaN
            let scale = if size > 0.0 { slope / size } else { 0.0 };
            (*re, *im) = (*re * scale, *im * scale);
        }
        self.adjoint(&real, &imaginary)
    }

    fn keeps(&self, place: usize) -> bool {
        !(self.no_dc && place.is_multiple_of(self.bins()))
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::tests::{Golden, largest_difference, noise};

    #[test]
    fn as_scipy_has_it() {
        for case in Golden::load().stft {
            let stft = Stft::with(case.input.len(), case.window, case.hop, false);
            let (real, imaginary) = stft.forward(&case.input);
            // of sums of sixteen products
            assert!(largest_difference(&real, &case.real) < 1e-12);
            assert!(largest_difference(&imaginary, &case.imaginary) < 1e-12);
            assert!(largest_difference(&stft.magnitudes(&case.input), &case.magnitudes) < 1e-12);
        }
    }

    #[test]
    fn shapes_and_the_sum_of_the_window() {
        let stft = Stft::new(128, false);
        assert_eq!((stft.frames(), stft.bins(), stft.kept()), (15, 9, 135));
        let of_ones = stft.magnitudes(&[1.0; 128]);
        // a Hann window sums to half its length; at the next frequency it has a quarter of the length
        assert!((of_ones[0] - 8.0).abs() < 1e-12 && (of_ones[1] - 4.0).abs() < 1e-12 && of_ones[2].abs() < 1e-12);
        let without = Stft::new(128, true);
        assert_eq!(without.kept(), 120);
        let x = noise(1, 128);
        let (all, some) = (stft.magnitudes(&x), without.magnitudes(&x));
        assert!(all.chunks(9).zip(some.chunks(8)).all(|(a, s)| a[1..] == *s));
    }

    #[test]
    fn the_adjoint_is_the_transposed() {
        let stft = Stft::with(40, 8, 3, false);
        let (x, n) = (noise(2, 40), stft.frames() * stft.bins());
        let (re, im) = (noise(3, n), noise(4, n));
        let (fr, fi) = stft.forward(&x);
        let there = dot(&fr, &re) + dot(&fi, &im);
        let back = dot(&x, &stft.adjoint(&re, &im));
        assert!((there - back).abs() < 1e-12 * there.abs().max(1.0), "{there} {back}");
    }
}
