//! What the rows of both stacks are made of.

use super::weights::FrameParts;
use crate::arena::Floats;
use crate::decode::weights::check;
use crate::words::Words;

/// The tables of [`FrameParts`] that rows are sums or chains of.
pub(super) struct Rows {
    words: Words,
    /// e.
    character: usize,
    bins: Floats,
    last: Floats,
    place: Floats,
    back: Floats,
    step: Floats,
}

impl Rows {
    /// # Panics
    /// Tables of other shapes.
    pub fn new(parts: &FrameParts, words: Words) -> Rows {
        let (places, d, character) = (words.places(), parts.sizes.speller.width, parts.sizes.character);
        assert!(character > 0, "characters of no numbers");
        let (all, most) = (words.steps().all(), words.steps().most());
        let table = |what: &str, numbers: &[f32], rows: usize, width: usize| {
            check(what, numbers, rows * width);
            Floats::of(numbers)
        };
        Rows {
            character,
            bins: table("bins", parts.bins, places.len() * (most + 1), character),
            last: table("last", parts.last, all + 1 + most, d),
            place: table("place", parts.place, places.len() + 1, d),
            back: table("back", parts.back, most + 1, d),
            step: table("step", parts.step, all + 1, d),
            words,
        }
    }

    /// W.
    pub fn word(&self) -> usize {
        self.words.length()
    }

    /// R.
    pub fn steps(&self) -> usize {
        self.words.steps().all()
    }

    /// 2 C e.
    pub fn frame_width(&self) -> usize {
        2 * self.words.places().len() * self.character
    }

    /// Writes what the trunk is told of the two frames before `frame` of the sequence `ids`: `x` (2 C e).
    pub fn frame(&self, x: &mut [f32], ids: &[u32], frame: usize) {
        let e = self.character;
        for (row, x) in self.words.seen(ids, frame).zip(x.chunks_exact_mut(e)) {
            x.copy_from_slice(&self.bins[row * e..][..e]);
        }
    }

    /// Writes the speller's row of input `i` of `ids`, `x` (d); `known` is what the trunk knows of its frame.
    pub fn spelled(&self, x: &mut [f32], ids: &[u32], i: usize, known: &[f32]) {
        x.copy_from_slice(known);
        let tables = [&self.last, &self.place, &self.back, &self.step];
        for (table, row) in tables.into_iter().zip(self.words.spelt(ids, i)) {
            let row = &table[row * x.len()..][..x.len()];
            x.iter_mut().zip(row).for_each(|(x, y)| *x += y);
        }
    }
}
