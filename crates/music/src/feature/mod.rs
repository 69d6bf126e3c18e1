//! Music features, 35 numbers a frame: onset strength, 20 cepstral coefficients, 12 pitch classes, onset peaks, beats.
//!
//! A frame begins every 512 samples, so features at s frames per second come from the sound at 512 s samples per
//! second.
//!
//! Source: Li et al., "AI Choreographer" (2021), with librosa's functions; EDGE and Lodge use the same at 30 frames per
//! second. Theirs start the beat tracker at the tempo in the name of AIST's file; here it is detected.
//!
//! ```
//! use kinelm_music::feature::{CHANNELS, STRENGTH, features_of, rate_of};
//!
//! let rate = rate_of(30.0)? as usize;
//! let click: Vec<f32> = (0..2 * rate).map(|i| if i / 100 == rate / 100 { 1.0 } else { 0.0 }).collect();
//! let features = features_of(&click, 30.0)?;
//! assert_eq!((features.frames(), features.numbers.len()), (61, 61 * CHANNELS));
//! let strength = |frame: usize| features.numbers[frame * CHANNELS + STRENGTH];
//! let onset = (0..61).max_by(|a, b| strength(*a).total_cmp(&strength(*b))).unwrap();
//! assert!((28..=34).contains(&onset), "the click is at 1 s, frame 30");
//! # Ok::<(), kinelm_music::Error>(())
//! ```

mod chroma;
mod cqt;
mod mel;
mod onset;
mod tuning;

use crate::beat::{Beats, Tracker};
use crate::frames::{Frames, Spectrum, hann};
use crate::read::decode_at;
use crate::{Error, Result};
use chroma::{CLASSES, Cens};
use mel::{BANDS, Bank, Cosines};
use std::ops::Range;
use std::path::Path;
use tuning::Tuning;

/// Samples from one frame to the next.
pub const HOP: usize = 512;
/// Samples of a frame's window.
pub const WINDOW: usize = 2048;
/// Numbers of a frame.
pub const CHANNELS: usize = 35;
/// The onset strength: the mean rise over bands, decibels.
pub const STRENGTH: usize = 0;
/// The cepstral coefficients.
pub const CEPSTRUM: Range<usize> = 1..21;
/// The pitch classes, C first.
pub const CHROMA: Range<usize> = 21..33;
/// 1 in the frame of an onset, else 0.
pub const PEAK: usize = 33;
/// 1 in the frame nearest to a beat, else 0.
pub(crate) const BEAT: usize = 34;
/// Bands this many decibels below the loudest one count as silent.
const DYNAMIC_RANGE: f32 = 80.0;
/// Lowest and highest rate, frames per second.
const FPS: std::ops::RangeInclusive<f64> = 17.0..=240.0; // 17 * 512 = 8,704 Hz just hold the highest octave of `cqt`

/// The 35 numbers of each frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    /// Frames per second.
    pub fps: f64,
    /// (F, 35): [`STRENGTH`], [`CEPSTRUM`], [`CHROMA`], [`PEAK`], `BEAT`.
    pub numbers: Vec<f32>,
    /// The beats and the tempo.
    pub beats: Beats,
}

impl Features {
    /// Frames.
    pub fn frames(&self) -> usize {
        self.numbers.len() / CHANNELS
    }
}

/// The samples per second that features at `fps` frames per second are computed from.
///
/// # Errors
/// `fps` outside 17 to 240, or 512 times it not whole: [`kinelm_store::Error::Invalid`].
pub fn rate_of(fps: f64) -> Result<u32> {
    let rate = fps * HOP as f64;
    if !FPS.contains(&fps) || rate.fract() != 0.0 {
        let expected = "17 to 240, and 512 times it a whole number (take 30 for 29.97)";
        return Err(Error::invalid("the frame rate of music features", fps, expected));
    }
    Ok(rate as u32)
}

/// The features of a file; it is read twice.
///
/// # Errors
/// Those of [`rate_of`] and of reading.
pub fn features(path: &Path, fps: f64) -> Result<Features> {
    let rate = rate_of(fps)?;
    // twice, since the floor and the tuning of the whole sound decide each frame, and a sound may be too long to hold
    let (mut first, mut tracker) = (FirstPass::new(rate), Tracker::new());
    let mut measure = |samples: &[f32]| {
        first.take(Some(samples));
        Ok(())
    };
    let mut track = |samples: &[f32]| {
        tracker.push(samples);
        Ok(())
    };
    decode_at(path, &mut [(rate, &mut measure), (crate::beat::RATE, &mut track)])?;
    let mut second = SecondPass::new(rate, &first.finish());
    let mut push = |samples: &[f32]| {
        second.push(samples);
        Ok(())
    };
    decode_at(path, &mut [(rate, &mut push)])?;
    Ok(second.finish(fps, tracker.finish()))
}

/// The features of samples at [`rate_of`] `fps`.
///
/// # Errors
/// Those of [`rate_of`].
pub fn features_of(samples: &[f32], fps: f64) -> Result<Features> {
    let rate = rate_of(fps)?;
    let mut first = FirstPass::new(rate);
    first.take(Some(samples));
    let mut second = SecondPass::new(rate, &first.finish());
    second.push(samples);
    let beats = crate::beat::beats_of(&crate::resample::resample(samples, rate, crate::beat::RATE)?);
    Ok(second.finish(fps, beats))
}

/// Properties of the whole sound that each frame's features depend on.
struct Calibration {
    /// Decibels below which bands are silent.
    floor: f32,
    /// In bins of the constant-Q transform.
    tuning: f64,
}

/// Power spectra and mel bands of frames.
struct BandSpectra {
    frames: Frames,
    spectrum: Spectrum,
    bank: Bank,
}

impl BandSpectra {
    fn new(rate: u32) -> BandSpectra {
        let spectrum = Spectrum::new(hann(WINDOW));
        BandSpectra { frames: Frames::new(WINDOW, HOP), spectrum, bank: Bank::new(WINDOW, rate) }
    }

    /// Takes samples, or the end of the sound; calls `each` with each frame's power and its bands in decibels.
    fn take(&mut self, samples: Option<&[f32]>, each: &mut dyn FnMut(&mut [f32], &[f32; BANDS])) {
        let (spectrum, bank) = (&mut self.spectrum, &self.bank);
        let (mut power, mut bands) = (vec![0.0; WINDOW / 2 + 1], [0.0; BANDS]);
        let mut frame = |x: &[f32]| {
            spectrum.transform(x);
            power.iter_mut().zip(&spectrum.bins).for_each(|(to, bin)| *to = bin.norm_sqr());
            bank.decibels(&power, &mut bands);
            each(&mut power, &bands);
        };
        match samples {
            Some(samples) => self.frames.push(samples, &mut frame),
            None => self.frames.finish(&mut frame),
        }
    }
}

/// The first pass over the sound, which calibrates the second.
struct FirstPass {
    spectra: BandSpectra,
    loudest: f32,
    tuning: Tuning,
}

impl FirstPass {
    fn new(rate: u32) -> FirstPass {
        FirstPass { spectra: BandSpectra::new(rate), loudest: f32::NEG_INFINITY, tuning: Tuning::new(WINDOW, rate) }
    }

    /// Takes samples, or the end of the sound.
    fn take(&mut self, samples: Option<&[f32]>) {
        let (loudest, tuning) = (&mut self.loudest, &mut self.tuning);
        self.spectra.take(samples, &mut |power, bands| {
            *loudest = bands.iter().copied().fold(*loudest, f32::max);
            // in place: nothing reads the power after the bands
            power.iter_mut().for_each(|p| *p = p.sqrt());
            tuning.take(power);
        });
    }

    fn finish(mut self) -> Calibration {
        self.take(None);
        Calibration { floor: self.loudest - DYNAMIC_RANGE, tuning: self.tuning.estimate() }
    }
}

/// The second pass, which computes the features.
struct SecondPass {
    spectra: BandSpectra,
    cens: Cens,
    rate: u32,
    floor: f32,
    cosines: Cosines,
    before: Option<[f32; BANDS]>,
    rises: Vec<f32>,
    /// (F, 20)
    cepstra: Vec<f32>,
}

impl SecondPass {
    fn new(rate: u32, calibration: &Calibration) -> SecondPass {
        SecondPass {
            spectra: BandSpectra::new(rate),
            cens: Cens::new(rate, HOP, calibration.tuning),
            rate,
            floor: calibration.floor,
            cosines: Cosines::new(CEPSTRUM.len()),
            before: None,
            rises: Vec::new(),
            cepstra: Vec::new(),
        }
    }

    fn push(&mut self, samples: &[f32]) {
        self.cens.push(samples);
        self.take(Some(samples));
    }

    /// Takes samples, or the end of the sound.
    fn take(&mut self, samples: Option<&[f32]>) {
        let (before, floor) = (&mut self.before, self.floor);
        let (cosines, rises, cepstra) = (&self.cosines, &mut self.rises, &mut self.cepstra);
        self.spectra.take(samples, &mut |_, bands| {
            // one less than frames: the first has no frame before it
            rises.extend(before.as_ref().map(|before| onset::rise(before, bands, floor)));
            cepstra.extend(cosines.of(bands, floor));
            *before = Some(*bands);
        });
    }

    fn finish(mut self, fps: f64, beats: Beats) -> Features {
        self.take(None);
        let frames = self.cepstra.len() / CEPSTRUM.len();
        let strength = onset::strength(&self.rises, frames);
        let chroma = self.cens.finish(frames);
        let mut numbers = vec![0.0; frames * CHANNELS];
        for (f, row) in numbers.chunks_exact_mut(CHANNELS).enumerate() {
            row[STRENGTH] = strength[f];
            row[CEPSTRUM].copy_from_slice(&self.cepstra[f * CEPSTRUM.len()..][..CEPSTRUM.len()]);
            row[CHROMA].copy_from_slice(&chroma[f][..CLASSES]);
        }
        for f in onset::peaks(&strength, self.rate) {
            numbers[f * CHANNELS + PEAK] = 1.0;
        }
        for time in &beats.times_s {
            let f = (time * fps).round() as usize;
            // a beat in the last half frame rounds to one beyond the end
            if let Some(x) = numbers.get_mut(f * CHANNELS + BEAT) {
                *x = 1.0;
            }
        }
        Features { fps, numbers, beats }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_features_at_the_lowest_rate_the_highest_and_the_models_own() {
        for fps in [17.0, 20.0, 24.0, 30.0, 60.0, 240.0] {
            let rate = rate_of(fps).unwrap();
            let beat = |i: u32| (i % (rate / 2)) as f32 / rate as f32;
            let sound: Vec<f32> = (0..4 * rate)
                .map(|i| (-30.0 * beat(i)).exp() * (1.0 + (i as f32 * 880.0 / rate as f32).sin()))
                .collect();
            let found = features_of(&sound, fps).unwrap();
            assert_eq!(found.frames(), 1 + (4.0 * fps) as usize, "{fps}");
            assert!(found.numbers.iter().all(|x| x.is_finite()));
            let strength = |f: usize| found.numbers[f * CHANNELS + STRENGTH];
            let peaks = (0..found.frames()).filter(|f| found.numbers[f * CHANNELS + PEAK] == 1.0).count();
            // 8 beats in 4 s, give or take the ends
            assert!((5..=9).contains(&peaks), "{fps}: {peaks} peaks");
            // strongest at a beat, half a window late at most
            let best = (1..found.frames() / 2).max_by(|a, b| strength(*a).total_cmp(&strength(*b))).unwrap();
            let off = (best as f64 / fps) % 0.5;
            assert!(off.min(0.5 - off) <= 1.0 / fps + 0.5 * WINDOW as f64 / f64::from(rate), "{fps}: {best}");
        }
        for fps in [16.9, 240.1, 29.97] {
            assert!(rate_of(fps).is_err(), "{fps}");
        }
    }
}
