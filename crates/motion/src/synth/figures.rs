//! The dance figures of each genre, which last a few beats.
//!
//! A figure is a function from beats to a [`Control`], with a list of steps. It starts and ends at the same controls up to
//! whole turns, so that any figure can follow any other, mirrored or not.

use super::control::Control;
use crate::Vec3;
use std::f64::consts::{PI, TAU};

/// A step: `foot` (0 left, 1 right) lands on `beat` after a flight of `beats`, rising by `height_m`, `out` metres further
/// outward and `ahead` metres further forward than its standing position.
#[derive(Debug, Clone, Copy)]
pub struct Landing {
    pub foot: usize,
    pub beat: f64,
    pub beats: f64,
    pub height_m: f64,
    pub out: f64,
    pub forward: f64,
}

/// A dance figure.
pub struct Figure {
    pub beats: f64,
    pub at: fn(f64) -> Control,
    pub landings: &'static [Landing],
}

/// A genre of dance.
pub struct Genre {
    pub name: &'static str,
    /// Beats per minute, before the dancer's own tempo.
    pub tempo_bpm: f64,
    /// Time constant of the low pass, seconds; small is sharp.
    pub softness_s: f64,
    /// How far the hips are below standing height, metres.
    pub crouch_m: f64,
    pub figures: &'static [Figure],
    /// The final pose.
    pub closing: fn() -> Control,
}

/// All genres.
pub const GENRES: [Genre; 4] = [
    // three beats per bar, drifting from side to side
    Genre {
        name: "sway",
        tempo_bpm: 92.0,
        softness_s: 0.16,
        crouch_m: 0.035,
        figures: &[
            Figure { beats: 6.0, at: sway_drift, landings: DRIFT_STEPS },
            Figure { beats: 6.0, at: sway_reach, landings: LUNGE_STEPS },
            Figure { beats: 6.0, at: sway_circle, landings: ROCK_STEPS },
        ],
        closing: || Control {
            wrists: [Vec3::new(0.25, 0.85, 0.2), Vec3::new(0.65, -0.45, 0.3)],
            spine: Vec3::new(-0.06, 0.1, 0.14),
            head: Vec3::new(-0.2, 0.25, 0.0),
            ..Control::REST
        },
    },
    // a step on every beat, knees high, fists
    Genre {
        name: "stomp",
        tempo_bpm: 104.0,
        softness_s: 0.055,
        crouch_m: 0.075,
        figures: &[
            Figure { beats: 8.0, at: stomp_march, landings: MARCH_STEPS },
            Figure { beats: 8.0, at: stomp_wide, landings: WIDE_STEPS },
            Figure { beats: 8.0, at: stomp_drive, landings: DRIVE_STEPS },
        ],
        closing: || Control {
            wrists: [Vec3::new(0.5, -0.62, 0.35); 2],
            travel: Vec3::new(0.0, -0.03, 0.0),
            spine: Vec3::new(-0.12, 0.0, 0.0),
            head: Vec3::new(-0.08, 0.0, 0.0),
            ..Control::REST
        },
    },
    // feet almost still, a movement running through the body
    Genre {
        name: "wave",
        tempo_bpm: 84.0,
        softness_s: 0.10,
        crouch_m: 0.055,
        figures: &[
            Figure { beats: 8.0, at: wave_ripple, landings: SETTLE_STEPS },
            Figure { beats: 8.0, at: wave_roll, landings: SETTLE_STEPS },
            Figure { beats: 8.0, at: wave_wings, landings: SIDE_STEPS },
        ],
        closing: || Control {
            wrists: [Vec3::new(0.68, 0.1, 0.42), Vec3::new(0.68, -0.1, 0.42)],
            spine: Vec3::new(0.03, 0.0, 0.0),
            head: Vec3::new(-0.1, 0.0, 0.0),
            ..Control::REST
        },
    },
    // turns on the ball of the foot, arms open and closed
    Genre {
        name: "spin",
        tempo_bpm: 112.0,
        softness_s: 0.09,
        crouch_m: 0.035,
        figures: &[
            Figure { beats: 8.0, at: spin_turn, landings: TURN_STEPS },
            Figure { beats: 8.0, at: spin_chase, landings: CHASE_STEPS },
            Figure { beats: 8.0, at: spin_paddle, landings: PADDLE_STEPS },
        ],
        closing: || Control {
            wrists: [Vec3::new(0.2, 0.92, 0.12), Vec3::new(0.85, 0.08, 0.25)],
            spine: Vec3::new(-0.1, -0.15, 0.06),
            head: Vec3::new(-0.15, 0.35, 0.0),
            ..Control::REST
        },
    },
];

/// A sine wave of period 1 in `turns`.
fn wave(turns: f64) -> f64 {
    (TAU * turns).sin()
}

/// A smooth step from 0 to 1 while `beat` goes from `a` to `b`.
pub fn between(beat: f64, a: f64, b: f64) -> f64 {
    let t = ((beat - a) / (b - a)).clamp(0.0, 1.0);
    t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
}

/// 1 on every beat, 0 between; sharper with a larger `power`.
fn pulse(beat: f64, power: i32) -> f64 {
    (0.5 + 0.5 * (TAU * beat).cos()).powi(power)
}

fn v(x: f64, y: f64, z: f64) -> Vec3 {
    Vec3::new(x, y, z)
}

const fn land(foot: usize, beat: f64, beats: f64, height_m: f64, out: f64, forward: f64) -> Landing {
    Landing { foot, beat, beats, height_m, out, forward }
}

const DRIFT_STEPS: &[Landing] = &[
    land(0, 1.0, 0.9, 0.05, 0.0, 0.0),
    land(1, 2.0, 0.8, 0.04, -0.02, 0.0),
    land(1, 4.0, 0.9, 0.05, 0.0, 0.0),
    land(0, 5.0, 0.8, 0.04, -0.02, 0.0),
];

fn sway_drift(b: f64) -> Control {
    let (side, late) = (wave((b - 0.4) / 6.0), wave((b - 1.0) / 6.0));
    Control {
        wrists: [v(0.62 + 0.12 * side, 0.08 + 0.5 * late, 0.3), v(0.62 - 0.12 * side, 0.08 - 0.5 * late, 0.3)],
        travel: v(0.3 * (between(b, 0.0, 1.2) - between(b, 3.0, 4.2)), 0.025 * wave(b / 3.0 - 0.4), 0.0),
        shift: v(0.05 * side, 0.0, 0.02 * late),
        hips: v(0.0, 0.08 * late, 0.07 * side),
        spine: v(0.03, 0.18 * late, -0.17 * late),
        head: v(0.06 * wave(b / 3.0), 0.2 * side, -0.16 * wave((b - 1.5) / 6.0)),
        ..Control::REST
    }
}

const LUNGE_STEPS: &[Landing] = &[land(1, 1.0, 0.9, 0.05, 0.16, 0.04), land(1, 5.0, 1.2, 0.04, 0.0, 0.0)];

fn sway_reach(b: f64) -> Control {
    // the left arm rises by the side, passes over the head and comes down in front
    let up = between(b, 0.0, 2.4) - between(b, 3.2, 5.8);
    let over = between(b, 1.6, 3.2) - between(b, 4.0, 5.8);
    Control {
        wrists: [
            v(0.45 + 0.35 * (PI * up).sin() - 0.62 * over, -0.7 + 1.5 * up, 0.2 + 0.12 * over),
            v(0.4 - 0.25 * over, -0.7 + 0.35 * over, 0.25 + 0.25 * over),
        ],
        travel: v(0.0, -0.05 * up, 0.0),
        shift: v(-0.04 * over, 0.0, 0.0),
        hips: v(0.0, -0.1 * over, -0.05 * over),
        spine: v(0.02 + 0.05 * over, -0.2 * over, 0.34 * over),
        head: v(-0.12 * up, 0.3 * over, 0.1 * over),
        ..Control::REST
    }
}

const ROCK_STEPS: &[Landing] = &[land(0, 1.0, 0.9, 0.05, 0.0, 0.24), land(0, 4.0, 0.9, 0.05, 0.0, 0.0)];

fn sway_circle(b: f64) -> Control {
    let (s, c) = (wave(b / 6.0), wave(b / 6.0 + 0.25));
    let rise = 0.5 - 0.5 * c;
    Control {
        wrists: [
            v(0.42 + 0.3 * s, 0.05 + 0.6 * rise, 0.42 + 0.22 * c),
            v(0.42 - 0.3 * s, -0.05 + 0.6 * rise, 0.42 + 0.22 * c),
        ],
        travel: v(0.0, -0.02 - 0.03 * wave(b / 3.0), 0.0),
        shift: v(0.03 * s, 0.0, 0.08 * (between(b, 0.6, 2.0) - between(b, 3.2, 4.6))),
        hips: v(0.05 * c, 0.1 * s, 0.05 * s),
        spine: v(0.13 * c, 0.12 * s, -0.16 * s),
        head: v(0.12 * wave((b - 0.5) / 6.0 + 0.25), 0.15 * s, -0.1 * wave((b - 0.5) / 6.0)),
        ..Control::REST
    }
}

const MARCH_STEPS: &[Landing] = &[
    land(1, 1.0, 0.72, 0.24, 0.02, 0.0),
    land(0, 2.0, 0.72, 0.24, 0.02, 0.0),
    land(1, 3.0, 0.72, 0.24, 0.02, 0.0),
    land(0, 4.0, 0.72, 0.24, 0.02, 0.0),
    land(1, 5.0, 0.72, 0.24, 0.02, 0.0),
    land(0, 6.0, 0.72, 0.24, 0.02, 0.0),
    land(1, 7.0, 0.72, 0.24, 0.02, 0.0),
    land(0, 8.0, 0.72, 0.24, 0.02, 0.0),
];

fn stomp_march(b: f64) -> Control {
    // the left foot is in the air before even beats, together with the right arm
    let s = wave(b / 2.0 - 0.12);
    let arm = |s: f64| v(0.34 - 0.08 * s, -0.28 + 0.42 * s, 0.5 + 0.12 * s);
    Control {
        wrists: [arm(s), arm(-s)],
        travel: v(0.0, -0.055 * pulse(b - 0.06, 2), 0.0),
        hips: v(0.05, -0.12 * s, 0.05 * s),
        spine: v(0.1 + 0.08 * pulse(b, 2), 0.22 * s, 0.0),
        head: v(-0.08 + 0.12 * pulse(b - 0.1, 2), -0.08 * s, 0.0),
        ..Control::REST
    }
}

const WIDE_STEPS: &[Landing] = &[
    land(1, 1.0, 0.7, 0.12, 0.14, 0.0),
    land(0, 2.0, 0.7, 0.12, 0.14, 0.0),
    land(0, 7.0, 0.7, 0.14, 0.02, 0.0),
    land(1, 8.0, 0.7, 0.14, 0.02, 0.0),
];

fn stomp_wide(b: f64) -> Control {
    // four throws: in on the half beat, out on the beat
    let down = between(b, 1.2, 2.2) - between(b, 6.0, 7.0);
    let out = down * (0.5 + 0.5 * wave(b + 0.25));
    let tilt = down * wave((b - 2.0) / 4.0 + 0.25);
    Control {
        wrists: [
            v(0.12 + 0.72 * out, -0.2 + 0.2 * down + 0.25 * tilt, 0.58 - 0.4 * out),
            v(0.12 + 0.72 * out, -0.2 + 0.2 * down - 0.25 * tilt, 0.58 - 0.4 * out),
        ],
        travel: v(0.0, -0.1 * down - 0.045 * pulse(b - 0.05, 2), 0.0),
        shift: v(0.07 * tilt, 0.0, 0.0),
        hips: v(0.1 * down, 0.0, 0.05 * tilt),
        spine: v(0.12 + 0.12 * (1.0 - out) * down, 0.1 * tilt, -0.12 * tilt),
        head: v(-0.1 * down, 0.1 * tilt, 0.0),
        ..Control::REST
    }
}

const DRIVE_STEPS: &[Landing] = &[
    land(1, 1.0, 0.7, 0.16, 0.0, 0.0),
    land(0, 2.0, 0.7, 0.16, 0.0, 0.0),
    land(1, 3.0, 0.7, 0.22, 0.02, 0.0),
    land(0, 4.0, 0.7, 0.22, 0.02, 0.0),
    land(1, 6.0, 0.7, 0.12, 0.0, 0.0),
    land(0, 7.0, 0.7, 0.12, 0.0, 0.0),
];

fn stomp_drive(b: f64) -> Control {
    // forward, fists up on four, back again
    let fists = between(b, 3.4, 4.0) - between(b, 5.2, 6.2);
    let s = wave(b / 2.0 - 0.12) * (1.0 - fists);
    let arm = |s: f64| v(0.34 + 0.05 * fists, -0.25 + 0.36 * s + 0.95 * fists, 0.5 - 0.3 * fists);
    Control {
        wrists: [arm(s), arm(-s)],
        travel: v(0.0, -0.05 * pulse(b - 0.05, 2), 0.4 * (between(b, 0.0, 2.0) - between(b, 5.0, 7.0))),
        hips: v(0.06, -0.1 * s, 0.03 * s),
        spine: v(0.14 - 0.24 * fists, 0.18 * s, 0.0),
        head: v(-0.05 - 0.2 * fists, 0.0, 0.0),
        ..Control::REST
    }
}

const SETTLE_STEPS: &[Landing] = &[land(0, 1.0, 0.8, 0.035, 0.07, 0.0), land(0, 8.0, 0.8, 0.035, 0.0, 0.0)];

fn wave_ripple(b: f64) -> Control {
    // the wave enters at the left hand and leaves at the right one two beats later
    let at = |lag: f64| wave((b - lag) / 4.0);
    let on = between(b, 0.0, 1.5) - between(b, 6.8, 8.0);
    let arm = |lag: f64| v(0.3 + 0.54 * on, -0.6 + 0.68 * on + 0.36 * on * at(lag), 0.22 + 0.1 * at(lag + 0.6));
    Control {
        wrists: [arm(0.0), arm(2.0)],
        travel: v(0.0, -0.025 + 0.025 * at(1.0), 0.0),
        shift: v(-0.05 * at(1.0), 0.0, 0.0),
        hips: v(0.0, 0.0, 0.07 * at(1.6)),
        spine: v(0.0, 0.1 * at(0.8), 0.2 * at(0.6)),
        head: v(0.0, 0.28 * wave((b - 0.4) / 4.0 + 0.25), 0.12 * at(1.4)),
        ..Control::REST
    }
}

fn wave_roll(b: f64) -> Control {
    // knees, hips, chest, head, hands, one after the other
    let at = |lag: f64| wave((b - lag) / 4.0);
    let on = between(b, 0.0, 1.2) - between(b, 6.8, 8.0);
    let hand = |side: f64| {
        v(0.22 + 0.1 * at(2.2), -0.45 + 0.5 * on + 0.42 * on * at(1.6 + side), 0.3 + 0.36 * on + 0.14 * at(0.9))
    };
    Control {
        wrists: [hand(0.0), hand(0.25)],
        travel: v(0.0, -0.05 - 0.05 * at(0.0), 0.0),
        shift: v(0.0, 0.0, 0.055 * at(0.4)),
        hips: v(-0.2 * at(0.7), 0.0, 0.0),
        spine: v(0.06 - 0.34 * at(1.3), 0.0, 0.0),
        head: v(-0.28 * at(1.8), 0.0, 0.0),
        ..Control::REST
    }
}

const SIDE_STEPS: &[Landing] = &[
    land(0, 1.0, 0.9, 0.04, 0.0, 0.0),
    land(1, 3.0, 0.9, 0.04, 0.0, 0.0),
    land(1, 5.0, 0.9, 0.04, 0.0, 0.0),
    land(0, 7.0, 0.9, 0.04, 0.0, 0.0),
];

fn wave_wings(b: f64) -> Control {
    // down and up with the arms as wings, once in each direction
    let open = 0.5 - 0.5 * wave(b / 4.0 + 0.25);
    let late = 0.5 - 0.5 * wave((b - 0.4) / 4.0 + 0.25);
    let side = between(b, 0.0, 2.8) - between(b, 4.0, 6.8);
    let wing = v(0.38 + 0.5 * (PI * open).sin(), -0.62 + 1.38 * open, 0.25 + 0.08 * late);
    Control {
        wrists: [wing, v(wing.x, -0.62 + 1.38 * late, wing.z)],
        travel: v(0.24 * side, -0.11 + 0.11 * late, 0.0),
        hips: v(0.12 * (1.0 - late), 0.0, 0.0),
        spine: v(0.18 - 0.3 * late, 0.0, 0.08 * wave(b / 8.0)),
        head: v(0.12 - 0.3 * late, 0.2 * wave(b / 8.0), 0.0),
        ..Control::REST
    }
}

const TURN_STEPS: &[Landing] = &[
    land(1, 1.0, 0.7, 0.05, -0.01, 0.0),
    land(0, 2.0, 0.7, 0.05, -0.01, 0.0),
    land(1, 3.0, 0.7, 0.05, -0.01, 0.0),
    land(0, 4.0, 0.7, 0.05, -0.01, 0.0),
    land(1, 5.0, 0.8, 0.06, 0.16, -0.04),
    land(1, 7.0, 0.9, 0.05, 0.0, 0.0),
];

fn spin_turn(b: f64) -> Control {
    // the arms wind up to the right, close for the turn, and open on the side step
    let wind = between(b, 0.0, 0.4) - between(b, 0.5, 1.2);
    let closed = between(b, 1.0, 2.0) - between(b, 3.4, 4.4);
    let open = between(b, 4.0, 5.2) - between(b, 6.4, 8.0);
    let arm = |up: f64| v(0.78 - 0.72 * closed + 0.04 * open, 0.02 - 0.14 * closed + up * open, 0.28 + 0.24 * closed);
    Control {
        wrists: [arm(0.62) - v(0.45, 0.0, -0.3) * wind - v(0.4, 0.0, 0.0) * open, arm(0.1) + v(0.05, 0.1, -0.3) * wind],
        travel: v(0.0, 0.015 * closed - 0.05 * wind - 0.05 * open, 0.0),
        turn: TAU * between(b, 0.4, 4.4),
        shift: v(-0.03 * open, 0.0, 0.0),
        spine: v(0.0, -0.35 * wind + 0.15 * open, 0.16 * open),
        // spotting: the head lags at first, then leads to the front
        head: v(
            -0.05,
            -0.5 * (between(b, 0.4, 1.6) - between(b, 1.8, 2.6)) + 0.5 * (between(b, 2.0, 2.9) - between(b, 3.4, 4.4))
                - 0.35 * open,
            0.0,
        ),
        ..Control::REST
    }
}

const CHASE_STEPS: &[Landing] = &[
    land(0, 1.0, 0.7, 0.05, 0.0, 0.02),
    land(1, 2.0, 0.7, 0.05, -0.02, 0.0),
    land(0, 3.0, 0.7, 0.05, 0.0, 0.02),
    land(1, 4.0, 0.7, 0.05, -0.02, 0.0),
    land(1, 5.0, 0.7, 0.05, 0.0, 0.02),
    land(0, 6.0, 0.7, 0.05, -0.02, 0.0),
    land(1, 7.0, 0.7, 0.05, 0.0, 0.02),
    land(0, 8.0, 0.7, 0.05, -0.02, 0.0),
];

fn spin_chase(b: f64) -> Control {
    // a three-step turn to the left and back while the arms describe a large circle
    let (s, c) = (wave(b / 4.0), wave(b / 4.0 + 0.25));
    let path = between(b, 0.0, 3.4) - between(b, 4.0, 7.4);
    let lean = wave(b / 8.0);
    Control {
        wrists: [v(0.42 + 0.36 * s, 0.12 - 0.55 * c, 0.4), v(0.42 - 0.36 * s, 0.12 - 0.55 * c, 0.4)],
        travel: v(0.55 * path, -0.02 - 0.02 * (TAU * b).cos(), 0.0),
        turn: TAU * (between(b, 0.1, 3.5) - between(b, 4.1, 7.5)),
        hips: v(0.0, 0.15 * lean, 0.05 * wave(b / 2.0)),
        spine: v(0.02, 0.2 * s, -0.14 * s),
        head: v(-0.05, 0.25 * lean, -0.08 * s),
        ..Control::REST
    }
}

const PADDLE_STEPS: &[Landing] = &[
    land(0, 1.0, 0.8, 0.05, 0.08, 0.05),
    land(0, 3.0, 0.8, 0.05, 0.08, 0.05),
    land(0, 5.0, 0.8, 0.05, 0.08, 0.05),
    land(0, 7.0, 0.8, 0.05, 0.0, 0.0),
];

fn spin_paddle(b: f64) -> Control {
    // around the right foot, pushed by the left: a quarter turn every two beats
    let turn = (0..4).map(|i| between(b, 2.0 * f64::from(i) + 0.1, 2.0 * f64::from(i) + 1.6)).sum::<f64>() / 4.0;
    let sweep = wave(b / 2.0 - 0.2);
    Control {
        wrists: [v(0.7 + 0.1 * sweep, 0.12 + 0.2 * sweep, 0.3 - 0.15 * sweep), v(0.3, 0.78 + 0.06 * sweep, 0.15)],
        travel: v(0.0, -0.02 - 0.03 * wave(b / 2.0), 0.0),
        turn: -TAU * turn,
        hips: v(0.0, -0.12 * sweep, 0.05 * sweep),
        spine: v(0.0, -0.16 * sweep, 0.1),
        head: v(-0.05, -0.3 * sweep, 0.0),
        ..Control::REST
    }
}
