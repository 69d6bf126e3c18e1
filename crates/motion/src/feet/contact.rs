//! Foot contacts: detection, and the displacements that lock the feet.

use super::{BLEND_S, Begins, flatten, track::FootTrack};
use crate::{Quat, Vec3};
use std::ops::Range;

/// A contact begins when a foot is below the first pair and ends when it exceeds the second: height above its standing
/// height in metres, speed in metres per second.
const BEGINS: (f64, f64) = (0.04, 0.5);
const ENDS: (f64, f64) = (0.07, 0.9);
/// Shorter contacts are ignored, seconds.
const SHORTEST_S: f64 = 0.1;
/// A foot further than this from its mean position slides on purpose or steps near the floor, metres.
const FURTHEST_M: f64 = 0.16;
/// The other joint of a locked foot may penetrate the floor by this much, metres; the end of a toe, which has no flesh below
/// it, may not.
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
    /// The point in contact: ankle, ball or end of a toe, whichever moves least.
    pub point: usize,
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

    /// Leaves the first `given` frames unchanged: a contact that began in them stays at its position in the last of them.
    pub fn begin_at(&mut self, given: usize, track: &FootTrack) {
        if self.from < given {
            let stood = track.at(given.min(self.to) - 1, self.point);
            self.place = [stood.x, stood.z];
            self.from = given.min(self.to);
            self.turn = 0.0;
        }
    }
}

/// The contacts of a foot (`side` 0: left, 1: right) in temporal order, with the floor at `floor_m`.
pub fn contacts(track: &FootTrack, side: usize, floor_m: f64) -> Vec<Contact> {
    let frames = track.frames();
    let at = |f: usize, point: usize| track.at(f, point);
    let speed = |f: usize, point: usize| {
        let (a, b) = (f.saturating_sub(1), (f + 1).min(frames - 1));
        if b > a { (at(b, point) - at(a, point)).length() * track.fps / (b - a) as f64 } else { 0.0 }
    };
    // the foot is in contact as long as one of its points is
    let in_contact = |f: usize, (height, fast): (f64, f64)| {
        track.leg.points().any(|(point, rest)| at(f, point).y - floor_m - rest < height && speed(f, point) < fast)
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
        // ENDS is the looser pair, so the frame that began the contact passes too, and `f` advances
        while f < frames && in_contact(f, ENDS) {
            f += 1;
        }
        split(&|frames| best(track, side, floor_m, frames), &speed, from..f, SHORTEST_S * track.fps, &mut found);
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
    let speeds: Vec<f64> = frames.clone().map(|f| speed(f, contact.point)).collect();
    let mut sorted = speeds.clone();
    sorted.sort_by(f64::total_cmp);
    // of equally fast steps the middle one: taken off one by one, those of a repeated dance would take quadratic time
    let from_end = |i: usize| i.min(speeds.len() - i);
    let by_speed = |&a: &usize, &b: &usize| speeds[a].total_cmp(&speeds[b]).then(from_end(a).cmp(&from_end(b)));
    let Some(fastest) = (0..speeds.len()).max_by(by_speed) else { return };
    let peak = speeds[fastest];
    // without a clear step the foot glides the whole time: dropping it is right, a lock would drag the body
    if peak < STEP * sorted[sorted.len() / 2] {
        return;
    }
    let in_step = |i: &usize| speeds[*i] > IN_STEP * peak;
    let first = (0..fastest).rev().find(|i| !in_step(i)).map_or(0, |i| i + 1);
    let last = (fastest..speeds.len()).find(|i| !in_step(i)).unwrap_or(speeds.len());
    split(fit, speed, frames.start..frames.start + first, shortest, found);
    split(fit, speed, frames.start + last..frames.end, shortest, found);
}

/// The point of the foot that moves least during contact, and its largest distance from its mean position.
fn best(track: &FootTrack, side: usize, floor_m: f64, frames: Range<usize>) -> Option<(f64, Contact)> {
    let of = |(point, rest): (usize, f64)| {
        let at = |f: usize| track.at(f, point);
        let least = frames.clone().map(|f| at(f).y).fold(f64::MAX, f64::min);
        // toes in the air move as little as the heel on the floor: only points near the floor count
        (least - floor_m - rest < ENDS.0).then(|| {
            let mean = frames.clone().map(at).sum::<Vec3>() / frames.len() as f64;
            let distance = |f: usize| (at(f).x - mean.x).hypot(at(f).z - mean.z);
            let furthest = frames.clone().map(distance).fold(0.0, f64::max);
            let place = [mean.x, mean.z];
            (furthest, Contact { side, from: frames.start, to: frames.end, point, place, turn: 0.0 })
        })
    };
    track.leg.points().filter_map(of).min_by(|a, b| a.0.total_cmp(&b.0))
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
/// [`BLEND_S`]. Given frames stay.
pub(super) fn moves(track: &FootTrack, contacts: &[Contact], floor_m: f64, begins: Begins) -> Moves {
    let (leg, frames, given) = (track.leg, track.frames(), begins.frames);
    // position of a point of the foot after the pitch correction
    let turned = |f: usize, point: usize, turn: f64| {
        let ankle = track.at(f, leg.ankle);
        let turn = track.sole(f).map_or(Quat::IDENTITY, |sole| flatten::toes_up(sole, turn));
        ankle + turn * (track.at(f, point) - ankle)
    };
    // the end of a toe that is in the floor where given frames end comes out of it gradually
    let stood = |&(toe, rest): &(usize, f64)| {
        let last = given.checked_sub(1).filter(|last| *last < frames);
        last.map_or(0.0, |last| (floor_m + rest - track.at(last, toe).y).max(0.0))
    };
    let toes: Vec<(usize, f64, f64)> = leg.toes.iter().map(|toe| (toe.0, toe.1, stood(toe))).collect();
    let mut out = Moves { by: vec![Vec3::ZERO; frames], turn: vec![0.0; frames] };
    let mut locked: Vec<bool> = (0..frames).map(|f| f < given).collect();
    for contact in contacts {
        let [x, z] = contact.place;
        let least = |(point, rest, gives): (usize, f64, f64)| {
            let heights = contact.frames().map(|f| turned(f, point, contact.turn).y - rest);
            heights.fold(f64::MAX, f64::min) + gives
        };
        let joint = |&(joint, rest)| (joint, rest, if joint == contact.point { 0.0 } else { GIVES_M });
        let toe = |&(toe, rest, stood)| (toe, rest, if contact.from == given { stood } else { 0.0 });
        let points = leg.foot.iter().map(joint).chain(toes.iter().map(toe));
        let lowest = points.map(least).fold(f64::MAX, f64::min);
        for f in contact.frames() {
            let by = Vec3::new(x, 0.0, z) - turned(f, contact.point, contact.turn);
            out.by[f] = Vec3::new(by.x, floor_m - lowest, by.z);
            out.turn[f] = contact.turn;
            locked[f] = true;
        }
    }
    let n = ((BLEND_S * track.fps).round() as usize).max(1);
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
    }
    // lift what would penetrate the floor, for the ends of toes in bumps: they touch it so often that the knees would jerk
    let mut deep = vec![0.0f64; frames];
    for f in (0..frames).filter(|&f| !locked[f]) {
        let height = |point: usize, rest: f64, by: Vec3| turned(f, point, out.turn[f]).y + by.y - floor_m - rest;
        let lowest = leg.foot.iter().map(|&(joint, rest)| height(joint, rest, out.by[f])).fold(f64::MAX, f64::min);
        let by = out.by[f] + Vec3::Y * (-lowest).max(0.0);
        let tolerated = 1.0 - begins.share(f);
        let depths = toes.iter().map(|&(toe, rest, stood)| -height(toe, rest, by) - tolerated * stood);
        (out.by[f], deep[f]) = (by, depths.fold(0.0, f64::max));
    }
    let room = |f: usize| [before[f], after[f]].into_iter().flatten().fold(n, usize::min);
    out.by.iter_mut().zip(bumps(&deep, room)).for_each(|(by, lift)| by.y += lift);
    out
}

/// The maximum (F) of smooth bumps, one at each frame, of these heights and half as wide as `room` says, frames.
fn bumps(heights: &[f64], room: impl Fn(usize) -> usize) -> Vec<f64> {
    let mut out = vec![0.0f64; heights.len()];
    for (f, height) in heights.iter().enumerate().filter(|(_, height)| **height > 0.0) {
        let room = room(f);
        let first = (f + 1).saturating_sub(room);
        for g in first..(f + room).min(out.len()) {
            out[g] = out[g].max(height * smooth(1.0 - f.abs_diff(g) as f64 / room as f64));
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bumps_are_high_enough_and_end_where_they_must() {
        let heights = [0.0, 0.0, 0.01, 0.03, 0.01, 0.0, 0.0, 0.0, 0.02, 0.0];
        // two frames to either side, the last bump none
        let lifts = bumps(&heights, |f| if f == 8 { 1 } else { 3 });
        assert!(lifts.iter().zip(heights).all(|(lift, height)| *lift >= height), "{lifts:?}");
        assert_eq!((lifts[7], lifts[8], lifts[9]), (0.0, 0.02, 0.0), "{lifts:?}");
        assert!(lifts[..4].is_sorted() && lifts[3..8].is_sorted_by(|a, b| a >= b), "{lifts:?}");
    }

    #[test]
    fn many_steps_alike_are_split_in_linear_time_but_for_a_logarithm() {
        // a foot that glides on by a step in every second, each as fast as the others
        let fit = |fitted: &std::cell::Cell<usize>, frames: Range<usize>| {
            fitted.set(fitted.get() + frames.len());
            let steps = (frames.end - 1) / 20 - frames.start / 20;
            let contact = Contact { side: 0, from: frames.start, to: frames.end, point: 0, place: [0.0; 2], turn: 0.0 };
            Some((0.1 + 0.2 * steps as f64, contact))
        };
        let speed = |f: usize, _: usize| if f.is_multiple_of(20) { 0.8 } else { 0.01 };
        for seconds in [64, 512] {
            let (fitted, mut found) = (std::cell::Cell::new(0), Vec::new());
            split(&|frames| fit(&fitted, frames), &speed, 0..20 * seconds, 2.0, &mut found);
            assert_eq!(found.len(), seconds);
            assert!(fitted.get() < 20 * seconds * 12, "{} frames in {seconds} s", fitted.get());
        }
    }
}
