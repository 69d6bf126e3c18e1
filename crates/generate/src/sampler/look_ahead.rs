//! Look-ahead: a dance goes on with the best of several continuations, block after block.
//!
//! A likelihood doesn't see a body that leans or slides; a look at two seconds does. So every block is sampled several times
//! side by side, one [`Chooser`] names the best, and all go on from it: its keys and values are copied, nothing is read
//! again. This is best-of-N sampling, stretch by stretch: Nakano et al., "WebGPT" (2021), section 3.

use crate::Result;
use rand_chacha::rand_core::RngCore;
use std::fmt::Debug;
use std::ops::Range;
use std::sync::Arc;

/// Names the best of several continuations of a dance.
pub trait Chooser: Debug + Send + Sync {
    /// The number of the best of these dances, all alike but for the last words; `block`: the numbers of those. Each has
    /// the ids of its words from word `first` on, spaces included.
    ///
    /// # Errors
    /// Words that can't be decoded.
    fn best(&self, dances: &[&[u32]], first: usize, block: Range<usize>) -> Result<usize>;
}

/// How far and how often a dance is looked ahead.
#[derive(Debug, Clone)]
pub struct LookAhead {
    /// Continuations of each block, at least 2.
    pub candidates: usize,
    /// Words of the first block, behind what is known of the dance's beginning; at least 1.
    pub first: usize,
    /// Words of all later ones, at least 1.
    pub block: usize,
    /// Words before a block that the chooser sees with it.
    pub before: usize,
    /// Names the best.
    pub chooser: Arc<dyn Chooser>,
}

/// The seed of a candidate for a block of a dance with this seed. The first has the dance's own, so that a dance whose first
/// candidates are all the best is the one that is made without look-ahead.
pub(super) fn block_seed(seed: u64, block: usize, candidate: usize) -> u64 {
    match candidate {
        0 => seed,
        i => kinelm_store::random::stream(seed, "look-ahead", block as u64, i as u64).next_u64(),
    }
}
