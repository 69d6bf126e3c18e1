//! Beat alignment of a dance: its kinematic beats, their distance to the beats of the music, and the chance level.

use crate::resample::{Method, resample};
use crate::{Clip, Result, Vec3};
use std::f64::consts::TAU;

/// Frames per second at which kinematic beats are detected.
const FPS: f64 = 60.0;
/// Standard deviation of the alignment score, seconds: three frames.
pub(crate) const SIGMA_S: f64 = 3.0 / FPS;
/// Standard deviation of the low pass of a speed, frames.
const SMOOTH: f64 = 5.0;
/// A beat is slower than this many neighbours on either side.
const ORDER: usize = 10;
/// Shifts of the music that estimate the chance level.
const SHIFTS: usize = 1000;

/// How kinematic beats are detected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BeatRule {
    /// Minima of the speed over 10 frames on either side (Li et al., "AI Choreographer", 2021).
    CompatA,
    /// Minima over both neighbours of the speed after a Gaussian low pass of 5 frames (Siyao et al., "Bailando", 2022).
    CompatB,
    /// Minima over 10 frames of the low-passed speed; the time of a step is half-way between its frames.
    Fixed,
}

/// The kinematic beats of a clip, seconds: the times when its joints move slowest. The clip is resampled to 60 frames per
/// second.
///
/// # Errors
/// Those of resampling; none in practice.
///
/// # Panics
/// If the clip lacks one of the joints.
pub fn beats_s(clip: &Clip, joints: &[usize], rule: BeatRule) -> Result<Vec<f64>> {
    let speeds = speeds(clip, joints)?;
    let (speeds, order, late) = match rule {
        BeatRule::CompatA => (speeds, ORDER, 0.0),
        BeatRule::CompatB => (smoothed(&speeds), 1, 0.0),
        BeatRule::Fixed => (smoothed(&speeds), ORDER, 0.5),
    };
    Ok(minima(&speeds, order).into_iter().map(|i| (i as f64 + late) / FPS).collect())
}

/// The mean distance that the joints move in each step of 1/60 s.
fn speeds(clip: &Clip, joints: &[usize]) -> Result<Vec<f64>> {
    // the published definitions count frames at 60 fps; other rates would detect other beats
    let at_60 = if clip.fps() == FPS { None } else { Some(resample(clip, FPS, Method::Smooth)?) };
    let clip = at_60.as_ref().unwrap_or(clip);
    let (positions, j) = (clip.positions(), clip.joints());
    let frames: Vec<_> = positions.chunks_exact(j).collect();
    let speed = |pair: &[&[Vec3]]| {
        joints.iter().map(|&joint| (pair[1][joint] - pair[0][joint]).length()).sum::<f64>() / joints.len().max(1) as f64
    };
    Ok(frames.windows(2).map(speed).collect())
}

/// The tempo of a clip's joints, beats per minute: the peak of the spectrum of their speed (mean removed, Hann window)
/// from 40 to 300. `None` for a clip that doesn't move or is shorter than two seconds.
///
/// # Errors
/// Those of resampling; none in practice.
///
/// # Panics
/// If the clip lacks one of the joints.
pub fn pulse_bpm(clip: &Clip, joints: &[usize]) -> Result<Option<f64>> {
    let mut x = speeds(clip, joints)?;
    let (n, mean) = (x.len() as f64, x.iter().sum::<f64>() / x.len().max(1) as f64);
    if n < 2.0 * FPS {
        return Ok(None);
    }
    // Hann, at half-integer points, so that no sample has weight 0
    let window = |i: usize| 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / n).cos();
    x.iter_mut().enumerate().for_each(|(i, x)| *x = (*x - mean) * window(i));
    let power = |bpm: f64| {
        let turn = |i: usize| TAU * bpm / 60.0 * i as f64 / FPS;
        let (a, b) =
            x.iter().enumerate().fold((0.0, 0.0), |(a, b), (i, x)| (a + x * turn(i).cos(), b + x * turn(i).sin()));
        a * a + b * b
    };
    // 40 to 300 in steps of 0.5
    let tempi = (0..=520).map(|i| 40.0 + 0.5 * f64::from(i));
    let peak = tempi.map(|bpm| (power(bpm), bpm)).max_by(|a, b| a.0.total_cmp(&b.0));
    Ok(peak.filter(|(power, _)| *power > 1e-18).map(|(_, bpm)| bpm))
}

/// Indices of values below all others within `order` on either side; the ends are repeated.
fn minima(x: &[f64], order: usize) -> Vec<usize> {
    let last = x.len().saturating_sub(1);
    let is = |i: usize| (1..=order).all(|k| x[i] < x[i.saturating_sub(k)] && x[i] < x[(i + k).min(last)]);
    (0..x.len()).filter(|&i| is(i)).collect()
}

/// A Gaussian low pass over four standard deviations, mirrored at the ends.
fn smoothed(x: &[f64]) -> Vec<f64> {
    let radius = (4.0 * SMOOTH + 0.5) as i64;
    let kernel: Vec<f64> = (-radius..=radius).map(|k| (-0.5 * (k as f64 / SMOOTH).powi(2)).exp()).collect();
    let (total, n) = (kernel.iter().sum::<f64>(), x.len() as i64);
    let mirrored = |i: i64| {
        let i = i.rem_euclid(2 * n);
        x[i.min(2 * n - 1 - i) as usize]
    };
    (0..n).map(|i| kernel.iter().zip(i - radius..).map(|(k, at)| k * mirrored(at)).sum::<f64>() / total).collect()
}

/// The beat alignment of two series, 0 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BeatAlignment {
    /// Mean over the kinematic beats of their score against the nearest beat of the music; 0 without beats.
    pub motion: f64,
    /// Mean over the beats of the music against the nearest kinematic beat.
    pub music: f64,
}

impl BeatAlignment {
    /// The scores of ascending beats: `exp(-d² / 2 sigma²)`, d to the nearest beat, sigma 50 ms. Li et al. (2021) define the
    /// first mean and compute the second; Siyao et al. (2022) compute the second.
    pub fn of(motion_s: &[f64], music_s: &[f64]) -> BeatAlignment {
        BeatAlignment { motion: nearness(motion_s, music_s), music: nearness(music_s, motion_s) }
    }

    /// The harmonic mean of both.
    pub fn both(&self) -> f64 {
        let sum = self.motion + self.music;
        if sum > 0.0 { 2.0 * self.motion * self.music / sum } else { 0.0 }
    }
}

/// Distance of a time from the nearest of `to`, ascending.
fn distance(time: f64, to: &[f64]) -> f64 {
    let next = to.partition_point(|t| *t < time);
    let around = [next.checked_sub(1), Some(next)].into_iter().flatten().filter_map(|i| to.get(i));
    around.map(|t| (t - time).abs()).fold(f64::INFINITY, f64::min)
}

/// Mean score of the times `of` against `to`, both ascending.
fn nearness(of: &[f64], to: &[f64]) -> f64 {
    let near = |time: &f64| (-0.5 * (distance(*time, to) / SIGMA_S).powi(2)).exp();
    if of.is_empty() { 0.0 } else { of.iter().map(near).sum::<f64>() / of.len() as f64 }
}

/// The beats of the music, shifted cyclically over a dance of `seconds`; each series ascending.
fn shifts(music_s: &[f64], seconds: f64) -> impl Iterator<Item = Vec<f64>> {
    (0..SHIFTS).map(move |i| {
        // evenly spaced instead of random, so that the chance level is the same in every run; shift 0 is included
        let by = seconds * i as f64 / SHIFTS as f64;
        let mut shifted: Vec<f64> = music_s.iter().map(|beat| (beat + by).rem_euclid(seconds)).collect();
        shifted.sort_by(f64::total_cmp);
        shifted
    })
}

/// The beats of the music that a dance hits: those with a kinematic beat within `SIGMA_S`, 50 ms.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BeatHits {
    /// Per beat of the music; `None` for beats outside the dance, which don't count.
    pub each: Vec<Option<bool>>,
    /// Hits expected by chance: the mean over 1,000 cyclic shifts of the music.
    pub chance: f64,
}

impl BeatHits {
    /// The hits of a dance of `seconds`; all beats ascending.
    pub fn of(motion_s: &[f64], music_s: &[f64], seconds: f64) -> BeatHits {
        // 50 ms up to rounding is a hit
        let is_hit = |beat: &f64| distance(*beat, motion_s) <= SIGMA_S + 1e-9;
        let counts = |beat: &f64| (0.0..seconds).contains(beat);
        let music: Vec<f64> = music_s.iter().copied().filter(counts).collect();
        let hits = shifts(&music, seconds).map(|beats| beats.iter().filter(|beat| is_hit(beat)).count());
        BeatHits {
            chance: hits.sum::<usize>() as f64 / SHIFTS as f64,
            each: music_s.iter().map(|beat| counts(beat).then(|| is_hit(beat))).collect(),
        }
    }

    /// The number of beats hit.
    pub fn hit(&self) -> usize {
        self.each.iter().flatten().filter(|hit| **hit).count()
    }

    /// The number of beats within the dance.
    pub fn beats(&self) -> usize {
        self.each.iter().flatten().count()
    }
}

/// The expected [`BeatAlignment::motion`] of a beat that is uniform between the first and the last of the music: over
/// intervals P, `sigma sqrt(2 pi) erf(P / (2 sqrt(2) sigma)) / P`. `None` for fewer than two beats.
pub fn chance(music_s: &[f64]) -> Option<f64> {
    let whole = music_s.last()? - music_s.first()?;
    let of_step = |pair: &[f64]| SIGMA_S * TAU.sqrt() * erf((pair[1] - pair[0]) / (8f64.sqrt() * SIGMA_S));
    (whole > 0.0).then(|| music_s.windows(2).map(of_step).sum::<f64>() / whole)
}

/// The error function of non-negative numbers to 1.5e-7: Abramowitz and Stegun (1964), 7.1.26.
fn erf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let sum = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    1.0 - sum.iter().fold(0.0, |sum, a| (sum + a) * t) * (-x * x).exp()
}

/// A permutation test of beat alignment: the dance with its music, and with the same music shifted.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ShiftTest {
    /// The alignment with the music.
    pub found: BeatAlignment,
    /// Its mean over 1,000 cyclic shifts of the music.
    pub mean: BeatAlignment,
    /// Its variance over the shifts.
    pub variance: BeatAlignment,
    /// The fraction of shifts with a lower alignment.
    pub percentile: BeatAlignment,
    /// [`chance`] for the music.
    pub chance: Option<f64>,
    /// The number of beats of the motion and of the music.
    pub beats: [usize; 2],
}

impl ShiftTest {
    /// Tests a dance of `seconds`; beats of the music outside it are ignored.
    pub fn of(motion_s: &[f64], music_s: &[f64], seconds: f64) -> ShiftTest {
        let music: Vec<f64> = music_s.iter().copied().filter(|beat| (0.0..seconds).contains(beat)).collect();
        let found = BeatAlignment::of(motion_s, &music);
        let all: Vec<BeatAlignment> =
            shifts(&music, seconds).map(|shifted| BeatAlignment::of(motion_s, &shifted)).collect();
        let [motion, in_music] = [|a: &BeatAlignment| a.motion, |a: &BeatAlignment| a.music].map(|part| {
            let mean = |of: &dyn Fn(f64) -> f64| all.iter().map(|a| of(part(a))).sum::<f64>() / SHIFTS as f64;
            let (found, whole) = (part(&found), mean(&|x| x));
            [whole, mean(&|x| (x - whole).powi(2)), mean(&|x| f64::from(u8::from(x < found)))]
        });
        let [mean, variance, percentile] =
            [0, 1, 2].map(|figure| BeatAlignment { motion: motion[figure], music: in_music[figure] });
        ShiftTest { found, mean, variance, percentile, chance: chance(&music), beats: [motion_s.len(), music.len()] }
    }

    /// z-scores of the mean over dances against their shifts. `None` without variance.
    pub fn z(all: &[ShiftTest]) -> Option<BeatAlignment> {
        let z = |part: fn(&BeatAlignment) -> f64| {
            // of sums instead of means: variances of independent dances add up, and the number of dances cancels
            let above: f64 = all.iter().map(|test| part(&test.found) - part(&test.mean)).sum();
            let variance: f64 = all.iter().map(|test| part(&test.variance)).sum();
            (variance > 1e-12).then(|| above / variance.sqrt())
        };
        Some(BeatAlignment { motion: z(|a| a.motion)?, music: z(|a| a.music)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Quat, smpl};
    use serde_json::Value;

    /// A body that sways for `seconds`, at rest on every beat at `bpm`.
    fn swaying(bpm: f64, fps: f64, seconds: f64) -> Clip {
        let times = (0..(seconds * fps) as usize).map(|f| f as f64 / fps);
        // at rest half-way between two frames at 60 per second, so that a single step is the slowest
        let turn = |t: f64| std::f64::consts::PI * (t - 0.5 / FPS) * bpm / 60.0;
        let root: Vec<Vec3> = times.map(|t| Vec3::X * turn(t).cos()).collect();
        let rotations = vec![Quat::IDENTITY; 24 * root.len()];
        Clip::new(smpl::neutral(), fps, root, rotations).unwrap()
    }

    fn every(bpm: f64, seconds: f64) -> Vec<f64> {
        (0..).map(|i| 60.0 / bpm * f64::from(i)).take_while(|t| *t < seconds).collect()
    }

    #[test]
    fn a_body_at_rest_on_the_beat_scores_one_and_off_it_by_50_ms_0_607() {
        for fps in [60.0, 20.0] {
            let found = beats_s(&swaying(120.0, fps, 20.0), &[0, 4, 5], BeatRule::Fixed).unwrap();
            assert!((38..=40).contains(&found.len()), "{fps}: {}", found.len());
            for beat in &found {
                assert!((beat * 2.0 - (beat * 2.0).round()).abs() < 0.02, "{fps}: {beat}");
            }
        }
        let (a, b) = (every(120.0, 20.0), every(120.0, 20.0).iter().map(|t| t + 0.05).collect::<Vec<_>>());
        let found = BeatAlignment::of(&a, &b);
        let sixty = (-0.5f64).exp();
        assert!((found.motion - sixty).abs() < 1e-9 && (found.both() - sixty).abs() < 1e-9, "{found:?}");
        assert_eq!(BeatAlignment::of(&a, &a), BeatAlignment { motion: 1.0, music: 1.0 });
        assert_eq!(BeatAlignment::of(&[], &a).both(), 0.0);
    }

    #[test]
    fn a_pulse_is_as_fast_as_the_beats_between_which_a_body_goes() {
        for bpm in [90.0, 113.0] {
            let found = pulse_bpm(&swaying(bpm, 20.0, 20.0), &[0, 4, 5]).unwrap().unwrap();
            assert!((found - bpm).abs() <= 1.0, "{bpm}: {found}");
        }
        assert_eq!(pulse_bpm(&swaying(90.0, 20.0, 1.0), &[0]).unwrap(), None);
        assert_eq!(pulse_bpm(&swaying(0.0, 20.0, 9.0), &[0]).unwrap(), None);
    }

    #[test]
    fn chance_is_the_formula_s_and_that_of_shifts() {
        for (bpm, expected) in [(80.0, 0.167), (100.0, 0.209), (120.0, 0.251), (135.0, 0.282)] {
            let music = every(bpm, 30.0);
            assert!((chance(&music).unwrap() - expected).abs() < 5e-4, "{bpm}: {:?}", chance(&music));
        }
        let music = every(120.0, 30.0);
        // a steady beat at another tempo
        let held = ShiftTest::of(&every(97.0, 30.0), &music, 30.0);
        assert!((held.mean.motion - 0.25).abs() < 0.005 && (held.found.motion - 0.25).abs() < 0.05, "{held:?}");
        let held = ShiftTest::of(&music, &music, 30.0);
        assert!(held.percentile.motion > 0.95 && (held.mean.motion - 0.25).abs() < 0.005, "{held:?}");
        // the z-score of one dance to a steady beat is limited; that of ten is higher
        let [one, ten] = [1, 10].map(|n| ShiftTest::z(&vec![held; n]).unwrap().motion);
        assert!(one < 2.7 && (ten / one - 10f64.sqrt()).abs() < 1e-9, "{one} {ten}");
        assert_eq!(ShiftTest::z(&[ShiftTest::of(&[], &[], 5.0)]), None);
    }

    #[test]
    fn a_beat_is_hit_within_50_ms_and_by_chance_as_often_as_they_cover_the_dance() {
        let motion = [0.5, 1.55, 2.551];
        let hits = BeatHits::of(&motion, &[-0.5, 0.45, 1.5, 2.5, 3.5, 4.0], 4.0);
        assert_eq!(hits.each, [None, Some(true), Some(true), Some(false), Some(false), None]);
        assert_eq!((hits.hit(), hits.beats()), (2, 4));
        // three kinematic beats cover 0.3 s of 4 s, and so do the hits of the four beats by chance
        assert!((hits.chance - 0.3).abs() < 0.01, "{}", hits.chance);
        assert_eq!(BeatHits::of(&[], &[0.5], 1.0), BeatHits { each: vec![Some(false)], chance: 0.0 });
        assert_eq!(BeatHits::of(&[0.5], &[], 0.0), BeatHits::default());
    }

    #[test]
    fn beats_of_a_speed_are_scipy_s() {
        let golden: Value = serde_json::from_str(include_str!("../../tests/golden/beats.json")).unwrap();
        let numbers = |key: &str| -> Vec<f64> { serde_json::from_value(golden[key].clone()).unwrap() };
        let positions = |key: &str| -> Vec<usize> { serde_json::from_value(golden[key].clone()).unwrap() };
        let speed = numbers("speed");
        let smooth = smoothed(&speed);
        for (found, expected) in smooth.iter().zip(numbers("smooth")) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert_eq!(minima(&speed, ORDER), positions("compat_a"));
        assert_eq!(minima(&smooth, 1), positions("compat_b"));
        assert_eq!(minima(&smooth, ORDER), positions("fixed"));
        for (x, expected) in [0.0, 0.1, 0.5, 1.0, 2.0, 4.0].iter().zip(numbers("erf")) {
            assert!((erf(*x) - expected).abs() < 2e-7, "{x}");
        }
        assert!(smoothed(&[]).is_empty() && minima(&[], ORDER).is_empty());
    }
}
