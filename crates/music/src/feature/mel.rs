//! Mel bands, decibels and cepstrum, as in librosa.

use std::f64::consts::PI;

/// Bands of the mel spectrum.
pub const BANDS: usize = 128;

/// Slaney's mel scale: linear below 1 kHz, logarithmic above.
///
/// Source: Slaney, "Auditory Toolbox" (1998).
fn mel_of(hz: f64) -> f64 {
    const STEP: f64 = 200.0 / 3.0;
    if hz < 1000.0 { hz / STEP } else { 15.0 + (hz / 1000.0).ln() / (6.4f64.ln() / 27.0) }
}

// 1 kHz is mel 15, 27 mels are a factor of 6.4: the constants of the Auditory Toolbox
fn hz_of(mel: f64) -> f64 {
    const STEP: f64 = 200.0 / 3.0;
    if mel < 15.0 { mel * STEP } else { 1000.0 * ((mel - 15.0) * (6.4f64.ln() / 27.0)).exp() }
}

/// Triangular filters over the bins of a power spectrum, each of area 1 in hertz.
pub struct Bank {
    /// First bin and weights of each band.
    bands: Vec<(usize, Vec<f32>)>,
}

impl Bank {
    /// For spectra of `size` samples at `rate` per second, up to half the rate.
    pub fn new(size: usize, rate: u32) -> Bank {
        let top = mel_of(f64::from(rate) / 2.0);
        let edge = |i: usize| hz_of(top * i as f64 / (BANDS + 1) as f64);
        let hz = |bin: usize| bin as f64 * f64::from(rate) / size as f64;
        let band = |i: usize| {
            let (low, middle, high) = (edge(i), edge(i + 1), edge(i + 2));
            let weight = |bin: usize| {
                let up = (hz(bin) - low) / (middle - low);
                let down = (high - hz(bin)) / (high - middle);
                (up.min(down).max(0.0) * 2.0 / (high - low)) as f32
            };
            let all: Vec<f32> = (0..=size / 2).map(weight).collect();
            // at low rates a band may fall between two bins and be empty, always -100 dB, as in librosa
            let first = all.iter().position(|w| *w > 0.0).unwrap_or(0);
            let end = all.iter().rposition(|w| *w > 0.0).map_or(first, |last| last + 1);
            (first, all[first..end].to_vec())
        };
        Bank { bands: (0..BANDS).map(band).collect() }
    }

    /// The bands of a power spectrum in decibels, at least -100: `10 log10 max(1e-10, power)`.
    pub fn decibels(&self, power: &[f32], out: &mut [f32; BANDS]) {
        for (to, (first, weights)) in out.iter_mut().zip(&self.bands) {
            let sum: f32 = weights.iter().zip(&power[*first..]).map(|(w, p)| w * p).sum();
            *to = 10.0 * sum.max(1e-10).log10();
        }
    }
}

/// Rows of the orthonormal discrete cosine transform (type II) of [`BANDS`] numbers.
pub struct Cosines(Vec<[f32; BANDS]>);

impl Cosines {
    /// The first `rows`.
    pub fn new(rows: usize) -> Cosines {
        let row = |k: usize| {
            let scale = ((if k == 0 { 1.0 } else { 2.0 }) / BANDS as f64).sqrt();
            std::array::from_fn(|i| (scale * (PI * k as f64 * (i as f64 + 0.5) / BANDS as f64).cos()) as f32)
        };
        Cosines((0..rows).map(row).collect())
    }

    /// The coefficients of bands, raised to at least `floor`.
    pub fn of(&self, decibels: &[f32; BANDS], floor: f32) -> impl Iterator<Item = f32> {
        let raised = decibels.map(|d| d.max(floor));
        self.0.iter().map(move |row| row.iter().zip(&raised).map(|(c, d)| c * d).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_turns_back() {
        for hz in [0.0, 440.0, 999.0, 1000.0, 1001.0, 8000.0] {
            assert!((hz_of(mel_of(hz)) - hz).abs() < 1e-9, "{hz}");
        }
        assert!((mel_of(1000.0) - 15.0).abs() < 1e-12);
    }

    #[test]
    fn a_flat_cepstrum_is_its_first_number() {
        let c: Vec<f32> = Cosines::new(20).of(&[-3.0; BANDS], -80.0).collect();
        assert!((c[0] + 3.0 * (BANDS as f32).sqrt()).abs() < 1e-4);
        assert!(c[1..].iter().all(|x| x.abs() < 1e-4));
    }
}
