//! The spans in which a layout gives some joints: a row of a chart.

use super::layout::TimelineLayout;
use serde::Serialize;
use std::ops::Range;

/// Whether joints are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum GivenState {
    /// All of them, by one segment.
    Given,
    /// None of them.
    Generated,
    /// Some of them, or by several segments.
    Partly,
}

/// Frames through which the same segments give the same of some joints.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GivenSpan {
    /// Of the dance.
    pub frames: Range<usize>,
    /// Whether the joints are given.
    pub state: GivenState,
    /// The first segment that gives any of them, by its number in the timeline.
    pub segment: Option<usize>,
}

impl TimelineLayout {
    /// The spans of joints, SMPL ids, from the first frame to the last.
    pub fn spans(&self, joints: &[usize]) -> Vec<GivenSpan> {
        let mut borders: Vec<usize> = self.segments.iter().flat_map(|s| [s.frames.start, s.frames.end]).collect();
        borders.extend([0, self.frames]);
        borders.retain(|border| *border <= self.frames);
        borders.sort_unstable();
        borders.dedup();
        let mut spans: Vec<GivenSpan> = Vec::new();
        for pair in borders.windows(2) {
            let by = |joint: &usize| {
                self.segments.iter().find(|s| s.frames.contains(&pair[0]) && s.joints.contains(joint)).map(|s| s.index)
            };
            let given: Vec<Option<usize>> = joints.iter().map(by).collect();
            let segment = given.iter().flatten().next().copied();
            let state = match segment {
                None => GivenState::Generated,
                Some(_) if given.iter().all(|by| *by == segment) => GivenState::Given,
                Some(_) => GivenState::Partly,
            };
            match spans.last_mut() {
                Some(last) if last.state == state && last.segment == segment => last.frames.end = pair[1],
                _ => spans.push(GivenSpan { frames: pair[0]..pair[1], state, segment }),
            }
        }
        spans
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::request::Timeline;
    use kinelm_motion::{Motion, format, synth};

    #[test]
    fn a_row_is_given_generated_or_partly_given() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bvh");
        let clip = synth::corpus(1, 1, 4.0, 20.0).unwrap().remove(0).clip;
        format::write(&path, &Motion::new(&path, clip)).unwrap();
        let text = "rig = \"a\"\nseconds = 4\n[clips.a]\nfile = \"a.bvh\"\n[[segment]]\nlabels = { genre = \"x\" }\n\
                    from = 0\nto = 1\n[[segment]]\nclip = \"a\"\nfrom = 0\nto = 2\n[[segment]]\nclip = \"a\"\n\
                    joints = \"root,left_arm\"\nfrom = 2\nto = 3\nat = 2\n";
        let (_, layout) = Timeline::parse(&dir.path().join("t.toml"), text).unwrap();
        let of = |frames, state, segment| GivenSpan { frames, state, segment };
        let arms = layout.spans(&[16, 17]);
        let (given, partly) = (of(0..40, GivenState::Given, Some(1)), of(40..60, GivenState::Partly, Some(2)));
        assert_eq!(arms, [given.clone(), partly, of(60..80, GivenState::Generated, None)]);
        let left = layout.spans(&[16]);
        assert_eq!(left, [given, of(40..60, GivenState::Given, Some(2)), of(60..80, GivenState::Generated, None)]);
        assert_eq!(layout.spans(&[1])[1], of(40..80, GivenState::Generated, None));
    }
}
