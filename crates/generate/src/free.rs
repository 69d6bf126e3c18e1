//! What of a dance was invented: the rest is its prompt's.

use super::followed::Followed;
use super::open::OpenRequest;
use std::ops::Range;

/// Frames through which the same joints were invented.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stretch {
    /// At the model's rate.
    pub frames: Range<usize>,
    /// SMPL ids of coded joints, ascending.
    pub joints: Vec<usize>,
}

/// The stretches of a dance of `frames` frames at the model's rate, of which `coded` joints are known, in their order;
/// none where nothing was invented.
pub fn stretches(frames: usize, coded: &[usize], given: impl Fn(usize, usize) -> bool) -> Vec<Stretch> {
    let mut all: Vec<Stretch> = Vec::new();
    for frame in 0..frames {
        let joints: Vec<usize> = coded.iter().copied().filter(|&joint| !given(frame, joint)).collect();
        match all.last_mut() {
            Some(last) if last.frames.end == frame && last.joints == joints => last.frames.end += 1,
            _ => all.push(Stretch { frames: frame..frame + 1, joints }),
        }
    }
    all.retain(|stretch| !stretch.joints.is_empty());
    all
}

impl OpenRequest {
    /// What of the dance is invented.
    pub fn invented(&self) -> Vec<Stretch> {
        let coded = self.tokenizer.channels().joints();
        let given = |frame: usize, joint: usize| match &self.prompt {
            Some(Followed { edit: Some(edited), .. }) => edited.model().is_given(frame, joint),
            Some(prompt) => {
                let begun = self.recipe.prompt.as_ref().and_then(|p| p.from_frame).is_some_and(|n| frame < n);
                let follows = prompt.selection.as_ref().is_some_and(|s| s.joints.contains(&joint));
                begun || (follows && frame < prompt.clip.frames())
            }
            None => false,
        };
        stretches(self.frames, coded, given)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_end_where_other_joints_are_given() {
        // the arm is given for ten frames, and all of the first three
        let given = |frame: usize, joint: usize| frame < 3 || (joint == 16 && frame < 10);
        let found = stretches(12, &[0, 4, 16], given);
        let of = |frames, joints: &[usize]| Stretch { frames, joints: joints.to_vec() };
        assert_eq!(found, [of(3..10, &[0, 4]), of(10..12, &[0, 4, 16])]);
        assert!(stretches(5, &[0, 4], |_, _| true).is_empty());
        assert_eq!(stretches(5, &[0], |_, _| false), [of(0..5, &[0])]);
    }
}
