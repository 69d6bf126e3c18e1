//! What the rows of both stacks are made of.

use super::weights::FrameParts;
use crate::arena::Floats;
use crate::bins::Bins;
use crate::decode::before::Words;
use crate::decode::weights::check;

/// The tables of [`FrameParts`] that rows are sums or chains of.
pub(super) struct Rows {
    words: Words,
    /// S.
    most: usize,
    steps: Steps,
    /// e.
    character: usize,
    bins: Floats,
    last: Floats,
    place: Floats,
    back: Floats,
    step: Floats,
}

/// How a table of steps between bins is laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Steps {
    /// Sc.
    circular: usize,
    /// Sl.
    clamped: usize,
}

impl Steps {
    fn new(places: &[Bins]) -> Steps {
        let most = |circular: bool| {
            let counts = places.iter().filter(|bins| bins.circular == circular).map(|bins| bins.count as usize);
            counts.max().unwrap_or(0)
        };
        Steps { circular: most(true), clamped: most(false) }
    }

    /// R: the row of no step, behind those of all steps.
    fn none(self) -> usize {
        self.circular + (2 * self.clamped).saturating_sub(1)
    }

    /// The row of the step between two bins of a place.
    fn row(self, bins: Bins, from: usize, to: usize) -> usize {
        match bins.circular {
            true => (to + bins.count as usize - from) % bins.count as usize,
            false => self.circular + to + self.clamped - 1 - from,
        }
    }
}

impl Rows {
    /// # Panics
    /// Tables of other shapes.
    pub fn new(parts: &FrameParts, words: Words) -> Rows {
        let (places, d, character) = (words.places(), parts.sizes.speller.width, parts.sizes.character);
        assert!(character > 0, "characters of no numbers");
        let steps = Steps::new(places);
        let most = steps.circular.max(steps.clamped);
        let table = |what: &str, numbers: &[f32], rows: usize, width: usize| {
            check(what, numbers, rows * width);
            Floats::of(numbers)
        };
        Rows {
            most,
            steps,
            character,
            bins: table("bins", parts.bins, places.len() * (most + 1), character),
            last: table("last", parts.last, steps.none() + 1 + most, d),
            place: table("place", parts.place, places.len() + 1, d),
            back: table("back", parts.back, most + 1, d),
            step: table("step", parts.step, steps.none() + 1, d),
            words,
        }
    }

    /// W.
    pub fn word(&self) -> usize {
        self.words.places().len() + 1
    }

    /// R.
    pub fn steps(&self) -> usize {
        self.steps.none()
    }

    /// 2 C e.
    pub fn frame_width(&self) -> usize {
        2 * self.words.places().len() * self.character
    }

    /// What follows input `i` of `ids`, and the bin that stands there so many `frames` back.
    fn bin(&self, ids: &[u32], i: usize, frames: usize) -> Option<(Bins, usize)> {
        let bins = self.words.follows(i)?;
        Some((bins, bins.bin(self.words.back(ids, i, frames)?)?))
    }

    /// Writes what the trunk is told of the two frames before `frame` of the sequence `ids`: `x` (2 C e).
    pub fn frame(&self, x: &mut [f32], ids: &[u32], frame: usize) {
        let (places, e) = (self.words.places().len(), self.character);
        for (frames, x) in (1..).zip(x.chunks_exact_mut(places * e)) {
            for (place, x) in x.chunks_exact_mut(e).enumerate() {
                let bin = self.bin(ids, frame * self.word() + place, frames).map_or(self.most, |(_, bin)| bin);
                x.copy_from_slice(&self.bins[(place * (self.most + 1) + bin) * e..][..e]);
            }
        }
    }

    /// Writes the speller's row of input `i` of `ids`, `x` (d); `known` is what the trunk knows of its frame.
    pub fn spelled(&self, x: &mut [f32], ids: &[u32], i: usize, known: &[f32]) {
        let (none, place) = (self.steps.none(), i % self.word());
        let (one, two) = (self.bin(ids, i, 1), self.bin(ids, i, 2));
        let step = one.zip(two).map_or(none, |((bins, a), (_, b))| self.steps.row(bins, b, a));
        // within a frame, input i itself is what follows the input before: no frame back
        let read = |frames| if place == 0 { None } else { self.bin(ids, i - 1, frames) };
        let last = match (read(0), read(1)) {
            (Some((bins, to)), Some((_, from))) => self.steps.row(bins, from, to),
            (Some((_, to)), None) => none + 1 + to,
            (None, _) => none,
        };
        let back = one.map_or(self.most, |(_, bin)| bin);
        x.copy_from_slice(known);
        for (table, row) in [(&self.last, last), (&self.place, place), (&self.back, back), (&self.step, step)] {
            let row = &table[row * x.len()..][..x.len()];
            x.iter_mut().zip(row).for_each(|(x, y)| *x += y);
        }
    }
}
