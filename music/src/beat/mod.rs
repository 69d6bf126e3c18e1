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
use crate::read::hear;
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
}

impl Beats {
    /// Beats a minute: the median of the piece. None where there are fewer than two beats.
    pub fn bpm(&self) -> Option<f64> {
        let mut steps: Vec<f64> = self.times_s.windows(2).map(|w| w[1] - w[0]).collect();
        median(&mut steps).map(|step| 60.0 / step)
    }

    /// Beats a minute around each beat: the median of eight steps, of fewer where the piece has fewer. As many as beats.
    pub fn tempi_bpm(&self) -> Vec<f64> {
        let steps: Vec<f64> = self.times_s.windows(2).map(|w| w[1] - w[0]).collect();
        let around = |i: usize| {
            let from = i.saturating_sub(TEMPO_BEATS / 2).min(steps.len().saturating_sub(TEMPO_BEATS));
            let to = (from + TEMPO_BEATS).min(steps.len());
            median(&mut steps[from..to].to_vec()).map_or(0.0, |step| 60.0 / step)
        };
        (0..self.times_s.len()).map(around).collect()
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
}

impl Default for Tracker {
    fn default() -> Self {
        Tracker::new()
    }
}

impl Tracker {
    /// Before the first sample.
    pub fn new() -> Tracker {
        Tracker { flux: Flux::new(), samples: 0 }
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
        let found = level::beats(&series, &pulse::pulse(&change, &periods));
        let heard = heard(&change, &found);
        let time = |frame: &f64| (frame / FPS - LATE_S).max(0.0);
        Ok(Beats { times_s: found[heard].iter().map(time).filter(|t| *t <= seconds).collect(), seconds })
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
    let mut tracker = Tracker::new();
    hear(path, &mut [(RATE, &mut |samples: &[f32]| tracker.push(samples))])?;
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
