//! Greedy: the most likely id.

use super::Candidate;

/// The most likely id; of equals the first.
pub fn sample(left: &[Candidate]) -> Option<u32> {
    let first = left.first()?;
    Some(left.iter().fold(first, |best, c| if c.logit > best.logit { c } else { best }).id)
}
