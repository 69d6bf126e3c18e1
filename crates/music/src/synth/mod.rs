//! A small synthesiser: renders a score of beats, so that synthetic dances have music in step with them.
//!
//! Kick, snare, hat, bass and chords play a [`Style`]'s pattern at the given beats, in a key and with chords that the seed
//! chooses. There are no samples of recorded sound.
//!
//! ```
//! use kinelm_music::synth::{Score, Style, render};
//!
//! let score = Score { style: Style::Disco, beats_s: vec![0.0, 0.5, 1.0], downbeat: 0, seconds: 2.0, seed: 7 };
//! let samples = render(&score, 22_050)?;
//! assert_eq!((samples.len(), &samples), (44_100, &render(&score, 22_050)?));
//! # Ok::<(), kinelm_music::Error>(())
//! ```

mod style;
mod voice;

pub use style::Style;

use crate::{Error, Result};
use kinelm_store::Subject;
use style::Hit;
use voice::{Noise, add};

/// Beats of a bar.
const BAR: usize = 4;
/// The longest piece, seconds.
pub const LONGEST_S: f64 = 3600.0;

/// A piece to render.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// The pattern.
    pub style: Style,
    /// The beats, seconds, rising. Each lasts until the next, the last as long as the one before it.
    pub beats_s: Vec<f64>,
    /// Index of the first beat of the first bar of four; earlier beats are a pick-up.
    pub downbeat: usize,
    /// Length of the piece; its end is faded out.
    pub seconds: f64,
    /// Chooses key, chords and accents.
    pub seed: u64,
}

/// The samples of a score at `rate` per second; the same score gives the same samples. Peaks are at -1 dB or below.
///
/// # Errors
/// A piece longer than an hour, a rate outside 8,000 to 192,000, and beats that don't rise or are outside the piece:
/// [`kinelm_store::Error::Invalid`].
pub fn render(score: &Score, rate: u32) -> Result<Vec<f32>> {
    check(score, rate)?;
    let mut out = vec![0.0f32; (score.seconds * f64::from(rate)).round() as usize];
    let mut noise = Noise::new(score.seed);
    // F2 to C3
    let key = 41 + noise.below(8) as i32;
    let chords = score.style.chords(&mut noise);
    for (i, at) in score.beats_s.iter().enumerate() {
        let step = step(&score.beats_s, i);
        let bar_beat = (i + BAR - score.downbeat % BAR) % BAR;
        // a pick-up belongs to the chord of the first bar
        let bar = (i.saturating_sub(score.downbeat)) / BAR;
        let chord = chords[bar % chords.len()];
        for hit in score.style.pattern().iter().filter(|hit| hit.beat == bar_beat) {
            let accent = 1.0 + 0.08 * noise.next();
            add(&mut out, rate, at + hit.part * step, hit.loud * accent, &sound(hit, key, chord, step), &mut noise);
        }
    }
    finish(&mut out, rate);
    Ok(out)
}

fn check(score: &Score, rate: u32) -> Result<()> {
    if !(0.0..=LONGEST_S).contains(&score.seconds) {
        return Err(Error::invalid_parameter("seconds", score.seconds, format!("0 to {LONGEST_S}")));
    }
    if !(8_000..=192_000).contains(&rate) {
        return Err(Error::invalid_parameter("rate", rate, "8000 to 192000 samples per second"));
    }
    let outside = score.beats_s.iter().position(|b| !(0.0..=score.seconds).contains(b));
    let falls = score.beats_s.windows(2).position(|w| w[1] <= w[0]).map(|i| i + 1);
    match outside.or(falls) {
        Some(i) => {
            let expected = format!("seconds that rise from 0 to {}", score.seconds);
            Err(Error::invalid(Subject::of_parameter(format!("beats_s[{i}]")), score.beats_s[i], expected))
        }
        None => Ok(()),
    }
}

/// The length of a beat, seconds.
fn step(beats: &[f64], i: usize) -> f64 {
    let between = |i: usize| Some(beats.get(i + 1)? - beats.get(i)?);
    // 2 s at most: a note over a long pause would drone
    between(i).or_else(|| between(i.checked_sub(1)?)).unwrap_or(0.5).min(2.0)
}

fn sound(hit: &Hit, key: i32, chord: [i32; 3], step: f64) -> voice::Sound {
    use style::Part;
    let length = hit.length * step;
    match hit.who {
        Part::Kick => voice::Sound::Kick,
        Part::Snare => voice::Sound::Snare,
        Part::Hat => voice::Sound::Hat,
        Part::Bass => voice::Sound::Bass { note: key - 12 + chord[0], length },
        Part::Fifth => voice::Sound::Bass { note: key - 12 + chord[2], length },
        Part::Chord => voice::Sound::Chord { notes: chord.map(|n| key + 12 + n), length },
    }
}

/// Fades out the last 50 ms and normalises the peak to -1 dB.
fn finish(out: &mut [f32], rate: u32) {
    let fade = (0.05 * f64::from(rate)) as usize;
    let n = out.len();
    for (i, x) in out.iter_mut().rev().take(fade.min(n)).enumerate() {
        *x *= i as f32 / fade as f32;
    }
    let peak = out.iter().fold(0.0f32, |a, x| a.max(x.abs()));
    if peak > 0.0 {
        // -1 dB is 0.891
        let gain = 0.89 / peak;
        out.iter_mut().for_each(|x| *x *= gain);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beat::{RATE, beats_of};

    fn score(style: Style, bpm: f64, seconds: f64) -> Score {
        let beats_s = (0..).map(|i| 0.3 + 60.0 / bpm * f64::from(i)).take_while(|t| *t < seconds - 0.5).collect();
        Score { style, beats_s, downbeat: 1, seconds, seed: 5 }
    }

    #[test]
    fn a_score_sounds_the_same_twice_and_another_seed_differs() {
        let s = score(Style::Pop, 100.0, 6.0);
        let x = render(&s, 22_050).unwrap();
        assert_eq!(x, render(&s, 22_050).unwrap());
        assert_ne!(x, render(&Score { seed: 6, ..s.clone() }, 22_050).unwrap());
        assert_eq!(x.len(), 132_300);
        assert!(x.iter().all(|x| x.abs() < 0.891) && x[..6_000].iter().all(|x| *x == 0.0));
        assert_eq!(render(&Score { beats_s: vec![], ..s.clone() }, 22_050).unwrap(), vec![0.0; 132_300]);
        assert!(render(&Score { beats_s: vec![], seconds: 0.0, ..s }, 22_050).unwrap().is_empty());
    }

    #[test]
    fn what_cannot_be_played_is_refused() {
        let s = score(Style::March, 100.0, 6.0);
        let of = |s: Score, rate| render(&s, rate).unwrap_err().to_string();
        assert!(of(Score { seconds: f64::NAN, ..s.clone() }, 22_050).starts_with("`seconds` is NaN"));
        assert!(of(s.clone(), 100).contains("`rate` is 100; expected 8000 to 192000 samples per second"));
        assert!(
            of(Score { beats_s: vec![1.0, 0.5], ..s.clone() }, 22_050)
                .starts_with("`beats_s[1]` is 0.5; expected seconds that rise from 0")
        );
        assert!(
            of(Score { beats_s: vec![1.0, 7.0], ..s }, 22_050)
                .starts_with("`beats_s[1]` is 7; expected seconds that rise from 0 to 6")
        );
    }

    #[test]
    fn the_tracker_taps_to_every_style() {
        for style in Style::ALL {
            let mut right = 0;
            for bpm in [84.0, 97.0, 112.0] {
                let s = score(style, bpm, 40.0);
                let found = beats_of(&render(&s, RATE).unwrap());
                let hit = |t: &&f64| found.times_s.iter().any(|f| (f - **t).abs() < 0.035);
                let hits = s.beats_s.iter().filter(hit).count();
                let n = found.times_s.len();
                println!("{style:?} at {bpm}: {hits} of {} beats, {n} found, {:?}", s.beats_s.len(), found.bpm());
                right += usize::from(hits * 10 > s.beats_s.len() * 9 && n < s.beats_s.len() * 11 / 10);
            }
            assert!(right >= 2, "{style:?}");
        }
    }
}
