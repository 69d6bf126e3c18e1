//! What was invented, brought to what is given on both sides of it. On SMPL-24, at the model's rate.
//!
//! A model draws a gap from its beginning on and may end elsewhere than where the clip goes on. It also foretells the first
//! frame behind the gap, which is given; what lies between the two is left over, and spread over the gap: of the path and
//! the heading over all of it, rigidly, of other joints over its last second, each share a smooth step. What differs in
//! speed is spread over its last 0.3 s.

use super::mask::Mask;
use crate::Result;
use kinelm_motion::rotation::{exp_map, heading, nearest_sign, slerp};
use kinelm_motion::{Clip, Quat, Vec3};
use std::ops::Range;

/// Rotations come to what is given behind a gap over so many seconds, or over the gap if that is shorter.
const CLOSE_S: f64 = 1.0;
/// What coding changed of the frame before a gap fades over so many seconds.
const BEGIN_S: f64 = 0.2;
/// Speeds come to those behind a gap over so many seconds.
const SPEED_S: f64 = 0.3;
/// Joints that the model doesn't know go to their mean over so many seconds where nothing is given any more.
const SETTLE_S: f64 = 0.5;

/// What was left over at the end of a gap, before it was spread.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOver {
    /// The gap: frames at the model's rate.
    pub frames: Range<usize>,
    /// How far the root stood from where it is given, centimetres; 0 where it was not free.
    pub cm: f64,
    /// How far it faced elsewhere, degrees.
    pub heading_degrees: f64,
    /// Mean over the free joints, degrees.
    pub joints_degrees: f64,
}

impl LeftOver {
    /// One number for all that was left over, by which one of several dances is preferred: a centimetre of the path counts
    /// as much as a degree of the joints.
    pub fn total(&self) -> f64 {
        self.cm + self.heading_degrees + self.joints_degrees
    }
}

/// A smooth step from 0 to 1.
pub fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The shares that a frame of a gap takes of what differs before it and of what differs behind it.
#[derive(Debug, Clone, Copy)]
pub struct Shares {
    /// Of the frame before the gap: 1 there, fading.
    pub begin: f64,
    /// Of the frame behind the gap: 1 there.
    pub end: f64,
}

impl Shares {
    /// Of a frame of a gap in a clip of `frames`, fading over `begin` frames at its beginning and `end` at its end.
    pub fn of(frame: usize, gap: &Range<usize>, frames: usize, (begin, end): (f64, f64)) -> Shares {
        let way = |of: f64| of.min(gap.len() as f64).max(1.0) + 1.0;
        let since = (frame + 1 - gap.start) as f64;
        let until = (gap.end - frame) as f64;
        Shares {
            begin: if gap.start == 0 { 0.0 } else { 1.0 - smooth(since / way(begin)) },
            end: if gap.end >= frames { 0.0 } else { 1.0 - smooth(until / way(end)) },
        }
    }
}

/// How far a frame of a gap is carried, in frames, to have one frame a frame more speed behind it: a cubic that is 0 at both
/// ends of the last `within` frames, at rest at the first and of slope 1 at the second.
fn speed_share(frame: usize, gap: &Range<usize>, within: f64) -> f64 {
    let within = within.min(gap.len() as f64 + 1.0);
    let u = (1.0 - (gap.end - frame) as f64 / within).max(0.0);
    within * (u * u * u - u * u)
}

/// `dance`, moved in every gap of the root so that it goes on from where `truth` stands before it, or goes to where it
/// stands behind it if nothing is before. `truth` is as long, its last frame held beyond the clip.
///
/// # Errors
/// None that clips of one length bring about.
pub fn aligned(dance: &Clip, truth: &Clip, mask: &Mask) -> Result<Clip> {
    let (mut root, mut rotations) = (dance.root().to_vec(), dance.rotations().to_vec());
    let (frames, j) = (dance.frames(), dance.joints());
    for gap in mask.free_runs(0) {
        let at = match (gap.start, gap.end) {
            (0, end) if end < frames => end,
            (start, _) => start.saturating_sub(1),
        };
        let (turn, from, to) = (turn_between(dance.pose(at)[0], truth.pose(at)[0]), dance.root()[at], truth.root()[at]);
        for f in gap.start..(gap.end + 1).min(frames) {
            root[f] = turn * (dance.root()[f] - from) + to;
            rotations[f * j] = turn * dance.pose(f)[0];
        }
    }
    Ok(Clip::new(dance.skeleton().clone(), dance.fps(), root, rotations)?)
}

/// The turn about the vertical that makes one pelvis face as another.
fn turn_between(from: Quat, to: Quat) -> Quat {
    Quat::from_rotation_y(angle_between_headings(from, to))
}

fn angle_between_headings(from: Quat, to: Quat) -> f64 {
    let angle = heading(from).zip(heading(to)).map_or(0.0, |(from, to)| to - from);
    angle.sin().atan2(angle.cos())
}

/// `dance`, [`aligned`] and with one frame foretold behind every gap, where it is free; `truth` where it is given.
///
/// # Errors
/// None that clips of one length bring about.
pub fn closed(dance: &Clip, truth: &Clip, mask: &Mask) -> Result<(Clip, Vec<LeftOver>)> {
    let (frames, j, fps) = (dance.frames(), dance.joints(), dance.fps());
    let (mut root, mut rotations) = (truth.root().to_vec(), truth.rotations().to_vec());
    let mut left: Vec<(LeftOver, u32)> = Vec::new();
    let mut note = |gap: &Range<usize>| -> usize {
        left.iter().position(|(l, _)| l.frames == *gap).unwrap_or_else(|| {
            left.push((LeftOver { frames: gap.clone(), cm: 0.0, heading_degrees: 0.0, joints_degrees: 0.0 }, 0));
            left.len() - 1
        })
    };
    let mut found: Vec<(usize, f64, f64, Option<f64>)> = Vec::new();
    for gap in mask.free_runs(0) {
        let goes_on = mask.is_given(gap.end, 0) && mask.is_given(gap.end + 1, 0);
        let mut way = Way::between(dance, truth, &gap, goes_on);
        if !drawn_behind_given(mask, 0, &gap) {
            way.tilt_before = Vec3::ZERO;
        }
        for f in gap.clone() {
            let fade = (BEGIN_S * fps, gap.len() as f64);
            let speed = speed_share(f, &gap, SPEED_S * fps);
            (root[f], rotations[f * j]) = way.carry(dance, f, Shares::of(f, &gap, frames, fade), speed);
        }
        if gap.end < frames && gap.start > 0 {
            found.push((note(&gap), 100.0 * way.to.length(), way.turn.abs().to_degrees(), None));
        }
    }
    for joint in (1..j).filter(|&joint| mask.is_coded(joint)) {
        for gap in mask.free_runs(joint) {
            let off = |f: usize| difference(dance.pose(f)[joint], truth.pose(f)[joint]);
            let begin = if drawn_behind_given(mask, joint, &gap) { off(gap.start - 1) } else { Vec3::ZERO };
            let end = if gap.end < frames { off(gap.end) } else { Vec3::ZERO };
            let goes_on = mask.is_given(gap.end, joint) && mask.is_given(gap.end + 1, joint);
            let speed = |clip: &Clip, f: usize| difference(clip.pose(f)[joint], clip.pose(f + 1)[joint]);
            let faster = if goes_on { speed(truth, gap.end) - speed(dance, gap.end - 1) } else { Vec3::ZERO };
            for f in gap.clone() {
                let shares = Shares::of(f, &gap, frames, (BEGIN_S * fps, CLOSE_S * fps));
                let speed = speed_share(f, &gap, SPEED_S * fps);
                let by = begin * shares.begin + end * shares.end + faster * speed;
                rotations[f * j + joint] = dance.pose(f)[joint] * exp_map::from_vector(by);
            }
            if gap.end < frames && gap.start > 0 {
                found.push((note(&gap), 0.0, 0.0, Some(end.length().to_degrees())));
            }
        }
    }
    for (at, cm, heading, joint) in found {
        let (left, joints) = &mut left[at];
        left.cm += cm;
        left.heading_degrees += heading;
        left.joints_degrees += joint.unwrap_or(0.0);
        *joints += u32::from(joint.is_some());
    }
    for (left, joints) in &mut left {
        left.joints_degrees /= f64::from((*joints).max(1));
    }
    left.sort_by_key(|(left, _)| (left.frames.start, left.frames.end));
    let clip = Clip::new(dance.skeleton().clone(), fps, root, rotations)?;
    Ok((clip, left.into_iter().map(|(left, _)| left).collect()))
}

/// Whether the frame before a gap is given and decoded as such: behind another gap it is the foretold one.
fn drawn_behind_given(mask: &Mask, joint: usize, gap: &Range<usize>) -> bool {
    gap.start == 1 || gap.start > 1 && mask.is_given(gap.start - 2, joint)
}

/// The turn that leads from one rotation to another, in the frame of the first, as a rotation vector.
pub(super) fn difference(from: Quat, to: Quat) -> Vec3 {
    let turn = from.conjugate() * to;
    exp_map::to_vector(nearest_sign(turn, Quat::IDENTITY))
}

/// What the root lacks at the ends of a gap.
struct Way {
    /// Where the gap begins: what the path is turned about.
    start: Vec3,
    /// Radians about the vertical, at its end.
    turn: f64,
    /// Metres, at its end, the path turned.
    to: Vec3,
    /// What is left of the pelvis's rotation at its end, the heading turned.
    tilt: Vec3,
    /// The same at its beginning.
    tilt_before: Vec3,
    /// How much faster the truth moves behind it, metres a frame.
    faster: Vec3,
    /// How much faster it turns, radians a frame.
    turns_faster: f64,
}

impl Way {
    fn between(dance: &Clip, truth: &Clip, gap: &Range<usize>, goes_on: bool) -> Way {
        let before = gap.start.checked_sub(1);
        // the frame before stands as it was decoded, and the gap as it was laid on the truth
        let start = before.map_or(dance.root()[gap.start], |f| truth.root()[f]);
        let before_turned = |f: usize| turn_between(dance.pose(f)[0], truth.pose(f)[0]) * dance.pose(f)[0];
        let tilt_before = before.map_or(Vec3::ZERO, |f| difference(before_turned(f), truth.pose(f)[0]));
        let none = Vec3::ZERO;
        let mut way = Way { start, turn: 0.0, to: none, tilt: none, tilt_before, faster: none, turns_faster: 0.0 };
        if gap.end < dance.frames() {
            let (from, to) = (dance.pose(gap.end)[0], truth.pose(gap.end)[0]);
            // of a gap without a beginning the whole was laid on its end
            way.turn = if before.is_some() { angle_between_headings(from, to) } else { 0.0 };
            let turn = Quat::from_rotation_y(way.turn);
            way.to = truth.root()[gap.end] - (start + turn * (dance.root()[gap.end] - start));
            way.tilt = difference(turn * from, to);
            if goes_on {
                let step = |clip: &Clip, f: usize| clip.root()[f + 1] - clip.root()[f];
                let turned = |clip: &Clip, f: usize| angle_between_headings(clip.pose(f)[0], clip.pose(f + 1)[0]);
                way.faster = step(truth, gap.end) - turn * step(dance, gap.end - 1);
                way.turns_faster = turned(truth, gap.end) - turned(dance, gap.end - 1);
            }
        }
        way
    }

    /// Place and rotation of the root in a frame of the gap.
    fn carry(&self, dance: &Clip, frame: usize, shares: Shares, speed: f64) -> (Vec3, Quat) {
        let turn = Quat::from_rotation_y(self.turn * shares.end);
        let place = self.start + turn * (dance.root()[frame] - self.start) + self.to * shares.end;
        let tilt = exp_map::from_vector(self.tilt_before * shares.begin + self.tilt * shares.end);
        let faster = Quat::from_rotation_y(self.turns_faster * speed);
        (place + self.faster * speed, faster * turn * dance.pose(frame)[0] * tilt)
    }
}

/// Joints that the model doesn't know, where all that it knows is free: from their pose before the gap to that behind it; to
/// their mean over half a second where nothing is behind, as behind it where nothing is before. `clip` is on any rig.
///
/// # Errors
/// None that a clip brings about.
pub fn bridged(clip: &Clip, joints: &[usize], gaps: &[Range<usize>], mean: &[Quat]) -> Result<Clip> {
    let (frames, j) = (clip.frames(), clip.joints());
    let mut rotations = clip.rotations().to_vec();
    for gap in gaps {
        for (f, &joint) in gap.clone().flat_map(|f| joints.iter().map(move |joint| (f, joint))) {
            let before = gap.start.checked_sub(1).map(|f| clip.pose(f)[joint]);
            let behind = (gap.end < frames).then(|| clip.pose(gap.end)[joint]);
            let since = (f + 1 - gap.start) as f64;
            rotations[f * j + joint] = match (before, behind) {
                (Some(from), Some(to)) => slerp(from, to, smooth(since / (gap.len() + 1) as f64)),
                (Some(from), None) => slerp(from, mean[joint], smooth(since / (SETTLE_S * clip.fps()).max(1.0))),
                (None, Some(to)) => to,
                (None, None) => mean[joint],
            };
        }
    }
    Ok(Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations)?)
}

#[cfg(test)]
mod tests {
    use super::super::mask::tests::mask;
    use super::*;
    use kinelm_motion::rotation::angle_between;
    use kinelm_motion::synth;

    /// Three seconds of a dance at 20 frames a second.
    fn truth() -> Clip {
        synth::corpus(4, 1, 3.0, 20.0).unwrap().remove(0).clip
    }

    /// The dance that goes elsewhere from frame `from` on: turned, moved, and with another elbow.
    fn astray(clip: &Clip, from: usize) -> Clip {
        let turn = Quat::from_rotation_y(0.3);
        let (mut root, mut rotations) = (clip.root().to_vec(), clip.rotations().to_vec());
        for f in from..clip.frames() {
            root[f] = turn * root[f] + Vec3::new(0.4, 0.02, -0.1);
            rotations[f * 24] = turn * rotations[f * 24];
            rotations[f * 24 + 18] *= Quat::from_rotation_x(0.5);
        }
        Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations).unwrap()
    }

    fn most_step(clip: &Clip) -> (f64, f64) {
        let steps = (1..clip.frames()).map(|f| {
            let turned = (0..24).map(|j| angle_between(clip.pose(f)[j], clip.pose(f - 1)[j])).fold(0.0, f64::max);
            ((clip.root()[f] - clip.root()[f - 1]).length(), turned)
        });
        steps.fold((0.0, 0.0), |(a, b), (c, d)| (f64::max(a, c), f64::max(b, d)))
    }

    #[test]
    fn a_gap_is_brought_to_both_ends_and_what_is_given_stays() {
        let (truth, mask) = (truth(), mask(60, |f, _| !(20..40).contains(&f)));
        let dance = astray(&truth, 25);
        let dance = aligned(&dance, &truth, &mask).unwrap();
        let (clip, left) = closed(&dance, &truth, &mask).unwrap();
        for f in (0..20).chain(40..60) {
            assert_eq!((clip.root()[f], clip.pose(f)), (truth.root()[f], truth.pose(f)), "frame {f}");
        }
        let [left] = &left[..] else { panic!("{left:?}") };
        assert_eq!(left.frames, 20..40);
        assert!((left.heading_degrees - 0.3f64.to_degrees()).abs() < 0.1, "{left:?}");
        assert!(left.cm > 30.0 && (left.joints_degrees - 0.5f64.to_degrees() / 23.0).abs() < 0.1, "{left:?}");
        // it went astray by a jump in one frame; what is left is no larger than that, and the ends are met without one
        let ((path, turn), (_, jump)) = (most_step(&truth), most_step(&dance));
        let ends: Vec<(f64, f64)> = [18..22, 36..42].map(|frames| most_step(&clip.slice(frames))).into_iter().collect();
        assert!(ends.iter().all(|(p, t)| *p < path + 0.05 && *t < turn + 0.1 && *t < jump), "{ends:?} {path} {turn}");
    }

    #[test]
    fn a_dance_that_is_the_truth_is_hardly_touched() {
        let (truth, mask) = (truth(), mask(60, |f, j| !(10..50).contains(&f) || j == 4));
        let aligned = aligned(&truth, &truth, &mask).unwrap();
        let (clip, left) = closed(&aligned, &truth, &mask).unwrap();
        assert!(left.iter().all(|left| left.total() < 1e-6), "{left:?}");
        // speeds are taken from both sides of a border, so that what accelerates there is moved, by less than it moves in a frame
        let (path, turn) = most_step(&truth);
        let turned = clip.rotations().iter().zip(truth.rotations()).map(|(a, b)| angle_between(*a, *b));
        assert!(turned.fold(0.0, f64::max) < turn);
        assert!(clip.root().iter().zip(truth.root()).all(|(a, b)| (*a - *b).length() < path));
    }

    #[test]
    fn wherever_a_dance_is_decoded_a_gap_begins_where_it_is_given() {
        let (truth, mask) = (truth(), mask(60, |f, _| !(20..40).contains(&f)));
        let elsewhere = Quat::from_rotation_y(2.2);
        let root = truth.root().iter().map(|p| elsewhere * *p + Vec3::new(7.0, 0.0, 3.0)).collect();
        let mut rotations = truth.rotations().to_vec();
        rotations.iter_mut().step_by(24).for_each(|pelvis| *pelvis = elsewhere * *pelvis);
        let dance = Clip::new(truth.skeleton().clone(), truth.fps(), root, rotations).unwrap();
        let (clip, left) = closed(&aligned(&dance, &truth, &mask).unwrap(), &truth, &mask).unwrap();
        assert!(left[0].total() < 1e-6, "{left:?}");
        let (path, turn) = most_step(&truth);
        for f in 20..40 {
            assert!((clip.root()[f] - truth.root()[f]).length() < path, "frame {f}");
            assert!(angle_between(clip.pose(f)[0], truth.pose(f)[0]) < turn, "frame {f}");
        }
    }

    #[test]
    fn what_has_no_beginning_is_laid_on_its_end_and_what_has_no_end_goes_where_it_goes() {
        let truth = truth();
        let dance = astray(&truth, 0);
        let opens = mask(60, |f, _| f >= 30);
        let (clip, left) = closed(&aligned(&dance, &truth, &opens).unwrap(), &truth, &opens).unwrap();
        assert!(left.is_empty(), "nothing pulls it: {left:?}");
        assert!((clip.root()[29] - clip.root()[30]).length() < most_step(&truth).0 + 0.02);
        let ends = mask(60, |f, _| f < 30);
        let (clip, left) = closed(&aligned(&dance, &truth, &ends).unwrap(), &truth, &ends).unwrap();
        assert!(left.is_empty() && (clip.root()[29] - clip.root()[30]).length() < most_step(&truth).0 + 0.02);
    }

    #[test]
    fn unknown_joints_go_from_pose_to_pose() {
        let clip = truth();
        let mean: Vec<Quat> = clip.pose(7).to_vec();
        let bridged = bridged(&clip, &[22], &[10..20, 50..60], &mean).unwrap();
        let of = |f: usize| bridged.pose(f)[22];
        assert_eq!([of(9), of(20)], [clip.pose(9)[22], clip.pose(20)[22]]);
        let way: Vec<f64> = (9..20).map(|f| angle_between(of(f), of(20))).collect();
        assert!(way.windows(2).all(|pair| pair[1] <= pair[0] + 1e-9), "{way:?}");
        assert!(angle_between(of(59), mean[22]) < 1e-6);
        assert_eq!(bridged.pose(15)[21], clip.pose(15)[21]);
    }
}
