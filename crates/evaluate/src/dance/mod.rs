//! Measures of one dance: whether it freezes, repeats itself, responds to its prompt, copies. Defined in
//! docs/measures.md.
//!
//! Real and generated clips go through the same coding and decoding: the tokenizer of the corpus that holds the real ones,
//! the joints that it doesn't code at rest.

pub mod beats;
mod coded;
pub mod compare;
mod coordination;
mod copying;
pub mod features;
pub mod fidelity;
mod frechet;
pub mod freeze;
pub mod judge;
mod load;
mod metrics;
mod panels;
pub mod positions;
mod print;
pub mod prompt;
pub mod real;
mod reference;
mod repetition;
mod report;
#[cfg(test)]
mod tests;
pub mod two_sample;

pub use coded::Dance;
pub use load::requested_label;
pub use metrics::GroupMetrics;
pub use reference::Reference;
pub use report::{Copied, Report};

/// The p-quantile of ascending numbers, linear between ranks.
fn percentile(sorted: &[f64], p: f64) -> Option<f64> {
    percentile_of(sorted, sorted.len(), p)
}

/// The same of `all` numbers, of which the lowest are known, as far as [`ranks`] says.
fn percentile_of(lowest: &[f64], all: usize, p: f64) -> Option<f64> {
    let at = p * all.checked_sub(1)? as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    Some(lowest[low] + (lowest[high] - lowest[low]) * (at - low as f64))
}

/// How many of the lowest of `all` numbers the p-quantile needs.
fn ranks(all: usize, p: f64) -> usize {
    (p * all as f64).ceil() as usize + 1
}

/// Standard deviation, dividing by the number; `None` of fewer than two.
fn sd(numbers: &[f64]) -> Option<f64> {
    let n = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / n;
    (numbers.len() > 1).then(|| (numbers.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / n).sqrt())
}
