//! The clips of a plan read and laid beside each other: which frames of which go where, turned and moved how.

use super::told;
use crate::Error;
use crate::request::{At, Segment, TimedLabel, Timeline, TimelineClip};
use kinelm_motion::format::{self, ReadOptions, RestFrame, bvh::BvhSource, resolve_floor};
use kinelm_motion::joints::{self, Selection};
use kinelm_motion::moment::{Moment, Timebase};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::{self, Retarget};
use kinelm_motion::rig::map_for;
use kinelm_motion::rotation::heading;
use kinelm_motion::{Clip, Motion, Quat, Source, Vec3, smpl};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Where a body goes on through a gap before the next clip: as fast as both ends, but no longer than this, seconds, and no
/// faster than this, m/s.
const GOES_ON_S: f64 = 1.0;
const FASTEST_M_S: f64 = 1.5;
/// Over so many seconds an end's speed is measured.
const SPEED_S: f64 = 0.2;
/// Plans are no longer than this, seconds.
const LONGEST_S: f64 = 3600.0;

/// What is wrong with a plan, and where.
pub(super) enum Fault {
    /// With a segment, counted from 0: found, expected.
    Segment(usize, String, String),
    /// With a clip, by its name.
    Clip(String, String, String),
    /// With the clip that lends its rig.
    Rig(String, String),
    /// With the whole.
    Timeline(String, String),
    /// A file can't be read.
    Read(Error),
}

impl From<Error> for Fault {
    fn from(e: Error) -> Fault {
        Fault::Read(e)
    }
}

impl From<kinelm_motion::Error> for Fault {
    fn from(e: kinelm_motion::Error) -> Fault {
        Fault::Read(e.into())
    }
}

impl From<Fault> for Error {
    fn from(fault: Fault) -> Error {
        let said = |place: String, found: String, expected: String| {
            Error::call(format!("{place}: found {found}, expected {expected}"))
        };
        match fault {
            Fault::Segment(n, found, expected) => said(format!("segment {} of the plan", n + 1), found, expected),
            Fault::Clip(name, found, expected) => said(format!("clip {name} of the plan"), found, expected),
            Fault::Rig(found, expected) => said("the plan's rig".into(), found, expected),
            Fault::Timeline(found, expected) => said("the plan".into(), found, expected),
            Fault::Read(e) => e,
        }
    }
}

/// A clip of a plan on the rig that is written, at its rate.
pub(super) struct ReadClip {
    /// On that rig.
    pub clip: Clip,
    /// Its numbers and bytes, no frame left out, where its file has the very rig and rate.
    pub exact: Option<(BvhSource, Arc<[u8]>)>,
    /// Frames of the file in front of the clip's.
    pub left_out: usize,
    /// The frames and the rate of its file: moments are counted in these.
    scale: Timebase,
    /// How far its floor lies above that of the rig's clip, metres.
    above_m: f64,
    /// (F) where it faces, radians.
    headings: Vec<f64>,
}

/// A segment with its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
    /// The clip's name.
    pub clip: String,
    /// SMPL ids, ascending.
    pub joints: Vec<usize>,
    /// The joints as the plan names them, in SMPL's names.
    pub list: String,
    /// Frames of the dance.
    pub frames: Range<usize>,
    /// The clip's frame at their beginning.
    pub at: usize,
    /// How it is turned, radians, and then moved.
    pub turn: f64,
    /// Metres.
    pub shift: Vec3,
}

impl Placed {
    /// Whether it goes on exactly where `before` ends.
    fn goes_on(&self, before: &Placed) -> bool {
        self.clip == before.clip && self.at + before.frames.start == before.at + self.frames.start
    }

    fn has_root(&self) -> bool {
        self.joints.first() == Some(&0)
    }
}

/// A plan, laid.
pub struct TimelineLayout {
    /// Segments in the order of their beginnings.
    pub placed: Vec<Placed>,
    /// Frames of the dance.
    pub frames: usize,
    /// Frames a second.
    pub fps: f64,
    /// What the model is told when, in seconds of the dance.
    pub labels: Vec<TimedLabel>,
    /// What the user should know.
    pub notes: Vec<String>,
    /// The name of the clip that lends its rig.
    pub(super) rig_name: String,
    /// That clip, and how its file is read.
    pub(super) rig: (TimelineClip, Motion, BvhSource),
    /// Where its floor is, metres.
    pub(super) floor_m: f64,
    pub(super) clips: BTreeMap<String, ReadClip>,
}

impl TimelineLayout {
    pub(super) fn of(plan: &Timeline) -> Result<TimelineLayout, Fault> {
        if plan.segments.is_empty() {
            return Err(Fault::Timeline("no [[segment]]".into(), "at least one".into()));
        }
        if plan.segments.iter().all(|segment| segment.clip.is_none() && !segment.labels.is_empty()) {
            let expected = "one with a clip at least; a dance of labels alone is made by --label";
            return Err(Fault::Timeline("segments that tell labels, and none with a clip".into(), expected.into()));
        }
        let known = plan.clips.keys().cloned().collect::<Vec<_>>().join(", ");
        let own = plan
            .clips
            .get(&plan.rig)
            .ok_or_else(|| Fault::Rig(format!("`{}`", plan.rig), format!("the name of one of the clips: {known}")))?;
        let mut notes = Vec::new();
        let unread = |name: &str, e: &dyn std::fmt::Display| {
            Fault::Clip(name.to_owned(), e.to_string(), "a clip that can be read".into())
        };
        let mut motion = format::read(&own.file, &own.options()).map_err(|e| unread(&plan.rig, &e))?;
        if motion.clip.frames() == 0 {
            return Err(Fault::Clip(plan.rig.clone(), "no frames".into(), "a clip with at least one".into()));
        }
        let Source::Bvh(source) = &motion.source else {
            let expected = "a .bvh, whose numbers can be kept; kinelm convert makes one";
            return Err(Fault::Clip(plan.rig.clone(), format!("{}", own.file.display()), expected.into()));
        };
        let source = (**source).clone();
        let floor_m = resolve_floor(&mut motion, &own.options()).map_err(|e| unread(&plan.rig, &e))?;
        let mut clips = BTreeMap::new();
        for (name, clip) in &plan.clips {
            if *name == plan.rig || plan.segments.iter().any(|segment| segment.clip.as_ref() == Some(name)) {
                let ready = ready(clip, (own, &motion, &source, floor_m), &mut notes).map_err(|fault| match fault {
                    Fault::Read(e) => unread(name, &e),
                    fault => fault,
                })?;
                if ready.exact.is_none() {
                    let what = "has another rig or rate than the plan's: its numbers are converted, not copied";
                    notes.push(format!("{name} ({}) {what}", clip.file.display()));
                }
                clips.insert(name.clone(), ready);
            }
        }
        let fps = motion.clip.fps();
        let over = plan.over.0.seconds(fps);
        if !(0.0..=10.0).contains(&over) {
            return Err(Fault::Timeline(format!("over = {}", plan.over.0), "0 to 10 seconds".into()));
        }
        let length = plan.seconds.map(|At(length)| length.seconds(fps));
        if let (Some(At(told)), Some(s)) = (plan.seconds, length)
            && !(s > 0.0 && s <= LONGEST_S)
        {
            return Err(Fault::Timeline(format!("seconds = {told}"), format!("more than 0, and {LONGEST_S} at most")));
        }
        let mut placed = Vec::new();
        for (n, segment) in plan.segments.iter().enumerate() {
            let Some(clip) = &segment.clip else { continue };
            let ready = clips
                .get(clip)
                .ok_or_else(|| Fault::Segment(n, format!("clip = \"{clip}\""), format!("one of the clips: {known}")))?;
            let place = place((clip, segment), ready, (&motion, own), &mut notes);
            placed.push((n, place.map_err(|(found, expected)| Fault::Segment(n, found, expected))?));
        }
        placed.sort_by_key(|(n, p)| (p.frames.start, *n));
        apart(&mut placed, (over * fps).round() as usize, fps)?;
        let (mut labels, told_to) = told::labels(&plan.segments, fps)?;
        let last = placed.iter().map(|(_, p)| p.frames.end).chain([told_to]).max().unwrap_or(0);
        let frames = length.map_or(last, |s| (s * fps).round() as usize);
        if frames < last {
            let found = format!("a segment up to {:.2} s", last as f64 / fps);
            return Err(Fault::Timeline(found, format!("all to end within seconds = {}", frames as f64 / fps)));
        }
        // to the end, whatever part of a frame of the model that is
        for label in labels.iter_mut().filter(|_| told_to == frames) {
            label.to = label.to.filter(|to| *to != Moment::Seconds(frames as f64 / fps));
        }
        let mut placed: Vec<Placed> = placed.into_iter().map(|(_, p)| p).collect();
        join(&mut placed, &clips, fps);
        let rig_name = plan.rig.clone();
        Ok(TimelineLayout {
            placed,
            frames,
            fps,
            labels,
            notes,
            rig_name,
            rig: (own.clone(), motion, source),
            floor_m,
            clips,
        })
    }
}

/// Reads a clip and brings it to the rig.
fn ready(
    clip: &TimelineClip,
    (own, rig, source, floor_m): (&TimelineClip, &Motion, &BvhSource, f64),
    notes: &mut Vec<String>,
) -> Result<ReadClip, Fault> {
    let (options, fps) = (clip.options(), rig.clip.fps());
    format::Format::of(&clip.file)?; // refused by its name before it is read
    let bytes: Arc<[u8]> = kinelm_store::input::bytes(&clip.file).map_err(Error::io(&clip.file))?.into();
    let mut motion = format::parse(&clip.file, &bytes, &options)?;
    notes.extend(motion.warnings.iter().map(|warning| format!("{}: {}", clip.file.display(), warning.what)));
    let whole = ReadOptions { skip: 0, rest: RestFrame::Keep, ..options.clone() };
    let all = format::parse(&clip.file, &bytes, &whole)?;
    let left_out = all.clip.frames() - motion.clip.frames();
    let scale = Timebase { frames: motion.clip.frames(), fps: motion.clip.fps(), left_out, model_fps: None };
    let on_smpl = resample(&retarget::to_smpl(&motion, clip.map.as_deref())?, fps, Method::Auto)?;
    let mut last = 0.0;
    let headings = (0..on_smpl.frames()).map(|f| {
        last = heading(on_smpl.pose(f)[0]).unwrap_or(last);
        last
    });
    let headings = headings.collect();
    if let Source::Bvh(other) = &all.source
        && source.is_alike(other)
        && motion.clip.fps() == fps
    {
        let above_m = if clip == own { 0.0 } else { resolve_floor(&mut motion, &options)? - floor_m };
        let exact = Some(((**other).clone(), bytes));
        return Ok(ReadClip { clip: motion.clip, exact, left_out, scale, above_m, headings });
    }
    let skeleton = rig.clip.skeleton();
    let way = Retarget::new(skeleton, &map_for(skeleton, own.map.as_deref())?, smpl::neutral())?;
    let moved = way.with_floor(format::floor_height(rig, own.map.as_deref())?).to_rig_over(&on_smpl, None)?;
    let mut on_rig = Motion { clip: moved, ..rig.clone() };
    let above_m = resolve_floor(&mut on_rig, &own.options())? - floor_m;
    Ok(ReadClip { clip: on_rig.clip, exact: None, left_out: 0, scale, above_m, headings })
}

/// A segment in frames; found and expected where it can't be.
fn place(
    (clip, segment): (&str, &Segment),
    ready: &ReadClip,
    (rig, own): (&Motion, &TimelineClip),
    notes: &mut Vec<String>,
) -> Result<Placed, (String, String)> {
    let fps = rig.clip.fps();
    let wrong =
        |e: kinelm_motion::Error| (format!("joints = \"{}\": {e}", segment.joints), "joints of the rig".to_owned());
    let list = joints::to_smpl_names(&segment.joints, rig.clip.skeleton(), own.map.as_deref()).map_err(wrong)?;
    let twice = joints::ambiguous_names(&segment.joints, rig.clip.skeleton(), own.map.as_deref());
    notes.extend(twice.iter().map(|(part, own)| joints::ambiguity_note(part, own)));
    let Selection { mut joints, .. } = joints::parse(&list).map_err(wrong)?;
    joints.sort_unstable();
    joints.dedup();
    let Range { start: from, end: to } = times(segment, fps)?;
    let has = ready.clip.frames();
    let at =
        border("at", segment.at, ready.scale, format!("a moment of the clip, which has {:.2} s", has as f64 / fps))?;
    let at = (at as f64 / ready.scale.fps * fps).round() as usize;
    if at + (to - from) > has {
        let (long, left) = ((to - from) as f64 / fps, (has - at) as f64 / fps);
        let found = format!("{long:.2} s from {} of {} on", segment.at.0, clip);
        return Err((found, format!("{left:.2} s at most, which the clip still has there")));
    }
    Ok(Placed { clip: clip.to_owned(), joints, list, frames: from..to, at, turn: 0.0, shift: Vec3::ZERO })
}

/// The frames of the dance over which a segment holds; found and expected where there are none.
pub(super) fn times(segment: &Segment, fps: f64) -> Result<Range<usize>, (String, String)> {
    let scale = Timebase { frames: (LONGEST_S * fps) as usize, fps, left_out: 0, model_fps: None };
    let counted = || "seconds or frames (40f) from the beginning of the dance".to_owned();
    let (from, to) = (border("from", segment.from, scale, counted())?, border("to", segment.to, scale, counted())?);
    if from >= to {
        return Err((format!("from {} to {}", segment.from.0, segment.to.0), "an end behind the beginning".into()));
    }
    Ok(from..to)
}

/// The frame of a moment that a key names, not counted from the end.
fn border(key: &str, at: At, scale: Timebase, expected: String) -> Result<usize, (String, String)> {
    let negative = matches!(at.0, Moment::Seconds(n) | Moment::Frames(n) | Moment::Model(n) if n.is_sign_negative());
    at.0.boundary(scale).filter(|_| !negative).ok_or_else(|| (format!("{key} = {}", at.0), expected))
}

/// Refuses joints that two segments give at a time, and makes room where one goes over into another.
fn apart(placed: &mut [(usize, Placed)], over: usize, fps: f64) -> Result<(), Fault> {
    // of each, frames at its beginning and at its end
    let mut cuts = vec![(0, 0); placed.len()];
    for second in 1..placed.len() {
        for first in 0..second {
            let ((n, a), (m, b)) = (&placed[first], &placed[second]);
            let Some(&joint) = a.joints.iter().find(|joint| b.joints.contains(joint)) else { continue };
            if b.frames.start < a.frames.end {
                let [from, to] = [b.frames.start, a.frames.end.min(b.frames.end)].map(|f| f as f64 / fps);
                let name = smpl::NAMES[joint];
                let found = format!("{name} from {from:.2} to {to:.2} s, which segment {} gives too", *n + 1);
                return Err(Fault::Segment(*m, found, "every joint once at a time".into()));
            }
            let room = over.saturating_sub(b.frames.start - a.frames.end);
            if room == 0 || b.goes_on(a) {
                continue;
            }
            cuts[first].1 = cuts[first].1.max(room - room / 2);
            cuts[second].0 = cuts[second].0.max(room / 2);
        }
    }
    for ((n, segment), (front, back)) in placed.iter_mut().zip(cuts) {
        if segment.frames.len() <= front + back {
            let found = format!("{:.2} s", segment.frames.len() as f64 / fps);
            let cut = (front + back) as f64 / fps;
            let expected = format!("more than the {cut:.2} s of it that are made anew where clips meet (over)");
            return Err(Fault::Segment(*n, found, expected));
        }
        segment.frames = segment.frames.start + front..segment.frames.end - back;
        segment.at += front;
    }
    Ok(())
}

/// Turns and moves segments with a root so that each goes on where the one before has come to.
fn join(placed: &mut [Placed], clips: &BTreeMap<String, ReadClip>, fps: f64) {
    let mut before: Option<Placed> = None;
    for segment in placed.iter_mut().filter(|segment| segment.has_root()) {
        let ready = &clips[&segment.clip];
        let first = ready.clip.root()[segment.at];
        match &before {
            Some(last) if segment.goes_on(last) => (segment.turn, segment.shift) = (last.turn, last.shift),
            Some(last) => {
                let (from, end) = (&clips[&last.clip], last.at + last.frames.len() - 1);
                segment.turn = last.turn + from.headings[end.min(from.headings.len() - 1)]
                    - ready.headings[segment.at.min(ready.headings.len() - 1)];
                let [leaving, coming] = [Quat::from_rotation_y(last.turn), Quat::from_rotation_y(segment.turn)];
                let speed =
                    (leaving * speed(&from.clip, end, false) + coming * speed(&ready.clip, segment.at, true)) / 2.0;
                let s = ((segment.frames.start - last.frames.end + 1) as f64 / fps).min(GOES_ON_S);
                let there = leaving * from.clip.root()[end] + last.shift + speed * s;
                segment.shift = (there - coming * first).with_y(-ready.above_m);
            }
            None => segment.shift = Vec3::Y * -ready.above_m,
        }
        before = Some(segment.clone());
    }
}

/// How fast the root goes over the ground behind a frame, or before it, m/s.
fn speed(clip: &Clip, frame: usize, behind: bool) -> Vec3 {
    let steps = ((SPEED_S * clip.fps()).round() as usize).max(1);
    let other = if behind { (frame + steps).min(clip.frames() - 1) } else { frame.saturating_sub(steps) };
    let (from, to) = if behind { (frame, other) } else { (other, frame) };
    if from == to {
        return Vec3::ZERO;
    }
    let way = (clip.root()[to] - clip.root()[from]).with_y(0.0) * (clip.fps() / (to - from) as f64);
    way.clamp_length_max(FASTEST_M_S)
}
