//! The straight line through two clips along which they are nearest: a lag and a tempo.

use super::body::BodyPoses;
use rayon::prelude::*;
use std::ops::Range;

/// The tempo of the student over the teacher's.
pub const TEMPI: [f64; 2] = [0.8, 1.25];
/// Frames from one line to the next of the first search, at either end.
const COARSE: i64 = 2;
/// Frames along a line that are measured in the first search.
const SAMPLES: usize = 400;

/// The student's frames at the teacher's first and last frame; they may be outside the clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    first: i64,
    last: i64,
    /// F of the teacher.
    frames: usize,
}

impl Line {
    /// Frames of the student for one of the teacher.
    fn slope(self) -> f64 {
        (self.last - self.first) as f64 / (self.frames - 1).max(1) as f64
    }

    /// The student's frame at one of the teacher.
    pub fn at(self, frame: usize) -> i64 {
        (self.first as f64 + self.slope() * frame as f64).round() as i64
    }

    /// The line `later` frames later at the teacher's frame `middle`, and `longer` frames longer.
    fn moved(self, middle: usize, later: i64, longer: i64) -> Line {
        let at_middle = self.first as f64 + self.slope() * middle as f64 + later as f64;
        let length = self.last - self.first + longer;
        let slope = length as f64 / (self.frames - 1).max(1) as f64;
        let first = (at_middle - slope * middle as f64).round() as i64;
        Line { first, last: first + length, frames: self.frames }
    }

    /// How many frames later the student is at the teacher's first frame.
    pub fn lag(self) -> i64 {
        self.first
    }

    /// The student's tempo over the teacher's; above 1 is faster. 1 for a teacher of one frame.
    pub fn tempo(self) -> f64 {
        if self.frames > 1 { self.slope().recip() } else { 1.0 }
    }

    /// Whether lag and tempo are at the ends of what is searched.
    pub fn at_limits(self, band: i64) -> [bool; 2] {
        let [least, most] = lengths(self.frames);
        [self.first.abs() >= band, self.frames > 1 && [least, most].contains(&(self.last - self.first))]
    }

    /// The teacher's frames at which the student has one, of `student` frames.
    pub fn overlap(self, student: usize) -> Range<usize> {
        let reach = |frame: i64| ((frame - self.first) as f64 / self.slope().max(1e-9)).clamp(0.0, self.frames as f64);
        let (mut from, mut to) = (reach(0).floor() as usize, reach(student as i64).ceil() as usize);
        let inside = |frame: usize| (0..student as i64).contains(&self.at(frame));
        // rounding: a frame more or less at either end
        while from > 0 && inside(from - 1) {
            from -= 1;
        }
        while from < to && !inside(from) {
            from += 1;
        }
        while to < self.frames && inside(to) {
            to += 1;
        }
        while to > from && !inside(to - 1) {
            to -= 1;
        }
        from..to
    }
}

/// The student's frames from the beginning of a line to its end, at the greatest and at the least tempo.
fn lengths(frames: usize) -> [i64; 2] {
    let span = frames.saturating_sub(1) as f64;
    // within the tempi: rounding would go beyond them
    [(span / TEMPI[1]).ceil(), (span / TEMPI[0]).floor()].map(|x| x as i64)
}

/// The line with the least mean distance among those of a lag of at most `band` frames and a tempo within [`TEMPI`];
/// the overlap has at least half of the shorter clip. Of equals the one nearest to no lag and the same tempo.
///
/// Every second frame at either end is tried first, and every lag of the same tempo, at 400 frames along the line; then lines
/// around the best, moved and turned where the clips overlap.
pub(super) fn nearest_line(teacher: &BodyPoses, student: &BodyPoses, band: i64) -> Line {
    let frames = teacher.frames();
    let [least, most] = lengths(frames);
    let fits = |line: &Line| line.first.abs() <= band && (least..=most).contains(&(line.last - line.first));
    let line = |first: i64, length: i64| Line { first, last: first + length, frames };
    let cost = |line: &Line, samples| mean_distance(teacher, student, *line, samples);
    let same = frames as i64 - 1;
    let reach = (same - least).max(most - same);
    let lengths: Vec<i64> = outwards(reach).map(|by| same + by).collect();
    let of_length = |length: &i64| {
        let step = if *length == same { 1 } else { COARSE };
        let lines = outwards_by(step, band).map(|first| line(first, *length)).filter(fits);
        nearer(lines.map(|line| (cost(&line, SAMPLES), line)))
    };
    let coarse: Vec<_> = lengths.par_iter().map(of_length).collect();
    // in the order of the lengths: the same on any number of threads
    let start = nearer(coarse.into_iter().flatten()).map_or(line(0, same), |(_, line)| line);
    let mut best = (cost(&start, usize::MAX), start);
    loop {
        let overlap = best.1.overlap(student.frames());
        // a short student is a small part of the line: a frame at its end is many at the line's
        let (middle, turn) = ((overlap.start + overlap.end) / 2, (frames / overlap.len().max(1)).max(1) as i64);
        let around = (-1..=1).flat_map(|a| [-turn, -1, 0, 1, turn].map(|b| (a, b)));
        let lines = around.map(|(a, b)| best.1.moved(middle, a, b)).filter(fits);
        match nearer(lines.map(|line| (cost(&line, usize::MAX), line))) {
            Some(next) if next.0 < best.0 => best = next,
            _ => return best.1,
        }
    }
}

/// 0, then every [`COARSE`]th number up to `reach` on both sides, outwards.
fn outwards(reach: i64) -> impl Iterator<Item = i64> {
    outwards_by(COARSE, reach)
}

fn outwards_by(step: i64, reach: i64) -> impl Iterator<Item = i64> {
    (0..=reach).step_by(step as usize).flat_map(|by| [by, -by]).skip(1)
}

/// The one of the least cost, the first on ties.
fn nearer(lines: impl Iterator<Item = (f64, Line)>) -> Option<(f64, Line)> {
    lines.reduce(|best, next| if next.0 < best.0 { next } else { best })
}

/// Along a line, metres, at up to `samples` frames spread over it; infinite where the clips share too little.
fn mean_distance(teacher: &BodyPoses, student: &BodyPoses, line: Line, samples: usize) -> f64 {
    let overlap = line.overlap(student.frames());
    if 2 * overlap.len() < teacher.frames().min(student.frames()).max(1) {
        return f64::INFINITY;
    }
    let count = overlap.len().min(samples);
    let frame = |n: usize| overlap.start + n * overlap.len() / count;
    let sum: f64 = (0..count).map(frame).map(|i| teacher.distance(i, student, line.at(i) as usize)).sum();
    sum / count as f64
}
