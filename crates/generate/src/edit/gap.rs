//! Generated gaps closed: brought to what is given on both sides. On SMPL-24, at the model's rate.
//!
//! A model samples a gap from its beginning on and may end elsewhere than where the clip continues. It also samples the first
//! frame after the gap, which is given. The difference between the two is the closing error, which is spread over the gap: of
//! path and heading over all of it, rigidly, of other joints over its last second, each by a smooth step. The difference in
//! speed is spread over its last 0.3 s.
//!
//! Contacts are not considered: feet in contact slide where the path's error is large.

use super::mask::Mask;
use crate::Result;
use kinelm_motion::rotation::{exp_map, heading, nearest_sign, slerp};
use kinelm_motion::{Clip, Quat, Vec3};
use std::ops::Range;

/// Rotations meet those after a gap within this time, seconds, or within the gap if that is shorter.
const CLOSE_S: f64 = 1.0;
/// The coding error of the frame before a gap fades within this time, seconds.
const BEGIN_S: f64 = 0.2;
/// Speeds meet those after a gap within this time, seconds.
const SPEED_S: f64 = 0.3;
/// Uncoded joints ease to their mean within this time, seconds, where nothing is given after a gap.
const SETTLE_S: f64 = 0.5;

/// The error at the end of a gap, before it is spread.
#[derive(Debug, Clone, PartialEq)]
pub struct ClosingError {
    /// The gap: frames at the model's rate.
    pub frames: Range<usize>,
    /// Distance of the root from where it is given, centimetres; 0 where it was not free.
    pub cm: f64,
    /// Heading error in degrees.
    pub heading_degrees: f64,
    /// Mean rotation error of the free joints, degrees.
    pub joints_degrees: f64,
}

impl ClosingError {
    /// One number by which tries are compared: a centimetre of the path counts as much as a degree of the joints.
    pub fn total(&self) -> f64 {
        self.cm + self.heading_degrees + self.joints_degrees
    }
}

/// A smooth step from 0 to 1.
pub(crate) fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    // slope 0 at both ends, so that a share that fades leaves no corner in the speed
    t * t * (3.0 - 2.0 * t)
}

/// The shares that a frame of a gap takes of the differences at its beginning and at its end.
#[derive(Debug, Clone, Copy)]
pub struct Shares {
    /// Of the difference in the frame before the gap: 1 there, fading.
    pub begin: f64,
    /// Of the difference in the frame after the gap: 1 there.
    pub end: f64,
}

impl Shares {
    /// Of a frame of a gap in a clip of `frames` frames, fading over `begin` frames at its beginning and `end` at its end.
    pub fn of(frame: usize, gap: &Range<usize>, frames: usize, begin: f64, end: f64) -> Shares {
        // + 1: the share is 1 in the frame outside the gap, and 0 only after `of` frames inside
        let length = |of: f64| of.min(gap.len() as f64).max(1.0) + 1.0;
        let since = (frame + 1 - gap.start) as f64;
        let until = (gap.end - frame) as f64;
        Shares {
            // at the clip's own ends there is nothing to meet
            begin: if gap.start == 0 { 0.0 } else { 1.0 - smooth(since / length(begin)) },
            end: if gap.end >= frames { 0.0 } else { 1.0 - smooth(until / length(end)) },
        }
    }
}

/// The offset of a frame of a gap, in frames, that adds a speed of one frame per frame at the gap's end: a cubic that is 0 at
/// both ends of the last `within` frames, with slope 0 at the first and 1 at the second.
fn speed_share(frame: usize, gap: &Range<usize>, within: f64) -> f64 {
    let within = within.min(gap.len() as f64 + 1.0);
    let u = (1.0 - (gap.end - frame) as f64 / within).max(0.0);
    // u^3 - u^2 has slope 1 at u = 1; times `within` its slope is 1 per frame
    within * (u * u * u - u * u)
}

/// `dance`, moved in every gap of the root so that it continues from `truth` before the gap, or meets `truth` after it if
/// nothing comes before. `truth` is as long, its last frame held beyond the clip.
///
/// # Errors
/// None for clips of one length.
pub fn aligned(dance: &Clip, truth: &Clip, mask: &Mask) -> Result<Clip> {
    let (mut root, mut rotations) = (dance.root().to_vec(), dance.rotations().to_vec());
    let (frames, j) = (dance.frames(), dance.joints());
    for gap in mask.free_runs(0) {
        let at = match (gap.start, gap.end) {
            // a gap at the beginning has no frame before it, and is put where it ends
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

/// The turn about the vertical that gives one pelvis the heading of another.
fn turn_between(from: Quat, to: Quat) -> Quat {
    Quat::from_rotation_y(angle_between_headings(from, to))
}

/// The turn from the heading of one pelvis to that of another, radians, -PI to PI; 0 where one has none.
pub(crate) fn angle_between_headings(from: Quat, to: Quat) -> f64 {
    let angle = heading(from).zip(heading(to)).map_or(0.0, |(from, to)| to - from);
    // the short way round: the difference of two headings may be beyond half a turn
    angle.sin().atan2(angle.cos())
}

/// `dance`, [`aligned`] and with one look-ahead frame after every gap, where it is free; `truth` where it is given. Also the
/// errors that were spread, by gap.
///
/// # Errors
/// None for clips of one length.
pub fn close(dance: &Clip, truth: &Clip, mask: &Mask) -> Result<(Clip, Vec<ClosingError>)> {
    let (frames, j, fps) = (dance.frames(), dance.joints(), dance.fps());
    let (mut root, mut rotations) = (truth.root().to_vec(), truth.rotations().to_vec());
    let mut left: Vec<(ClosingError, u32)> = Vec::new();
    let mut note = |gap: &Range<usize>| -> usize {
        left.iter().position(|(l, _)| l.frames == *gap).unwrap_or_else(|| {
            // joints free in the same frames share one entry; the number counts them, for the mean
            left.push((ClosingError { frames: gap.clone(), cm: 0.0, heading_degrees: 0.0, joints_degrees: 0.0 }, 0));
            left.len() - 1
        })
    };
    let mut found: Vec<(usize, f64, f64, Option<f64>)> = Vec::new();
    for gap in mask.free_runs(0) {
        // two given frames after the gap, without which it has no speed to meet
        let continues = mask.is_given(gap.end, 0) && mask.is_given(gap.end + 1, 0);
        // all corrections are of the dance as it came, so that the order of the joints doesn't matter
        let mut correction = RootCorrection::between(dance, truth, &gap, continues);
        if !follows_given(mask, 0, &gap) {
            correction.tilt_at_start = Vec3::ZERO;
        }
        for f in gap.clone() {
            let shares = Shares::of(f, &gap, frames, BEGIN_S * fps, gap.len() as f64);
            let speed = speed_share(f, &gap, SPEED_S * fps);
            (root[f], rotations[f * j]) = correction.apply(dance, f, shares, speed);
        }
        if gap.end < frames && gap.start > 0 {
            found.push((note(&gap), 100.0 * correction.offset.length(), correction.turn.abs().to_degrees(), None));
        }
    }
    for joint in (1..j).filter(|&joint| mask.is_coded(joint)) {
        for gap in mask.free_runs(joint) {
            let off = |f: usize| difference(dance.pose(f)[joint], truth.pose(f)[joint]);
            let begin = if follows_given(mask, joint, &gap) { off(gap.start - 1) } else { Vec3::ZERO };
            let end = if gap.end < frames { off(gap.end) } else { Vec3::ZERO };
            let continues = mask.is_given(gap.end, joint) && mask.is_given(gap.end + 1, joint);
            let speed = |clip: &Clip, f: usize| difference(clip.pose(f)[joint], clip.pose(f + 1)[joint]);
            let faster = if continues { speed(truth, gap.end) - speed(dance, gap.end - 1) } else { Vec3::ZERO };
            for f in gap.clone() {
                let shares = Shares::of(f, &gap, frames, BEGIN_S * fps, CLOSE_S * fps);
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

/// Whether the frame before a gap is given and decoded as such: right after another gap it is a look-ahead frame.
fn follows_given(mask: &Mask, joint: usize, gap: &Range<usize>) -> bool {
    gap.start == 1 || gap.start > 1 && mask.is_given(gap.start - 2, joint)
}

/// The rotation from one rotation to another, in the frame of the first, as a rotation vector.
pub(super) fn difference(from: Quat, to: Quat) -> Vec3 {
    let turn = from.conjugate() * to;
    exp_map::to_vector(nearest_sign(turn, Quat::IDENTITY))
}

/// The correction of the root that closes a gap.
struct RootCorrection {
    /// The root where the gap begins: the path is turned about it.
    start: Vec3,
    /// Turn about the vertical at the gap's end, radians.
    turn: f64,
    /// Offset at the gap's end after the turn, metres.
    offset: Vec3,
    /// Rotation of the pelvis at the gap's end after the turn.
    tilt: Vec3,
    /// The same at its beginning.
    tilt_at_start: Vec3,
    /// Difference of speed after the gap, metres per frame.
    faster: Vec3,
    /// Difference of turning speed, radians per frame.
    turns_faster: f64,
}

impl RootCorrection {
    fn between(dance: &Clip, truth: &Clip, gap: &Range<usize>, continues: bool) -> RootCorrection {
        let before = gap.start.checked_sub(1);
        // the frame before is as decoded, the gap as aligned to the truth
        let start = before.map_or(dance.root()[gap.start], |f| truth.root()[f]);
        let before_turned = |f: usize| turn_between(dance.pose(f)[0], truth.pose(f)[0]) * dance.pose(f)[0];
        let tilt_at_start = before.map_or(Vec3::ZERO, |f| difference(before_turned(f), truth.pose(f)[0]));
        let (turn, zero) = (0.0, Vec3::ZERO);
        let mut correction =
            RootCorrection { start, turn, offset: zero, tilt: zero, tilt_at_start, faster: zero, turns_faster: 0.0 };
        if gap.end < dance.frames() {
            let (from, to) = (dance.pose(gap.end)[0], truth.pose(gap.end)[0]);
            // a gap without a beginning is aligned to its end as a whole
            correction.turn = if before.is_some() { angle_between_headings(from, to) } else { 0.0 };
            let turn = Quat::from_rotation_y(correction.turn);
            correction.offset = truth.root()[gap.end] - (start + turn * (dance.root()[gap.end] - start));
            correction.tilt = difference(turn * from, to);
            if continues {
                let step = |clip: &Clip, f: usize| clip.root()[f + 1] - clip.root()[f];
                let turned = |clip: &Clip, f: usize| angle_between_headings(clip.pose(f)[0], clip.pose(f + 1)[0]);
                correction.faster = step(truth, gap.end) - turn * step(dance, gap.end - 1);
                correction.turns_faster = turned(truth, gap.end) - turned(dance, gap.end - 1);
            }
        }
        correction
    }

    /// Position and rotation of the root in a frame of the gap.
    fn apply(&self, dance: &Clip, frame: usize, shares: Shares, speed: f64) -> (Vec3, Quat) {
        let turn = Quat::from_rotation_y(self.turn * shares.end);
        let position = self.start + turn * (dance.root()[frame] - self.start) + self.offset * shares.end;
        let tilt = exp_map::from_vector(self.tilt_at_start * shares.begin + self.tilt * shares.end);
        let faster = Quat::from_rotation_y(self.turns_faster * speed);
        (position + self.faster * speed, faster * turn * dance.pose(frame)[0] * tilt)
    }
}

/// Uncoded joints interpolated through gaps in which every coded joint is free: from their pose before the gap to that after
/// it; to their `mean` within half a second where nothing comes after; as after it where nothing comes before. `clip` is on
/// any rig.
///
/// # Errors
/// None for a valid clip.
pub(crate) fn bridge(clip: &Clip, joints: &[usize], gaps: &[Range<usize>], mean: &[Quat]) -> Result<Clip> {
    let (frames, j) = (clip.frames(), clip.joints());
    let mut rotations = clip.rotations().to_vec();
    for gap in gaps {
        for (f, &joint) in gap.clone().flat_map(|f| joints.iter().map(move |joint| (f, joint))) {
            let before = gap.start.checked_sub(1).map(|f| clip.pose(f)[joint]);
            let after = (gap.end < frames).then(|| clip.pose(gap.end)[joint]);
            let since = (f + 1 - gap.start) as f64;
            rotations[f * j + joint] = match (before, after) {
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
    fn a_gap_meets_both_ends_and_given_frames_stay() {
        let (truth, mask) = (truth(), mask(60, |f, _| !(20..40).contains(&f)));
        let dance = astray(&truth, 25);
        let dance = aligned(&dance, &truth, &mask).unwrap();
        let (clip, left) = close(&dance, &truth, &mask).unwrap();
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
        let (clip, left) = close(&aligned, &truth, &mask).unwrap();
        assert!(left.iter().all(|left| left.total() < 1e-6), "{left:?}");
        // speeds are taken from both sides of a border, so that what accelerates there is moved, by less than it moves in a frame
        let (path, turn) = most_step(&truth);
        let turned = clip.rotations().iter().zip(truth.rotations()).map(|(a, b)| angle_between(*a, *b));
        assert!(turned.fold(0.0, f64::max) < turn);
        assert!(clip.root().iter().zip(truth.root()).all(|(a, b)| (*a - *b).length() < path));
    }

    #[test]
    fn a_gap_begins_at_the_given_frame_wherever_the_dance_is_decoded() {
        let (truth, mask) = (truth(), mask(60, |f, _| !(20..40).contains(&f)));
        let elsewhere = Quat::from_rotation_y(2.2);
        let root = truth.root().iter().map(|p| elsewhere * *p + Vec3::new(7.0, 0.0, 3.0)).collect();
        let mut rotations = truth.rotations().to_vec();
        rotations.iter_mut().step_by(24).for_each(|pelvis| *pelvis = elsewhere * *pelvis);
        let dance = Clip::new(truth.skeleton().clone(), truth.fps(), root, rotations).unwrap();
        let (clip, left) = close(&aligned(&dance, &truth, &mask).unwrap(), &truth, &mask).unwrap();
        assert!(left[0].total() < 1e-6, "{left:?}");
        let (path, turn) = most_step(&truth);
        for f in 20..40 {
            assert!((clip.root()[f] - truth.root()[f]).length() < path, "frame {f}");
            assert!(angle_between(clip.pose(f)[0], truth.pose(f)[0]) < turn, "frame {f}");
        }
    }

    #[test]
    fn a_gap_without_a_beginning_is_aligned_to_its_end_and_one_without_an_end_is_left() {
        let truth = truth();
        let dance = astray(&truth, 0);
        let opens = mask(60, |f, _| f >= 30);
        let (clip, left) = close(&aligned(&dance, &truth, &opens).unwrap(), &truth, &opens).unwrap();
        assert!(left.is_empty(), "nothing pulls it: {left:?}");
        assert!((clip.root()[29] - clip.root()[30]).length() < most_step(&truth).0 + 0.02);
        let ends = mask(60, |f, _| f < 30);
        let (clip, left) = close(&aligned(&dance, &truth, &ends).unwrap(), &truth, &ends).unwrap();
        assert!(left.is_empty() && (clip.root()[29] - clip.root()[30]).length() < most_step(&truth).0 + 0.02);
    }

    #[test]
    fn uncoded_joints_are_interpolated_from_pose_to_pose() {
        let clip = truth();
        let mean: Vec<Quat> = clip.pose(7).to_vec();
        let bridged = bridge(&clip, &[22], &[10..20, 50..60], &mean).unwrap();
        let of = |f: usize| bridged.pose(f)[22];
        assert_eq!([of(9), of(20)], [clip.pose(9)[22], clip.pose(20)[22]]);
        let way: Vec<f64> = (9..20).map(|f| angle_between(of(f), of(20))).collect();
        assert!(way.windows(2).all(|pair| pair[1] <= pair[0] + 1e-9), "{way:?}");
        assert!(angle_between(of(59), mean[22]) < 1e-6);
        assert_eq!(bridged.pose(15)[21], clip.pose(15)[21]);
    }
}
