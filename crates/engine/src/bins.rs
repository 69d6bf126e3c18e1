//! Neighbouring ids, or columns of logits, of ascending numbers.

use std::ops::Range;

/// Ascending bins: the ids of a slot of every word, or the columns of logits that a target is one of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bins {
    /// The first id or column.
    pub first: u32,
    /// How many there are.
    pub count: u32,
    /// Whether the last and the first are neighbours, as angles are.
    pub circular: bool,
}

impl Bins {
    /// For a target without neighbours.
    pub const NONE: Bins = Bins { first: 0, count: 0, circular: false };

    /// The bin of an id; `None` for ids of other kinds.
    pub fn bin(self, id: u32) -> Option<usize> {
        id.checked_sub(self.first).filter(|&bin| bin < self.count).map(|bin| bin as usize)
    }

    /// The ids of the bins.
    pub fn ids(self) -> Range<u32> {
        self.first..self.first + self.count
    }
}
