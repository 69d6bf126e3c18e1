//! From vectors to logits: over all tokens, or over differences to the token one word back.
//!
//! Each row takes the product with one table alone, and of that the columns it needs: rows of the same table are brought
//! together.

use super::before::Relative;
use super::kernel::Left;
use super::layers::{Room, products};
use super::matrix::{Matrix, PIECE, WeightKind};
use crate::words::Words;
use std::ops::Range;

/// A table of the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Table {
    Absolute,
    Circular,
    Clamped,
}

const TABLES: [Table; 3] = [Table::Absolute, Table::Circular, Table::Clamped];

/// What the logits of a row are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Task {
    /// Those of all tokens.
    All,
    /// Those of `count` tokens from `first` on; columns of the circular table from `count - bin` on, going round.
    Round { first: usize, count: usize, bin: usize },
    /// Those of `count` tokens from `first` on; columns of the clamped table from `column` on.
    Shifted { first: usize, count: usize, column: usize },
}

impl Task {
    fn table(self) -> Table {
        match self {
            Task::All => Table::Absolute,
            Task::Round { .. } => Table::Circular,
            Task::Shifted { .. } => Table::Clamped,
        }
    }

    /// Columns of its table that it needs.
    fn columns(self, vocabulary: usize) -> Range<usize> {
        match self {
            Task::All => 0..vocabulary,
            Task::Round { count, .. } => 0..count,
            Task::Shifted { count, column, .. } => column..column + count,
        }
    }

    /// Writes the `logits` (V), which are minus infinity, from its row of the product.
    fn write(self, logits: &mut [f32], product: &Pieces, row: usize) {
        match self {
            Task::All => product.copy(logits, row, 0),
            Task::Round { first, count, bin } => {
                let (low, high) = logits[first..first + count].split_at_mut(bin);
                product.copy(low, row, count - bin);
                product.copy(high, row, 0);
            }
            Task::Shifted { first, count, column } => product.copy(&mut logits[first..first + count], row, column),
        }
    }
}

/// Some pieces of a product.
pub(super) struct Pieces<'a> {
    pub numbers: &'a [f32],
    pub rows: usize,
    /// The first piece that is there.
    pub first: usize,
}

impl Pieces<'_> {
    /// The numbers of a row from a column on.
    pub fn copy(&self, mut to: &mut [f32], row: usize, mut column: usize) {
        while !to.is_empty() {
            let within = column % PIECE;
            let n = to.len().min(PIECE - within);
            let piece = &self.numbers[(column / PIECE - self.first) * self.rows * PIECE..];
            to[..n].copy_from_slice(&piece[row * PIECE + within..][..n]);
            (to, column) = (&mut to[n..], column + n);
        }
    }
}

/// The tables of a head, packed.
pub(super) struct Head {
    vocabulary: usize,
    absolute: Matrix,
    differences: Option<Differences>,
}

struct Differences {
    words: Words,
    circular: Option<Matrix>,
    clamped: Option<Matrix>,
}

impl Head {
    /// # Panics
    /// Tables of other shapes.
    pub fn new(
        kind: WeightKind,
        (vocabulary, width): (usize, usize),
        absolute: &[f32],
        relative: Option<(Words, Relative)>,
    ) -> Head {
        let matrix = |what: &str, table: &[f32], rows: usize| {
            assert_eq!(table.len(), rows * width, "numbers of {what}");
            Matrix::new(kind, (width, rows), PIECE, |_| 0.0, |i, j| table[j * width + i])
        };
        let differences = relative.map(|(words, tables)| {
            let steps = words.steps();
            let some = |what, table, rows| (rows > 0).then(|| matrix(what, table, rows));
            Differences {
                circular: some("circular differences", tables.circular, steps.circular),
                clamped: some("clamped differences", tables.clamped, steps.up_and_down()),
                words,
            }
        });
        Head { vocabulary, absolute: matrix("head", absolute, vocabulary), differences }
    }

    /// Columns of the widest table.
    pub fn widest(&self) -> usize {
        let difference = |table: &Option<Matrix>| table.as_ref().map_or(0, Matrix::columns);
        let differences = self.differences.as_ref();
        let widest = differences.map_or(0, |d| difference(&d.circular).max(difference(&d.clamped)));
        self.absolute.columns().max(widest)
    }

    /// Bytes that are read for a token, the mean over the places of a word.
    pub fn bytes(&self) -> usize {
        let Some(Differences { words, circular, clamped, .. }) = &self.differences else {
            return self.absolute.bytes();
        };
        let of = |count: u32, table: &Option<Matrix>| {
            table.as_ref().map_or(0, |table| table.bytes() * count as usize / table.columns())
        };
        let places = words.places().iter();
        let differences = places.map(|bins| of(bins.count, if bins.circular { circular } else { clamped }));
        (differences.sum::<usize>() + self.absolute.bytes()) / (words.places().len() + 1)
    }

    fn table(&self, table: Table) -> Option<&Matrix> {
        let differences = self.differences.as_ref();
        match table {
            Table::Absolute => Some(&self.absolute),
            Table::Circular => differences.and_then(|d| d.circular.as_ref()),
            Table::Clamped => differences.and_then(|d| d.clamped.as_ref()),
        }
    }

    /// What the logits behind input `i` of the sequence `ids` are.
    fn task(&self, ids: &[u32], i: usize) -> Task {
        let known = |d: &Differences| Some((d.words.bin(ids, i, 1)?, d.words.steps()));
        let Some(((bins, bin), steps)) = self.differences.as_ref().and_then(known) else { return Task::All };
        let (first, count) = (bins.first as usize, bins.count as usize);
        match bins.circular {
            true => Task::Round { first, count, bin },
            false => Task::Shifted { first, count, column: steps.column(bins, bin, 0) },
        }
    }

    /// Appends the logits (rows, V) of the first rows of `room.normed` (rows, D) to `logits`. `asked` are the rows' sequences
    /// and inputs.
    pub fn logits<'a>(
        &self,
        logits: &mut Vec<f32>,
        room: &mut Room,
        width: usize,
        asked: impl Iterator<Item = (&'a [u32], usize)> + Clone,
    ) {
        let (before, vocabulary) = (logits.len(), self.vocabulary);
        let tasks = asked.map(|(ids, i)| self.task(ids, i));
        logits.resize(before + tasks.clone().count() * vocabulary, f32::NEG_INFINITY);
        for table in TABLES {
            let Some(matrix) = self.table(table) else { continue };
            let mine = || tasks.clone().enumerate().filter(|(_, task)| task.table() == table);
            let (mut rows, mut first, mut last) = (0, usize::MAX, 0);
            for (row, task) in mine() {
                // the vectors before the norm are no longer needed
                room.x[rows * width..][..width].copy_from_slice(&room.normed[row * width..][..width]);
                let needed = task.columns(vocabulary);
                (first, last) = (first.min(needed.start), last.max(needed.end));
                rows += 1;
            }
            if rows == 0 {
                continue;
            }
            let pieces = first / PIECE..last.div_ceil(PIECE);
            products(matrix, pieces.clone(), &mut room.pieces, Left::whole(&room.x, rows, width, width));
            let product = Pieces { numbers: &room.pieces, rows, first: pieces.start };
            for (i, (row, task)) in mine().enumerate() {
                task.write(&mut logits[before + row * vocabulary..][..vocabulary], &product, i);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bins::Bins;

    #[test]
    fn each_row_asks_for_the_columns_it_needs() {
        let places = [(4, true), (3, false), (5, false)].map(|(count, circular)| Bins { first: 6, count, circular });
        let width = 2;
        let tables = Relative { circular: &[0.0; 8], clamped: &[0.0; 18] };
        let words = Words::new(1, places.to_vec());
        let head = Head::new(WeightKind::F32, (11, width), &[0.0; 22], Some((words, tables)));
        // the last token of the second word's place is that of <mask>
        let ids = [1, 9, 7, 10, 5, 6, 8, 3, 5, 6];
        let tasks: Vec<Task> = (0..10).map(|i| head.task(&ids, i)).collect();
        let all = Task::All;
        let round = |bin| Task::Round { first: 6, count: 4, bin };
        let shifted = |count, column| Task::Shifted { first: 6, count, column };
        let second = [round(3), shifted(3, 3), shifted(5, 0), all];
        assert_eq!(tasks[..8], [[all; 4], second].concat());
        assert_eq!(tasks[8..], [round(0), shifted(3, 2)]);
        assert_eq!(head.task(&[&ids[..], &[7]].concat(), 10), all);
        assert_eq!((shifted(5, 4).columns(11), round(0).columns(11)), (4..9, 0..4));
    }

    #[test]
    fn differences_go_round_or_are_shifted() {
        // columns 64 to 191 of a product of two rows
        let numbers: Vec<f32> = (1..3)
            .flat_map(|piece| (0..2 * PIECE).map(move |i| (1000 * (i / PIECE) + piece * PIECE + i % PIECE) as f32))
            .collect();
        let product = Pieces { numbers: &numbers, rows: 2, first: 1 };
        let mut logits = [-1.0; 8];
        Task::Shifted { first: 2, count: 5, column: 125 }.write(&mut logits, &product, 1);
        assert_eq!(logits, [-1.0, -1.0, 1125.0, 1126.0, 1127.0, 1128.0, 1129.0, -1.0]);
        let product = Pieces { first: 0, ..product };
        Task::Round { first: 1, count: 6, bin: 2 }.write(&mut logits, &product, 0);
        assert_eq!(logits, [-1.0, 68.0, 69.0, 64.0, 65.0, 66.0, 67.0, -1.0]);
    }
}
