//! Sampling rules: which of the allowed tokens comes next.
//!
//! One file per rule, applied in a fixed order: only the ids that the grammar allows; repetition penalty; then greedy takes
//! the most likely id, or temperature, top-k, top-p and min-p apply, each to what the one before has left, and an id is
//! sampled by probability. A rule that isn't requested changes nothing. The sampler of candle-transformers has no min-p and
//! no mask for the grammar's ids, and its greedy choice ignores edits of the probabilities, so it is not used here; where
//! both have a rule, the tests compare the two.
//!
//! A rule is a function over the ids that are left, with their logits. It leaves at least one, in ascending order, and the
//! most likely of them, whose logit is 0.

mod greedy;
mod min_p;
mod repetition;
mod temperature;
mod top_k;
mod top_p;

use crate::{Error, Result};
use kinelm_engine::op::exp64;
use kinelm_model::ModelConfig;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::ops::Range;

/// How a token is sampled from the model's logits. By default by its probability.
///
/// ```
/// use kinelm_generate::sampling::Sampling;
///
/// let sampling = Sampling { top_k: Some(2), ..Sampling::temperature(0.8) };
/// let mut rng = kinelm_store::random::stream(1, "example", 0, 0);
/// // of five ids the grammar allows 1 to 4, of which 2 and 4 are the most likely
/// let id = sampling.sample(&[9.0, 0.5, 2.0, 0.1, 1.5], &[1..5], &[], &mut rng).unwrap();
/// assert!([2, 4].contains(&id));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sampling {
    /// Always the most likely id; of equals the first. Every other rule but the penalty is without effect then. Default
    /// false.
    pub greedy: bool,
    /// Divides the probability of an id that was in the same slot of one of the last `repetition_words` words; above 0,
    /// 1: no penalty. Default 1.
    pub repetition_penalty: f64,
    /// Words that the penalty looks back. Default 20.
    pub repetition_words: usize,
    /// Divides the logits; above 0. Default 1.
    pub temperature: f64,
    /// Keeps this many of the most likely ids; at least 1.
    pub top_k: Option<usize>,
    /// Keeps the fewest most likely ids that have this probability together; above 0, up to 1.
    pub top_p: Option<f64>,
    /// Keeps the ids at least this many times as likely as the most likely one; 0 to 1.
    pub min_p: Option<f64>,
}

/// [`Sampling::top_p`] where a request has no truncation: measured in docs/results/two-level.md.
pub const TOP_P: f64 = 0.95;

/// The same by a model with a forecast, whose dances would be a quarter slower than real ones: what is left to sample is how far a
/// step is from its forecast.
pub const FORECAST_TOP_P: f64 = 0.97;

/// That of a model.
pub fn default_top_p(model: &ModelConfig) -> f64 {
    if model.forecast() { FORECAST_TOP_P } else { TOP_P }
}

impl Default for Sampling {
    fn default() -> Sampling {
        Sampling {
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
    /// Finite; the most likely has 0 once the logits are centred.
    logit: f64,
}

impl Sampling {
    /// Always the most likely id.
    pub fn greedy() -> Sampling {
        Sampling { greedy: true, ..Sampling::default() }
    }

    /// By probability, after dividing the logits by a temperature above 0.
    pub fn temperature(temperature: f64) -> Sampling {
        Sampling { temperature, ..Sampling::default() }
    }

    /// Refuses options outside their ranges.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] with the option.
    pub fn validate(&self) -> Result<()> {
        let is_positive = |x: f64| x > 0.0 && x.is_finite();
        let faults = [
            (!is_positive(self.temperature)).then_some(("temperature", self.temperature, "a number above 0")),
            (!is_positive(self.repetition_penalty)).then_some((
                "repetition_penalty",
                self.repetition_penalty,
                "a number above 0; 1 is none",
            )),
            self.top_k.filter(|&k| k == 0).map(|_| ("top_k", 0.0, "at least 1")),
            self.top_p.filter(|p| !(*p > 0.0 && *p <= 1.0)).map(|p| ("top_p", p, "a number above 0 and up to 1")),
            self.min_p.filter(|p| !(0.0..=1.0).contains(p)).map(|p| ("min_p", p, "a number from 0 to 1")),
        ];
        match faults.into_iter().flatten().next() {
            Some((name, found, expected)) => Err(Error::invalid_parameter(name, found, expected)),
            None => Ok(()),
        }
    }

    /// The same without the rules that remove ids.
    pub(crate) fn untruncated(self) -> Sampling {
        // named one by one, so that a new rule is put on one side or the other
        let Sampling { greedy: _, repetition_penalty, repetition_words, temperature, top_k: _, top_p: _, min_p: _ } =
            self;
        Sampling { repetition_penalty, repetition_words, temperature, ..Sampling::default() }
    }

    /// Whether any rule removes ids.
    pub(crate) fn truncates(&self) -> bool {
        *self != self.untruncated()
    }

    /// The same with this `top_p` where nothing truncates.
    pub fn truncated_at(self, top_p: f64) -> Sampling {
        Sampling { top_p: self.top_p.or((!self.truncates()).then_some(top_p)), ..self }
    }

    /// Words that the repetition penalty looks back; 0 without a penalty.
    pub(crate) fn looks_back(&self) -> usize {
        if self.repetition_penalty == 1.0 { 0 } else { self.repetition_words }
    }

    /// Samples an id from the `allowed` ones, ascending ranges, by the `logits` (V) of all ids. The repetition penalty applies
    /// to the `recent` ids. A logit of minus infinity is probability 0. `None` if a logit is missing, NaN or plus infinity,
    /// or if none is finite.
    ///
    /// Probabilities are summed in f64 in the order of the ids, so the same stream gives the same id on every machine.
    pub fn sample(&self, logits: &[f32], allowed: &[Range<u32>], recent: &[u32], rng: &mut ChaCha8Rng) -> Option<u32> {
        let mut left = candidates(logits, allowed)?;
        repetition::apply(&mut left, recent, self.repetition_penalty);
        if self.greedy {
            return greedy::sample(&left);
        }
        self.truncate(&mut left);
        temperature::sample(&left, rng)
    }

    /// Applies temperature and the truncating rules, in their order.
    fn truncate(&self, left: &mut Vec<Candidate>) {
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

/// The `allowed` ids at least `min_p` times as likely as the likeliest of them, by the `logits` (V) of all ids, ascending.
/// `None` if a logit is missing, NaN or plus infinity, or if none is finite.
pub(crate) fn likely(logits: &[f32], allowed: &[Range<u32>], min_p: f64) -> Option<Vec<Range<u32>>> {
    let all = of_allowed(logits, allowed)?;
    let each = || all.iter().flat_map(|(first, logits)| (*first..).zip(*logits));
    let top = each().fold(f32::NEG_INFINITY, |top, (_, logit)| top.max(*logit));
    let least = f64::from(top) + min_p::least(min_p);
    let likely = each().filter(|(_, logit)| f64::from(**logit) >= least);
    top.is_finite().then(|| likely.map(|(id, _)| id..id + 1).collect())
}

/// ln p of an id among the `allowed` ones, by the `logits` (V) of all ids; minus infinity where it is impossible.
pub(crate) fn log_probability(logits: &[f32], allowed: &[Range<u32>], id: u32) -> f64 {
    let Some(mut all) = candidates(logits, allowed) else { return f64::NEG_INFINITY };
    centre(&mut all);
    // centred, so that no exponential overflows and at least one is 1
    let own = all.iter().find(|candidate| candidate.id == id).map_or(f64::NEG_INFINITY, |own| own.logit);
    own - weights(&all).iter().sum::<f64>().ln()
}

/// The allowed ids of probability above 0, ascending.
fn candidates(logits: &[f32], allowed: &[Range<u32>]) -> Option<Vec<Candidate>> {
    let mut found = Vec::with_capacity(allowed.iter().map(ExactSizeIterator::len).sum());
    for (first, logits) in of_allowed(logits, allowed)? {
        let possible = (first..).zip(logits).filter(|(_, logit)| **logit != f32::NEG_INFINITY);
        found.extend(possible.map(|(id, &logit)| Candidate { id, logit: logit.into() }));
    }
    (!found.is_empty()).then_some(found)
}

/// The first id and the logits of each range of allowed ids; `None` if one is missing, NaN or plus infinity.
fn of_allowed<'a>(logits: &'a [f32], allowed: &[Range<u32>]) -> Option<Vec<(u32, &'a [f32])>> {
    let of = |ids: &Range<u32>| {
        let logits = logits.get(ids.start as usize..ids.end as usize)?;
        // below infinity: neither that nor NaN
        logits.iter().all(|logit| *logit < f32::INFINITY).then_some((ids.start, logits))
    };
    allowed.iter().map(of).collect()
}

/// Shifts all logits so that the largest is 0.
fn centre(left: &mut [Candidate]) {
    let top = left.iter().fold(f64::NEG_INFINITY, |top, c| top.max(c.logit));
    left.iter_mut().for_each(|c| c.logit -= top);
}

/// Probabilities, but for a common factor: the largest logit is 0.
fn weights(left: &[Candidate]) -> Vec<f64> {
    let mut weights: Vec<f64> = left.iter().map(|candidate| candidate.logit).collect();
    exp64::exp(&mut weights);
    weights
}

/// The most likely first, of equals the one with the smaller id.
fn by_likelihood(a: &Candidate, b: &Candidate) -> Ordering {
    b.logit.total_cmp(&a.logit).then(a.id.cmp(&b.id))
}

/// Keeps those up to the `last` one by likelihood.
fn keep_up_to(left: &mut Vec<Candidate>, last: Candidate) {
    left.retain(|c| by_likelihood(c, &last).is_le());
}

#[cfg(test)]
mod tests;
