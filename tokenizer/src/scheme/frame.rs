//! Words of one frame: the root's step, then the pose.

use super::line::Scale;
use super::pelvis::{Turns, about_y};
use super::walk::{Height, Travel, Walk, check_positions, start};
use super::{Encoded, UncodedPose};
use crate::{Channels, Result, Words};
use kinelm_motion::rotation::{Axis, exp_map};
use kinelm_motion::{Clip, Quat, Vec3, smpl};
use std::f64::consts::PI;

/// How a scheme codes the joints of a pose, frame by frame through a clip.
pub(super) trait Poses {
    /// Encodes a pose (24) into a word's characters after the translation; returns the decoded pelvis if it is coded.
    fn encode(&mut self, pose: &[Quat], word: &mut [u16], out: &mut Encoded) -> Option<Quat>;

    /// Sets the coded joints of a pose (24); returns the pelvis if it is coded.
    fn decode(&mut self, word: &[u16], pose: &mut [Quat]) -> Option<Quat>;
}

/// The words of a clip, `length` characters each.
pub(super) fn encode(
    clip: &Clip,
    length: usize,
    mut walk: Walk,
    steps: &[impl Scale; 3],
    mut poses: impl Poses,
) -> Result<Encoded> {
    check_positions(clip)?;
    let mut codes = vec![0; clip.frames() * length];
    let mut out = Encoded::default();
    let start = start(clip);
    for (f, word) in codes.chunks_exact_mut(length).enumerate() {
        let (head, tail) = word.split_at_mut(3);
        for (place, (code, clipped)) in head.iter_mut().zip(walk.step(steps, clip.root()[f] - start)) {
            *place = code;
            out.clipped += u64::from(clipped);
        }
        if let Some(pelvis) = poses.encode(clip.pose(f), tail, &mut out) {
            // the decoded heading, which the decoder has too: steps of the next frame are relative to it
            walk.face(pelvis);
        }
    }
    out.words = Words::fixed(codes, length);
    Ok(out)
}

/// The clip of words.
pub(super) fn decode(
    words: &Words,
    fps: f64,
    uncoded: UncodedPose<'_>,
    mut walk: Walk,
    steps: &[impl Scale; 3],
    mut poses: impl Poses,
) -> Result<Clip> {
    let mut root = Vec::with_capacity(words.len());
    let mut rotations = Vec::with_capacity(words.len() * 24);
    for (f, word) in words.iter().enumerate() {
        // position before rotation, as in the encoder: a step is in the heading of the frame before
        walk.follow(steps, [word[0], word[1], word[2]]);
        root.push(walk.at());
        uncoded.fill(f, &mut rotations);
        if let Some(pelvis) = poses.decode(&word[3..], &mut rotations[f * 24..]) {
            walk.face(pelvis);
        }
    }
    Ok(Clip::new(smpl::neutral(), fps, root, rotations)?)
}

/// The codes of one joint's rotation vector.
pub(super) struct Coded {
    pub codes: [u16; 3],
    /// Components outside the bins.
    pub clipped: u64,
    /// Whether the nearest codes were replaced because they would not encode to themselves after decoding.
    pub second: bool,
}

/// Bins of rotation vectors, one character per component.
pub(super) trait Vectors {
    /// The codes of the `n`-th coded joint. For a tilt, which has no y, the code of y is ignored.
    fn code(&self, n: usize, q: Quat) -> Coded;

    /// The vector of codes of the `n`-th coded joint.
    fn vector(&self, n: usize, codes: [u16; 3]) -> Vec3;

    /// The edges between the bins of a component of the `n`-th coded joint, ascending, radians.
    fn edges(&self, n: usize, axis: Axis) -> Vec<f64>;
}

/// Codes each joint separately: x, y, z of its rotation vector, or turn and tilt of the pelvis.
pub(super) struct Each<'a, V> {
    joints: &'a [usize],
    turns: Option<Turns>,
    vectors: V,
}

impl<'a, V: Vectors> Each<'a, V> {
    /// At a clip's start; `bins` of the turn, if the channels have one.
    pub(super) fn new(channels: &'a Channels, bins: u32, vectors: V) -> Self {
        Each { joints: channels.joints(), turns: channels.has_turn().then(|| Turns::new(bins)), vectors }
    }

    /// Codes only the pelvis, if it is coded.
    pub(super) fn pelvis(channels: &'a Channels, bins: u32, vectors: V) -> Self {
        let mut each = Each::new(channels, bins, vectors);
        each.joints = &each.joints[..usize::from(each.joints.first() == Some(&0))];
        each
    }

    fn tilt(&self, codes: [u16; 3]) -> Vec3 {
        self.vectors.vector(0, codes) * Vec3::new(1.0, 0.0, 1.0)
    }
}

impl<V: Vectors> Poses for Each<'_, V> {
    fn encode(&mut self, pose: &[Quat], word: &mut [u16], out: &mut Encoded) -> Option<Quat> {
        let (mut joints, mut places, mut pelvis) = (self.joints, word, None);
        let mut tally = |coded: &Coded| {
            out.clipped += coded.clipped;
            out.second_codes += u64::from(coded.second);
        };
        // a copy, because the closure borrows `self` for its bins
        let mut turns = self.turns;
        if let Some(turns) = &mut turns {
            let (step, (coded, tilt)) = turns.step(pose[0], |tilt| {
                let coded = self.vectors.code(0, tilt);
                let decoded = self.tilt(coded.codes);
                ((coded, decoded), decoded)
            });
            let (place, tail) = places.split_at_mut(3);
            place.copy_from_slice(&[step, coded.codes[0], coded.codes[2]]);
            tally(&coded);
            pelvis = Some(about_y(turns.radians()) * exp_map::from_vector(tilt));
            (joints, places) = (&joints[1..], tail);
        }
        self.turns = turns;
        let first = usize::from(pelvis.is_some());
        for (n, (&joint, place)) in joints.iter().zip(places.chunks_exact_mut(3)).enumerate() {
            let coded = self.vectors.code(first + n, pose[joint]);
            place.copy_from_slice(&coded.codes);
            tally(&coded);
            if joint == 0 {
                pelvis = Some(exp_map::from_vector(self.vectors.vector(n, coded.codes)));
            }
        }
        pelvis
    }

    fn decode(&mut self, word: &[u16], pose: &mut [Quat]) -> Option<Quat> {
        let (mut joints, mut places, mut first) = (self.joints, word, 0);
        if let Some(turns) = &mut self.turns {
            turns.follow(word[0]);
            let turn = about_y(turns.radians());
            pose[0] = turn * exp_map::from_vector(self.tilt([word[1], 0, word[2]]));
            (joints, places, first) = (&joints[1..], &word[3..], 1);
        }
        for (n, (&joint, k)) in joints.iter().zip(places.chunks_exact(3)).enumerate() {
            pose[joint] = exp_map::from_vector(self.vectors.vector(first + n, [k[0], k[1], k[2]]));
        }
        (self.joints.first() == Some(&0)).then(|| pose[0])
    }
}

/// Decoded vectors up to this length, radians, are canonical, and rounding in a file doesn't turn them into their twins.
pub(super) const LONGEST: f64 = PI - 1e-6;

/// The rotations of a pose as numbers: canonical rotation vectors; the tilt's x and z for a pelvis with a turn.
///
/// Canonical rather than continuous in time: a frame's numbers don't depend on earlier frames, and vectors are at most half a
/// turn long, so that a fitted range contains them.
pub(super) struct Numbers<'a> {
    joints: &'a [usize],
    pub turns: Option<Turns>,
}

impl<'a> Numbers<'a> {
    /// At a clip's start.
    pub(super) fn new(channels: &'a Channels, bins: u32) -> Self {
        Numbers { joints: channels.joints(), turns: channels.has_turn().then(|| Turns::new(bins)) }
    }

    /// The numbers of a pose.
    pub(super) fn len(channels: &Channels) -> usize {
        channels.len() - 3 - usize::from(channels.has_turn())
    }

    /// Whether the pelvis is coded.
    pub(super) fn has_pelvis(&self) -> bool {
        self.joints.first() == Some(&0)
    }

    /// Appends the numbers of a pose (24); returns the code of the turn's step.
    pub(super) fn of(&mut self, pose: &[Quat], out: &mut Vec<f64>) -> Option<u16> {
        let tilted = self.turns.as_mut().map(|turns| turns.step(pose[0], |tilt| (tilt, Vec3::ZERO)));
        self.gather(tilted, pose, out)
    }

    /// As [`Numbers::of`], with the previous frame's turn.
    pub(super) fn of_kept_turn(&mut self, pose: &[Quat], out: &mut Vec<f64>) -> Option<u16> {
        let tilted = self.turns.map(|turns| turns.keep(pose[0]));
        self.gather(tilted, pose, out)
    }

    fn gather(&self, tilted: Option<(u16, Quat)>, pose: &[Quat], out: &mut Vec<f64>) -> Option<u16> {
        let mut joints = self.joints;
        if let Some((_, tilt)) = tilted {
            let v = exp_map::to_vector(tilt);
            out.extend([v.x, v.z]);
            joints = &joints[1..];
        }
        joints.iter().for_each(|&joint| out.extend(exp_map::to_vector(pose[joint]).to_array()));
        tilted.map(|(step, _)| step)
    }

    /// Whether the turn of a decoded tilt is undefined.
    pub(super) fn upside_down(&self, numbers: &[f64]) -> bool {
        self.turns.is_some_and(|turns| turns.upside_down(Vec3::new(numbers[0], 0.0, numbers[1])))
    }

    /// Moves the turn by its code and sets the coded joints of a pose (24); returns the pelvis if it is coded.
    pub(super) fn set(&mut self, numbers: &[f64], step: Option<u16>, pose: &mut [Quat]) -> Option<Quat> {
        let (mut joints, mut numbers) = (self.joints, numbers);
        if let (Some(turns), Some(step)) = (&mut self.turns, step) {
            turns.follow(step);
            pose[0] = self.pelvis(numbers);
            (joints, numbers) = (&joints[1..], &numbers[2..]);
        }
        for (&joint, v) in joints.iter().zip(numbers.chunks_exact(3)) {
            pose[joint] = exp_map::from_vector(Vec3::from_slice(v));
        }
        self.has_pelvis().then(|| pose[0])
    }

    /// Makes decoded vectors canonical and those that weren't at most half a turn less `shorter` radians long. Returns whether
    /// there were any.
    pub(super) fn canonical(&self, numbers: &mut [f64], shorter: f64) -> bool {
        let (tilt, vectors) = numbers.split_at_mut(if self.turns.is_some() { 2 } else { 0 });
        let mut longer = false;
        let mut each = |v: Vec3| {
            let long = v.length() > LONGEST;
            longer |= long;
            if long { exp_map::canonical(v).clamp_length_max((LONGEST - shorter).max(0.0)) } else { v }
        };
        if let [x, z] = tilt {
            let v = each(Vec3::new(*x, 0.0, *z));
            (*x, *z) = (v.x, v.z);
        }
        vectors.chunks_exact_mut(3).for_each(|v| v.copy_from_slice(&each(Vec3::from_slice(v)).to_array()));
        longer
    }

    /// The pelvis of a pose's numbers and the current turn.
    pub(super) fn pelvis(&self, numbers: &[f64]) -> Quat {
        match &self.turns {
            Some(turns) => about_y(turns.radians()) * exp_map::from_vector(Vec3::new(numbers[0], 0.0, numbers[1])),
            None => exp_map::from_vector(Vec3::from_slice(numbers)),
        }
    }

    /// The numbers of all frames of clips, (N, [`Numbers::len`]).
    pub(super) fn of_clips(channels: &Channels, bins: u32, clips: &[Clip]) -> Vec<f64> {
        let frames: usize = clips.iter().map(Clip::frames).sum();
        let mut out = Vec::with_capacity(frames * Numbers::len(channels));
        for clip in clips {
            let mut numbers = Numbers::new(channels, bins);
            (0..clip.frames()).for_each(|f| _ = numbers.of(clip.pose(f), &mut out));
        }
        out
    }
}

/// The sorted columns of numbers (N, `columns`), for fitting bins.
pub(super) fn sorted_columns(rows: &[f64], columns: usize) -> Vec<Vec<f64>> {
    let column = |c: usize| {
        let mut column: Vec<f64> = rows.iter().skip(c).step_by(columns).copied().collect();
        column.sort_unstable_by(f64::total_cmp);
        column
    };
    (0..columns).map(column).collect()
}

/// Calls `each` with the root's step from every frame of a clip to the next, relative to the heading that `poses` decodes from
/// `length` characters.
pub(super) fn each_step(clip: &Clip, length: usize, mut poses: impl Poses, mut each: impl FnMut(Vec3)) -> Result<()> {
    check_positions(clip)?;
    let mut walk = Walk::new(0.0, Travel::Velocity, Height::Velocity);
    let mut word = vec![0; length];
    for (f, pair) in clip.root().windows(2).enumerate() {
        if let Some(pelvis) = poses.encode(clip.pose(f), &mut word, &mut Encoded::default()) {
            walk.face(pelvis);
        }
        each(walk.turned_in(pair[1] - pair[0]));
    }
    Ok(())
}

/// The steps x, y, z of training clips, each sorted, relative to the heading that `poses` decodes from `length` characters, and
/// the mean height of the clips' first frames, metres; `None` without a frame. The first frames' steps in height are included.
pub(super) fn training_steps<P: Poses>(
    clips: &[Clip],
    length: usize,
    poses: impl Fn() -> P,
) -> Result<Option<([Vec<f64>; 3], f64)>> {
    let firsts: Vec<f64> = clips.iter().filter_map(|c| c.root().first()).map(|p| p.y).collect();
    if firsts.is_empty() {
        return Ok(None);
    }
    let first_height = firsts.iter().sum::<f64>() / firsts.len() as f64;
    // 0 is always among the steps: frame 0 has none in x and z, and standing must be codable
    let mut steps = [vec![0.0], firsts.iter().map(|y| y - first_height).collect(), vec![0.0]];
    for clip in clips {
        each_step(clip, length, poses(), |step| {
            steps.iter_mut().zip(step.to_array()).for_each(|(all, x)| all.push(x));
        })?;
    }
    steps.iter_mut().for_each(|all| all.sort_unstable_by(f64::total_cmp));
    Ok(Some((steps, first_height)))
}
