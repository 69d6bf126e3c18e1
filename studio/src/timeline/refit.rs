//! Segments of a clip whose reading changes: they have the same frames of the clip as before, and become longer or
//! shorter with it.
//!
//! At half the rate a clip lasts twice as long. Its segments do too then, and later segments are moved, so that nothing
//! overlaps and a clip that was cut continues. A segment that had the clip's beginning or end has it afterwards.

use super::Timelines;
use super::edit::cuts;
use super::file::TimelineFile;
use super::segments::Cut;
use crate::Result;
use kinelm_generate::request::Segment;
use kinelm_motion::moment::Moment;
use serde_json::json;

/// The rate and length of a clip, by a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Length {
    /// Frames per second.
    pub fps: f64,
    /// Frames.
    pub frames: usize,
}

/// A clip before and after its reading changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reread {
    /// As it was read.
    pub before: Length,
    /// As it is read.
    pub after: Length,
    /// Whether its frames are those that it had, but for some at its beginning.
    pub is_same_motion: bool,
}

/// Times of a segment, seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Times {
    from: f64,
    to: f64,
    at: f64,
}

/// Fits the segments of the clips with these names. `file` is the text in which they are read as they were.
///
/// # Errors
/// A timeline that can't be laid out.
pub(super) fn refit(timelines: &Timelines, file: &mut TimelineFile, names: &[String], reread: Reread) -> Result<()> {
    let parsed = timelines.lay_out(&file.text())?;
    let (cuts, fps) = cuts(timelines, file)?;
    let is_own = |name: &Option<String>| name.as_ref().is_some_and(|name| names.contains(name));
    // the rig's clip gives the dance its rate
    let fps_after = if names.contains(&parsed.timeline.rig) { reread.after.fps } else { fps };
    let warp = Warp::of(cuts.iter().filter(|cut| is_own(&cut.clip)).map(|cut| span(cut, fps)), reread);
    let mut fitted: Vec<Times> = cuts
        .iter()
        .map(|cut| match is_own(&cut.clip) {
            true => own(cut, reread, &warp, (fps, fps_after)),
            false => other(cut, &warp, fps),
        })
        .collect();
    let ends: Vec<f64> = fitted.iter().enumerate().map(|(n, times)| room(n, times.to, &cuts, &fitted)).collect();
    fitted.iter_mut().zip(ends).for_each(|(times, end)| times.to = end);
    for (index, (segment, (cut, times))) in parsed.timeline.segments.iter().zip(cuts.iter().zip(&fitted)).enumerate() {
        write(file, (index, segment), (cut, times), (fps, fps_after))?;
    }
    if let Some(seconds) = parsed.timeline.seconds {
        let before = seconds.0.seconds(fps);
        set(before, warp.at(before), seconds.0, (fps, fps_after), |value| file.set_top("seconds", &json!(value)))?;
    }
    Ok(())
}

fn span(cut: &Cut, fps: f64) -> (f64, f64) {
    (cut.frames.start as f64 / fps, cut.frames.end as f64 / fps)
}

/// Moves times of the dance: spans of the clip's segments are stretched with it.
struct Warp {
    stretch: f64,
    /// Disjoint and ascending.
    spans: Vec<(f64, f64)>,
}

impl Warp {
    fn of(spans: impl Iterator<Item = (f64, f64)>, reread: Reread) -> Warp {
        let mut all: Vec<(f64, f64)> = spans.collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut spans: Vec<(f64, f64)> = Vec::new();
        for (from, to) in all {
            match spans.last_mut().filter(|last| from <= last.1) {
                Some(last) => last.1 = last.1.max(to),
                None => spans.push((from, to)),
            }
        }
        // other motion has no frames in common: its segments stay where they are
        let stretch = if reread.is_same_motion { reread.before.fps / reread.after.fps } else { 1.0 };
        Warp { stretch, spans }
    }

    fn at(&self, s: f64) -> f64 {
        // of all that is before it, only the clip's own time is stretched
        let covered: f64 = self.spans.iter().map(|(from, to)| (to.min(s) - from).max(0.0)).sum();
        s + (self.stretch - 1.0) * covered
    }
}

/// A segment of the clip.
fn own(cut: &Cut, reread: Reread, warp: &Warp, (fps, fps_after): (f64, f64)) -> Times {
    let Reread { before, after, is_same_motion } = reread;
    let (from, to) = span(cut, fps);
    // the segment's frames of the clip before, and after
    let (first, last) = (cut.at_s * before.fps, (cut.at_s + to - from) * before.fps);
    // frames that are left out at the beginning now; negative where some came back
    let gone = if is_same_motion { before.frames as f64 - after.frames as f64 } else { 0.0 };
    // a segment rounded to a frame of the dance may end as much before the clip's end
    let frame = (before.fps / fps).max(1.0);
    let end = after.frames as f64;
    let begin = if first < 0.5 { 0.0 } else { (first - gone).clamp(0.0, end).round() };
    let stop = if last > before.frames as f64 - frame { end } else { (last - gone).clamp(0.0, end) };
    // whole frames of the dance, no more than the clip has of them
    let of = |frames: f64| (frames / after.fps * fps_after).round();
    // n frames span n - 1 steps; 1e-9, as 2.9999 of rounding is 3
    let has = ((end - 1.0).max(0.0) / after.fps * fps_after + 1e-9).floor() + 1.0 - of(begin);
    let start = (warp.at(from) * fps_after).round();
    let long = of(stop - begin).min(has).max(0.0);
    Times { from: start / fps_after, to: (start + long) / fps_after, at: begin / after.fps }
}

/// A segment of another clip, or of labels alone.
fn other(cut: &Cut, warp: &Warp, fps: f64) -> Times {
    let (from, to) = span(cut, fps);
    let (start, mut end) = (warp.at(from), warp.at(to));
    if cut.clip.is_some() {
        end = end.min(start + to - from); // its own clip has no more
    }
    Times { from: start, to: end, at: cut.at_s }
}

/// The end of a segment, before the next one that gives one of its joints.
fn room(n: usize, end: f64, cuts: &[Cut], fitted: &[Times]) -> f64 {
    let shares = |other: &Cut| other.joints.iter().any(|joint| cuts[n].joints.contains(joint));
    let after = |other: &Cut| other.frames.start >= cuts[n].frames.end;
    let next = cuts.iter().zip(fitted).filter(|(other, _)| after(other) && shares(other)).map(|(_, times)| times.from);
    next.fold(end, f64::min)
}

fn write(
    file: &mut TimelineFile,
    (index, segment): (usize, &Segment),
    (cut, times): (&Cut, &Times),
    rates: (f64, f64),
) -> Result<()> {
    // no frame is left: the text stays, and its fault is shown
    if times.to - times.from < 0.5 / rates.1 {
        return Ok(());
    }
    let (from, to) = span(cut, rates.0);
    set(from, times.from, segment.from.0, rates, |value| file.set(index, "from", &json!(value)))?;
    set(to, times.to, segment.to.0, rates, |value| file.set(index, "to", &json!(value)))?;
    // a place in frames of the clip's file names the same pose at any rate
    match segment.at.0 {
        Moment::Seconds(s) if (s - times.at).abs() > 1e-6 => file.set(index, "at", &json!(times.at)),
        _ => Ok(()),
    }
}

/// Sets a time of the dance if its text means another one now.
fn set(
    before: f64,
    after: f64,
    text: Moment,
    (fps, fps_after): (f64, f64),
    set: impl FnOnce(f64) -> Result<()>,
) -> Result<()> {
    let says = match text {
        // it rounds to the same frame as before: the text stays
        Moment::Seconds(s) if (before - s).abs() <= 0.5 / fps && (before - after).abs() < 1e-6 => after,
        moment => moment.seconds(fps_after),
    };
    if (says - after).abs() > 1e-6 { set(after) } else { Ok(()) }
}
