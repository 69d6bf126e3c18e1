//! A timeline as text, to check it before anything is sampled.

use super::layout::{PlacedSegment, TimelineLayout};
use kinelm_motion::joints;
use std::fmt::Write;

/// Parts of the body that have a line each.
const PARTS: [&str; 7] = ["root", "torso", "head", "left_arm", "right_arm", "left_leg", "right_leg"];
/// The most columns of a line.
const WIDTH: usize = 72;

/// A line per segment, and one per part of the body: the segment that gives it, `.` where it is generated, `+` where only some
/// of its joints are given.
pub fn chart(layout: &TimelineLayout) -> String {
    let s = |frame: usize| frame as f64 / layout.fps;
    let mut text = format!("{:.2} s, {} frames at {} fps\n", s(layout.frames), layout.frames, layout.fps);
    for (n, segment) in layout.segments.iter().enumerate() {
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
    for label in &layout.labels {
        let _ = writeln!(text, "label {label}");
    }
    // a short dance has a column a frame
    let columns = layout.frames.clamp(1, WIDTH);
    for part in PARTS {
        let own = joints::parse(part).map(|s| s.joints).unwrap_or_default();
        let _ = write!(text, "{part:<10} ");
        for column in 0..columns {
            let frames = column * layout.frames / columns..(column + 1) * layout.frames / columns;
            let meets = |p: &PlacedSegment| p.frames.start < frames.end && frames.start < p.frames.end;
            let here = |joint: &usize| layout.segments.iter().position(|p| meets(p) && p.joints.contains(joint));
            let given: Vec<Option<usize>> = own.iter().map(here).collect();
            text.push(match given.first() {
                Some(Some(n)) if given.iter().all(|g| *g == Some(*n)) => mark(*n),
                _ if given.iter().all(Option::is_none) => '.',
                _ => '+',
            });
        }
        text.push('\n');
    }
    let is_given = |frame: usize, joint: usize| {
        layout.segments.iter().any(|p| p.frames.contains(&frame) && p.joints.contains(&joint))
    };
    if (0..24).all(|joint| (0..layout.frames).all(|frame| is_given(frame, joint))) {
        text.push_str("nothing is free: there is nothing for a model to generate\n");
    }
    text
}

/// 1 to 9, then letters.
fn mark(n: usize) -> char {
    (1..=9u8).map(|n| (b'0' + n) as char).chain('a'..='z').nth(n).unwrap_or('#')
}
