//! Steps that can be undone, and undone ones.

use super::document::Change;
use serde::{Deserialize, Serialize};

/// The most steps, and their bytes.
const MOST_STEPS: usize = 200;
const MOST_BYTES: usize = 32 << 20;

/// Something that the user did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// A name in a few plain words.
    pub name: String,
    /// Its changes.
    pub changes: Vec<Change>,
}

impl Step {
    fn bytes(&self) -> usize {
        self.changes.iter().map(Change::bytes).sum()
    }
}

/// The steps of a project.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct History {
    done: Vec<Step>,
    undone: Vec<Step>,
}

impl History {
    /// Adds a step. Undone steps are dropped, and so are the oldest beyond the limits.
    pub fn push(&mut self, step: Step) {
        self.undone.clear();
        self.done.push(step);
        let mut bytes: usize = self.done.iter().map(Step::bytes).sum();
        // the last step stays, whatever its size: what was just done can be undone
        while self.done.len() > MOST_STEPS || (bytes > MOST_BYTES && self.done.len() > 1) {
            bytes -= self.done.remove(0).bytes();
        }
    }

    /// Undoes the last step: the changes that do so.
    pub fn undo(&mut self) -> Option<Vec<Change>> {
        let step = self.done.pop()?;
        // in reverse order: a later change may build on an earlier one of the step
        let changes = step.changes.iter().rev().map(Change::inverse).collect();
        self.undone.push(step);
        Some(changes)
    }

    /// Carries out the last undone step again: the changes.
    pub fn redo(&mut self) -> Option<Vec<Change>> {
        let step = self.undone.pop()?;
        let changes = step.changes.clone();
        self.done.push(step);
        Some(changes)
    }

    /// All steps.
    pub fn steps(&self) -> impl Iterator<Item = &Step> {
        self.done.iter().chain(&self.undone)
    }

    /// Steps that can be undone, and redone.
    pub fn counts(&self) -> (usize, usize) {
        (self.done.len(), self.undone.len())
    }

    /// The names of the next step back and of the next step on.
    pub fn names(&self) -> (Option<&str>, Option<&str>) {
        (self.done.last().map(|step| &*step.name), self.undone.last().map(|step| &*step.name))
    }

    /// Whether any step names the dance with this id.
    pub fn has_dance(&self, id: &str) -> bool {
        let is_it = |change: &Change| match change {
            Change::Dance { before, after } => [before, after].into_iter().flatten().any(|dance| dance.id == id),
            _ => false,
        };
        self.done.iter().chain(&self.undone).any(|step| step.changes.iter().any(is_it))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(n: usize, bytes: usize) -> Step {
        let text = |n: usize| Some(format!("{n}{}", "x".repeat(bytes)));
        Step { name: n.to_string(), changes: vec![Change::Timeline { before: text(n), after: text(n + 1) }] }
    }

    #[test]
    fn two_hundred_steps_are_kept_and_a_new_one_ends_what_was_undone() {
        let mut history = History::default();
        (0..250).for_each(|n| history.push(step(n, 1)));
        assert_eq!((history.counts(), history.names().0), ((200, 0), Some("249")));
        for n in (50..250).rev() {
            assert_eq!(history.undo().unwrap(), [step(n, 1).changes[0].inverse()]);
        }
        assert!(history.undo().is_none());
        assert_eq!((history.redo().unwrap(), history.counts()), (step(50, 1).changes, (1, 199)));
        history.push(step(0, 1));
        assert_eq!((history.counts(), history.redo()), ((2, 0), None));
        let mut history = History::default();
        (0..9).for_each(|n| history.push(step(n, MOST_BYTES / 8)));
        assert_eq!(history.counts(), (3, 0));
    }
}
