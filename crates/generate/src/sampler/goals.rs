//! Goal conditioning of a dance while it is sampled.

use kinelm_model::FrameConditioning;
use kinelm_model::goal::{Conditioning, GoalTrack};
use kinelm_tokenizer::root_path::RootState;
use std::sync::Arc;

/// Conditions the frames of one dance on the goals after them.
#[derive(Debug, Clone)]
pub(super) struct GoalConditioning {
    goals: Arc<GoalTrack>,
    /// The root's state after each word, as far as it was needed.
    states: Vec<Option<RootState>>,
    /// The conditioning of one frame.
    frame: Conditioning,
    /// The last word that was conditioned.
    last: Option<usize>,
}

impl GoalConditioning {
    pub fn new(goals: Arc<GoalTrack>) -> GoalConditioning {
        let frame = Conditioning::none(1, goals.characters());
        GoalConditioning { goals, states: Vec::new(), frame, last: None }
    }

    /// Whether a word was the last that was conditioned.
    pub(crate) fn has_conditioned(&self, word: usize) -> bool {
        self.last == Some(word)
    }

    /// The conditioning of a word that comes after those of `ids`; `None` where it has no goal.
    pub(crate) fn condition(&mut self, word: usize, ids: &[u32]) -> Option<FrameConditioning<'_>> {
        let length = self.goals.characters() + 1;
        let codes = |word: usize| self.goals.codes(&ids[word * length..][..length]);
        for word in self.states.len()..word {
            let state = self.goals.stand(word, &codes(word), self.states.last().and_then(Option::as_ref));
            self.states.push(state);
        }
        let previous = word.checked_sub(1)?;
        let Conditioning { numbers, rows: [steps, paces], .. } = &mut self.frame;
        let known = (codes(previous), self.states[previous].as_ref());
        let has_goal = self.goals.encode(word, &known.0, known.1, numbers, [steps, paces]);
        self.last = self.last.filter(|_| !has_goal).or(has_goal.then_some(word));
        has_goal.then_some(FrameConditioning { numbers, rows: [steps, paces] })
    }
}
