//! What a frame is told of the music that is danced to.
//!
//! A frame at time t is told the beat: a 1, which says that it is known, and cosine and sine of its phase, and of twice and
//! of three times its phase, at t and at [`AHEAD_S`] behind it. The phase goes evenly from 0 at a beat to a turn at the next;
//! before the first beat and behind the last it goes on as between the two nearest, for [`BEYOND`] beats. Where that ends
//! nothing is known, and all numbers are 0.
//!
//! Training, measuring and generation all ask [`told`].

use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// What of the music a model is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Music {
    /// Nothing.
    #[default]
    None,
    /// Where its beats are.
    Beats,
}

/// Times at which the phase is told, behind that of the frame, seconds.
const AHEAD_S: [f64; 4] = [0.0, 0.1, 0.25, 0.5];
/// Multiples of the phase whose cosine and sine are told.
const MULTIPLES: usize = 3;
/// Beats before the first and behind the last in which the phase is known.
const BEYOND: f64 = 4.0;

impl Music {
    /// Whether it is nothing.
    pub fn is_none(&self) -> bool {
        *self == Music::None
    }

    /// M: numbers that a frame is told.
    pub fn numbers(self) -> usize {
        match self {
            Music::None => 0,
            Music::Beats => 1 + 2 * MULTIPLES * AHEAD_S.len(),
        }
    }
}

/// The phase at a time, in beats, among beats that rise; none where it isn't known.
fn phase(beats_s: &[f64], time_s: f64) -> Option<f64> {
    if beats_s.len() < 2 {
        return None;
    }
    let next = beats_s.partition_point(|beat| *beat <= time_s).clamp(1, beats_s.len() - 1);
    let (a, b) = (beats_s[next - 1], beats_s[next]);
    let phase = (time_s - a) / (b - a);
    (-BEYOND..=1.0 + BEYOND).contains(&phase).then(|| (next - 1) as f64 + phase)
}

/// What frames at these times are told of music with these beats (seconds, rising): (N, M).
pub fn told(music: Music, beats_s: &[f64], times_s: impl Iterator<Item = f64>) -> Vec<f32> {
    let m = music.numbers();
    let mut all = Vec::new();
    for time in times_s {
        let first = all.len();
        all.resize(first + m, 0.0);
        let Some((known, phases)) = all[first..].split_first_mut().filter(|_| phase(beats_s, time).is_some()) else {
            continue;
        };
        *known = 1.0;
        for (numbers, ahead) in phases.chunks_exact_mut(2 * MULTIPLES).zip(AHEAD_S) {
            let Some(phase) = phase(beats_s, time + ahead) else { continue };
            for (pair, multiple) in numbers.chunks_exact_mut(2).zip(1..) {
                let angle = TAU * f64::from(multiple) * phase.rem_euclid(1.0);
                pair.copy_from_slice(&[angle.cos() as f32, angle.sin() as f32]);
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(beats_s: &[f64], time: f64) -> Vec<f32> {
        told(Music::Beats, beats_s, std::iter::once(time))
    }

    #[test]
    fn phases_go_evenly_from_beat_to_beat_and_on_for_four() {
        let beats = [1.0, 1.5, 2.5];
        for (time, expected) in [(1.0, 0.0), (1.25, 0.5), (1.5, 1.0), (2.25, 1.75), (2.5, 2.0), (0.5, -1.0), (4.0, 3.5)]
        {
            assert!((phase(&beats, time).unwrap() - expected).abs() < 1e-12, "{time}: {:?}", phase(&beats, time));
        }
        assert_eq!([phase(&beats, -1.01), phase(&beats, 6.51), phase(&[1.0], 1.0), phase(&[], 1.0)], [None; 4]);
        assert!(phase(&beats, -0.99).is_some() && phase(&beats, 6.49).is_some());
    }

    #[test]
    fn a_frame_is_told_the_beat_now_and_what_comes() {
        let beats: Vec<f64> = (0..20).map(|i| 0.4 * f64::from(i)).collect();
        let told = one(&beats, 2.1);
        assert_eq!(told.len(), Music::Beats.numbers());
        assert_eq!(told.len(), 25);
        assert_eq!(told[0], 1.0);
        // a quarter of a beat on, then by 0.1, 0.25 and 0.5 s
        for (numbers, ahead) in told[1..].chunks(6).zip([0.0, 0.25, 0.625, 1.25]) {
            for (pair, multiple) in numbers.chunks(2).zip(1..) {
                let angle = TAU * f64::from(multiple) * (0.25 + ahead);
                assert!((f64::from(pair[0]) - angle.cos()).abs() < 1e-6, "{ahead} {multiple}: {pair:?}");
                assert!((f64::from(pair[1]) - angle.sin()).abs() < 1e-6, "{ahead} {multiple}: {pair:?}");
            }
        }
    }

    #[test]
    fn nothing_is_zeros_and_what_lies_beyond_too() {
        assert!(one(&[], 1.0).iter().all(|x| *x == 0.0));
        let beats = [1.0, 1.5];
        assert!(one(&beats, 3.6).iter().all(|x| *x == 0.0) && one(&beats, 9.0).len() == 25);
        // known now, and no more half a second later
        let last = one(&beats, 3.3);
        assert!(last[0] == 1.0 && last[1] != 0.0 && last[19..].iter().all(|x| *x == 0.0), "{last:?}");
        assert!(told(Music::None, &beats, [0.0, 1.0].into_iter()).is_empty());
    }
}
