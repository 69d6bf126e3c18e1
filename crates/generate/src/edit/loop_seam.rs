//! Loops: the last seconds of a clip are generated so that they end where its first frame begins.
//!
//! The first second is appended to the clip once more, and the seconds before it are a gap like any other. The file that is
//! written ends with the gap: played over and over, the frame after the last is the first.

use super::gap::bridge;
use crate::prompt::PromptClip;
use crate::request::{Loop, LoopKind, Span};
use crate::{Error, Result};
use kinelm_motion::moment::Moment;
use kinelm_motion::rotation::heading;
use kinelm_motion::{Clip, Quat, Vec3};
use kinelm_tokenizer::Tokenizer;
use std::ops::Range;

/// Seconds of the beginning that are given after the gap.
const APPENDED_S: f64 = 1.0;

/// The seam of a looping clip, in frames of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct LoopSeam {
    /// The generated frames, up to the end of the clip.
    pub gap: Range<usize>,
    /// Frames of the beginning that are appended after it.
    pub appended: usize,
}

impl LoopSeam {
    /// The gap as a span of all joints, in a file with `left_out` more frames in front.
    pub fn span(&self, left_out: usize) -> Span {
        let at = |frame: usize| Some(Moment::Frames((left_out + frame) as f64));
        Span { joints: "all".into(), from: at(self.gap.start), to: at(self.gap.end) }
    }

    /// Frames that are written.
    pub fn frames(&self) -> usize {
        self.gap.end
    }
}

/// The prompt with its last seconds interpolated and its first one appended.
///
/// # Errors
/// A clip that is not longer than the gap and a second; what coding fails with.
pub(crate) fn lengthen(looping: Loop, prompt: PromptClip, tokenizer: &Tokenizer) -> Result<(PromptClip, LoopSeam)> {
    let clip = &prompt.motion.clip;
    let (frames, fps) = (clip.frames(), clip.fps());
    let over_s = looping.over_s.ok_or_else(|| Error::missing("`over_s`", "say how many seconds are generated"))?;
    // one frame at least, at any rate
    let [over, appended] = [over_s, APPENDED_S].map(|s| (s * fps).round().max(1.0) as usize);
    if frames < over + appended + 1 {
        let (s, least) = (frames as f64 / fps, over_s + APPENDED_S);
        let why = format!(
            "the clip has {s:.2} s; with {over_s} s generated it needs {least} and a frame; generate less (`loop_over`)"
        );
        return Err(Error::unsupported_parameter("loop", why));
    }
    let seam = LoopSeam { gap: frames - over..frames, appended };
    let turn = match looping.kind {
        LoopKind::Back => 0.0,
        LoopKind::Pose => heading_change(&prompt.clip),
    };
    let long = with_beginning(clip, &seam, looping.kind, turn)?;
    let motion = prompt.motion.clone().with_clip(long);
    Ok((prompt.with_motion(motion, tokenizer)?, seam))
}

/// The change of heading of a clip on SMPL-24 from its first frame to its last, radians; 0 where it has none.
fn heading_change(clip: &Clip) -> f64 {
    let at = |frame: usize| heading(clip.pose(frame)[0]);
    let last = clip.frames().saturating_sub(1);
    at(0).zip(at(last)).map_or(0.0, |(from, to)| to - from)
}

/// The clip with a straight path through its gap and its beginning after it.
fn with_beginning(clip: &Clip, seam: &LoopSeam, kind: LoopKind, turn: f64) -> Result<Clip> {
    let (last, joints) = (clip.frames() - 1, clip.joints());
    let turn = Quat::from_rotation_y(turn);
    let first = clip.root()[0];
    let to = match kind {
        LoopKind::Back => first,
        // a step after the last frame, as long as the clip's first; at the height of the first
        LoopKind::Pose => (clip.root()[last] + turn * (clip.root()[1] - first)).with_y(first.y),
    };
    let (mut root, mut rotations) = (clip.root().to_vec(), clip.rotations().to_vec());
    for f in 0..seam.appended {
        root.push(turn * (clip.root()[f] - first) + to);
        rotations.push(turn * clip.pose(f)[0]);
        rotations.extend_from_slice(&clip.pose(f)[1..]);
    }
    let (from, steps) = (root[seam.gap.start - 1], (seam.gap.len() + 1) as f64);
    for (i, f) in seam.gap.clone().enumerate() {
        // replaced, as the clip's own last seconds don't lead to its beginning; the gap is sampled anyway
        root[f] = Vec3::lerp(from, to, (i + 1) as f64 / steps);
    }
    let long = Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)?;
    let all: Vec<usize> = (0..joints).collect();
    bridge(&long, &all, std::slice::from_ref(&seam.gap), clip.pose(0))
}

/// The roughness of the seam: the largest jerk, mean over joints, of the frames that touch it, and the 99th percentile of the
/// clip without its gap; m/s³, of the body in the frame of its root. `clip` is as written.
pub(crate) fn roughness(clip: &Clip, gap: &Range<usize>) -> Option<(f64, f64)> {
    let (frames, joints) = (clip.frames(), clip.joints());
    let here = (vec![Vec3::ZERO; frames], clip.rotations().to_vec());
    let mut seen = here.1;
    seen.chunks_mut(joints).for_each(|pose| pose[0] = Quat::IDENTITY);
    let places = Clip::new(clip.skeleton().clone(), clip.fps(), here.0, seen).ok()?.positions();
    let jerk = |f: usize| {
        // round the end: the frames after the last are the first
        let at = |i: usize, j: usize| places[(f + i) % frames * joints + j];
        let third = |j: usize| at(3, j) - at(2, j) * 3.0 + at(1, j) * 3.0 - at(0, j);
        (0..joints).map(|j| third(j).length()).sum::<f64>() / joints as f64 * clip.fps().powi(3)
    };
    // a jerk needs four frames, all of them given
    let mut usual: Vec<f64> = (0..gap.start.checked_sub(3)?).map(jerk).collect();
    usual.sort_by(f64::total_cmp);
    let high = *usual.get((usual.len() as f64 * 0.99) as usize)?;
    Some(((frames - 3..frames).map(jerk).fold(0.0, f64::max), high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::synth;

    fn clip() -> Clip {
        synth::corpus(3, 1, 6.0, 20.0).unwrap().remove(0).clip
    }

    #[test]
    fn the_beginning_is_appended_after_a_straight_gap() {
        let clip = clip();
        let n = clip.frames();
        let seam = LoopSeam { gap: n - 40..n, appended: 20 };
        let back = with_beginning(&clip, &seam, LoopKind::Back, 0.0).unwrap();
        assert_eq!((back.frames(), seam.frames()), (n + 20, n));
        assert_eq!((back.root()[n], back.pose(n + 5)), (clip.root()[0], clip.pose(5)));
        assert_eq!(back.slice(0..n - 40), clip.slice(0..n - 40));
        let step = back.root()[n - 40] - back.root()[n - 41];
        assert!((n - 40..=n).all(|f| (back.root()[f] - back.root()[f - 1] - step).length() < 1e-9));
    }

    #[test]
    fn the_pose_returns_where_the_clip_ends() {
        let clip = clip();
        let n = clip.frames();
        let seam = LoopSeam { gap: n - 30..n, appended: 20 };
        let on = with_beginning(&clip, &seam, LoopKind::Pose, 0.7).unwrap();
        let turn = Quat::from_rotation_y(0.7);
        let step = turn * (clip.root()[1] - clip.root()[0]);
        assert!((on.root()[n] - clip.root()[n - 1] - step).with_y(0.0).length() < 1e-9, "a step on");
        assert!((on.root()[n].y - clip.root()[0].y).abs() < 1e-9, "as high as it began");
        assert!(on.pose(n + 3)[0].angle_between(turn * clip.pose(3)[0]) < 1e-6);
        assert_eq!(on.pose(n + 3)[1..], clip.pose(3)[1..]);
    }

    #[test]
    fn a_jump_at_the_seam_is_rough_and_a_turn_on_the_spot_is_not() {
        // a movement that comes back after 40 frames
        let clip = clip();
        let phase = |f: usize| std::f64::consts::TAU * f as f64 / 40.0;
        let pose = |f: usize| {
            let mut pose = clip.pose(0).to_vec();
            (1..24).for_each(|j| pose[j] = Quat::from_rotation_x(0.2 * (phase(f) + j as f64).sin()));
            pose
        };
        let make = |frames: usize| {
            let rotations = (0..frames).flat_map(pose).collect();
            Clip::new(clip.skeleton().clone(), 20.0, vec![Vec3::ZERO; frames], rotations).unwrap()
        };
        let (smooth, usual) = roughness(&make(120), &(100..120)).unwrap();
        assert!(smooth <= 1.01 * usual, "{smooth} of {usual}");
        let (rough, usual) = roughness(&make(130), &(100..130)).unwrap();
        assert!(rough > 5.0 * usual, "{rough} of {usual}");
    }
}
