//! Spectral flux of a sound: rises in four bands, lasting change in two.

use super::{FPS, HOP, RATE};
use crate::frames::{Frames, Spectrum, hann};
use std::collections::VecDeque;

/// Series of flux: rises below 200 Hz, to 800 Hz, to 3.2 kHz and above; lasting change below 2.5 kHz and below 250 Hz.
pub const SERIES: usize = 6;
/// How many of the series are rises.
pub const RISES: usize = 4;
const WINDOW: usize = 1024;
const BANDS: usize = 48;
/// Lowest and highest edge of the bands, hertz.
const RANGE: (f64, f64) = (30.0, 10_000.0);
/// Upper ends of the series of rises, hertz.
const UPPER: [f64; RISES] = [200.0, 800.0, 3200.0, f64::INFINITY];
/// Upper ends of the series of lasting change, hertz.
const LASTING_UPPER: [f64; SERIES - RISES] = [2500.0, 250.0];
/// Frames over which a rise is measured: half a window.
const LAG: usize = 2;
/// Frames on each side of a lasting change: 0.2 s.
const LASTING: usize = 17;
/// Loudness of a magnitude m is `ln(1 + LOUDNESS m)`.
const LOUDNESS: f32 = 100.0;
/// Seconds over which a series is normalised.
const LEVELLED_S: f64 = 6.0;

/// The flux of a stream of samples at [`RATE`].
///
/// A band rises by its loudness less the largest loudness of it and its two neighbours two frames earlier, so that vibrato
/// doesn't count. Source: Böck and Widmer, "Maximum filter vibrato suppression for onset detection" (2013).
pub struct Flux {
    frames: Frames,
    spectrum: Spectrum,
    /// First bin and weights of each band, sum 1.
    bank: Vec<(usize, Vec<f32>)>,
    middles: Vec<f64>,
    series: Series,
    past: VecDeque<[f32; BANDS]>,
}

/// F numbers per series.
pub type Series = [Vec<f32>; SERIES];

impl Default for Flux {
    fn default() -> Self {
        Flux::new()
    }
}

impl Flux {
    /// No samples yet.
    pub fn new() -> Flux {
        let (bank, middles) = bank();
        Flux {
            frames: Frames::new(WINDOW, HOP),
            spectrum: Spectrum::new(hann(WINDOW)),
            bank,
            middles,
            series: Default::default(),
            past: VecDeque::new(),
        }
    }

    /// Takes samples.
    pub fn push(&mut self, samples: &[f32]) {
        // taken out: `frames` calls back into all of self
        let mut frames = std::mem::replace(&mut self.frames, Frames::new(2, 1));
        frames.push(samples, &mut |x| self.take(x));
        self.frames = frames;
    }

    /// The series of the whole sound, normalised over 6 s and slightly smoothed.
    pub fn finish(mut self) -> Series {
        let mut frames = std::mem::replace(&mut self.frames, Frames::new(2, 1));
        frames.finish(&mut |x| self.take(x));
        // lasting change is known 17 frames late; after the end is silence
        (1..LASTING).for_each(|_| self.lasting([0.0; BANDS]));
        let frames = self.series[0].len();
        for (s, series) in self.series.iter_mut().enumerate() {
            series.resize(frames, 0.0);
            level(series);
            *series = smooth(series, if s < RISES { 1.0 } else { 2.0 });
        }
        self.series
    }

    fn take(&mut self, frame: &[f32]) {
        self.spectrum.transform(frame);
        let magnitudes: Vec<f32> = self.spectrum.bins.iter().map(|c| c.norm()).collect();
        let mut loudness = [0.0; BANDS];
        for (to, (first, weights)) in loudness.iter_mut().zip(&self.bank) {
            let sum: f32 = weights.iter().zip(&magnitudes[*first..]).map(|(w, m)| w * m).sum();
            *to = (LOUDNESS * sum).ln_1p();
        }
        // this frame is not in `past` yet: the last but one is two frames earlier
        let before = self.past.len().checked_sub(LAG).map(|i| self.past[i]);
        let rise = |b: usize| {
            before.map_or(0.0, |before| {
                let near = &before[b.saturating_sub(1)..(b + 2).min(BANDS)];
                (loudness[b] - near.iter().copied().fold(0.0, f32::max)).max(0.0)
            })
        };
        let mut low = 0.0;
        for (series, high) in self.series.iter_mut().zip(UPPER) {
            let within = (0..BANDS).filter(|b| (low..high).contains(&self.middles[*b]));
            series.push(mean(within.map(rise)));
            low = high;
        }
        self.lasting(loudness);
    }

    /// Adds by how much the 0.2 s that end with this frame are louder than the 0.2 s before them.
    fn lasting(&mut self, loudness: [f32; BANDS]) {
        self.past.push_back(loudness);
        if self.past.len() < LASTING {
            return;
        }
        let split = self.past.len() - LASTING;
        let share =
            |from: usize, to: usize, b: usize| (from..to).map(|i| self.past[i][b]).sum::<f32>() / LASTING as f32;
        let change = |b: usize| (share(split, split + LASTING, b) - share(0, split, b)).max(0.0);
        for (s, high) in LASTING_UPPER.into_iter().enumerate() {
            let within = (0..BANDS).filter(|b| self.middles[*b] < high);
            let found = mean(within.map(change));
            self.series[RISES + s].push(found);
        }
        if self.past.len() == 2 * LASTING {
            self.past.pop_front();
        }
    }
}

fn mean(all: impl Iterator<Item = f32>) -> f32 {
    let (sum, n) = all.fold((0.0, 0), |(sum, n), x| (sum + x, n + 1));
    if n == 0 { 0.0 } else { sum / n as f32 }
}

/// Triangles spaced evenly on O'Shaughnessy's mel scale, each of sum 1, and their centres in hertz.
fn bank() -> (Vec<(usize, Vec<f32>)>, Vec<f64>) {
    let mel = |hz: f64| 2595.0 * (1.0 + hz / 700.0).log10();
    let hz_of = |mel: f64| 700.0 * (10f64.powf(mel / 2595.0) - 1.0);
    let (low, high) = (mel(RANGE.0), mel(RANGE.1));
    let edge = |i: usize| hz_of(low + (high - low) * i as f64 / (BANDS + 1) as f64);
    let hz = |bin: usize| bin as f64 * f64::from(RATE) / WINDOW as f64;
    let band = |i: usize| {
        let (low, middle, high) = (edge(i), edge(i + 1), edge(i + 2));
        let weight = |bin: usize| ((hz(bin) - low) / (middle - low)).min((high - hz(bin)) / (high - middle)).max(0.0);
        let first = (0..=WINDOW / 2).find(|bin| weight(*bin) > 0.0);
        let Some(first) = first else {
            // a band that falls between two bins takes the nearer one
            return ((middle / hz(1)).round() as usize, vec![1.0]);
        };
        let weights: Vec<f64> = (first..=WINDOW / 2).map(weight).take_while(|w| *w > 0.0).collect();
        let sum: f64 = weights.iter().sum();
        (first, weights.iter().map(|w| (w / sum) as f32).collect())
    };
    ((0..BANDS).map(band).collect(), (0..BANDS).map(|i| edge(i + 1)).collect())
}

/// Divides a series by its root mean square around each frame.
fn level(series: &mut [f32]) {
    let squares: Vec<f32> = series.iter().map(|x| x * x).collect();
    let around = moving_mean(&squares, (LEVELLED_S * FPS) as usize);
    for (x, square) in series.iter_mut().zip(around) {
        // silence stays small instead of becoming 0 / 0
        *x /= square.sqrt() + 1e-3;
    }
}

/// The mean of the `n` (made odd) numbers around each number, of fewer at the ends; for numbers that are 0 or more.
pub fn moving_mean(x: &[f32], n: usize) -> Vec<f32> {
    let half = n / 2;
    // prefix sums, in f64: their differences cancel over a long piece
    let mut sums = vec![0.0f64];
    for x in x {
        sums.push(sums[sums.len() - 1] + f64::from(*x));
    }
    let one = |i: usize| {
        let (from, to) = (i.saturating_sub(half), (i + half + 1).min(x.len()));
        // what cancels may leave -1e-17, whose root is NaN; all series here are at least 0
        ((sums[to] - sums[from]) / (to - from) as f64).max(0.0) as f32
    };
    (0..x.len()).map(one).collect()
}

/// A Gaussian low pass, `sigma` in frames; silence beyond the ends.
fn smooth(x: &[f32], sigma: f32) -> Vec<f32> {
    let reach = (4.0 * sigma).ceil() as usize;
    let weight = |i: usize| (-0.5 * ((i as f32 - reach as f32) / sigma).powi(2)).exp();
    let total: f32 = (0..=2 * reach).map(weight).sum();
    let weights: Vec<f32> = (0..=2 * reach).map(|i| weight(i) / total).collect();
    let at = |i: usize| -> f32 {
        let each = weights.iter().enumerate();
        each.filter_map(|(k, w)| (i + k).checked_sub(reach).and_then(|j| x.get(j)).map(|x| w * x)).sum()
    };
    (0..x.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn flux(x: &[f32], block: usize) -> Series {
        let mut f = Flux::new();
        x.chunks(block).for_each(|b| f.push(b));
        f.finish()
    }

    #[test]
    fn a_tone_rises_in_its_band_when_it_begins() {
        let rate = f64::from(RATE);
        for (hz, band) in [(90.0, 0), (400.0, 1), (1500.0, 2), (6000.0, 3)] {
            let tone = |i: usize| if i < 44_100 { 0.0 } else { (0.5 * (TAU * hz * i as f64 / rate).sin()) as f32 };
            let x: Vec<f32> = (0..110_250).map(tone).collect();
            let series = flux(&x, 1000);
            let peak = |s: &[f32]| (0..s.len()).max_by(|a, b| s[*a].total_cmp(&s[*b])).unwrap();
            let at = peak(&series[band]) as f64 / FPS;
            assert!((at - 2.0).abs() < 0.03, "{hz}: {at}");
            let lasting = peak(&series[RISES]) as f64 / FPS;
            assert!((lasting - 2.0).abs() < 0.1 || hz > 2500.0, "{hz}: {lasting}");
            assert!(series.iter().all(|s| s.len() == 1 + x.len() / HOP));
        }
    }

    #[test]
    fn blocks_change_nothing_and_silence_is_still() {
        let x: Vec<f32> = (0..30_000).map(|i| ((i * i % 977) as f32 / 488.0 - 1.0) * 0.1).collect();
        assert_eq!(flux(&x, 13), flux(&x, 30_000));
        assert!(flux(&vec![0.0; 40_000], 4096).iter().all(|s| s.iter().all(|x| *x == 0.0)));
        assert_eq!(flux(&[0.1; 100], 100)[0].len(), 1);
        assert_eq!(moving_mean(&[1.0, 2.0, 3.0, 4.0], 3), [1.5, 2.0, 3.0, 3.5]);
    }
}
