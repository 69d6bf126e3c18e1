//! What music sounds like, as 35 numbers a frame: onset strength, 20 cepstral coefficients, 12 pitch classes, onset
//! peaks, beats.
//!
//! Frames are 512 samples apart, so of s frames per second the sound is heard at 512 s samples per second.
//!
//! Source: Li et al., "AI Choreographer" (2021), with librosa's functions; EDGE and Lodge have the same at 30 frames per
//! second. Theirs start the beat tracker at the tempo in the name of AIST's file; here it has to hear it.

pub mod chroma;
pub mod cqt;
pub mod mel;
pub mod onset;
pub mod tuning;

use crate::beat::{Beats, Tracker};
use crate::frames::{Frames, Spectrum, hann};
use crate::read::decode_at;
use crate::{Error, Result};
use chroma::{CLASSES, Cens};
use mel::{BANDS, Bank, Cosines};
use std::ops::Range;
use std::path::Path;
use tuning::Tuning;

/// Samples from a frame to the next.
pub const HOP: usize = 512;
/// Samples of a frame's window.
pub const WINDOW: usize = 2048;
/// Numbers of a frame.
pub const CHANNELS: usize = 35;
/// The onset strength, decibels of rise in the mean over bands.
pub const STRENGTH: usize = 0;
/// The cepstral coefficients.
pub const CEPSTRUM: Range<usize> = 1..21;
/// The pitch classes, C first.
pub const CHROMA: Range<usize> = 21..33;
/// 1 in a frame of an onset, else 0.
pub const PEAK: usize = 33;
/// 1 in the frame nearest to a beat, else 0.
pub const BEAT: usize = 34;
/// Decibels below the loudest band at which a band is silent.
const DEEP: f32 = 80.0;
/// Lowest and highest rate, frames per second.
const FPS: std::ops::RangeInclusive<f64> = 17.0..=240.0;

/// The 35 numbers of each frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    /// Frames per second.
    pub fps: f64,
    /// (F, 35): [`STRENGTH`], [`CEPSTRUM`], [`CHROMA`], [`PEAK`], [`BEAT`].
    pub numbers: Vec<f32>,
    /// The beats that stand in them, and the tempo.
    pub beats: Beats,
}

impl Features {
    /// Frames.
    pub fn frames(&self) -> usize {
        self.numbers.len() / CHANNELS
    }
}

/// The samples per second at which features of this rate are heard.
///
/// # Errors
/// [`Error::Call`] outside 17 to 240 frames per second, or where 512 times the rate is no whole number.
pub fn rate_of(fps: f64) -> Result<u32> {
    let rate = fps * HOP as f64;
    if !FPS.contains(&fps) || rate.fract() != 0.0 {
        let what = format!("features of {fps} frames per second; expected 17 to 240, and 512 times it a whole number");
        return Err(Error::Call(format!("{what} (take 30 for 29.97)")));
    }
    Ok(rate as u32)
}

/// The features of a file; it is read twice.
///
/// # Errors
/// Those of [`rate_of`] and of reading.
pub fn features(path: &Path, fps: f64) -> Result<Features> {
    let rate = rate_of(fps)?;
    let (mut first, mut tracker) = (First::new(rate), Tracker::new());
    let mut listen = |samples: &[f32]| first.push(samples);
    let mut follow = |samples: &[f32]| tracker.push(samples);
    decode_at(path, &mut [(rate, &mut listen), (crate::beat::RATE, &mut follow)])?;
    let mut second = Second::new(rate, &first.finish())?;
    decode_at(path, &mut [(rate, &mut |samples: &[f32]| second.push(samples))])?;
    second.finish(fps, tracker.finish()?)
}

/// The features of samples at [`rate_of`] `fps`.
///
/// # Errors
/// Those of [`rate_of`].
pub fn features_of(samples: &[f32], fps: f64) -> Result<Features> {
    let rate = rate_of(fps)?;
    let mut first = First::new(rate);
    first.push(samples)?;
    let mut second = Second::new(rate, &first.finish())?;
    second.push(samples)?;
    let beats = crate::beat::beats_of(&crate::resample::resample(samples, rate, crate::beat::RATE)?)?;
    second.finish(fps, beats)
}

/// What has to be known of the whole sound before a frame of it can be told.
struct Whole {
    /// Decibels below which bands are silent.
    floor: f32,
    /// In bins of the constant-Q transform.
    tuning: f64,
}

/// Spectra of frames: magnitudes, and bands in decibels.
struct Listener {
    frames: Frames,
    spectrum: Spectrum,
    bank: Bank,
}

impl Listener {
    fn new(rate: u32) -> Listener {
        let spectrum = Spectrum::new(hann(WINDOW));
        Listener { frames: Frames::new(WINDOW, HOP), spectrum, bank: Bank::new(WINDOW, rate) }
    }

    /// Hands on each frame's power and bands. Without samples it is the end.
    fn push(&mut self, samples: Option<&[f32]>, each: &mut dyn FnMut(&mut [f32], &[f32; BANDS])) -> Result<()> {
        let (spectrum, bank) = (&mut self.spectrum, &self.bank);
        let (mut power, mut bands, mut done) = (vec![0.0; WINDOW / 2 + 1], [0.0; BANDS], Ok(()));
        let mut frame = |x: &[f32]| {
            if done.is_err() {
                return;
            }
            done = spectrum.take(x);
            power.iter_mut().zip(&spectrum.bins).for_each(|(to, bin)| *to = bin.norm_sqr());
            bank.decibels(&power, &mut bands);
            each(&mut power, &bands);
        };
        match samples {
            Some(samples) => self.frames.push(samples, &mut frame),
            None => self.frames.finish(&mut frame),
        }
        done
    }
}

/// The first hearing.
struct First {
    listener: Listener,
    loudest: f32,
    tuning: Tuning,
}

impl First {
    fn new(rate: u32) -> First {
        First { listener: Listener::new(rate), loudest: f32::NEG_INFINITY, tuning: Tuning::new(WINDOW, rate) }
    }

    fn push(&mut self, samples: &[f32]) -> Result<()> {
        self.hear(Some(samples))
    }

    fn hear(&mut self, samples: Option<&[f32]>) -> Result<()> {
        let (loudest, tuning) = (&mut self.loudest, &mut self.tuning);
        self.listener.push(samples, &mut |power, bands| {
            *loudest = bands.iter().copied().fold(*loudest, f32::max);
            power.iter_mut().for_each(|p| *p = p.sqrt());
            tuning.take(power);
        })
    }

    fn finish(mut self) -> Whole {
        // the frames that reach behind the end; a window of another length can't come
        let _ = self.hear(None);
        Whole { floor: self.loudest - DEEP, tuning: self.tuning.estimate() }
    }
}

/// The second hearing, which tells.
struct Second {
    listener: Listener,
    cens: Cens,
    rate: u32,
    floor: f32,
    cosines: Cosines,
    before: Option<[f32; BANDS]>,
    rises: Vec<f32>,
    /// (F, 20)
    cepstra: Vec<f32>,
}

impl Second {
    fn new(rate: u32, whole: &Whole) -> Result<Second> {
        Ok(Second {
            listener: Listener::new(rate),
            cens: Cens::new(rate, HOP, whole.tuning)?,
            rate,
            floor: whole.floor,
            cosines: Cosines::new(CEPSTRUM.len()),
            before: None,
            rises: Vec::new(),
            cepstra: Vec::new(),
        })
    }

    fn push(&mut self, samples: &[f32]) -> Result<()> {
        self.cens.push(samples)?;
        self.hear(Some(samples))
    }

    fn hear(&mut self, samples: Option<&[f32]>) -> Result<()> {
        let (before, floor) = (&mut self.before, self.floor);
        let (cosines, rises, cepstra) = (&self.cosines, &mut self.rises, &mut self.cepstra);
        self.listener.push(samples, &mut |_, bands| {
            rises.extend(before.as_ref().map(|before| onset::rise(before, bands, floor)));
            cepstra.extend(cosines.of(bands, floor));
            *before = Some(*bands);
        })
    }

    fn finish(mut self, fps: f64, beats: Beats) -> Result<Features> {
        self.hear(None)?;
        let frames = self.cepstra.len() / CEPSTRUM.len();
        let strength = onset::strength(&self.rises, frames);
        let chroma = self.cens.finish(frames)?;
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
            if let Some(x) = numbers.get_mut(f * CHANNELS + BEAT) {
                *x = 1.0;
            }
        }
        Ok(Features { fps, numbers, beats })
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
            assert!((5..=9).contains(&peaks), "{fps}: {peaks} peaks");
            // loudest where it begins anew, half a window late at most
            let best = (1..found.frames() / 2).max_by(|a, b| strength(*a).total_cmp(&strength(*b))).unwrap();
            let off = (best as f64 / fps) % 0.5;
            assert!(off.min(0.5 - off) <= 1.0 / fps + 0.5 * WINDOW as f64 / f64::from(rate), "{fps}: {best}");
        }
        for fps in [16.9, 240.1, 29.97] {
            assert!(rate_of(fps).is_err(), "{fps}");
        }
    }
}
