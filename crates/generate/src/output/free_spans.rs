//! Which joints of a dance are generated, and when: the rest is its prompt's.

use crate::edit::mask::runs_of;
use crate::open::{OpenRequest, PreparedPrompt};
use std::ops::Range;

/// Frames through which the same joints are generated.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FreeSpan {
    /// At the model's rate.
    pub frames: Range<usize>,
    /// SMPL ids of coded joints, ascending.
    pub joints: Vec<usize>,
}

/// The spans of a dance of `frames` frames at the model's rate and these `coded` joints; empty where everything is given.
fn spans(frames: usize, coded: &[usize], is_given: impl Fn(usize, usize) -> bool) -> Vec<FreeSpan> {
    let free = |frame| coded.iter().copied().filter(|&joint| !is_given(frame, joint)).collect::<Vec<usize>>();
    let spans = runs_of(frames, free).into_iter().filter(|(_, joints)| !joints.is_empty());
    spans.map(|(frames, joints)| FreeSpan { frames, joints }).collect()
}

impl OpenRequest {
    /// Which joints are generated, and when.
    pub fn free_spans(&self) -> Vec<FreeSpan> {
        let coded = self.tokenizer.channels().joints();
        let is_given = |frame: usize, joint: usize| match &self.prompt {
            Some(PreparedPrompt { edit: Some(edit), .. }) => edit.mask().is_given(frame, joint),
            Some(prompt) => {
                let from = self.resolved.prompt.as_ref().and_then(|p| p.from_frame);
                let is_selected = prompt.selection.as_ref().is_some_and(|s| s.joints.contains(&joint));
                from.is_some_and(|n| frame < n) || (is_selected && frame < prompt.clip.frames())
            }
            None => false,
        };
        spans(self.frames, coded, is_given)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_ends_where_other_joints_are_given() {
        // the arm is given for ten frames, and all of the first three
        let given = |frame: usize, joint: usize| frame < 3 || (joint == 16 && frame < 10);
        let found = spans(12, &[0, 4, 16], given);
        let of = |frames, joints: &[usize]| FreeSpan { frames, joints: joints.to_vec() };
        assert_eq!(found, [of(3..10, &[0, 4]), of(10..12, &[0, 4, 16])]);
        assert!(spans(5, &[0, 4], |_, _| true).is_empty());
        assert_eq!(spans(5, &[0], |_, _| false), [of(0..5, &[0])]);
    }
}
