//! A timeline composed into one file: the numbers of its clips digit for digit, straight lines between.

use super::layout::{PlacedSegment, TimelineLayout, TimelineRig};
use crate::Result;
use crate::edit::gap::bridge;
use crate::edit::mask::Mask;
use crate::edit::splice::RigJoints;
use crate::request::{Edit, PromptRequest, Span, Timeline};
use kinelm_motion::format::bvh::{BvhSource, Piece, parse_header};
use kinelm_motion::format::{Changed, ReadOptions, RestFrame};
use kinelm_motion::moment::Moment;
use kinelm_motion::retarget::Retarget;
use kinelm_motion::{Clip, Quat, Vec3, smpl};
use std::path::Path;

impl TimelineLayout {
    /// The file that lends its rig.
    pub fn path(&self) -> &Path {
        &self.rig.own.file
    }

    /// How the composed file is read.
    pub fn read(&self) -> ReadOptions {
        let (up, floor) = (self.rig.source.rig.axes.up, Some(self.rig.floor_m));
        ReadOptions { skip: 0, rest: RestFrame::Keep, up, floor, ..self.rig.own.options() }
    }

    /// The spans that the clips give.
    pub(crate) fn given(&self) -> Vec<Span> {
        let span = |segment: &PlacedSegment| {
            let [from, to] = [segment.frames.start, segment.frames.end].map(|f| Some(Moment::Frames(f as f64)));
            Span { joints: segment.list.clone(), from, to }
        };
        self.segments.iter().map(span).collect()
    }

    /// The prompt of a dance that generates what the clips leave free. Blend and tries as in [`Edit`].
    pub fn prompt(&self, timeline: Timeline, blend_s: Option<f64>, tries: Option<usize>) -> PromptRequest {
        let edit = Edit { given: self.given(), blend_s, tries, ..Edit::default() };
        PromptRequest {
            read: self.read(),
            timeline: Some(timeline),
            edit: Some(edit),
            ..PromptRequest::of(self.path())
        }
    }

    /// The file: what clips give, and straight lines where none does.
    ///
    /// # Errors
    /// None for clips that were read.
    pub(crate) fn compose(&self) -> Result<Vec<u8>> {
        let TimelineRig { own, motion, source, .. } = &self.rig;
        let skeleton = motion.clip.skeleton();
        let retarget = Retarget::new(motion.humanoid()?, smpl::neutral())?;
        let owners = owners(&retarget);
        // (F, J) the segment that gives a joint
        let j = skeleton.joints();
        let mut by: Vec<Option<usize>> = vec![None; self.frames * j];
        for (n, segment) in self.segments.iter().enumerate() {
            for frame in segment.frames.clone() {
                let given = (0..j).filter(|&joint| segment.joints.contains(&owners[joint]));
                given.for_each(|joint| by[frame * j + joint] = Some(n));
            }
        }
        let clip = self.clip(&by)?;
        let names: Vec<&String> = self.clips.keys().collect();
        let exact: Vec<Option<Piece>> =
            self.clips.values().map(|read| read.exact.as_ref().map(|(source, text)| (source, &text[..]))).collect();
        let pieces: Vec<Piece> = exact.iter().flatten().copied().collect();
        let piece_of = |segment: usize| {
            let clip = names.iter().position(|name| **name == self.segments[segment].clip)?;
            exact[clip].map(|_| exact[..clip].iter().flatten().count())
        };
        let of_segment: Vec<Option<usize>> = (0..self.segments.len()).map(piece_of).collect();
        // where no clip gives numbers they are new; the rig's fill their places until then
        let of_rig = names.iter().position(|name| **name == self.rig.name).unwrap_or(0);
        let of_rig = (exact[..of_rig].iter().flatten().count(), self.clips[&self.rig.name].left_out);
        let words = |frame: usize, joint: usize| {
            let given = by[frame * j + joint].and_then(|n| {
                let segment = &self.segments[n];
                let left_out = self.clips[&segment.clip].left_out;
                Some((of_segment[n]?, left_out + segment.at + frame - segment.frames.start))
            });
            // rows need words in every column before `spliced` writes the new numbers over them
            Some(given.unwrap_or(of_rig))
        };
        let text = source.composed(&pieces, self.frames, words);
        let stays = |n: usize| self.segments[n].turn == 0.0 && self.segments[n].shift == Vec3::ZERO;
        let is_new = |frame: usize, joint: usize| match by[frame * j + joint].filter(|&n| of_segment[n].is_some()) {
            Some(n) => joint == 0 && !stays(n),
            None => true,
        };
        let changed = Changed {
            before: 0,
            root: (0..self.frames).map(|frame| is_new(frame, 0)).collect(),
            joints: (0..self.frames * j).map(|i| is_new(i / j, i % j)).collect(),
        };
        let read = self.read();
        // the rig is as its own clip says, not as rows say that are to be filled yet
        let head = parse_header(&own.file, &text, &read)?;
        let (numbers, _) = head.rows(&own.file, &text, &read)?;
        let composed = BvhSource {
            head,
            numbers,
            frames: self.frames,
            read_fps: source.read_fps,
            rig: source.rig.clone(),
            floor_m: None,
        };
        Ok(composed.spliced(&text, &clip, &changed)?)
    }

    /// What the segments give, and straight lines where none does. `by`: (F, J) the segment that gives a joint.
    fn clip(&self, by: &[Option<usize>]) -> Result<Clip> {
        let rig = &self.rig.motion.clip;
        let j = rig.joints();
        let mean: Vec<Quat> = rig.pose(0).to_vec();
        let (mut root, mut rotations) = (vec![rig.root()[0]; self.frames], mean.repeat(self.frames));
        for (i, n) in by.iter().enumerate() {
            let (Some(n), frame, joint) = (*n, i / j, i % j) else { continue };
            let segment = &self.segments[n];
            let clip = &self.clips[&segment.clip].clip;
            let from = segment.at + frame - segment.frames.start;
            rotations[i] = clip.pose(from)[joint];
            if joint == 0 {
                let turn = Quat::from_rotation_y(segment.turn);
                rotations[i] = turn * rotations[i];
                root[frame] = turn * clip.root()[from] + segment.shift;
            }
        }
        for gap in Mask::runs(self.frames, |frame| by[frame * j].is_none()) {
            let (before, after) = (gap.start.checked_sub(1), Some(gap.end).filter(|&end| end < self.frames));
            for frame in gap.clone() {
                let share = (frame + 1 - gap.start) as f64 / (gap.len() + 1) as f64;
                root[frame] = match (before, after) {
                    (Some(a), Some(b)) => Vec3::lerp(root[a], root[b], share),
                    (Some(only), None) | (None, Some(only)) => root[only],
                    (None, None) => root[frame],
                };
            }
        }
        let mut clip = Clip::new(rig.skeleton().clone(), rig.fps(), root, rotations)?;
        for joint in 0..j {
            let gaps = Mask::runs(self.frames, |frame| by[frame * j + joint].is_none());
            if !gaps.is_empty() {
                clip = bridge(&clip, &[joint], &gaps, &mean)?;
            }
        }
        Ok(clip)
    }
}

/// (J) the SMPL joint that each joint of a rig goes with: its own, else that of its nearest ancestor, else the pelvis.
fn owners(retarget: &Retarget) -> Vec<usize> {
    let smpl = RigJoints::of(retarget).smpl;
    let mut owners = vec![0; smpl.len()];
    for joint in 0..smpl.len() {
        let above = retarget.rig().parents()[joint].map_or(0, |parent| owners[parent]);
        owners[joint] = smpl[joint].unwrap_or(above);
    }
    owners
}
