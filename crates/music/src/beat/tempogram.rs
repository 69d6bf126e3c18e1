//! The tempo of a sound over time.
//!
//! Limits: 40 to 240 beats a minute, in steps of 1.5 %. A window has 12 s, so quicker changes of tempo are left to the
//! pulse, which may deviate from the period.

use super::FPS;
use super::flux::moving_mean;
use realfft::RealFftPlanner;
use std::f64::consts::TAU;

/// Frames from one estimate to the next, a second.
pub const STEP: usize = 86;
/// Frames of an estimate's window, 12 s.
const WINDOW: usize = 1033; // odd, so that a frame is its middle
/// The slowest tempo, beats a minute; the number of tempi, 48 an octave.
const SLOWEST: f64 = 40.0;
// up to 40 * 2^(124 / 48) = 240 beats a minute
const TEMPI: usize = 125;
const PER_OCTAVE: f64 = 48.0;
/// Multiples of a period that are added up, and the weight of each relative to the one before.
const RETURNS: usize = 6;
const DECAY: f32 = 0.85;
/// The prior: its most likely tempo, and the octaves at which it has fallen by [`DOUBT`].
const LIKELIEST: f64 = 130.0;
const SPREAD: f64 = 0.9;
const DOUBT: f64 = 0.3;
/// The most that a change of tempo costs within a second, and the factor of its squared octaves.
const JUMP: f32 = 12.0;
const STIFFNESS: f64 = 200.0;

/// The candidate tempi, beats a minute.
pub fn tempi() -> impl Iterator<Item = f64> {
    (0..TEMPI).map(|i| SLOWEST * 2f64.powf(i as f64 / PER_OCTAVE))
}

/// The period of a series of flux, in frames a beat, every [`STEP`] frames: the best path through the tempogram (the
/// autocorrelation of 12 s, summed over multiples of each period) under a prior and a cost of changes.
///
/// Source: Grosche, Müller and Kurth, "Cyclic tempogram" (2010); the prior of Ellis, "Beat tracking by dynamic
/// programming" (2007), eq. 9.
pub fn periods(change: &[f32]) -> Vec<f64> {
    let periods: Vec<f64> = tempi().map(|bpm| 60.0 * FPS / bpm).collect();
    let rows = tempogram(change, &periods);
    let prior: Vec<f32> = tempi().map(|bpm| (DOUBT * ((bpm / LIKELIEST).log2() / SPREAD).powi(2)) as f32).collect();
    let cost = |i: usize, j: usize| {
        let octaves = (i as f64 - j as f64) / PER_OCTAVE;
        ((STIFFNESS * octaves * octaves) as f32).min(JUMP)
    };
    let costs: Vec<f32> = (0..TEMPI).map(|d| cost(d, 0)).collect();
    let mut best: Vec<f32> = rows[0].iter().zip(&prior).map(|(x, p)| x - p).collect();
    // TEMPI fits a byte, and an hour has 3,600 rows
    let mut back: Vec<Vec<u8>> = Vec::new();
    for row in &rows[1..] {
        let from = |i: usize| {
            let score = |j: usize| best[j] - costs[i.abs_diff(j)];
            (0..TEMPI).map(|j| (score(j), j)).fold((f32::NEG_INFINITY, 0), |a, b| if b.0 > a.0 { b } else { a })
        };
        let next: Vec<(f32, usize)> = (0..TEMPI).map(from).collect();
        best = next.iter().enumerate().map(|(i, (score, _))| score + row[i] - prior[i]).collect();
        back.push(next.iter().map(|(_, j)| *j as u8).collect());
    }
    let mut at = (0..TEMPI).fold(0, |a, b| if best[b] > best[a] { b } else { a });
    let mut path = vec![periods[at]];
    for row in back.iter().rev() {
        at = usize::from(row[at]);
        path.push(periods[at]);
    }
    path.reverse();
    path
}

/// A row of the tempogram every [`STEP`] frames.
fn tempogram(change: &[f32], periods: &[f64]) -> Vec<Vec<f32>> {
    let longest = periods[0] as usize * RETURNS + RETURNS + 2;
    // zeros as long as the longest lag: a circular autocorrelation must not meet its own beginning
    let size = (WINDOW + longest).next_power_of_two();
    let mut planner = RealFftPlanner::<f32>::new();
    let (forward, backward) = (planner.plan_fft_forward(size), planner.plan_fft_inverse(size));
    let (mut x, mut spectrum) = (forward.make_input_vec(), forward.make_output_vec());
    let window: Vec<f32> =
        (0..WINDOW).map(|i| (0.5 - 0.5 * (TAU * i as f64 / (WINDOW - 1) as f64).cos()) as f32).collect();
    // without its mean a series correlates by its ups and downs, not by being above 0
    let means = moving_mean(change, (2.0 * FPS) as usize);
    const MADE: &str = "the plans made these buffers";
    let mut rows = Vec::new();
    for start in (0..=change.len()).step_by(STEP) {
        x.fill(0.0);
        for (i, w) in window.iter().enumerate() {
            if let Some(f) = (start + i).checked_sub(WINDOW / 2).filter(|f| *f < change.len()) {
                x[i] = w * (change[f] - means[f]);
            }
        }
        forward.process(&mut x, &mut spectrum).expect(MADE);
        spectrum.iter_mut().for_each(|c| *c = c.norm_sqr().into());
        backward.process(&mut spectrum, &mut x).expect(MADE);
        // at lag 0: the energy. Rows are shares of it, 0 in silence; the inverse transform is not normalised
        let whole = x[0] + 1e-9 * size as f32;
        let at = |lag: f64| {
            let (i, f) = (lag as usize, lag.fract() as f32);
            ((1.0 - f) * x[i] + f * x[i + 1]) / whole
        };
        let strength =
            |period: &f64| -> f32 { (1..=RETURNS).map(|k| DECAY.powi(k as i32 - 1) * at(period * k as f64)).sum() };
        rows.push(periods.iter().map(strength).collect());
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_have_their_period_also_when_it_changes() {
        let mut change = vec![0.0; 8000];
        let (mut at, mut truth) = (10.0, Vec::new());
        while at < 7990.0 {
            change[at as usize] = 1.0;
            truth.push(at);
            at += if at < 4000.0 { 40.0 } else { 46.0 };
        }
        let found = periods(&change);
        assert_eq!(found.len(), 8000 / STEP + 1);
        // around the change, 12 s of window see both tempi
        assert!(found[10..40].iter().all(|p| (p - 40.0).abs() < 0.8), "{found:?}");
        assert!(found[55..80].iter().all(|p| (p - 46.0).abs() < 0.8), "{found:?}");
        assert_eq!(periods(&[]).len(), 1);
    }
}
