//! Beats of music, as a listener would tap them.
//!
//! Stages: `flux` (change per band), `tempogram` (tempo over time), `pulse` (dynamic programming through the flux),
//! `level` (which multiple and phase of the pulse is the beat).
//!
//! Limits: no downbeats and no metre. Any sound whose flux isn't constant gets a pulse, through pauses too. The usual
//! errors are half and double tempo and the off-beat; weights and measurements are of pieces mostly with drums
//! (docs/results/music.md).
//!
//! ```
//! use kinelm_music::beat::{RATE, beats_of};
//! use kinelm_music::synth::{Score, Style, render};
//!
//! let beats_s = (0..40).map(|i| 0.5 * f64::from(i)).collect();
//! let score = Score { style: Style::Pop, beats_s, downbeat: 0, seconds: 20.0, seed: 1 };
//! let found = beats_of(&render(&score, RATE)?);
//! assert!(found.bpm().is_some_and(|bpm| (bpm - 120.0).abs() < 2.0));
//! # Ok::<(), kinelm_music::Error>(())
//! ```

mod flux;
mod level;
mod pulse;
mod tempogram;
mod weights;

use crate::Result;
use crate::read::decode_at;
use flux::{Flux, RISES};
use std::path::Path;

/// Samples per second at which beats are tracked.
pub const RATE: u32 = 22_050;
/// Samples from a frame to the next.
pub const HOP: usize = 256;
/// Frames per second.
pub const FPS: f64 = RATE as f64 / HOP as f64;
/// Seconds by which flux is late: half a window and half a lag, less the lead of a Hann window. Measured on the pieces that the
/// tracker was developed with.
const LATE_S: f64 = 0.005;
/// Beats over which a tempo is measured.
const TEMPO_BEATS: usize = 8;

/// The beats of a sound and its tempo.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Beats {
    /// Seconds, rising, not below 0; none in silence.
    pub times_s: Vec<f64>,
    /// Length of the sound, seconds.
    pub seconds: f64,
    /// The tempi at which the pulse can be counted, the most likely first; their probabilities sum to 1. Empty when no pulse
    /// was found or the beats are not of a sound.
    pub tempi: Vec<Tempo>,
}

/// A candidate tempo: listeners, too, tap some pieces at half or double the rate of others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tempo {
    /// Beats a minute.
    pub bpm: f64,
    /// Its probability, 0 to 1.
    pub odds: f64,
}

/// A range of tempi, beats a minute.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TempoRange {
    /// At least.
    pub least: f64,
    /// At most.
    pub most: f64,
}

impl TempoRange {
    /// Octaves by which a tempo is outside the range; 0 inside, and within rounding of it.
    fn octaves_off(self, bpm: f64) -> f64 {
        let off = (self.least / bpm).log2().max((bpm / self.most).log2());
        // 2 %, about the error of a measured tempo
        if off < 0.03 { 0.0 } else { off }
    }
}

impl Beats {
    /// Beats a minute: the median of [`Beats::tempi_bpm`]. `None` for fewer than two beats.
    pub fn bpm(&self) -> Option<f64> {
        median(&mut self.tempi_bpm()).filter(|bpm| *bpm > 0.0)
    }

    /// Beats a minute around each beat, over up to eight intervals; 0 for a single beat.
    pub fn tempi_bpm(&self) -> Vec<f64> {
        let (times, last) = (&self.times_s, self.times_s.len().saturating_sub(1));
        let around = |i: usize| {
            // at both ends the eight intervals are those nearest, not fewer
            let from = i.saturating_sub(TEMPO_BEATS / 2).min(last.saturating_sub(TEMPO_BEATS));
            let to = (from + TEMPO_BEATS).min(last);
            if to > from { 60.0 * (to - from) as f64 / (times[to] - times[from]) } else { 0.0 }
        };
        (0..times.len()).map(around).collect()
    }
}

/// The median; of an even number the mean of the middle two.
fn median(all: &mut [f64]) -> Option<f64> {
    all.sort_by(f64::total_cmp);
    let n = all.len();
    (n > 0).then(|| 0.5 * (all[(n - 1) / 2] + all[n / 2]))
}

/// Tracks the beats of a stream of samples.
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
    /// No samples yet.
    pub fn new() -> Tracker {
        Tracker { flux: Flux::new(), samples: 0, range: None }
    }

    /// A tracker that counts beats within a range of tempi.
    pub fn within(range: Option<TempoRange>) -> Tracker {
        Tracker { range, ..Tracker::new() }
    }

    /// Takes samples at [`RATE`].
    pub fn push(&mut self, samples: &[f32]) {
        self.samples += samples.len() as u64;
        self.flux.push(samples);
    }

    /// The beats.
    pub fn finish(self) -> Beats {
        let seconds = self.samples as f64 / f64::from(RATE);
        let series = self.flux.finish();
        let sum = |f: usize| series[..RISES].iter().map(|s| s[f]).sum::<f32>() / RISES as f32;
        let change: Vec<f32> = (0..series[0].len()).map(sum).collect();
        let periods = tempogram::periods(&change);
        let (found, tempi) = level::beats(&series, &pulse::pulse(&change, &periods), self.range);
        let audible = audible(&change, &found);
        // a beat in the first 5 ms is at 0
        let time = |frame: &f64| (frame / FPS - LATE_S).max(0.0);
        Beats { times_s: found[audible].iter().map(time).filter(|t| *t <= seconds).collect(), seconds, tempi }
    }
}

/// The beats from the first change to the last, without those in silence at the ends.
fn audible(change: &[f32], beats: &[f64]) -> std::ops::Range<usize> {
    let loud = 0.05 * change.iter().copied().fold(0.0, f32::max);
    let first = change.iter().position(|x| *x > loud).unwrap_or(0) as f64;
    let last = change.iter().rposition(|x| *x > loud).unwrap_or(0) as f64;
    // a beat may be slightly off the change that it marks
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
    decode_at(
        path,
        &mut [(RATE, &mut |samples: &[f32]| {
            tracker.push(samples);
            Ok(())
        })],
    )?;
    Ok(tracker.finish())
}

/// The beats of samples at [`RATE`].
pub fn beats_of(samples: &[f32]) -> Beats {
    let mut tracker = Tracker::new();
    tracker.push(samples);
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
        let beats = beats_of(&clicks(&truth, 60.0));
        let (n, tempi) = (beats.times_s.len(), beats.tempi_bpm());
        // 95 %: the tempo jumps, and the tracker may miss beats around it
        assert!(hits(&beats.times_s, &truth) * 20 > truth.len() * 19 && n.abs_diff(truth.len()) < 4, "{n}: {beats:?}");
        assert!((tempi[n / 5] - 100.0).abs() < 1.0 && (tempi[n * 4 / 5] - 126.0).abs() < 1.0, "{tempi:?}");
        assert!((beats.seconds - 60.0).abs() < 1e-9);
    }

    #[test]
    fn silence_has_no_beats_and_neither_has_a_moment() {
        for x in [vec![], vec![0.0; 10], vec![0.0; 500_000], vec![0.5; 10]] {
            let beats = beats_of(&x);
            assert!(beats.times_s.len() <= 1 && beats.bpm().is_none(), "{} samples: {beats:?}", x.len());
        }
    }
}
