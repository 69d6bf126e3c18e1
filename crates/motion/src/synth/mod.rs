//! Synthetic labelled dances, generated from a seed for demos and tests: genres that differ in rhythm and movement, dancers
//! that differ in amplitude and timing, and takes that are never the same.
//!
//! A genre has figures of a few beats; a score arranges them; a dancer performs it with his habits. Feet are planned first,
//! step by step; the hips move between them; arms, spine and head follow the figure; inverse kinematics computes the
//! joints. No recorded motion is used.
//!
//! ```
//! let dances = kinelm_motion::synth::corpus(7, 2, 4.0, 30.0)?;
//! assert_eq!(dances[0].name(), "sway_ash_01");
//! assert_eq!((dances[1].genre, dances[1].clip.frames()), ("stomp", 120));
//! # Ok::<(), kinelm_motion::Error>(())
//! ```

mod control;
mod dancers;
mod figures;
mod rng;
mod score;
mod solve;
mod steps;

use crate::{Clip, Error, Result, Vec3, smpl};
use control::{CHANNELS, Control, smooth};
use dancers::{DANCERS, Dancer};
use figures::{GENRES, Genre};
use rng::Rng;
use score::Score;
use solve::Targets;
use steps::{Foot, Steps};

/// A synthetic dance with its labels.
#[derive(Debug, Clone, PartialEq)]
pub struct Dance {
    /// The motion, on [`smpl::neutral`]. It starts and ends standing, with the feet on y = 0.
    pub clip: Clip,
    /// One of [`genres`].
    pub genre: &'static str,
    /// One of [`dancers`].
    pub dancer: &'static str,
    /// The number of the take, from 1 for each genre and dancer.
    pub take: usize,
    /// The beats of the dance within the clip, seconds.
    pub beats_s: Vec<f64>,
    /// Index of the beat on which the first figure, and a bar of four, begins.
    pub downbeat: usize,
}

impl Dance {
    /// `{genre}_{dancer}_{take}`, for file names.
    pub fn name(&self) -> String {
        format!("{}_{}_{:02}", self.genre, self.dancer, self.take)
    }
}

/// Names of the genres.
pub fn genres() -> impl Iterator<Item = &'static str> {
    GENRES.iter().map(|g| g.name)
}

/// Names of the dancers.
pub fn dancers() -> impl Iterator<Item = &'static str> {
    DANCERS.iter().map(|d| d.name)
}

/// Longest dance, seconds, and highest rate, frames per second.
const LONGEST_S: f64 = 3600.0;
const FASTEST_FPS: f64 = 1000.0;

/// Makes `clips` dances of `seconds` at `fps`: all genres, then the next dancer, then the next take.
///
/// The same arguments give the same dances. A dance depends on the seed, its index and `seconds`, not on the number of
/// dances; at another `fps` it is the same dance. Dances shorter than 6 seconds hardly get beyond their ending.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) when `seconds` is outside `0..=3600` or `fps` outside `1..=1000`.
pub fn corpus(seed: u64, clips: usize, seconds: f64, fps: f64) -> Result<Vec<Dance>> {
    check(seconds, fps)?;
    (0..clips).map(|i| dance(seed, i, None, seconds, fps)).collect()
}

/// Slowest and fastest tempo, beats per minute.
const TEMPI_BPM: std::ops::RangeInclusive<f64> = 60.0..=180.0;

/// Makes a dance for each of these tempi, beats per minute, which it follows exactly except for the dancer's shuffle.
///
/// # Errors
/// Those of [`corpus`]; a tempo outside `60..=180`.
pub fn corpus_at(seed: u64, tempi_bpm: &[f64], seconds: f64, fps: f64) -> Result<Vec<Dance>> {
    check(seconds, fps)?;
    if let Some((i, bpm)) = tempi_bpm.iter().enumerate().find(|(_, bpm)| !TEMPI_BPM.contains(bpm)) {
        let (slow, fast) = (TEMPI_BPM.start(), TEMPI_BPM.end());
        let found = format!("{bpm} beats per minute");
        return Err(Error::invalid(format!("the tempo of dance {i}"), found, format!("{slow} to {fast}")));
    }
    tempi_bpm.iter().enumerate().map(|(i, bpm)| dance(seed, i, Some(*bpm), seconds, fps)).collect()
}

fn check(seconds: f64, fps: f64) -> Result<()> {
    if !(0.0..=LONGEST_S).contains(&seconds) || !(1.0..=FASTEST_FPS).contains(&fps) {
        let found = format!("{seconds} seconds at {fps} frames per second");
        return Err(Error::invalid("a synthetic dance", found, format!("0 to {LONGEST_S} at 1 to {FASTEST_FPS}")));
    }
    Ok(())
}

fn dance(seed: u64, index: usize, bpm: Option<f64>, seconds: f64, fps: f64) -> Result<Dance> {
    let (g, d) = (index % GENRES.len(), index / GENRES.len() % DANCERS.len());
    let take = index / (GENRES.len() * DANCERS.len());
    let (genre, dancer): (&'static Genre, &'static Dancer) = (&GENRES[g], &DANCERS[d]);
    let mut rng = Rng::new(seed, &[g as u64, d as u64, take as u64]);
    let score = Score::new(genre, dancer, bpm, seconds, &mut rng);
    let clip = perform(&score, seconds, fps)?;
    let (beats_s, downbeat) = score.beats(seconds);
    Ok(Dance { clip, genre: genre.name, dancer: dancer.name, take: take + 1, beats_s, downbeat })
}

/// The largest angle between a standing foot and the body before the foot pivots on its ball, radians.
const PIVOT: f64 = 0.75;

fn perform(score: &Score, seconds: f64, fps: f64) -> Result<Clip> {
    let skeleton = smpl::neutral();
    let times: Vec<f64> = (0..(seconds * fps).round() as usize).map(|f| f as f64 / fps).collect();
    let controls = smoothed_controls(score, &times, fps);
    let steps = score.steps();
    let weight: Vec<f64> = times.iter().map(|&t| steps.weight(t)).collect();
    // sigmas are seconds times the rate, so that a dance is the same at any rate
    let weight = smooth(&weight, 0.11 * fps);
    let feet: Vec<[Foot; 2]> =
        (0..times.len()).map(|f| [0, 1].map(|foot| foot_at(&steps, foot, times[f], &controls[f], weight[f]))).collect();
    let pelvis = pelvis_path(score, &controls, &feet, &weight, fps);
    let (mut root, mut rotations) = (Vec::new(), Vec::new());
    for f in 0..times.len() {
        let (before, after) = (&controls[f.saturating_sub(1)], &controls[(f + 1).min(times.len() - 1)]);
        let wrist_velocity = [0, 1].map(|side| (after.wrists[side] - before.wrists[side]) * (0.5 * fps));
        let targets = Targets { control: controls[f], feet: feet[f], pelvis: pelvis[f], wrist_velocity };
        let pose = solve::solve(&skeleton, &targets);
        root.push(pose.root);
        rotations.extend(pose.local);
    }
    Clip::new(skeleton, fps, root, rotations)
}

/// The controls after the low pass that stands for the body's inertia.
fn smoothed_controls(score: &Score, times: &[f64], fps: f64) -> Vec<Control> {
    let raw: Vec<[f64; CHANNELS]> = times.iter().map(|&t| score.control(t).channels()).collect();
    let columns: Vec<Vec<f64>> = (0..CHANNELS)
        .map(|c| smooth(&raw.iter().map(|r| r[c]).collect::<Vec<_>>(), score.softness_s() * fps))
        .collect();
    (0..times.len()).map(|f| Control::from_channels(std::array::from_fn(|c| columns[c][f]))).collect()
}

/// The foot as planned, pivoted on its ball if the body has turned too far, with its heel up when unweighted.
fn foot_at(steps: &Steps, foot: usize, time_s: f64, c: &Control, weight: f64) -> Foot {
    let planned = steps.foot(foot, time_s);
    let away = planned.heading - c.turn;
    // tanh limits the angle smoothly, so a foot begins to pivot without a jerk
    let turned = PIVOT * (away / PIVOT).tanh();
    let share = if foot == 0 { weight } else { 1.0 - weight };
    let light = (1.0 - share).powi(3) * 0.22;
    let pivot = 0.3 * (1.0 - (-((away - turned) / 0.3).powi(2)).exp());
    Foot { heading: c.turn + turned, pitch: planned.pitch + light + pivot, ..planned }
}

/// The path of the pelvis: between the feet by weight, displaced by the figure; its height is not limited by the legs yet.
fn pelvis_path(score: &Score, controls: &[Control], feet: &[[Foot; 2]], weight: &[f64], fps: f64) -> Vec<Vec3> {
    let under = |foot: &Foot| foot.toe - Vec3::new(foot.heading.sin(), 0.0, foot.heading.cos()) * 0.085;
    let between: Vec<Vec3> = feet
        .iter()
        .zip(weight)
        .map(|([left, right], w)| under(right).lerp(under(left), 0.5 + 0.75 * (w - 0.5)))
        .collect();
    let x = smooth(&between.iter().map(|p| p.x).collect::<Vec<_>>(), 0.09 * fps);
    let z = smooth(&between.iter().map(|p| p.z).collect::<Vec<_>>(), 0.09 * fps);
    let place = |f: usize| {
        let c = &controls[f];
        let shift = crate::Quat::from_rotation_y(c.turn) * c.shift;
        Vec3::new(x[f] + shift.x, score.hip_height_m() + c.travel.y, z[f] + shift.z)
    };
    (0..controls.len()).map(place).collect()
}

#[cfg(test)]
mod tests;
