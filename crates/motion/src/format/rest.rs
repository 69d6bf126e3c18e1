//! The rest-pose frame that many conversions put before the motion.

use super::{ReadOptions, RestFrame};
use crate::rotation::angle_between;
use crate::{Clip, Motion, Quat, Source, Warning};

/// A root rotation below this counts as none, radians: files with z up rotate the root there and back, some in single
/// precision.
const UNTURNED: f64 = 1e-6;

/// Steps after the rest frame up to this many times the median of those that follow are the motion's own.
const OWN: f64 = 3.0;
/// The longest time in which a smeared jump from the rest pose is over, seconds: 8 frames of cmu-dance's 120 a second.
const SMEARED_S: f64 = 0.1;

/// Reports the rest-pose frame of a motion read with `options`; drops it if they say so.
pub(crate) fn handle_rest_frame(mut motion: Motion, options: &ReadOptions) -> Motion {
    if options.skip > 0 || !has_rest_frame(&motion) {
        return motion;
    }
    let done = match options.rest {
        RestFrame::Keep => "kept",
        RestFrame::Drop => "left out",
    };
    let mut what = format!("frame 0 looks like a rest pose before the motion: {done}");
    let last = smeared_frames(&motion.clip, 1);
    if last > 0 {
        let frames = if last == 1 { "frame 1 still comes".into() } else { format!("frames 1 to {last} still come") };
        what += &format!("; {frames} out of it: `skip` {} leaves them out too", last + 1);
    }
    if options.rest == RestFrame::Drop {
        // a reference pose made from the clip is made again, without the dropped frame
        let found = motion.found().cloned();
        let frames = motion.clip.frames();
        motion = motion.slice(1..frames).with_found(found);
    }
    motion.warnings.push(Warning { kind: "rest_frame", what });
    motion
}

/// Frames after a rest frame, from `first` on, over which a filter has smeared the jump into the motion, its ringing
/// included, as in the conversions of cmu-dance; 0 if the motion begins there.
pub fn smeared_frames(clip: &Clip, first: usize) -> usize {
    let window = ((SMEARED_S * clip.fps()) as usize).min(clip.frames()).max(3);
    let steps = steps(clip, first + 2 * window);
    let is_smeared = |f: usize| {
        let following = steps[(f + 1).min(steps.len())..].iter().take(window);
        median(following.copied().collect()).is_some_and(|median| steps[f] > OWN * median)
    };
    let mut all = (first..steps.len().min(first + window)).filter(|f| is_smeared(*f));
    // it begins at once, and falls as it goes
    all.next().filter(|f| *f == first).map_or(0, |f| all.next_back().unwrap_or(f) + 1 - first)
}

/// Whether a rest-pose frame is detected and dropped.
pub(crate) fn drops_rest_frame(options: &ReadOptions) -> bool {
    options.skip == 0 && options.rest == RestFrame::Drop
}

/// Whether frame 0 is a rest pose before the motion, as in many CMU conversions.
///
/// It is if the root is not rotated (in a BVH: all its rotation channels are 0) and the step from frame 0 to frame 1 is
/// more than 10 times the median step. A step is the largest rotation of a joint between two frames; the mean over joints
/// misses a clip of cmu-dance. Clips of fewer than 3 frames have no rest frame.
pub fn has_rest_frame(motion: &Motion) -> bool {
    let clip = &motion.clip;
    let unturned = match &motion.source {
        _ if clip.frames() < 3 => false,
        Source::Bvh(source) if source.frames == clip.frames() => source.root_unturned(0),
        _ => angle_between(clip.pose(0)[0], Quat::IDENTITY) < UNTURNED,
    };
    if !unturned {
        return false;
    }
    let steps = steps(clip, clip.frames());
    let first = steps[0];
    median(steps).is_some_and(|median| first > 10.0 * median)
}

/// The largest rotation of a joint from each frame to the next, `most` of them.
fn steps(clip: &Clip, most: usize) -> Vec<f64> {
    let step = |f: usize| {
        // the cosine of half the angle is the least of that joint, and of one joint alone the angle itself is needed
        let turned = clip.pose(f).iter().zip(clip.pose(f + 1)).map(|(a, b)| (a.dot(*b).abs(), a, b));
        let most = turned.reduce(|most, other| if other.0 < most.0 { other } else { most });
        most.map_or(0.0, |(_, a, b)| angle_between(*a, *b))
    };
    (1..clip.frames()).take(most).map(|f| step(f - 1)).collect()
}

fn median(mut steps: Vec<f64>) -> Option<f64> {
    let middle = steps.len() / 2;
    (!steps.is_empty()).then(|| *steps.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{Unit, bvh};
    use std::path::Path;

    /// A root and a child that rotate by 1 degree per frame after a first frame with these angles.
    fn file(first: [f64; 2], frames: usize) -> Motion {
        let rows: String = (1..frames).map(|f| format!("{f} {f}\n")).collect();
        let text = format!(
            "HIERARCHY\nROOT a {{ OFFSET 0 0 0 CHANNELS 1 Xrotation JOINT b\n{{ OFFSET 0 1 0 CHANNELS 1 Zrotation End Site {{ OFFSET 0 1 0 }} }} }}\n\
             MOTION\nFrames: {frames}\nFrame Time: 0.05\n{} {}\n{rows}",
            first[0], first[1]
        );
        let options = ReadOptions { unit: Unit::METRE, ..Default::default() };
        bvh::read(Path::new("x.bvh"), text.as_bytes(), &options).unwrap()
    }

    #[test]
    fn a_jump_from_an_unturned_root() {
        assert!(has_rest_frame(&file([0.0, 40.0], 9)));
        assert!(!has_rest_frame(&file([0.1, 40.0], 9)), "the root is turned");
        assert!(!has_rest_frame(&file([0.0, 10.0], 9)), "9 degrees are no jump where others are 1");
        assert!(!has_rest_frame(&file([0.0, 40.0], 2)), "no median");
        assert!(!has_rest_frame(&file([0.0, 40.0], 1)));
    }

    #[test]
    fn it_is_said_and_kept_or_dropped() {
        let with =
            |rest, skip| handle_rest_frame(file([0.0, 40.0], 9), &ReadOptions { rest, skip, ..Default::default() });
        let kept = with(RestFrame::Keep, 0);
        assert_eq!((kept.clip.frames(), kept.warnings[0].kind), (9, "rest_frame"));
        let dropped = with(RestFrame::Drop, 0);
        assert_eq!((dropped.clip.frames(), dropped.warnings[0].kind), (8, "rest_frame"));
        let Source::Bvh(source) = &dropped.source else { panic!("a BVH") };
        assert!(source.is_untouched(&dropped.clip));
        assert!(with(RestFrame::Drop, 1).warnings.is_empty(), "with frames skipped none is looked for");
    }

    #[test]
    fn a_jump_that_a_filter_has_smeared_is_said_with_what_leaves_it_out() {
        let options = ReadOptions { rest: RestFrame::Drop, ..Default::default() };
        let said = |motion: Motion| handle_rest_frame(motion, &options).warnings[0].what.clone();
        assert!(said(file([0.0, 40.0], 30)).ends_with("left out"));
        let mut smeared = file([0.0, 90.0], 30);
        let mut rotations = smeared.clip.rotations().to_vec();
        for (f, degrees) in [(1, 60.0_f64), (2, 25.0)] {
            rotations[2 * f + 1] = Quat::from_rotation_z(degrees.to_radians());
        }
        let clip = &smeared.clip;
        smeared.clip = Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations).unwrap();
        assert_eq!((smeared_frames(&smeared.clip, 1), smeared_frames(&smeared.clip, 3)), (2, 0));
        let said = said(smeared);
        assert!(said.ends_with("left out; frames 1 to 2 still come out of it: `skip` 3 leaves them out too"), "{said}");
    }
}
