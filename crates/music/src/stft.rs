//! The spectrogram of the music-to-dance dissertation: 6 columns of 1,025 numbers a frame.

use crate::frames::{Spectrum, hann};
use crate::read::decode_at;
use crate::{Error, Result};
use std::path::Path;

/// Samples per second.
pub const RATE: u32 = 16_000;
/// Bins of a column.
pub const BINS: usize = 1025;
/// Columns of a frame.
pub const COLUMNS: usize = 6;
const WINDOW: usize = 2048;
const HOP: usize = 200;
/// Samples of the dissertation's excerpt for a frame: two frames at 30 a second. *Derived*: one frame's 533 samples would give
/// three columns, not six.
const EXCERPT: usize = 1067;

/// The samples of a frame's columns, and their scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// As printed: 1,067 samples from the frame's time on, mirrored at both ends to fill the windows; magnitudes.
    Compat,
    /// Six windows, one every 12.5 ms, around the frame's time, out of the whole sound; `ln(1 + 100 m)`.
    Fixed,
}

/// Computes the (6, 1025) numbers of each frame of a stream of samples.
pub struct Stft {
    form: Form,
    fps: f64,
    spectrum: Spectrum,
    /// Samples from number `start` on.
    waiting: Vec<f32>,
    start: usize,
    read: usize,
    frame: usize,
    numbers: Vec<f32>,
}

impl Stft {
    /// For motion at `fps` frames per second.
    ///
    /// # Errors
    /// `fps` outside 1 to 1000: [`kinelm_store::Error::Invalid`].
    pub fn new(form: Form, fps: f64) -> Result<Stft> {
        if !(1.0..=1000.0).contains(&fps) {
            return Err(Error::invalid("the frame rate of spectra", fps, "1 to 1000 frames per second"));
        }
        let spectrum = Spectrum::new(hann(WINDOW));
        let numbers = vec![0.0; COLUMNS * BINS];
        Ok(Stft { form, fps, spectrum, waiting: Vec::new(), start: 0, read: 0, frame: 0, numbers })
    }

    /// Takes samples at [`RATE`]; calls `each` with each complete frame.
    ///
    /// # Errors
    /// Those of `each`.
    pub fn push(&mut self, samples: &[f32], each: &mut dyn FnMut(&[f32]) -> Result<()>) -> Result<()> {
        self.waiting.extend_from_slice(samples);
        self.read += samples.len();
        // covers both forms: the last window reaches 500 + 1024 samples ahead, the excerpt 1067
        while self.at() + WINDOW + HOP * COLUMNS <= self.read {
            self.emit(each)?;
        }
        Ok(())
    }

    /// Calls `each` with the remaining frames up to the end, padded with silence. Returns the number of all frames.
    ///
    /// # Errors
    /// Those of `each`.
    pub fn finish(mut self, each: &mut dyn FnMut(&[f32]) -> Result<()>) -> Result<usize> {
        while self.at() < self.read {
            self.emit(each)?;
        }
        Ok(self.frame)
    }

    /// The sample at the next frame's time.
    fn at(&self) -> usize {
        // from the frame's number, not by adding: 533.3 samples a frame would drift
        (self.frame as f64 * f64::from(RATE) / self.fps).round() as usize
    }

    fn sample(&self, i: isize) -> f32 {
        let here = usize::try_from(i).ok().and_then(|i| i.checked_sub(self.start));
        here.and_then(|i| self.waiting.get(i)).copied().unwrap_or(0.0)
    }

    fn emit(&mut self, each: &mut dyn FnMut(&[f32]) -> Result<()>) -> Result<()> {
        let at = self.at() as isize;
        for column in 0..COLUMNS {
            let window: Vec<f32> = match self.form {
                Form::Compat => {
                    let first = (column * HOP) as isize - (WINDOW / 2) as isize;
                    (0..WINDOW as isize).map(|i| self.sample(at + mirrored(first + i))).collect()
                }
                Form::Fixed => {
                    let middle = at + (column * HOP) as isize - ((COLUMNS - 1) * HOP / 2) as isize;
                    let first = middle - (WINDOW / 2) as isize;
                    (0..WINDOW as isize).map(|i| self.sample(first + i)).collect()
                }
            };
            self.spectrum.transform(&window);
            for (to, bin) in self.numbers[column * BINS..].iter_mut().zip(&self.spectrum.bins) {
                let magnitude = bin.norm();
                *to = if self.form == Form::Fixed { (100.0 * magnitude).ln_1p() } else { magnitude };
            }
        }
        each(&self.numbers)?;
        self.frame += 1;
        // `Fixed` looks back 500 + 1024 samples
        let needed = self.at().saturating_sub(WINDOW).min(self.read);
        self.waiting.drain(..needed.saturating_sub(self.start).min(self.waiting.len()));
        self.start = self.start.max(needed);
        Ok(())
    }
}

/// An index into the excerpt, mirrored at its first and last sample.
fn mirrored(i: isize) -> isize {
    let last = EXCERPT as isize - 1;
    let i = i.rem_euclid(2 * last);
    if i > last { 2 * last - i } else { i }
}

/// Calls `each` with the frames of a file, one after the other; returns their number.
///
/// # Errors
/// Those of [`Stft::new`], of reading and of `each`.
pub fn stft(path: &Path, form: Form, fps: f64, each: &mut dyn FnMut(&[f32]) -> Result<()>) -> Result<usize> {
    let mut stft = Stft::new(form, fps)?;
    decode_at(path, &mut [(RATE, &mut |samples: &[f32]| stft.push(samples, each))])?;
    stft.finish(each)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(form: Form, x: &[f32], block: usize) -> Vec<Vec<f32>> {
        let (mut s, mut out) = (Stft::new(form, 30.0).unwrap(), Vec::new());
        let mut keep = |f: &[f32]| {
            out.push(f.to_vec());
            Ok(())
        };
        x.chunks(block).try_for_each(|b| s.push(b, &mut keep)).unwrap();
        let n = s.finish(&mut keep).unwrap();
        assert_eq!(n, out.len());
        out
    }

    #[test]
    fn blocks_change_nothing_and_each_frame_has_its_time() {
        let x: Vec<f32> = (0..16_000).map(|i| if (8_000..8_100).contains(&i) { 1.0 } else { 0.0 }).collect();
        for form in [Form::Compat, Form::Fixed] {
            let whole = frames(form, &x, 16_000);
            assert_eq!(whole.len(), 30);
            assert_eq!(frames(form, &x, 77), whole);
            let loud = |f: &Vec<f32>| f.iter().sum::<f32>();
            assert!(loud(&whole[0]) == 0.0 && loud(&whole[15]) > 0.0 && loud(&whole[25]) == 0.0);
        }
        assert!(Stft::new(Form::Fixed, 0.0).is_err());
    }

    #[test]
    fn the_ends_are_mirrored() {
        assert_eq!([-1, 0, 1066, 1067, 1068].map(mirrored), [1, 0, 1066, 1065, 1064]);
    }
}
