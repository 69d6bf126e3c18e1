//! Foot contacts: detection, and the displacements that lock the feet.

use super::{BLEND_S, flatten, leg::Leg};
use crate::{Clip, Vec3};
use std::ops::Range;

/// A contact begins when a foot is below the first pair and ends when it exceeds the second: height above its standing
/// height in metres, speed in metres per second.
const BEGINS: (f64, f64) = (0.04, 0.5);
const ENDS: (f64, f64) = (0.07, 0.9);
/// Shorter contacts are ignored, seconds.
const SHORTEST_S: f64 = 0.1;
/// A foot further than this from its mean position slides on purpose or steps near the floor, metres.
const FURTHEST_M: f64 = 0.16;
/// The other joint of a locked foot may penetrate the floor by this much, metres.
const GIVES_M: f64 = 0.02;
/// A step is a peak above this multiple of the median speed; it extends over speeds above the second fraction of the peak.
const STEP: f64 = 2.0;
const IN_STEP: f64 = 0.4;

/// A range of frames in which a foot is in contact with the floor.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// 0: left, 1: right.
    pub side: usize,
    /// The first frame.
    pub from: usize,
    /// The end, exclusive.
    pub to: usize,
    /// The joint in contact: ankle or ball, whichever moves less.
    pub joint: usize,
    /// Its position x, z; metres.
    pub place: [f64; 2],
    /// Pitch correction about the ankle, toes up, radians: [`flatten::turn`].
    pub turn: f64,
}

impl Contact {
    /// The range of frames.
    pub fn frames(&self) -> Range<usize> {
        self.from..self.to
    }

    /// Keeps the first `given` frames: a contact that began in them stays at its position in the last of them.
    pub fn begin_at(&mut self, given: usize, clip: &Clip) {
        if self.from < given {
            let stood = clip.global_pose(given.min(self.to) - 1).positions[self.joint];
            self.place = [stood.x, stood.z];
            self.from = given.min(self.to);
            self.turn = 0.0;
        }
    }
}

/// The contacts of a leg in temporal order, with the floor at `floor_m`.
pub fn contacts(clip: &Clip, leg: &Leg, side: usize, floor_m: f64) -> Vec<Contact> {
    let (positions, j, frames) = (clip.positions(), clip.joints(), clip.frames());
    let at = |f: usize, joint: usize| positions[f * j + joint];
    let speed = |f: usize, joint: usize| {
        let (a, b) = (f.saturating_sub(1), (f + 1).min(frames - 1));
        if b > a { (at(b, joint) - at(a, joint)).length() * clip.fps() / (b - a) as f64 } else { 0.0 }
    };
    // the foot is in contact as long as one of its joints is
    let in_contact = |f: usize, (height, fast): (f64, f64)| {
        leg.foot.iter().any(|&(joint, rest)| at(f, joint).y - floor_m - rest < height && speed(f, joint) < fast)
    };
    let mut found: Vec<Contact> = Vec::new();
    let mut f = 0;
    while f < frames {
        if !in_contact(f, BEGINS) {
            f += 1;
            continue;
        }
        let mut from = f;
        while from > 0 && found.last().is_none_or(|c| c.to < from) && in_contact(from - 1, ENDS) {
            from -= 1;
        }
        while f < frames && in_contact(f, ENDS) {
            f += 1;
        }
        split(&|frames| best(&at, leg, (side, floor_m), frames), &speed, from..f, SHORTEST_S * clip.fps(), &mut found);
    }
    found
}

/// Adds a range as a contact. If the foot moves too far, the range is split at a step within it, if there is one.
fn split(
    fit: &dyn Fn(Range<usize>) -> Option<(f64, Contact)>,
    speed: &dyn Fn(usize, usize) -> f64,
    frames: Range<usize>,
    shortest: f64,
    found: &mut Vec<Contact>,
) {
    if (frames.len() as f64) < shortest.max(2.0) {
        return;
    }
    let Some((spread, contact)) = fit(frames.clone()) else { return };
    if spread <= FURTHEST_M {
        found.push(contact);
        return;
    }
    let speeds: Vec<f64> = frames.clone().map(|f| speed(f, contact.joint)).collect();
    let mut sorted = speeds.clone();
    sorted.sort_by(f64::total_cmp);
    let Some(fastest) = (0..speeds.len()).max_by(|&a, &b| speeds[a].total_cmp(&speeds[b])) else { return };
    let peak = speeds[fastest];
    if peak < STEP * sorted[sorted.len() / 2] {
        return;
    }
    let in_step = |i: &usize| speeds[*i] > IN_STEP * peak;
    let first = (0..fastest).rev().find(|i| !in_step(i)).map_or(0, |i| i + 1);
    let last = (fastest..speeds.len()).find(|i| !in_step(i)).unwrap_or(speeds.len());
    split(fit, speed, frames.start..frames.start + first, shortest, found);
    split(fit, speed, frames.start + last..frames.end, shortest, found);
}

/// The foot joint that moves least during contact, and its largest distance from its mean position.
fn best(
    at: &dyn Fn(usize, usize) -> Vec3,
    leg: &Leg,
    (side, floor_m): (usize, f64),
    frames: Range<usize>,
) -> Option<(f64, Contact)> {
    let of = |&(joint, rest): &(usize, f64)| {
        let least = frames.clone().map(|f| at(f, joint).y).fold(f64::MAX, f64::min);
        // toes in the air move as little as the heel on the floor: only joints near the floor count
        (least - floor_m - rest < ENDS.0).then(|| {
            let mean = frames.clone().map(|f| at(f, joint)).sum::<Vec3>() / frames.len() as f64;
            let distance = |f: usize| (at(f, joint).x - mean.x).hypot(at(f, joint).z - mean.z);
            let furthest = frames.clone().map(distance).fold(0.0, f64::max);
            let place = [mean.x, mean.z];
            (furthest, Contact { side, from: frames.start, to: frames.end, joint, place, turn: 0.0 })
        })
    };
    leg.foot.iter().filter_map(of).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Displacement and pitch correction of a foot, (F) each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Moves {
    /// Displacement of the ankle, metres.
    pub by: Vec<Vec3>,
    /// Pitch correction about the ankle, toes up, radians.
    pub turn: Vec<f64>,
}

/// The corrections of a leg's foot: to its locked position in contacts, out of the floor elsewhere, blended over
/// [`BLEND_S`]. The first `given` frames stay.
pub fn moves(clip: &Clip, leg: &Leg, contacts: &[Contact], (floor_m, given): (f64, usize)) -> Moves {
    let (positions, j, frames) = (clip.positions(), clip.joints(), clip.frames());
    let at = |f: usize, joint: usize| positions[f * j + joint];
    // position of a foot joint after the pitch correction
    let turned = |f: usize, joint: usize, turn: f64| {
        let foot = at(f, joint) - at(f, leg.ankle);
        at(f, leg.ankle) + flatten::toes_up(foot, turn) * foot
    };
    let mut out = Moves { by: vec![Vec3::ZERO; frames], turn: vec![0.0; frames] };
    let mut locked: Vec<bool> = (0..frames).map(|f| f < given).collect();
    for contact in contacts {
        let [x, z] = contact.place;
        let least = |&(joint, rest): &(usize, f64)| {
            let heights = contact.frames().map(|f| turned(f, joint, contact.turn).y - rest);
            heights.fold(f64::MAX, f64::min) + if joint == contact.joint { 0.0 } else { GIVES_M }
        };
        let lowest = leg.foot.iter().map(least).fold(f64::MAX, f64::min);
        for f in contact.frames() {
            let by = Vec3::new(x, 0.0, z) - turned(f, contact.joint, contact.turn);
            out.by[f] = Vec3::new(by.x, floor_m - lowest, by.z);
            out.turn[f] = contact.turn;
            locked[f] = true;
        }
    }
    let n = ((BLEND_S * clip.fps()).round() as usize).max(1);
    let before: Vec<Option<usize>> = frames_since_locked(locked.iter().copied());
    let mut after: Vec<Option<usize>> = frames_since_locked(locked.iter().rev().copied());
    after.reverse();
    let ends = out.clone();
    let end = |f: usize| (ends.by[f], ends.turn[f]);
    for f in (0..frames).filter(|&f| !locked[f]) {
        let a = before[f].map(|back| (back, end(f - back)));
        let b = after[f].map(|next| (next, end(f + next)));
        (out.by[f], out.turn[f]) = match (a, b) {
            // blend between two contacts that are near each other
            (Some((i, a)), Some((k, b))) if i + k <= 2 * n => {
                let t = smooth(i as f64 / (i + k) as f64);
                (a.0 * (1.0 - t) + b.0 * t, a.1 * (1.0 - t) + b.1 * t)
            }
            (a, b) => {
                let near = [a, b].into_iter().flatten().filter(|(i, _)| *i <= n);
                near.fold((Vec3::ZERO, 0.0), |sum, (i, (by, turn))| {
                    let share = 1.0 - smooth(i as f64 / (n + 1) as f64);
                    (sum.0 + by * share, sum.1 + turn * share)
                })
            }
        };
        // lift what would penetrate the floor
        let height = |&(joint, rest): &(usize, f64)| turned(f, joint, out.turn[f]).y + out.by[f].y - floor_m - rest;
        let lowest = leg.foot.iter().map(height).fold(f64::MAX, f64::min);
        out.by[f].y += (-lowest).max(0.0);
    }
    out
}

/// For each frame, how many frames ago the last locked one was.
fn frames_since_locked(locked: impl Iterator<Item = bool>) -> Vec<Option<usize>> {
    let mut back = None;
    locked
        .map(|locked| {
            back = if locked { Some(0) } else { back.map(|b: usize| b + 1) };
            back
        })
        .collect()
}

/// Smoothstep: from 0 to 1 with zero slope at both ends.
pub(super) fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}
