//! Windows and spectra of a stream of samples.

use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::sync::Arc;

/// The periodic Hann window: `0.5 - 0.5 cos(2 pi i / n)`.
pub(crate) fn hann(n: usize) -> Vec<f32> {
    (0..n).map(|i| (0.5 - 0.5 * (TAU * i as f64 / n as f64).cos()) as f32).collect()
}

/// Windows of `size` samples every `hop`, frame `f` centred at sample `f hop`, with silence before and after the sound.
///
/// n samples give `1 + n / hop` frames, as librosa's centred transform with zero padding does.
///
/// ```
/// let (mut frames, mut count) = (kinelm_music::frames::Frames::new(8, 4), 0);
/// frames.push(&[1.0; 10], &mut |window| count += usize::from(window.len() == 8));
/// frames.finish(&mut |_| count += 1);
/// assert_eq!(count, 1 + 10 / 4);
/// ```
pub struct Frames {
    size: usize,
    hop: usize,
    waiting: VecDeque<f32>,
    /// Frames emitted so far.
    emitted: usize,
    read: usize,
}

impl Frames {
    /// No samples yet.
    ///
    /// # Panics
    /// When `size` is odd, or `hop` is 0 or more than `size`.
    pub fn new(size: usize, hop: usize) -> Frames {
        assert!(size.is_multiple_of(2) && (1..=size).contains(&hop), "windows of {size} every {hop}");
        Frames { size, hop, waiting: VecDeque::from(vec![0.0; size / 2]), emitted: 0, read: 0 }
    }

    /// Takes samples; calls `frame` with each complete window.
    pub fn push(&mut self, samples: &[f32], frame: &mut dyn FnMut(&[f32])) {
        self.read += samples.len();
        self.waiting.extend(samples);
        while self.waiting.len() >= self.size {
            self.emit(frame);
        }
    }

    /// Calls `frame` with the windows that reach beyond the end.
    pub fn finish(&mut self, frame: &mut dyn FnMut(&[f32])) {
        let total = 1 + self.read / self.hop;
        // for the last window, and the hop that `emit` takes off after it
        let missing = ((total - self.emitted) * self.hop + self.size).saturating_sub(self.waiting.len());
        self.waiting.extend(std::iter::repeat_n(0.0, missing));
        while self.emitted < total {
            self.emit(frame);
        }
    }

    fn emit(&mut self, frame: &mut dyn FnMut(&[f32])) {
        frame(&self.waiting.make_contiguous()[..self.size]);
        self.emitted += 1;
        // hop <= size, so there is that much
        self.waiting.drain(..self.hop);
    }
}

/// The windowed Fourier transform of frames.
pub struct Spectrum {
    window: Vec<f32>,
    fft: Arc<dyn RealToComplex<f32>>,
    input: Vec<f32>,
    scratch: Vec<Complex<f32>>,
    /// Bins 0 to size / 2 of the last frame.
    pub bins: Vec<Complex<f32>>,
}

impl Spectrum {
    /// For frames of the window's length.
    pub fn new(window: Vec<f32>) -> Spectrum {
        let fft = RealFftPlanner::new().plan_fft_forward(window.len());
        Spectrum {
            input: fft.make_input_vec(),
            scratch: fft.make_scratch_vec(),
            bins: fft.make_output_vec(),
            fft,
            window,
        }
    }

    /// Fills [`Spectrum::bins`] with the transform of the windowed frame, not normalised.
    ///
    /// # Panics
    /// When the frame has another length than the window.
    pub fn transform(&mut self, frame: &[f32]) {
        assert_eq!(frame.len(), self.window.len(), "samples of a frame");
        for ((to, x), w) in self.input.iter_mut().zip(frame).zip(&self.window) {
            *to = x * w;
        }
        let done = self.fft.process_with_scratch(&mut self.input, &mut self.bins, &mut self.scratch);
        done.expect("the plan made these buffers");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_centred_however_samples_come() {
        let x: Vec<f32> = (1..=103).map(|i| i as f32).collect();
        for (size, hop) in [(16, 4), (16, 10), (8, 8)] {
            let wanted: Vec<Vec<f32>> = (0..1 + x.len() / hop)
                .map(|f| {
                    let at = |i: usize| (f * hop + i).checked_sub(size / 2).and_then(|i| x.get(i)).copied();
                    (0..size).map(|i| at(i).unwrap_or(0.0)).collect()
                })
                .collect();
            for block in [1, 7, 200] {
                let (mut frames, mut found) = (Frames::new(size, hop), Vec::new());
                let mut keep = |f: &[f32]| found.push(f.to_vec());
                x.chunks(block).for_each(|b| frames.push(b, &mut keep));
                frames.finish(&mut keep);
                assert_eq!(found, wanted, "{size} every {hop}, blocks of {block}");
            }
        }
    }

    #[test]
    fn a_transform_as_its_definition() {
        let x: Vec<f32> = (0..32).map(|i| ((i * i) as f32 * 0.37).sin()).collect();
        let mut s = Spectrum::new(hann(32));
        s.transform(&x);
        for (k, bin) in s.bins.iter().enumerate() {
            let (mut re, mut im) = (0.0, 0.0);
            for (i, (x, w)) in x.iter().zip(hann(32)).enumerate() {
                let turn = -TAU * (k * i) as f64 / 32.0;
                re += f64::from(x * w) * turn.cos();
                im += f64::from(x * w) * turn.sin();
            }
            assert!((f64::from(bin.re) - re).abs() < 1e-5 && (f64::from(bin.im) - im).abs() < 1e-5, "bin {k}");
        }
    }
}
