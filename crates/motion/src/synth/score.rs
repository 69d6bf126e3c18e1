//! The score of a dance: its figures in time, how they are performed, and the resulting steps.

use super::control::Control;
use super::dancers::Dancer;
use super::figures::{Figure, Genre, between};
use super::rng::Rng;
use super::steps::{Footprint, Step, Steps};
use crate::{Quat, Vec3};
use std::f64::consts::TAU;

/// Seconds of standing before the first beat.
const UPBEAT_S: f64 = 0.6;
/// Beats of the ending: two steps, the final pose, stillness.
const CLOSING_BEATS: f64 = 5.0;
/// Beats over which one figure blends into the next.
const PASSAGE_BEATS: f64 = 0.8;

/// A figure in the score.
struct Part {
    figure: &'static Figure,
    mirrored: bool,
    starts: f64,
    /// Whole turns before it, radians.
    turned: f64,
}

impl Part {
    fn at(&self, beat: f64, amplitude: f64) -> Control {
        let mut c = (self.figure.at)(beat - self.starts).amplified(amplitude);
        if self.mirrored {
            c = c.mirrored();
        }
        Control { turn: c.turn + self.turned, ..c }
    }

    fn ends(&self) -> f64 {
        self.starts + self.figure.beats
    }
}

/// A slow drift of hands and head, so that repetitions differ.
struct Drift([[f64; 4]; 9]);

impl Drift {
    fn new(rng: &mut Rng) -> Self {
        Drift(std::array::from_fn(|_| {
            [rng.range(0.15, 0.3), rng.range(0.0, 1.0), rng.range(0.31, 0.6), rng.range(0.0, 1.0)]
        }))
    }

    fn add(&self, c: &mut Control, time_s: f64) {
        let at = |i: usize| {
            let [slow, p, quick, q] = self.0[i];
            0.6 * (TAU * (slow * time_s + p)).sin() + 0.4 * (TAU * (quick * time_s + q)).sin()
        };
        c.wrists[0] += Vec3::new(at(0), at(1), at(2)) * 0.05;
        c.wrists[1] += Vec3::new(at(3), at(4), at(5)) * 0.05;
        c.head += Vec3::new(0.05 * at(6), 0.12 * at(7), 0.04 * at(8));
    }
}

/// A whole dance.
pub struct Score {
    genre: &'static Genre,
    dancer: &'static Dancer,
    parts: Vec<Part>,
    beats_per_s: f64,
    amplitude: f64,
    mirrored_end: bool,
    drift: Drift,
}

impl Score {
    /// Figures in pairs, the second usually the mirror image of the first, as many as fit before the ending; at `bpm` beats
    /// per minute, or about the genre's tempo.
    pub fn new(genre: &'static Genre, dancer: &'static Dancer, bpm: Option<f64>, seconds: f64, rng: &mut Rng) -> Self {
        let own = genre.tempo_bpm * dancer.tempo * rng.range(0.98, 1.02) / 60.0;
        let wished = bpm.map_or(own, |bpm| bpm / 60.0);
        let room = (seconds - UPBEAT_S) * wished - CLOSING_BEATS;
        let mut parts: Vec<Part> = Vec::new();
        let (mut starts, mut turned) = (0.0, 0.0);
        let mut next = rng.below(genre.figures.len());
        let mut mirrored = rng.below(2) == 1;
        loop {
            for repeat in 0..2 {
                let figure = &genre.figures[next];
                // a slightly faster dance is better than standing at the end
                if starts + figure.beats > room * 1.05 {
                    let total = starts + CLOSING_BEATS;
                    let fits = wished * (total / (room + CLOSING_BEATS).max(1.0)).clamp(0.94, 1.06);
                    let beats_per_s = if bpm.is_some() { wished } else { fits };
                    let amplitude = dancer.amplitude * rng.range(0.95, 1.05);
                    let drift = Drift::new(rng);
                    return Score { genre, dancer, parts, beats_per_s, amplitude, mirrored_end: mirrored, drift };
                }
                let mirror = mirrored ^ (repeat == 1);
                let part = Part { figure, mirrored: mirror, starts, turned };
                // figures end where they began but for whole turns, which are added up
                turned = part.at(part.ends(), 1.0).turn;
                starts = part.ends();
                parts.push(part);
                if repeat == 0 && rng.below(10) < 3 {
                    break;
                }
            }
            // any figure but the one that just ended
            next = (next + 1 + rng.below(genre.figures.len() - 1)) % genre.figures.len();
            mirrored = rng.below(2) == 1;
        }
    }

    fn ends(&self) -> f64 {
        self.parts.last().map_or(0.0, Part::ends)
    }

    /// Beats elapsed at a time, with the dancer's shuffle.
    fn beat(&self, time_s: f64) -> f64 {
        let even = (time_s - UPBEAT_S) * self.beats_per_s;
        even + self.dancer.shuffle / TAU * 2.0 * (TAU * even).sin()
    }

    /// The time of a beat, seconds.
    fn time_s(&self, beat: f64) -> f64 {
        let mut even = beat;
        // the shuffle is a contraction, so a few iterations are exact to far below a frame
        for _ in 0..8 {
            even = beat - self.dancer.shuffle / TAU * 2.0 * (TAU * even).sin();
        }
        even / self.beats_per_s + UPBEAT_S
    }

    /// The beats from 0 to `seconds`, and the index of the beat on which the first figure begins.
    pub fn beats(&self, seconds: f64) -> (Vec<f64>, usize) {
        let first = self.beat(0.0).ceil();
        let all = (0..).map(|i| self.time_s(first + f64::from(i)));
        (all.skip_while(|t| *t < 0.0).take_while(|t| *t < seconds).collect(), (-first).max(0.0) as usize)
    }

    fn turned_at_end(&self) -> f64 {
        self.parts.last().map_or(0.0, |p| p.at(p.ends(), 1.0).turn)
    }

    fn closing(&self) -> Control {
        let c = (self.genre.closing)().amplified(self.amplitude.min(1.05));
        let c = if self.mirrored_end { c.mirrored() } else { c };
        Control { turn: self.turned_at_end(), ..c }
    }

    fn at_beat(&self, beat: f64) -> Control {
        let end = self.ends();
        let n = self.parts.partition_point(|p| p.starts <= beat).saturating_sub(1);
        let passage = |from: Control, to: Control, at: f64| {
            from.mix(&to, between(beat, at - 0.5 * PASSAGE_BEATS, at + 0.5 * PASSAGE_BEATS))
        };
        let mut c = match self.parts.get(n) {
            None => Control::REST,
            Some(part) => {
                let mut c = part.at(beat, self.amplitude);
                if n > 0 {
                    c = passage(self.parts[n - 1].at(beat, self.amplitude), c, part.starts);
                }
                match self.parts.get(n + 1) {
                    Some(next) => passage(c, next.at(beat, self.amplitude), next.starts),
                    None => c,
                }
            }
        };
        // out of standing within the upbeat; the heading isn't mixed, since part of a whole turn is another heading
        c = Control::REST.mix(&c, between(beat, -1.0, 0.8)).with_turn(c.turn);
        let home = Control { turn: self.turned_at_end(), ..Control::REST };
        c.mix(&home, 0.75 * between(beat, end, end + 1.6)).mix(&self.closing(), between(beat, end + 0.9, end + 3.0))
    }

    /// The controls at a time, before smoothing.
    pub fn control(&self, time_s: f64) -> Control {
        let mut c = self.at_beat(self.beat(time_s));
        let late = self.at_beat(self.beat(time_s - self.dancer.lag_s));
        (c.wrists, c.head) = (late.wrists, late.head);
        c.spine.x += self.dancer.bow;
        // breathing, and the drift that standing still would lack
        c.spine.x -= 0.012 * (TAU * 0.27 * time_s).sin();
        self.drift.add(&mut c, time_s);
        c
    }

    /// The footprint of a foot for the controls `c`.
    fn print(&self, foot: usize, c: &Control, out: f64, forward: f64) -> Footprint {
        let side = if foot == 0 { 1.0 } else { -1.0 };
        let place = Vec3::new(side * (self.dancer.stance_m + out), 0.0, 0.09 + forward);
        let toe = Vec3::new(c.travel.x, 0.0, c.travel.z) + Quat::from_rotation_y(c.turn) * place;
        Footprint { toe: Vec3::new(toe.x, 0.0, toe.z), heading: c.turn + side * 0.16 }
    }

    /// The steps of the whole dance.
    pub fn steps(&self) -> Steps {
        let mut steps = Steps::new([0, 1].map(|f| self.print(f, &Control::REST, 0.0, 0.0)));
        for part in &self.parts {
            for landing in part.figure.landings {
                let foot = if part.mirrored { 1 - landing.foot } else { landing.foot };
                let beat = part.starts + landing.beat;
                let c = part.at(beat, self.amplitude);
                steps.push(Step {
                    foot,
                    start_s: self.time_s(beat - landing.beats),
                    land_s: self.time_s(beat),
                    height_m: landing.height_m * self.amplitude,
                    to: self.print(foot, &c, landing.out * self.amplitude, landing.forward * self.amplitude),
                });
            }
        }
        let first = usize::from(self.mirrored_end);
        for (foot, beat) in [(first, 1.2), (1 - first, 2.2)] {
            let beat = self.ends() + beat;
            let to = self.print(foot, &self.closing(), 0.0, 0.0);
            let (start_s, land_s) = (self.time_s(beat - 0.8), self.time_s(beat));
            steps.push(Step { foot, start_s, land_s, height_m: 0.04, to });
        }
        steps
    }

    /// Time constant of the body's low pass, seconds.
    pub fn softness_s(&self) -> f64 {
        self.genre.softness_s * self.dancer.softness
    }

    /// Height of the hips before the figures' changes, metres.
    pub fn hip_height_m(&self) -> f64 {
        crate::smpl::STANDING_PELVIS_M - self.genre.crouch_m
    }
}
