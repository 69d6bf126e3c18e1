//! The constant-Q transform: a spectrum with the same number of bins in each octave.

use super::tuning::BINS_PER_OCTAVE;
use crate::frames::{Frames, Spectrum};
use realfft::num_complex::Complex;
use std::f64::consts::{PI, TAU};

/// Octaves, from C1 on.
pub const OCTAVES: usize = 7;
/// C1, hertz.
const LOWEST_HZ: f64 = 32.703_195_662_574_83;
/// Parts of a kernel's spectrum below this share of its peak are dropped.
const NEGLIGIBLE: f32 = 1e-3;

/// Receives a frame, a bin and the bin's magnitude.
pub type Bins<'a> = &'a mut dyn FnMut(usize, usize, f32);

/// Magnitudes of [`OCTAVES`] x [`BINS_PER_OCTAVE`] bins, C1 first, divided by the root of their windows' lengths.
///
/// Each lower octave is the same transform of the sound at half the rate. Frames are those of [`Frames`]; magnitudes come
/// octave by octave.
///
/// Source: Schörkhuber and Klapuri, "Constant-Q transform toolbox for music processing" (2010), as librosa's `cqt`.
pub struct ConstantQ {
    octaves: Vec<Octave>,
    halvings: Vec<Halving>,
}

impl ConstantQ {
    /// At `rate` samples per second, a frame every `hop` samples; `tuning` in bins.
    ///
    /// # Panics
    /// When the rate is too low for the highest octave (8,700 samples per second are enough), or `hop` can't be halved six
    /// times.
    pub fn new(rate: u32, hop: usize, tuning: f64) -> ConstantQ {
        // bins follow the recording: a tone of a piece tuned high is in the middle of its bin
        let lowest = LOWEST_HZ * 2f64.powf(tuning / BINS_PER_OCTAVE as f64);
        let top = lowest * 2f64.powi(OCTAVES as i32);
        // the main lobe of the highest bin, which is a bin below `top`, reaches 2 / Q = 3.9 % beyond it
        assert!(top * 1.02 <= f64::from(rate) / 2.0, "{rate} samples per second hold no octave up to {top} Hz");
        assert!(hop.is_multiple_of(1 << (OCTAVES - 1)), "a frame every {hop} samples");
        let octave = |o: usize| Octave::new(lowest, f64::from(rate), hop, OCTAVES - 1 - o);
        let octaves = (0..OCTAVES).map(octave).collect();
        ConstantQ { octaves, halvings: (1..OCTAVES).map(|_| Halving::new()).collect() }
    }

    /// Takes samples.
    pub fn push(&mut self, samples: &[f32], bins: Bins) {
        let mut at_rate = samples.to_vec();
        for (i, octave) in self.octaves.iter_mut().enumerate() {
            octave.push(&at_rate, bins);
            if let Some(halving) = self.halvings.get_mut(i) {
                at_rate = halving.push(&at_rate);
            }
        }
    }

    /// Emits the frames that reach beyond the end.
    pub fn finish(&mut self, bins: Bins) {
        let mut rest = Vec::new();
        // the end of each rate comes after the tail of the low pass above it
        for (i, octave) in self.octaves.iter_mut().enumerate() {
            octave.push(&rest, bins);
            octave.frames.finish(&mut |x| octave.bank.emit(x, bins));
            if let Some(halving) = self.halvings.get_mut(i) {
                rest = halving.push(&rest);
                rest.extend(halving.finish());
            }
        }
    }
}

/// One octave, at its own rate.
struct Octave {
    frames: Frames,
    bank: Bank,
}

/// The kernels of an octave.
struct Bank {
    /// The octave's lowest bin.
    first: usize,
    spectrum: Spectrum,
    kernels: Vec<Kernel>,
    /// The next frame.
    frame: usize,
}

/// The spectrum of a windowed tone from bin `from` on, with the divisor of the magnitude in it.
struct Kernel {
    from: usize,
    spectrum: Vec<Complex<f32>>,
}

impl Octave {
    /// The octave of this number, counted from the lowest.
    fn new(lowest_hz: f64, rate: f64, hop: usize, number: usize) -> Octave {
        let down = OCTAVES - 1 - number;
        let rate_here = rate / f64::from(1u32 << down);
        let hz = |i: usize| lowest_hz * 2f64.powf(number as f64 + i as f64 / BINS_PER_OCTAVE as f64);
        let step = 2f64.powf(2.0 / BINS_PER_OCTAVE as f64);
        // librosa's relative bandwidth: of the distance between both neighbours
        let q = (step + 1.0) / (step - 1.0);
        let hop = hop >> down;
        // at low rates the longest window is shorter than a hop
        let size = ((q * rate_here / hz(0)).ceil() as usize).max(hop).next_power_of_two();
        let weight = |i: usize| (q * rate / hz(i)).sqrt();
        let kernels = (0..BINS_PER_OCTAVE)
            .map(|i| Kernel::new(hz(i) / rate_here, q * rate_here / hz(i), size, weight(i)))
            .collect();
        let spectrum = Spectrum::new(vec![1.0; size]);
        let bank = Bank { first: number * BINS_PER_OCTAVE, spectrum, kernels, frame: 0 };
        Octave { frames: Frames::new(size, hop), bank }
    }

    fn push(&mut self, samples: &[f32], bins: Bins) {
        self.frames.push(samples, &mut |x| self.bank.emit(x, bins));
    }
}

impl Bank {
    fn emit(&mut self, frame: &[f32], bins: Bins) {
        self.spectrum.transform(frame);
        for (i, kernel) in self.kernels.iter().enumerate() {
            let of = &self.spectrum.bins[kernel.from..];
            let sum: Complex<f32> = kernel.spectrum.iter().zip(of).map(|(k, x)| k * x).sum();
            bins(self.frame, self.first + i, sum.norm());
        }
        self.frame += 1;
    }
}

impl Kernel {
    /// A tone of `turns` cycles a sample under a Hann window of `length` samples, centred in `size` samples.
    fn new(turns: f64, length: f64, size: usize, weight: f64) -> Kernel {
        // as librosa rounds it, so that the windows are the same samples
        let (start, end) = ((-length / 2.0).floor(), (length / 2.0).floor());
        let n = (end - start) as usize;
        let window: Vec<f64> = (0..n).map(|i| 0.5 - 0.5 * (TAU * i as f64 / n as f64).cos()).collect();
        let total: f64 = window.iter().sum();
        let lead = (size - n) / 2;
        let mut whole = vec![Complex::new(0.0f64, 0.0); size];
        for (i, w) in window.iter().enumerate() {
            let turn = TAU * turns * (start + i as f64);
            // / size: the product of two spectra is `size` times that of the signals (Parseval)
            whole[lead + i] = Complex::from_polar(weight * w / total / size as f64, turn);
        }
        forward(&mut whole);
        let all: Vec<Complex<f32>> =
            // conjugate, as in a scalar product with the tone; a tone has nothing above half the rate
            whole[..=size / 2].iter().map(|c| Complex::new(c.re as f32, -c.im as f32)).collect();
        let least = NEGLIGIBLE * all.iter().map(|c| c.norm()).fold(0.0, f32::max);
        let from = all.iter().position(|c| c.norm() > least).unwrap_or(0);
        let to = all.iter().rposition(|c| c.norm() > least).map_or(from, |last| last + 1);
        Kernel { from, spectrum: all[from..to].to_vec() }
    }
}

/// The Fourier transform of complex numbers, from those of their real and imaginary parts.
fn forward(x: &mut [Complex<f64>]) {
    let n = x.len();
    let plan = realfft::RealFftPlanner::<f64>::new().plan_fft_forward(n);
    let part = |of: &dyn Fn(&Complex<f64>) -> f64| {
        let mut input: Vec<f64> = x.iter().map(of).collect();
        let mut output = plan.make_output_vec();
        plan.process(&mut input, &mut output).expect("the plan has this length");
        output
    };
    let (re, im) = (part(&|c| c.re), part(&|c| c.im));
    for (k, to) in x.iter_mut().enumerate() {
        let at = |half: &[Complex<f64>]| -> Complex<f64> { if k <= n / 2 { half[k] } else { half[n - k].conj() } };
        *to = at(&re) + Complex::<f64>::i() * at(&im);
    }
}

/// Halves the rate, after a low pass without delay.
struct Halving {
    taps: Vec<f32>,
    waiting: Vec<f32>,
}

/// Half the length of the low pass. Its transition is from 0.92 to 1.08 of half the lower rate; it stops 100 dB.
const REACH: usize = 80;

impl Halving {
    fn new() -> Halving {
        let tap = |i: usize| {
            let t = i as f64 - REACH as f64;
            // sin(pi t / 2) / (pi t) at its limit
            let sinc = if t == 0.0 { 0.5 } else { (PI * t / 2.0).sin() / (PI * t) };
            // the four-term Blackman-Harris window
            let u = TAU * i as f64 / (2 * REACH) as f64;
            let window = 0.35875 - 0.48829 * u.cos() + 0.14128 * (2.0 * u).cos() - 0.01168 * (3.0 * u).cos();
            (sinc * window) as f32
        };
        // zeros before the first sample, so that output 0 is centred on it: the filter has no delay
        Halving { taps: (0..=2 * REACH).map(tap).collect(), waiting: vec![0.0; REACH] }
    }

    fn push(&mut self, samples: &[f32]) -> Vec<f32> {
        self.waiting.extend_from_slice(samples);
        let (mut out, mut at) = (Vec::new(), 0);
        while self.waiting.len() - at > 2 * REACH {
            out.push(self.taps.iter().zip(&self.waiting[at..]).map(|(h, x)| h * x).sum());
            at += 2;
        }
        self.waiting.drain(..at);
        out
    }

    fn finish(&mut self) -> Vec<f32> {
        self.push(&[0.0; REACH])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_the_rate_keeps_what_it_can_hold() {
        let tone = |hz: f64, rate: f64, n: usize| -> Vec<f32> {
            (0..n).map(|i| (TAU * hz * i as f64 / rate).sin() as f32).collect()
        };
        for n in [1000, 1001] {
            let mut h = Halving::new();
            let mut y: Vec<f32> = tone(100.0, 1000.0, n).chunks(37).flat_map(|b| h.push(b)).collect();
            y.extend(h.finish());
            assert_eq!(y.len(), n.div_ceil(2));
            let wanted = tone(100.0, 500.0, y.len());
            let worst = (50..450).map(|i| (y[i] - wanted[i]).abs()).fold(0.0, f32::max);
            assert!(worst < 1e-4, "{worst}");
        }
        let mut h = Halving::new();
        let y = h.push(&tone(300.0, 1000.0, 1000));
        assert!(y[50..400].iter().all(|x| x.abs() < 1e-4));
    }

    #[test]
    fn a_tone_has_its_bin_and_its_level() {
        let rate = 15_360;
        for bin in [40usize, 111, 200, 240] {
            let hz = LOWEST_HZ * 2f64.powf(bin as f64 / 36.0);
            let x: Vec<f32> = (0..3 * rate).map(|i| (TAU * hz * f64::from(i) / f64::from(rate)).sin() as f32).collect();
            let mut q = ConstantQ::new(rate as u32, 512, 0.0);
            let mut found = vec![0.0f32; OCTAVES * BINS_PER_OCTAVE];
            let mut keep = |frame: usize, bin: usize, magnitude: f32| {
                if frame == 45 {
                    found[bin] = magnitude;
                }
            };
            q.push(&x, &mut keep);
            q.finish(&mut keep);
            let best = (0..found.len()).max_by(|a, b| found[*a].total_cmp(&found[*b])).unwrap();
            assert_eq!(best, bin);
            // half the amplitude, by the root of the window's length
            let wanted = 0.5 * (51.9 * f64::from(rate) / hz).sqrt();
            assert!((f64::from(found[bin]) / wanted - 1.0).abs() < 0.01, "{} of {wanted}", found[bin]);
        }
    }

    #[test]
    #[should_panic(expected = "8000 samples per second hold no octave")]
    fn a_low_rate_has_no_highest_octave() {
        ConstantQ::new(8_000, 512, 0.0);
    }

    #[test]
    #[should_panic(expected = "a frame every 500 samples")]
    fn a_hop_is_halved_six_times() {
        ConstantQ::new(15_360, 500, 0.0);
    }
}
