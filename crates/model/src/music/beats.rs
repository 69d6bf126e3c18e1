//! Where the beats are, as numbers: a 1, which says that it is known, and cosine and sine of the beat's phase, and of twice and
//! of three times its phase, at each time of `AHEAD_S`.
//!
//! The phase goes evenly from 0 at a beat to a turn at the next. Before the first beat and after the last it goes on as
//! between the two nearest, for `BEYOND` beats.
//!
//! A beat is a time alone: neither its strength nor its place in the bar is known.

use super::AHEAD_S;
use std::f64::consts::TAU;

/// Multiples of the phase whose cosine and sine are written.
const MULTIPLES: usize = 3;
/// Beats before the first and after the last in which the phase is known.
const BEYOND: f64 = 4.0;
/// Conditioning numbers of a frame.
pub(crate) const NUMBERS: usize = 1 + 2 * MULTIPLES * AHEAD_S.len();

/// The phase at a time, in beats, among beats that rise; none where it isn't known.
fn phase(beats_s: &[f64], time_s: f64) -> Option<f64> {
    // one beat has no interval, so no phase
    if beats_s.len() < 2 {
        return None;
    }
    // clamped: before the first and after the last beat the nearest interval goes on
    let next = beats_s.partition_point(|beat| *beat <= time_s).clamp(1, beats_s.len() - 1);
    let (a, b) = (beats_s[next - 1], beats_s[next]);
    let phase = (time_s - a) / (b - a);
    (-BEYOND..=1.0 + BEYOND).contains(&phase).then(|| (next - 1) as f64 + phase)
}

/// Writes the beats' phase at these times, the first the frame's own, into zeros (`NUMBERS`).
pub fn write(beats_s: &[f64], times_s: [f64; AHEAD_S.len()], conditioning: &mut [f32]) {
    let Some((known, phases)) = conditioning.split_first_mut().filter(|_| phase(beats_s, times_s[0]).is_some()) else {
        return;
    };
    *known = 1.0;
    for (numbers, time) in phases.chunks_exact_mut(2 * MULTIPLES).zip(times_s) {
        let Some(phase) = phase(beats_s, time) else { continue };
        for (pair, multiple) in numbers.chunks_exact_mut(2).zip(1..) {
            let angle = TAU * f64::from(multiple) * phase.rem_euclid(1.0);
            pair.copy_from_slice(&[angle.cos() as f32, angle.sin() as f32]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(beats_s: &[f64], time: f64) -> Vec<f32> {
        let mut conditioning = vec![0.0; NUMBERS];
        write(beats_s, AHEAD_S.map(|ahead| time + ahead), &mut conditioning);
        conditioning
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
        let conditioning = one(&beats, 2.1);
        assert_eq!(conditioning.len(), 25);
        assert_eq!(conditioning[0], 1.0);
        // a quarter of a beat on, then by 0.1, 0.25 and 0.5 s
        for (numbers, ahead) in conditioning[1..].chunks(6).zip([0.0, 0.25, 0.625, 1.25]) {
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
    }
}
