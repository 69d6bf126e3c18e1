//! The clips of a timeline read and placed: which of their frames go where, turned and moved how.

use super::fault::Fault;
use super::labels::timed_labels;
use super::times::{LONGEST_S, border, times};
use crate::Error;
use crate::edit::mask::IN_PART;
use crate::request::{At, Segment, TimedLabel, Timeline, TimelineClip};
use kinelm_motion::format::{self, ReadOptions, RestFrame, bvh::BvhSource, resolve_floor};
use kinelm_motion::joints::{self, Selection};
use kinelm_motion::moment::{Moment, Timebase};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::{self, Retarget};
use kinelm_motion::rotation::heading;
use kinelm_motion::{Clip, Motion, Quat, Source, Vec3, smpl};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// A body moves on through a gap at the mean speed of both ends, but no longer than this, seconds, and no faster, m/s.
const MOVES_ON_S: f64 = 1.0;
const FASTEST_M_S: f64 = 1.5;
/// The time over which an end's speed is measured, seconds.
const SPEED_S: f64 = 0.2;

/// A clip of a timeline on the rig that is written, at its rate.
pub(super) struct ReadClip {
    /// On that rig.
    pub clip: Clip,
    /// Its numbers and bytes, no frame left out, where its file has the very rig and rate.
    pub exact: Option<(BvhSource, Arc<[u8]>)>,
    /// Frames of the file before the clip's.
    pub left_out: usize,
    /// Frames and rate of its file, in which moments are counted.
    scale: Timebase,
    /// Height of its floor above that of the rig's clip, metres.
    above_m: f64,
    /// (F) headings, radians.
    headings: Vec<f64>,
}

/// A segment in frames of the dance.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedSegment {
    /// Its number among the timeline's segments, from 0.
    pub index: usize,
    /// The clip's name.
    pub clip: String,
    /// SMPL ids, ascending.
    pub joints: Vec<usize>,
    /// The joints in SMPL's names, as the timeline lists them.
    pub list: String,
    /// Frames of the dance.
    pub frames: Range<usize>,
    /// The clip's frame at their beginning.
    pub at: usize,
    /// Turn about the vertical, radians, before `shift`.
    pub turn: f64,
    /// Metres.
    pub shift: Vec3,
}

impl PlacedSegment {
    /// Whether it continues exactly where `previous` ends.
    fn continues(&self, previous: &PlacedSegment) -> bool {
        self.clip == previous.clip && self.at + previous.frames.start == previous.at + self.frames.start
    }

    fn has_root(&self) -> bool {
        self.joints.first() == Some(&0)
    }
}

/// A timeline laid out.
pub struct TimelineLayout {
    /// Segments in the order of their beginnings.
    pub segments: Vec<PlacedSegment>,
    /// Frames of the dance.
    pub frames: usize,
    /// Frames per second.
    pub fps: f64,
    /// Labels, in seconds of the dance.
    pub labels: Vec<TimedLabel>,
    /// Notes for the user.
    pub notes: Vec<String>,
    /// The clip that lends its rig.
    pub(super) rig: TimelineRig,
    pub(super) clips: BTreeMap<String, ReadClip>,
}

/// The clip that lends a timeline its rig.
pub(super) struct TimelineRig {
    /// Its name.
    pub name: String,
    /// Its file, and how it is read.
    pub own: TimelineClip,
    pub motion: Motion,
    pub source: BvhSource,
    /// Its floor, metres.
    pub floor_m: f64,
}

/// What a timeline without segments is found to have: one that is only begun.
pub const NO_SEGMENT: &str = "no [[segment]]";

impl TimelineLayout {
    pub(super) fn of(timeline: &Timeline) -> Result<TimelineLayout, Fault> {
        let known = timeline.clips.keys().cloned().collect::<Vec<_>>().join(", ");
        check_segments(timeline)?;
        let own = timeline.clips.get(&timeline.rig).ok_or_else(|| {
            Fault::Rig(format!("`{}`", timeline.rig), format!("the name of one of the clips: {known}"))
        })?;
        let mut notes = Vec::new();
        let unread = |name: &str, e: &dyn std::fmt::Display| {
            Fault::Clip(name.to_owned(), e.to_string(), "a clip that can be read".into())
        };
        let file = ClipFile::read(own).map_err(|e| unread(&timeline.rig, &e))?;
        let mut motion = file.motion.clone();
        if motion.clip.frames() == 0 {
            return Err(Fault::Clip(timeline.rig.clone(), "no frames".into(), "a clip with at least one".into()));
        }
        let Source::Bvh(source) = &motion.source else {
            let expected = "a .bvh, whose numbers can stay; kinelm convert makes one";
            return Err(Fault::Clip(timeline.rig.clone(), format!("{}", own.file.display()), expected.into()));
        };
        let source = (**source).clone();
        let floor_m = resolve_floor(&mut motion, &own.options()).map_err(|e| unread(&timeline.rig, &e))?;
        let rig = TimelineRig { name: timeline.rig.clone(), own: own.clone(), motion, source, floor_m };
        let mut file = Some(file);
        let mut clips = BTreeMap::new();
        for (name, clip) in &timeline.clips {
            if *name == timeline.rig || timeline.segments.iter().any(|segment| segment.clip.as_ref() == Some(name)) {
                let own_file = if *name == timeline.rig { file.take() } else { None };
                let on_rig = own_file.map_or_else(|| ClipFile::read(clip), Ok);
                let on_rig = on_rig.map_err(Fault::Read).and_then(|file| file.on_rig(clip, &rig, &mut notes));
                let on_rig = on_rig.map_err(|fault| match fault {
                    Fault::Read(e) => unread(name, &e),
                    fault => fault,
                })?;
                if on_rig.exact.is_none() {
                    let what = "has another rig or rate than the timeline's: its numbers are converted, not copied";
                    notes.push(format!("{name} ({}) {what}", clip.file.display()));
                }
                clips.insert(name.clone(), on_rig);
            }
        }
        let fps = rig.motion.clip.fps();
        let transition = timeline.transition.0.seconds(fps);
        if !(0.0..=10.0).contains(&transition) {
            return Err(Fault::Timeline(format!("transition = {}", timeline.transition.0), "0 to 10 seconds".into()));
        }
        let length = timeline.seconds.map(|At(length)| length.seconds(fps));
        if let (Some(At(stated)), Some(s)) = (timeline.seconds, length)
            && !(s > 0.0 && s <= LONGEST_S)
        {
            return Err(Fault::Timeline(
                format!("seconds = {stated}"),
                format!("more than 0, and {LONGEST_S} at most"),
            ));
        }
        let mut placed = Vec::new();
        for (n, segment) in timeline.segments.iter().enumerate() {
            let Some(clip) = &segment.clip else { continue };
            let read = clips
                .get(clip)
                .ok_or_else(|| Fault::Segment(n, format!("clip = \"{clip}\""), format!("one of the clips: {known}")))?;
            placed.push(place(n, clip, segment, read, &rig.motion, &mut notes)?);
        }
        // in time, as `make_room` and `join` look at pairs of an earlier and a later one
        placed.sort_by_key(|p| (p.frames.start, p.index));
        make_room(&mut placed, (transition * fps).round() as usize, fps)?;
        let (mut labels, labelled) = timed_labels(&timeline.segments, fps)?;
        let last = placed.iter().map(|p| p.frames.end).chain([labelled]).max().unwrap_or(0);
        let frames = length.map_or(last, |s| (s * fps).round() as usize);
        if frames < last {
            let found = format!("a segment up to {:.2} s", last as f64 / fps);
            return Err(Fault::Timeline(found, format!("all to end within seconds = {}", frames as f64 / fps)));
        }
        // up to the end, whatever part of a frame of the model that is
        for label in labels.iter_mut().filter(|_| labelled == frames) {
            label.to = label.to.filter(|to| *to != Moment::Seconds(frames as f64 / fps));
        }
        join(&mut placed, &clips, fps);
        Ok(TimelineLayout { segments: placed, frames, fps, labels, notes, rig, clips })
    }
}

/// Refuses a timeline without segments, or whose segments only label.
fn check_segments(timeline: &Timeline) -> Result<(), Fault> {
    if timeline.segments.is_empty() {
        return Err(Fault::Timeline(NO_SEGMENT.into(), "at least one".into()));
    }
    if timeline.segments.iter().all(|segment| segment.clip.is_none() && !segment.labels.is_empty()) {
        let expected = "at least one with a clip; a dance of labels alone needs no timeline";
        return Err(Fault::Timeline("segments with labels alone".into(), expected.into()));
    }
    Ok(())
}

/// A clip's file, read.
struct ClipFile {
    bytes: Arc<[u8]>,
    motion: Motion,
}

impl ClipFile {
    fn read(clip: &TimelineClip) -> Result<ClipFile, Error> {
        format::Format::of(&clip.file)?; // refused by its name before it is read
        let bytes: Arc<[u8]> = kinelm_store::input::bytes(&clip.file).map_err(Error::io(&clip.file))?.into();
        let motion = format::parse(&clip.file, &bytes, &clip.options())?;
        Ok(ClipFile { bytes, motion })
    }

    /// The motion of the whole file. It is read again only where reading leaves out frames.
    fn whole(&self, clip: &TimelineClip) -> Result<Motion, Error> {
        let options = clip.options();
        if options.skip == 0 && !self.motion.warnings.iter().any(|warning| warning.kind == "rest_frame") {
            return Ok(self.motion.clone());
        }
        let options = ReadOptions { skip: 0, rest: RestFrame::Keep, ..options };
        Ok(format::parse(&clip.file, &self.bytes, &options)?)
    }

    /// The clip on the rig that is written.
    fn on_rig(self, clip: &TimelineClip, rig: &TimelineRig, notes: &mut Vec<String>) -> Result<ReadClip, Fault> {
        let TimelineRig { own, motion: rig, source, floor_m, .. } = rig;
        let (options, fps) = (clip.options(), rig.clip.fps());
        let all = self.whole(clip)?;
        let mut motion = self.motion;
        notes.extend(motion.warnings.iter().map(|warning| format!("{}: {}", clip.file.display(), warning.what)));
        let left_out = all.clip.frames() - motion.clip.frames();
        let scale = Timebase { frames: motion.clip.frames(), fps: motion.clip.fps(), left_out, model_fps: None };
        let on_smpl = resample(&retarget::to_smpl(&motion)?, fps, Method::Auto)?;
        let mut last = 0.0;
        let headings = (0..on_smpl.frames()).map(|f| {
            // a body that points straight up has no heading, and keeps its last
            last = heading(on_smpl.pose(f)[0]).unwrap_or(last);
            last
        });
        let headings = headings.collect();
        if let Source::Bvh(other) = &all.source
            && source.is_alike(other)
            && motion.clip.fps() == fps
        {
            let above_m = if clip == own { 0.0 } else { resolve_floor(&mut motion, &options)? - floor_m };
            let exact = Some(((**other).clone(), self.bytes));
            return Ok(ReadClip { clip: motion.clip, exact, left_out, scale, above_m, headings });
        }
        let retarget = Retarget::new(rig.humanoid()?, smpl::neutral())?.with_floor(format::floor_height(rig)?);
        let mut on_rig = rig.clone().with_clip(retarget.to_rig_over(&on_smpl, None)?);
        let above_m = resolve_floor(&mut on_rig, &own.options())? - floor_m;
        Ok(ReadClip { clip: on_rig.clip, exact: None, left_out: 0, scale, above_m, headings })
    }
}

/// A segment in frames.
fn place(
    index: usize,
    clip: &str,
    segment: &Segment,
    read: &ReadClip,
    rig: &Motion,
    notes: &mut Vec<String>,
) -> Result<PlacedSegment, Fault> {
    let fps = rig.clip.fps();
    let wrong = |e: kinelm_motion::Error| {
        Fault::Segment(index, format!("joints = \"{}\": {e}", segment.joints), "joints of the rig".into())
    };
    let list = joints::to_smpl_names(&segment.joints, rig.clip.skeleton(), rig.map()).map_err(wrong)?;
    let twice = joints::ambiguous_names(&segment.joints, rig.clip.skeleton(), rig.map());
    notes.extend(twice.iter().map(|(part, own)| joints::ambiguity_note(part, own)));
    let selection = joints::parse(&list).map_err(wrong)?;
    if selection.has_part_of_root() {
        let found = format!("joints = \"{}\": {IN_PART}", segment.joints);
        return Err(Fault::Segment(index, found, "joints of the rig, or root".into()));
    }
    let Selection { mut joints, .. } = selection;
    joints.sort_unstable();
    joints.dedup();
    let Range { start: from, end: to } = times(index, segment, fps)?;
    let has = read.clip.frames();
    let expected = format!("a moment of the clip, which has {:.2} s", has as f64 / fps);
    let at = border(index, "at", segment.at, read.scale, expected)?;
    let at = (at as f64 / read.scale.fps * fps).round() as usize;
    if at + (to - from) > has {
        let (long, left) = ((to - from) as f64 / fps, has.saturating_sub(at) as f64 / fps);
        let found = format!("{long:.2} s from {} of {} on", segment.at.0, clip);
        let expected = format!("{left:.2} s at most, which the clip still has there");
        return Err(Fault::Segment(index, found, expected));
    }
    let (clip, frames) = (clip.to_owned(), from..to);
    Ok(PlacedSegment { index, clip, joints, list, frames, at, turn: 0.0, shift: Vec3::ZERO })
}

/// Refuses joints that two segments give at a time, and shortens segments to make room for transitions.
fn make_room(placed: &mut [PlacedSegment], transition: usize, fps: f64) -> Result<(), Fault> {
    // frames cut at the beginning and at the end of each
    let mut cuts = vec![(0, 0); placed.len()];
    for second in 1..placed.len() {
        for first in 0..second {
            let (a, b) = (&placed[first], &placed[second]);
            let Some(&joint) = a.joints.iter().find(|joint| b.joints.contains(joint)) else { continue };
            if b.frames.start < a.frames.end {
                let [from, to] = [b.frames.start, a.frames.end.min(b.frames.end)].map(|f| f as f64 / fps);
                let name = smpl::NAMES[joint];
                let found = format!("{name} from {from:.2} to {to:.2} s, which segment {} gives too", a.index + 1);
                return Err(Fault::Segment(b.index, found, "every joint once at a time".into()));
            }
            let room = transition.saturating_sub(b.frames.start - a.frames.end);
            if room == 0 || b.continues(a) {
                continue;
            }
            // the larger half from the earlier segment, and the largest cut of all its neighbours
            cuts[first].1 = cuts[first].1.max(room - room / 2);
            cuts[second].0 = cuts[second].0.max(room / 2);
        }
    }
    for (segment, (front, back)) in placed.iter_mut().zip(cuts) {
        if segment.frames.len() <= front + back {
            let found = format!("{:.2} s", segment.frames.len() as f64 / fps);
            let cut = (front + back) as f64 / fps;
            let expected = format!("more than the {cut:.2} s of it that transitions take (transition)");
            return Err(Fault::Segment(segment.index, found, expected));
        }
        segment.frames = segment.frames.start + front..segment.frames.end - back;
        segment.at += front;
    }
    Ok(())
}

/// Turns and moves segments with a root so that each continues where the previous one ends.
fn join(segments: &mut [PlacedSegment], clips: &BTreeMap<String, ReadClip>, fps: f64) {
    let mut previous: Option<PlacedSegment> = None;
    for segment in segments.iter_mut().filter(|segment| segment.has_root()) {
        let read = &clips[&segment.clip];
        let first = read.clip.root()[segment.at];
        match &previous {
            Some(last) if segment.continues(last) => (segment.turn, segment.shift) = (last.turn, last.shift),
            Some(last) => {
                let (from, end) = (&clips[&last.clip], last.at + last.frames.len() - 1);
                segment.turn = last.turn + from.headings[end.min(from.headings.len() - 1)]
                    - read.headings[segment.at.min(read.headings.len() - 1)];
                let [leaving, arriving] = [Quat::from_rotation_y(last.turn), Quat::from_rotation_y(segment.turn)];
                let speed =
                    (leaving * speed(&from.clip, end, false) + arriving * speed(&read.clip, segment.at, true)) / 2.0;
                // + 1: from the last frame of one to the first of the next
                let s = ((segment.frames.start - last.frames.end + 1) as f64 / fps).min(MOVES_ON_S);
                let there = leaving * from.clip.root()[end] + last.shift + speed * s;
                segment.shift = (there - arriving * first).with_y(-read.above_m);
            }
            None => segment.shift = Vec3::Y * -read.above_m,
        }
        previous = Some(segment.clone());
    }
}

/// Velocity of the root over the ground after a frame, or before it, m/s.
fn speed(clip: &Clip, frame: usize, after: bool) -> Vec3 {
    let steps = ((SPEED_S * clip.fps()).round() as usize).max(1);
    let other = if after { (frame + steps).min(clip.frames() - 1) } else { frame.saturating_sub(steps) };
    let (from, to) = if after { (frame, other) } else { (other, frame) };
    // no frame beyond: at the clip's end, or in a clip of one frame
    if from == to {
        return Vec3::ZERO;
    }
    let velocity = (clip.root()[to] - clip.root()[from]).with_y(0.0) * (clip.fps() / (to - from) as f64);
    velocity.clamp_length_max(FASTEST_M_S)
}
