//! The product of rows of bytes with a matrix of bytes.
//!
//! A row is rounded to bytes by a scale of its own, a column by one of its own, and the sums are whole numbers: a row's
//! product is the same bits whatever rows are computed with it, and on every processor. Four numbers of k are multiplied at
//! a time where there is an instruction for it ([`quads`]), two elsewhere ([`pairs`]).
//! Source: a scale a row and a column: Dettmers et al., "LLM.int8()" (2022), section 2.

mod pairs;
mod quads;
mod round;

pub(super) use round::{Rows, round, size_of};

use crate::dispatch;
use pulp::Arch;
#[cfg(target_arch = "x86_64")]
use pulp::x86::V3;

/// How bytes are multiplied; all ways give the same bits.
#[derive(Debug, Clone, Copy)]
pub(super) enum Way {
    /// By [`quads`].
    Quads,
    /// By [`pairs`], with the instructions of AVX2.
    #[cfg(target_arch = "x86_64")]
    Pairs(V3),
    /// By the plain loops of [`pairs`].
    Plain,
}

impl Way {
    /// The fastest one that the kernels may use here.
    pub fn here() -> Way {
        match dispatch::arch() {
            _ if quads::are_there() => Way::Quads,
            #[cfg(target_arch = "x86_64")]
            Arch::V4(simd) => Way::Pairs(*simd),
            #[cfg(target_arch = "x86_64")]
            Arch::V3(simd) => Way::Pairs(simd),
            _ => Way::Plain,
        }
    }

    /// Numbers of k that are multiplied at a time: a word.
    pub fn word(self) -> usize {
        if matches!(self, Way::Quads) { quads::WORD } else { pairs::WORD }
    }

    /// Words that k numbers take.
    pub fn words(self, k: usize) -> usize {
        k.div_ceil(self.word())
    }

    /// What the sums of a column of bytes have in excess.
    pub fn excess(self, column: impl Iterator<Item = i8>) -> i32 {
        if matches!(self, Way::Quads) { quads::excess(column) } else { 0 }
    }
}

/// Some panels of a matrix of bytes.
pub(super) struct Product<'a> {
    /// (m, panels), a row every `ldc` numbers.
    pub c: &'a mut [f32],
    pub ldc: usize,
    pub rows: &'a Rows,
    /// How many rows.
    pub m: usize,
    pub k: usize,
    /// [panel][word of k][column][number of the word].
    pub panels: &'a [i8],
    /// Columns of a panel.
    pub panel: usize,
    /// A factor for each column of these panels; `excess` and `bias` have a number for each, too.
    pub scale: &'a [f32],
    /// [`Way::excess`] of the columns, to be taken off.
    pub excess: &'a [i32],
    pub bias: &'a [f32],
}

impl Product<'_> {
    /// # Panics
    /// Slices that are too short; rows that were rounded for another way.
    pub fn run(mut self, way: Way) {
        let (words, columns) = (way.words(self.k), self.scale.len());
        let Product { m, ldc, panel, .. } = self;
        assert!(columns.is_multiple_of(panel), "{columns} columns in panels of {panel}");
        self.rows.check(m, words, way);
        assert!(self.panels.len() >= columns * words * way.word(), "{columns} columns of {words} words");
        assert!(self.excess.len() == columns && self.bias.len() == columns && ldc >= columns, "{columns} columns");
        assert!(m == 0 || self.c.len() >= (m - 1) * ldc + columns, "{m} rows of {columns} sums");
        match way {
            Way::Quads => quads::run(&mut self, words),
            #[cfg(target_arch = "x86_64")]
            Way::Pairs(simd) => pairs::run(simd, &mut self, words),
            Way::Plain => pairs::plain(&mut self, words),
        }
    }
}

#[cfg(test)]
mod tests;
