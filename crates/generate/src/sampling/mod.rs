//! Which of the allowed tokens comes next.
//!
//! One file a rule, and the order is fixed: the grammar's ids alone; repetition penalty; then greedy takes the likeliest,
//! or temperature, top-k, top-p, min-p, each on what the one before has left, and a draw by probability of what is left
//! then. A rule that is not asked for changes nothing. The sampler of candle-transformers is not used: it has no min-p and
//! no mask for the grammar's ids, and its greedy choice ignores edits of the probabilities. Where the two have a rule in
//! common, the tests hold ours to it.

mod greedy;
mod min_p;
mod repetition;
mod temperature;
mod top_k;
mod top_p;

use crate::{Error, Result};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// How a token is drawn from the model's logits. By default by its probability.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Draw {
    /// The likeliest; of equals the first. The thesis's way. Every rule but the penalty is without effect then.
    pub greedy: bool,
    /// What the probability of an id is divided by that stood at the same place in one of the last `repetition_words`
    /// words; above 0, 1: no penalty.
    pub repetition_penalty: f64,
    /// Words that the penalty looks back; 0: none.
    pub repetition_words: usize,
    /// What logits are divided by, above 0.
    pub temperature: f64,
    /// Only this many of the likeliest; at least 1.
    pub top_k: Option<usize>,
    /// Only the fewest likeliest that have this probability together; above 0, up to 1.
    pub top_p: Option<f64>,
    /// Only those at least this many times as likely as the likeliest; 0 to 1.
    pub min_p: Option<f64>,
}

/// What [`Draw::top_p`] is in the program where nothing else is asked for: measured in docs/results/two-level.md. Where joints
/// are given see [`super::cut`].
pub const TOP_P: f64 = 0.95;

impl Default for Draw {
    fn default() -> Draw {
        Draw {
            greedy: false,
            repetition_penalty: 1.0,
            repetition_words: 20,
            temperature: 1.0,
            top_k: None,
            top_p: None,
            min_p: None,
        }
    }
}

/// An id that may come next.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    id: u32,
    /// Finite; once centred, the likeliest has 0.
    logit: f64,
}

impl Draw {
    /// Always the likeliest.
    pub fn greedy() -> Draw {
        Draw { greedy: true, ..Draw::default() }
    }

    /// By probability, the logits divided by a temperature above 0 first.
    pub fn temperature(temperature: f64) -> Draw {
        Draw { temperature, ..Draw::default() }
    }

    /// Refuses settings outside their ranges.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] with the setting, what was found and what is expected.
    pub fn check(&self) -> Result<()> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let faults = [
            (!positive(self.temperature)).then_some(("temperature", self.temperature, "a number above 0")),
            (!positive(self.repetition_penalty)).then_some((
                "repetition-penalty",
                self.repetition_penalty,
                "a number above 0; 1 is none",
            )),
            self.top_k.filter(|&k| k == 0).map(|_| ("top-k", 0.0, "at least 1")),
            self.top_p.filter(|p| !(*p > 0.0 && *p <= 1.0)).map(|p| ("top-p", p, "a number above 0 and up to 1")),
            self.min_p.filter(|p| !(0.0..=1.0).contains(p)).map(|p| ("min-p", p, "a number from 0 to 1")),
        ];
        match faults.into_iter().flatten().next() {
            Some((what, found, expected)) => Err(Error::call(format!("{what} {found}; expected {expected}"))),
            None => Ok(()),
        }
    }

    /// Whether any rule leaves out unlikely ids.
    pub fn truncates(&self) -> bool {
        self.greedy || self.top_k.is_some() || self.top_p.is_some() || self.min_p.is_some()
    }

    /// The same with [`TOP_P`] where nothing truncates.
    pub fn truncated(self) -> Draw {
        Draw { top_p: self.top_p.or((!self.truncates()).then_some(TOP_P)), ..self }
    }

    /// Words that the repetition penalty looks back; 0 without one.
    pub fn looks_back(&self) -> usize {
        if self.repetition_penalty == 1.0 { 0 } else { self.repetition_words }
    }

    /// The id that is drawn of those that are `allowed`, ranges that ascend, by the `logits` (V) of all; `recent` are the
    /// ids that the repetition penalty falls on. A logit of minus infinity is probability 0. `None` if a logit is missing,
    /// NaN or plus infinity, or if none is finite.
    ///
    /// Probabilities are summed in f64 in the order of the ids, so the same stream draws the same everywhere.
    pub fn pick(&self, logits: &[f32], allowed: &[Range<u32>], recent: &[u32], rng: &mut ChaCha8Rng) -> Option<u32> {
        let mut left = candidates(logits, allowed)?;
        repetition::apply(&mut left, recent, self.repetition_penalty);
        if self.greedy {
            return greedy::pick(&left);
        }
        self.narrow(&mut left);
        temperature::draw(&left, rng)
    }

    /// The rules that narrow what a draw is made of.
    fn narrow(&self, left: &mut Vec<Candidate>) {
        centre(left);
        temperature::apply(left, self.temperature);
        if let Some(k) = self.top_k {
            top_k::apply(left, k);
        }
        if let Some(p) = self.top_p {
            top_p::apply(left, p);
        }
        if let Some(p) = self.min_p {
            min_p::apply(left, p);
        }
    }
}

/// ln p of an id among those that are `allowed`, by the `logits` (V) of all; minus infinity where it can't come.
pub fn log_probability(logits: &[f32], allowed: &[Range<u32>], id: u32) -> f64 {
    let Some(mut all) = candidates(logits, allowed) else { return f64::NEG_INFINITY };
    centre(&mut all);
    let own = all.iter().find(|candidate| candidate.id == id).map_or(f64::NEG_INFINITY, |own| own.logit);
    own - all.iter().map(|candidate| candidate.logit.exp()).sum::<f64>().ln()
}

/// The allowed ids of probability above 0, ascending.
fn candidates(logits: &[f32], allowed: &[Range<u32>]) -> Option<Vec<Candidate>> {
    let mut found = Vec::with_capacity(allowed.iter().map(ExactSizeIterator::len).sum());
    for id in allowed.iter().cloned().flatten() {
        let logit = *logits.get(id as usize).filter(|l| !l.is_nan() && **l < f32::INFINITY)?;
        if logit.is_finite() {
            found.push(Candidate { id, logit: logit.into() });
        }
    }
    (!found.is_empty()).then_some(found)
}

/// Moves all logits so that the largest is 0.
fn centre(left: &mut [Candidate]) {
    let top = left.iter().fold(f64::NEG_INFINITY, |top, c| top.max(c.logit));
    left.iter_mut().for_each(|c| c.logit -= top);
}

/// Keeps the `keep` likeliest, of equals the first; the order of the ids stays.
fn keep_likeliest(left: &mut Vec<Candidate>, keep: usize) {
    if keep >= left.len() {
        return;
    }
    left.sort_by(|a, b| b.logit.total_cmp(&a.logit).then(a.id.cmp(&b.id)));
    left.truncate(keep);
    left.sort_by_key(|c| c.id);
}

#[cfg(test)]
mod tests;
