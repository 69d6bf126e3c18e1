//! The truncation of dances with given joints and of gaps, where a request has none.

use super::OpenRequest;
use crate::sampler::has_given_after_free;

/// [`crate::sampling::Sampling::top_p`] of a dance whose frames all have joints given after free ones. The given joints keep
/// such a dance going, and less chance leaves less to go wrong; a dance by itself would freeze sooner
/// (docs/results/two-level.md, "Truncation").
pub const GIVEN_TOP_P: f64 = 0.8;

/// [`crate::sampling::Sampling::top_p`] of other gaps that end, by a goal-conditioned model: what is given on both sides keeps the
/// dance going, and likelier samples end nearer and jerk less (docs/results/gaps.md).
pub const GAP_TOP_P: f64 = 0.7;

impl OpenRequest {
    /// Whether the model knows the ends of gaps, and there are some.
    pub(super) fn has_goals(&self) -> bool {
        self.run.config.goal && self.edit().is_some_and(|(_, edit)| edit.has_ends())
    }

    /// Whether every frame that isn't given whole has joints given after free ones.
    pub(super) fn is_given_throughout(&self) -> bool {
        let Some(prompt) = &self.prompt else { return false };
        let (frames, first) = (prompt.clip.frames(), self.first_given());
        let given = prompt.edit.as_ref().map_or_else(|| first.clone(), |edit| edit.given(frames).0);
        let is_whole = |frame: &[bool]| frame.iter().all(|is_given| *is_given);
        let mut sampled = given.chunks(first.len().max(1)).filter(|frame| !is_whole(frame)).peekable();
        self.frames <= frames && sampled.peek().is_some() && sampled.all(has_given_after_free)
    }

    /// Whether some joints are given in the first frame, after free ones, and a causal model doesn't see them.
    pub(super) fn begins_in_part(&self) -> bool {
        let begins = self.prompt.as_ref().is_some_and(|prompt| prompt.beginning.is_empty());
        begins && !self.is_masked() && !self.resolved.sampling.greedy && has_given_after_free(&self.first_given())
    }

    /// (C) which characters of the prompt's first word are given; empty: none, or there is no prompt.
    fn first_given(&self) -> Vec<bool> {
        let Some(prompt) = &self.prompt else { return Vec::new() };
        prompt.edit.as_ref().map_or_else(|| prompt.given.clone(), |edit| edit.given(1).0)
    }
}
