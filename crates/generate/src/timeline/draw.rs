//! A plan as text, to be looked at before anything is drawn.

use super::lay::{Placed, TimelineLayout};
use kinelm_motion::joints;
use std::fmt::Write;

/// Parts of the body that have a line each.
const PARTS: [&str; 7] = ["root", "torso", "head", "left_arm", "right_arm", "left_leg", "right_leg"];
/// Columns of a line, at most.
const WIDTH: usize = 72;

/// Lines for the segments, and one for every part of the body: by which segment it is given when, `.` where it is made anew,
/// and `+` where only some of its joints are.
pub fn timeline(laid: &TimelineLayout) -> String {
    let s = |frame: usize| frame as f64 / laid.fps;
    let mut text = format!("{:.2} s, {} frames at {} fps\n", s(laid.frames), laid.frames, laid.fps);
    for (n, segment) in laid.placed.iter().enumerate() {
        let (from, to, at) = (s(segment.frames.start), s(segment.frames.end), s(segment.at));
        let (clip, list) = (&segment.clip, &segment.list);
        let _ = write!(text, "{}  {from:7.2} to {to:7.2} s  {list} of {clip} from {at:.2} s on", mark(n));
        let (turn, shift) = (segment.turn.to_degrees(), segment.shift);
        if turn != 0.0 || shift.length() > 0.0 {
            let turn = (turn + 180.0).rem_euclid(360.0) - 180.0;
            let _ = write!(text, ", turned by {turn:.0} degrees and moved by {:.2} m", shift.length());
        }
        text.push('\n');
    }
    for label in &laid.labels {
        let _ = writeln!(text, "told {label}");
    }
    let columns = laid.frames.clamp(1, WIDTH);
    for part in PARTS {
        let own = joints::parse(part).map(|s| s.joints).unwrap_or_default();
        let _ = write!(text, "{part:<10} ");
        for column in 0..columns {
            let frames = column * laid.frames / columns..(column + 1) * laid.frames / columns;
            let meets = |p: &Placed| p.frames.start < frames.end && frames.start < p.frames.end;
            let here = |joint: &usize| laid.placed.iter().position(|p| meets(p) && p.joints.contains(joint));
            let given: Vec<Option<usize>> = own.iter().map(here).collect();
            text.push(match given.first() {
                Some(Some(n)) if given.iter().all(|g| *g == Some(*n)) => mark(*n),
                _ if given.iter().all(Option::is_none) => '.',
                _ => '+',
            });
        }
        text.push('\n');
    }
    let is_given =
        |frame: usize, joint: usize| laid.placed.iter().any(|p| p.frames.contains(&frame) && p.joints.contains(&joint));
    if (0..24).all(|joint| (0..laid.frames).all(|frame| is_given(frame, joint))) {
        text.push_str("nothing is made anew: there is nothing for a model to do\n");
    }
    text
}

/// 1 to 9, then letters.
fn mark(n: usize) -> char {
    (1..=9u8).map(|n| (b'0' + n) as char).chain('a'..='z').nth(n).unwrap_or('#')
}
