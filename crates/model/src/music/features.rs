//! What music sounds like, as numbers: a 1, which says that it is known, and the 35 of [`kinelm_music::feature`] at each
//! time of `AHEAD_S`, standardised by the training clips.
//!
//! Source of the 35: Li et al., "AI Choreographer" (2021), section 4, which gives a model those of the music around a frame.

use super::AHEAD_S;
use crate::{Error, Result};
use kinelm_corpus::music::clip_music::FeatureRows;
use kinelm_music::feature::CHANNELS;
use serde::{Deserialize, Serialize};

/// Conditioning numbers of a frame.
pub(crate) const NUMBERS: usize = 1 + CHANNELS * AHEAD_S.len();
/// A standard deviation is scaled to this. 141 new inputs of size 1 disturb what a model has learned
/// (docs/results/music.md).
const DEVIATION: f32 = 0.1;
/// Numbers are clamped to this many standard deviations, so that unfamiliar music doesn't drown the other inputs.
const MOST: f32 = 5.0;

/// Mean and standard deviation of the 35 numbers over the training clips.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scale {
    /// (35) Means.
    pub mean: Vec<f32>,
    /// (35) Standard deviations; a number that never changed has 0 and becomes 0.
    pub deviation: Vec<f32>,
}

impl Scale {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Another number of them than 35; means that aren't finite, deviations below 0 or not finite.
    pub fn validate(&self) -> Result<()> {
        let found = [self.mean.len(), self.deviation.len()];
        if found != [CHANNELS; 2] {
            let found = format!("{} means and {} deviations", found[0], found[1]);
            let expected = format!("{CHANNELS} of each, which training writes itself");
            return Err(Error::invalid("model.music_scale", found, expected));
        }
        let is_fine = |x: &f32| x.is_finite() && *x >= 0.0;
        match self.mean.iter().all(|x| x.is_finite()) && self.deviation.iter().all(is_fine) {
            true => Ok(()),
            false => {
                Err(Error::invalid("model.music_scale", "not finite, or has deviations below 0", "finite numbers"))
            }
        }
    }
}

/// Sums over rows, for a [`Scale`].
#[derive(Debug, Clone)]
pub struct Scaling {
    rows: f64,
    sums: [f64; CHANNELS],
    squares: [f64; CHANNELS],
}

impl Default for Scaling {
    fn default() -> Scaling {
        Scaling { rows: 0.0, sums: [0.0; CHANNELS], squares: [0.0; CHANNELS] }
    }
}

impl Scaling {
    /// Counts rows (N, 35), each `times` times.
    pub fn add(&mut self, rows: &[f32], times: f64) {
        for row in rows.chunks_exact(CHANNELS) {
            self.rows += times;
            for (i, x) in row.iter().map(|x| f64::from(*x)).enumerate() {
                self.sums[i] += times * x;
                self.squares[i] += times * x * x;
            }
        }
    }

    /// Their mean and deviation; none of no rows.
    pub fn scale(&self) -> Option<Scale> {
        let mean = self.sums.map(|sum| sum / self.rows);
        // rounding may leave the difference of two close squares below 0
        let deviation = |i: usize| (self.squares[i] / self.rows - mean[i] * mean[i]).max(0.0).sqrt();
        // what rounding leaves of a number that never changes is no deviation
        let of = |i: usize| if deviation(i) < 1e-6 * (1.0 + mean[i].abs()) { 0.0 } else { deviation(i) as f32 };
        (self.rows > 0.0)
            .then(|| Scale { mean: mean.map(|x| x as f32).into(), deviation: (0..CHANNELS).map(of).collect() })
    }
}

/// Writes the features at these times, the first the frame's own, into zeros (`NUMBERS`).
pub fn write(rows: &FeatureRows<'_>, scale: &Scale, times_s: [f64; AHEAD_S.len()], conditioning: &mut [f32]) {
    let Some((known, conditioning)) = conditioning.split_first_mut() else { return };
    for (i, (numbers, time)) in conditioning.chunks_exact_mut(CHANNELS).zip(times_s).enumerate() {
        if !rows.at(time, numbers) {
            continue;
        }
        if i == 0 {
            *known = 1.0;
        }
        for ((x, mean), deviation) in numbers.iter_mut().zip(&scale.mean).zip(&scale.deviation) {
            *x = if *deviation > 0.0 { DEVIATION * ((*x - mean) / deviation).clamp(-MOST, MOST) } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(numbers: impl Iterator<Item = f32>) -> Vec<f32> {
        numbers.flat_map(|x| (0..CHANNELS).map(move |c| if c == 3 { 7.0 } else { x + c as f32 })).collect()
    }

    #[test]
    fn the_scale_makes_training_rows_mean_0_and_deviation_1() {
        let numbers = rows((0..100).map(|i| ((i * 37) % 100) as f32));
        let mut scaling = Scaling::default();
        assert!(scaling.scale().is_none());
        scaling.add(&numbers, 2.5);
        let scale = scaling.scale().unwrap();
        scale.validate().unwrap();
        assert!((scale.mean[0] - 49.5).abs() < 1e-4 && (scale.deviation[0] - 28.866).abs() < 1e-3, "{scale:?}");
        assert_eq!((scale.mean[3], scale.deviation[3]), (7.0, 0.0));
        // more of some weigh more
        scaling.add(&rows(std::iter::repeat_n(149.5, 100)), 2.5);
        assert!((scaling.scale().unwrap().mean[0] - 99.5).abs() < 1e-4);
        let short = Scale { mean: vec![0.0; 34], ..scale.clone() };
        assert!(short.validate().unwrap_err().to_string().contains("34 means and 35 deviations; expected 35"));
        let below = Scale { deviation: vec![-1.0; 35], ..scale };
        assert!(below.validate().unwrap_err().to_string().contains("deviations below 0"));
    }

    #[test]
    fn a_frame_is_told_now_and_what_comes_between_rows_in_proportion() {
        let numbers = rows((0..10).map(|i| i as f32));
        let rows = FeatureRows { fps: 20.0, from_s: 1.0, numbers: numbers.into() };
        let scale =
            Scale { mean: vec![1.0; CHANNELS], deviation: (0..CHANNELS).map(|c| 2.0 * f32::from(c != 3)).collect() };
        let mut conditioning = vec![0.0; NUMBERS];
        write(&rows, &scale, AHEAD_S.map(|ahead| 1.125 + ahead), &mut conditioning);
        assert_eq!(conditioning[0], 1.0);
        let of = |i: usize, c: usize| conditioning[1 + i * CHANNELS + c];
        // rows 2.5, 4.5, 7.5; half a second on there is no music any more
        let near = |found: [f32; 4], expected: [f32; 4]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(near([of(0, 0), of(1, 0), of(2, 0), of(3, 0)], [0.075, 0.175, 0.325, 0.0]), "{conditioning:?}");
        // what never changed is 0, and nothing is more than 5 deviations
        assert!(near([of(0, 3), of(0, 4), of(2, 4), of(3, 4)], [0.0, 0.275, 0.5, 0.0]), "{conditioning:?}");
        let mut before = vec![0.0; NUMBERS];
        write(&rows, &scale, AHEAD_S.map(|ahead| 0.9 + ahead), &mut before);
        assert!(
            before[..1 + CHANNELS].iter().all(|x| *x == 0.0) && (before[1 + CHANNELS] + 0.05).abs() < 1e-6,
            "{before:?}"
        );
        let mut none = vec![0.0; NUMBERS];
        write(&FeatureRows::default(), &scale, AHEAD_S, &mut none);
        assert!(none.iter().all(|x| *x == 0.0));
    }
}
