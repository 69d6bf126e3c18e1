//! Beats of music, as a listener would tap them.
//!
//! The way: [`flux`] (what changes, in bands), [`tempogram`] (how fast it goes, over time), [`pulse`] (dynamic programming
//! through the changes), [`level`] (which multiple and phase of that pulse is the beat).

pub mod flux;
pub mod level;
pub mod pulse;
pub mod tempogram;
mod weights;

use crate::Result;
use crate::read::decode_at;
use flux::{Flux, RISES};
use std::path::Path;

/// Samples per second at which beats are looked for.
pub const RATE: u32 = 22_050;
/// Samples from a frame to the next.
pub const HOP: usize = 256;
/// Frames per second.
pub const FPS: f64 = RATE as f64 / HOP as f64;
/// Seconds by which change is heard late: half a window and half a lag, less what a Hann window hears early. Measured on the
/// pieces that the tracker was made with.
const LATE_S: f64 = 0.005;
/// Beats over which a tempo is taken.
const TEMPO_BEATS: usize = 8;

/// Beats, and how fast they come.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Beats {
    /// Seconds, rising, not below 0; none in silence.
    pub times_s: Vec<f64>,
    /// How long the sound is, seconds.
    pub seconds: f64,
    /// The levels at which its pulse can be counted, the likeliest first; their odds sum to 1. Empty where no pulse was
    /// found, or beats aren't of a sound.
    pub tempi: Vec<Tempo>,
}

/// A tempo that a piece may have: listeners too tap some pieces at half or double another's rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tempo {
    /// Beats a minute.
    pub bpm: f64,
    /// The probability that the tracker gives it, 0 to 1.
    pub odds: f64,
}

/// Beats a minute that are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TempoRange {
    /// At least.
    pub least: f64,
    /// At most.
    pub most: f64,
}

impl TempoRange {
    /// How many octaves a tempo lies outside; 0 within, and within rounding of it.
    fn octaves_off(self, bpm: f64) -> f64 {
        let off = (self.least / bpm).log2().max((bpm / self.most).log2());
        if off < 0.03 { 0.0 } else { off }
    }
}

impl Beats {
    /// Beats a minute: the median of [`Beats::tempi_bpm`]. None where there are fewer than two beats.
    pub fn bpm(&self) -> Option<f64> {
        median(&mut self.tempi_bpm()).filter(|bpm| *bpm > 0.0)
    }

    /// Beats a minute around each beat: of eight steps, of fewer where the piece has fewer; 0 of a single beat.
    pub fn tempi_bpm(&self) -> Vec<f64> {
        let (times, last) = (&self.times_s, self.times_s.len().saturating_sub(1));
        let around = |i: usize| {
            let from = i.saturating_sub(TEMPO_BEATS / 2).min(last.saturating_sub(TEMPO_BEATS));
            let to = (from + TEMPO_BEATS).min(last);
            if to > from { 60.0 * (to - from) as f64 / (times[to] - times[from]) } else { 0.0 }
        };
        (0..times.len()).map(around).collect()
    }
}

fn median(all: &mut [f64]) -> Option<f64> {
    all.sort_by(f64::total_cmp);
    let n = all.len();
    (n > 0).then(|| 0.5 * (all[(n - 1) / 2] + all[n / 2]))
}

/// A listener that is given a sound bit by bit and knows the beats when it ends.
pub struct Tracker {
    flux: Flux,
    samples: u64,
    range: Option<TempoRange>,
}

impl Default for Tracker {
    fn default() -> Self {
        Tracker::new()
    }
}

impl Tracker {
    /// Before the first sample.
    pub fn new() -> Tracker {
        Tracker { flux: Flux::new(), samples: 0, range: None }
    }

    /// The same, which counts beats within a range of tempi.
    pub fn within(range: Option<TempoRange>) -> Tracker {
        Tracker { range, ..Tracker::new() }
    }

    /// Takes samples at [`RATE`].
    ///
    /// # Errors
    /// Those of the transform.
    pub fn push(&mut self, samples: &[f32]) -> Result<()> {
        self.samples += samples.len() as u64;
        self.flux.push(samples)
    }

    /// The beats.
    ///
    /// # Errors
    /// Those of the transform.
    pub fn finish(self) -> Result<Beats> {
        let seconds = self.samples as f64 / f64::from(RATE);
        let series = self.flux.finish()?;
        let sum = |f: usize| series[..RISES].iter().map(|s| s[f]).sum::<f32>() / RISES as f32;
        let change: Vec<f32> = (0..series[0].len()).map(sum).collect();
        let periods = tempogram::periods(&change)?;
        let (found, tempi) = level::beats(&series, &pulse::pulse(&change, &periods), self.range);
        let heard = heard(&change, &found);
        let time = |frame: &f64| (frame / FPS - LATE_S).max(0.0);
        Ok(Beats { times_s: found[heard].iter().map(time).filter(|t| *t <= seconds).collect(), seconds, tempi })
    }
}

/// The beats from the first change to the last, less those of silence at the ends.
fn heard(change: &[f32], beats: &[f64]) -> std::ops::Range<usize> {
    let loud = 0.05 * change.iter().copied().fold(0.0, f32::max);
    let first = change.iter().position(|x| *x > loud).unwrap_or(0) as f64;
    let last = change.iter().rposition(|x| *x > loud).unwrap_or(0) as f64;
    // a beat may fall a little beside what is heard
    let near = 0.1 * FPS;
    let from = beats.partition_point(|b| *b < first - near);
    from..beats.partition_point(|b| *b <= last + near).max(from)
}

/// The beats of a file.
///
/// # Errors
/// Those of reading.
pub fn beats(path: &Path) -> Result<Beats> {
    beats_within(path, None)
}

/// The beats of a file, counted within a range of tempi.
///
/// # Errors
/// Those of reading.
pub fn beats_within(path: &Path, range: Option<TempoRange>) -> Result<Beats> {
    let mut tracker = Tracker::within(range);
    decode_at(path, &mut [(RATE, &mut |samples: &[f32]| tracker.push(samples))])?;
    tracker.finish()
}

/// The beats of samples at [`RATE`].
///
/// # Errors
/// Those of the transform.
pub fn beats_of(samples: &[f32]) -> Result<Beats> {
    let mut tracker = Tracker::new();
    tracker.push(samples)?;
    tracker.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Clicks at these times, each with a low thud.
    fn clicks(times: &[f64], seconds: f64) -> Vec<f32> {
        let mut x = vec![0.0f32; (seconds * f64::from(RATE)) as usize];
        for time in times {
            let start = (time * f64::from(RATE)).round() as usize;
            for (i, to) in x[start..].iter_mut().take(2000).enumerate() {
                let t = i as f64 / f64::from(RATE);
                let thud = (-t / 0.04).exp() * (500.0 * t).sin() + (-t / 0.01).exp() * (9000.0 * t).sin();
                *to += 0.3 * thud as f32;
            }
        }
        x
    }

    fn hits(found: &[f64], truth: &[f64]) -> usize {
        truth.iter().filter(|t| found.iter().any(|f| (f - *t).abs() < 0.025)).count()
    }

    #[test]
    fn clicks_are_beats_also_when_the_tempo_changes() {
        let (mut time, mut truth) = (0.7, Vec::new());
        while time < 58.0 {
            truth.push(time);
            time += if time < 30.0 { 60.0 / 100.0 } else { 60.0 / 126.0 };
        }
        let beats = beats_of(&clicks(&truth, 60.0)).unwrap();
        let (n, tempi) = (beats.times_s.len(), beats.tempi_bpm());
        assert!(hits(&beats.times_s, &truth) * 20 > truth.len() * 19 && n.abs_diff(truth.len()) < 4, "{n}: {beats:?}");
        assert!((tempi[n / 5] - 100.0).abs() < 1.0 && (tempi[n * 4 / 5] - 126.0).abs() < 1.0, "{tempi:?}");
        assert!((beats.seconds - 60.0).abs() < 1e-9);
    }

    #[test]
    fn silence_has_no_beats_and_neither_has_a_moment() {
        for x in [vec![], vec![0.0; 10], vec![0.0; 500_000], vec![0.5; 10]] {
            let beats = beats_of(&x).unwrap();
            assert!(beats.times_s.len() <= 1 && beats.bpm().is_none(), "{} samples: {beats:?}", x.len());
        }
    }
}
