//! Greedy: the likeliest.

use super::Candidate;

/// The likeliest id; of equals the first.
pub fn pick(left: &[Candidate]) -> Option<u32> {
    let first = left.first()?;
    Some(left.iter().fold(first, |best, c| if c.logit > best.logit { c } else { best }).id)
}
