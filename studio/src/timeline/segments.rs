//! Segments of a timeline as numbers: joints and frames, which can be cut, freed and given.
//!
//! A clip that is cut in two continues exactly where it was cut, so that nothing is generated between the parts. Where
//! the rates of clip and dance differ, not every frame allows that: a cut is moved by up to 12 frames, and if none of
//! them does, it stays, and a transition is generated.

use std::collections::BTreeMap;
use std::ops::Range;

/// A segment.
#[derive(Debug, Clone, PartialEq)]
pub struct Cut {
    /// The segment of the file that it is, or is a part of.
    pub origin: Option<usize>,
    /// The clip's name; `None`: labels alone.
    pub clip: Option<String>,
    /// The clip's rate, which its moments are rounded to.
    pub clip_fps: f64,
    /// SMPL ids, ascending.
    pub joints: Vec<usize>,
    /// Frames of the dance.
    pub frames: Range<usize>,
    /// Its beginning in the clip, seconds.
    pub at_s: f64,
    /// Labels.
    pub labels: BTreeMap<String, String>,
    /// Whether it is no longer as the file has it: joints, beginning, end.
    pub changed: [bool; 3],
}

/// The most frames by which a cut may be moved so that both parts continue.
const NEAR: usize = 12;

impl Cut {
    /// The clip's frame at a frame of the dance, as the library rounds it, in frames of the dance.
    fn at(&self, fps: f64, at_s: f64) -> i64 {
        ((at_s * self.clip_fps).round() / self.clip_fps * fps).round() as i64
    }

    /// The clip's time at a frame of the dance, seconds.
    fn at_frame(&self, frame: usize, fps: f64) -> f64 {
        self.at_s + (frame as f64 - self.frames.start as f64) / fps
    }

    /// Whether a part from this frame on continues where the part before it ends.
    fn continues_from(&self, frame: usize, fps: f64) -> bool {
        // both are rounded to the clip's frames and then to the dance's: where rates differ, not every frame fits
        let parted = self.at(fps, self.at_frame(frame, fps)) - self.at(fps, self.at_s);
        parted == frame as i64 - self.frames.start as i64
    }

    /// The frame nearest to one at which the segment can be cut.
    fn cut_near(&self, frame: usize, fps: f64) -> usize {
        let inside = |frame: &usize| self.frames.contains(frame) && *frame > self.frames.start;
        let near = (0..=NEAR).flat_map(|off| [frame.checked_sub(off), frame.checked_add(off)]).flatten();
        near.filter(inside).find(|frame| self.continues_from(*frame, fps)).unwrap_or(frame)
    }

    /// The part of it in some frames.
    fn part(&self, frames: Range<usize>, fps: f64) -> Cut {
        let at_s = self.at_frame(frames.start, fps);
        let changed = [
            self.changed[0],
            self.changed[1] || frames.start != self.frames.start,
            self.changed[2] || frames.end != self.frames.end,
        ];
        Cut { frames, at_s, changed, ..self.clone() }
    }

    /// Whether another is of the same clip and labels, at the same place of it.
    fn is_along(&self, other: &Cut, fps: f64) -> bool {
        let at = |cut: &Cut| self.at(fps, cut.at_s) - cut.frames.start as i64;
        self.clip.is_some() && self.clip == other.clip && self.labels == other.labels && at(self) == at(other)
    }
}

/// Cuts a segment in two.
pub fn split(cuts: &mut Vec<Cut>, index: usize, frame: usize, fps: f64) {
    let frame = cuts[index].cut_near(frame, fps);
    let whole = cuts[index].clone();
    cuts[index] = whole.part(whole.frames.start..frame, fps);
    cuts.insert(index + 1, Cut { origin: None, ..whole.part(frame..whole.frames.end, fps) });
}

/// Frees joints in some frames: segments that give them are cut, and give the other joints alone there.
pub fn free(cuts: &mut Vec<Cut>, joints: &[usize], frames: Range<usize>, fps: f64) {
    let mut after = Vec::new();
    for cut in cuts.drain(..) {
        let meets = cut.frames.start < frames.end && frames.start < cut.frames.end;
        if cut.clip.is_none() || !meets || !cut.joints.iter().any(|joint| joints.contains(joint)) {
            after.push(cut);
            continue;
        }
        let inside = |frame: usize| cut.frames.start < frame && frame < cut.frames.end;
        let border = |frame: usize| if inside(frame) { cut.cut_near(frame, fps) } else { frame };
        let from = border(frames.start).max(cut.frames.start);
        let to = border(frames.end).min(cut.frames.end);
        let left: Vec<usize> = cut.joints.iter().copied().filter(|joint| !joints.contains(joint)).collect();
        let mut middle = cut.part(from..to.max(from), fps);
        middle.changed[0] = true;
        if left.is_empty() {
            middle.clip = None;
        }
        middle.joints = left;
        let parts = [cut.part(cut.frames.start..from, fps), middle, cut.part(to..cut.frames.end, fps)];
        // labels hold without a clip, joints don't
        let is_something = |part: &Cut| !part.frames.is_empty() && (part.clip.is_some() || !part.labels.is_empty());
        let parts = parts.into_iter().filter(is_something);
        // the first part is the one that the file has
        after.extend(parts.enumerate().map(|(n, part)| Cut { origin: part.origin.filter(|_| n == 0), ..part }));
    }
    *cuts = after;
}

/// Gives joints of a clip in the segment's frames, instead of the segments that give them there.
pub fn give(cuts: &mut Vec<Cut>, new: Cut, fps: f64) {
    free(cuts, &new.joints, new.frames.clone(), fps);
    // where the parts of a clip that is given again were cut
    let beside = cuts.iter().rposition(|cut| cut.frames.start <= new.frames.start && cut.clip.is_some());
    cuts.insert(beside.map_or(cuts.len(), |at| at + 1), new);
    while let Some((into, from)) = joined(cuts, fps) {
        let other = cuts.remove(from);
        // removing an earlier one moves it by one
        let into = if from < into { into - 1 } else { into };
        cuts[into] = join(cuts[into].clone(), other);
    }
}

/// Two segments that can be one.
fn joined(cuts: &[Cut], fps: f64) -> Option<(usize, usize)> {
    let pairs = (0..cuts.len()).flat_map(|a| (0..cuts.len()).map(move |b| (a, b))).filter(|(a, b)| a != b);
    let mut pairs = pairs.filter(|&(a, b)| cuts[a].is_along(&cuts[b], fps));
    pairs.find(|&(a, b)| {
        let (a, b) = (&cuts[a], &cuts[b]);
        let disjoint = !a.joints.iter().any(|joint| b.joints.contains(joint));
        (a.frames == b.frames && disjoint) || (a.joints == b.joints && a.frames.end == b.frames.start)
    })
}

fn join(a: Cut, b: Cut) -> Cut {
    let mut joints = [a.joints.clone(), b.joints.clone()].concat();
    joints.sort_unstable();
    joints.dedup();
    let changed = [
        a.changed[0] || joints != a.joints,
        a.changed[1] || a.frames.start > b.frames.start,
        a.changed[2] || a.frames.end < b.frames.end,
    ];
    let frames = a.frames.start.min(b.frames.start)..a.frames.end.max(b.frames.end);
    // where the whole begins
    let at_s = if b.frames.start < a.frames.start { b.at_s } else { a.at_s };
    Cut { joints, frames, at_s, changed, origin: a.origin.or(b.origin), ..a }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole(frames: Range<usize>) -> Cut {
        Cut {
            origin: Some(0),
            clip: Some("a".into()),
            clip_fps: 30.0,
            joints: (0..24).collect(),
            frames,
            at_s: 1.0,
            labels: BTreeMap::new(),
            changed: [false; 3],
        }
    }

    fn ranges(cuts: &[Cut]) -> Vec<(Range<usize>, usize, f64)> {
        let at = |cut: &Cut| (cut.at_s * 1e3).round() / 1e3;
        cuts.iter().map(|cut| (cut.frames.clone(), cut.joints.len(), at(cut))).collect()
    }

    #[test]
    fn an_arm_is_freed_and_given_back() {
        let arm = [13, 16, 18, 20, 22];
        let mut cuts = vec![whole(0..300)];
        free(&mut cuts, &arm, 60..120, 30.0);
        assert_eq!(ranges(&cuts), [(0..60, 24, 1.0), (60..120, 19, 3.0), (120..300, 24, 5.0)]);
        assert_eq!(cuts.iter().map(|cut| cut.origin).collect::<Vec<_>>(), [Some(0), None, None]);
        let back = Cut { origin: None, joints: arm.to_vec(), at_s: 3.0, ..whole(60..120) };
        give(&mut cuts, back, 30.0);
        assert_eq!(ranges(&cuts), [(0..300, 24, 1.0)]);
        assert_eq!(cuts[0].origin, Some(0));
    }

    #[test]
    fn all_of_a_part_leaves_its_labels() {
        let mut cuts = vec![Cut { labels: [("genre".into(), "salsa".into())].into(), ..whole(0..90) }];
        let all: Vec<usize> = (0..24).collect();
        free(&mut cuts, &all, 0..30, 30.0);
        assert_eq!((cuts.len(), cuts[0].clip.clone(), cuts[0].frames.clone()), (2, None, 0..30));
        assert_eq!((cuts[1].origin, cuts[1].at_s), (None, 2.0));
        let mut cuts = vec![whole(0..90)];
        free(&mut cuts, &all, 0..90, 30.0);
        assert!(cuts.is_empty());
    }

    #[test]
    fn another_clip_takes_the_place_of_one() {
        let mut cuts = vec![whole(0..90)];
        let other = Cut { origin: None, clip: Some("b".into()), joints: vec![1, 4, 7, 10], at_s: 0.0, ..whole(30..60) };
        give(&mut cuts, other, 30.0);
        assert_eq!(ranges(&cuts), [(0..30, 24, 1.0), (30..60, 20, 2.0), (30..60, 4, 0.0), (60..90, 24, 3.0)]);
    }

    #[test]
    fn a_cut_is_where_both_parts_continue() {
        // a clip of 25 frames a second in a dance of 30: only every sixth frame is one of both
        let clip = Cut { clip_fps: 25.0, at_s: 0.0, ..whole(0..300) };
        for frame in [31, 59, 64, 150] {
            let mut cuts = vec![clip.clone()];
            split(&mut cuts, 0, frame, 30.0);
            assert!(cuts[0].is_along(&cuts[1], 30.0), "{frame}");
            assert!(cuts[1].frames.start.abs_diff(frame) <= 3 && cuts[0].frames.end == cuts[1].frames.start);
        }
    }
}
