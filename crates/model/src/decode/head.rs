//! From vectors to logits: over all ids, or over the steps from the bin one word back.
//!
//! Each row is multiplied by one table alone, and by the columns that it needs: rows of the same table go together.

use super::numbers::Numbers;
use crate::config::{HeadKind, ModelConfig, TokenLayout};
use crate::forecast::reached;
use crate::head_groups::STEPS;
use crate::words::Words;
use kinelm_engine::decode::{Matrix, Product, StackDecoder, WeightKind};
use std::ops::Range;

/// A table of the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Table {
    Absolute,
    Circular,
    Clamped,
}

const TABLES: [Table; 3] = [Table::Absolute, Table::Circular, Table::Clamped];

/// The source of a row's logits.
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
    fn write(self, logits: &mut [f32], product: &Product, row: usize) {
        match self {
            Task::All => product.copy(row, 0, logits),
            Task::Round { first, count, bin } => {
                // bin b is column (b - bin) mod count: those below `bin` are the table's last columns
                let (low, high) = logits[first..first + count].split_at_mut(bin);
                product.copy(row, count - bin, low);
                product.copy(row, 0, high);
            }
            Task::Shifted { first, count, column } => product.copy(row, column, &mut logits[first..first + count]),
        }
    }
}

/// The tables of a head, packed.
pub(super) struct Head {
    vocabulary: usize,
    absolute: Matrix,
    steps: Option<StepTables>,
}

struct StepTables {
    words: Words,
    circular: Option<Matrix>,
    clamped: Option<Matrix>,
}

impl Head {
    /// The head of a model whose last vectors are `width` wide; sequences have `front` tokens in front.
    pub fn new(
        numbers: &Numbers,
        config: &ModelConfig,
        tokens: &TokenLayout,
        front: usize,
        width: usize,
        kind: WeightKind,
    ) -> Head {
        let matrix = |table: &[f32]| Matrix::transposed(table, table.len() / width, width, kind);
        // a table exists only if such slots do
        let optional = |name: &str| Some(numbers.optional(name)).filter(|table| !table.is_empty()).map(matrix);
        let steps = (config.head_of(tokens) == HeadKind::Relative).then(|| StepTables {
            words: Words::new(front, tokens.bins()),
            circular: optional(STEPS[0]),
            clamped: optional(STEPS[1]),
        });
        Head { vocabulary: tokens.vocabulary, absolute: matrix(numbers.get(config.ids_table())), steps }
    }

    /// Columns of the widest table.
    pub fn widest(&self) -> usize {
        TABLES.iter().filter_map(|table| self.table(*table)).map(Matrix::columns).max().unwrap_or(0)
    }

    /// Bytes that are read for a token, the mean over the slots of a word.
    pub fn bytes(&self) -> usize {
        let Some(StepTables { words, circular, clamped }) = &self.steps else {
            return self.absolute.bytes();
        };
        let of = |count: u32, table: &Option<Matrix>| {
            table.as_ref().map_or(0, |table| table.bytes() * count as usize / table.columns())
        };
        let places = words.places().iter();
        let steps = places.map(|bins| of(bins.count, if bins.circular { circular } else { clamped }));
        // the space of every word is predicted over all ids
        (steps.sum::<usize>() + self.absolute.bytes()) / (words.places().len() + 1)
    }

    fn table(&self, table: Table) -> Option<&Matrix> {
        let steps = self.steps.as_ref();
        match table {
            Table::Absolute => Some(&self.absolute),
            Table::Circular => steps.and_then(|steps| steps.circular.as_ref()),
            Table::Clamped => steps.and_then(|steps| steps.clamped.as_ref()),
        }
    }

    /// The source of the logits after input `i` of the sequence `ids`, of which a step is forecast.
    fn task(&self, ids: &[u32], i: usize, forecast: i32) -> Task {
        let known = |steps: &StepTables| Some((steps.words.bin(ids, i, 1)?, steps.words.steps()));
        let Some(((bins, from), steps)) = self.steps.as_ref().and_then(known) else { return Task::All };
        let bin = reached(bins, from, forecast);
        let (first, count) = (bins.first as usize, bins.count as usize);
        match bins.circular {
            true => Task::Round { first, count, bin },
            false => Task::Shifted { first, count, column: steps.column(bins, bin, 0) },
        }
    }

    /// Appends the logits (rows, V) of the normed rows of `stack`; ids that can't follow have minus infinity. `rows` are the
    /// rows' sequences, inputs and forecasts.
    pub fn logits<'a>(
        &self,
        logits: &mut Vec<f32>,
        stack: &mut StackDecoder,
        rows: impl Iterator<Item = (&'a [u32], usize, i32)> + Clone,
    ) {
        let (before, vocabulary) = (logits.len(), self.vocabulary);
        let tasks = rows.map(|(ids, i, forecast)| self.task(ids, i, forecast)).enumerate();
        // a step reaches the bins of one slot: all other ids stay impossible
        logits.resize(before + tasks.clone().count() * vocabulary, f32::NEG_INFINITY);
        for table in TABLES {
            let Some(matrix) = self.table(table) else { continue };
            let mine = || tasks.clone().filter(|(_, task)| task.table() == table);
            let needed = mine().map(|(_, task)| task.columns(vocabulary));
            // one range for all rows: a product by pieces per row would read the table once for each
            let needed = needed.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end));
            let Some(needed) = needed else { continue };
            let product = stack.product(matrix, mine().map(|(row, _)| row), needed);
            for (i, (row, task)) in mine().enumerate() {
                task.write(&mut logits[before + row * vocabulary..][..vocabulary], &product, i);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_engine::bins::Bins;
    use kinelm_engine::decode::{KvKind, Norm, Run, Stack, StackWeights};

    fn matrix(n: usize) -> Matrix {
        let numbers: Vec<f32> = (0..n).map(|j| j as f32).collect();
        Matrix::transposed(&numbers, n, 1, WeightKind::F32)
    }

    #[test]
    fn each_row_needs_columns_of_one_table() {
        let places = [(4, true), (3, false), (5, false)].map(|(count, circular)| Bins { first: 6, count, circular });
        let steps =
            StepTables { words: Words::new(1, places.to_vec()), circular: Some(matrix(4)), clamped: Some(matrix(9)) };
        let head = Head { vocabulary: 11, absolute: matrix(11), steps: Some(steps) };
        // the last token of the second word's slot is that of <mask>
        let ids = [1, 9, 7, 10, 5, 6, 8, 3, 5, 6];
        let tasks: Vec<Task> = (0..10).map(|i| head.task(&ids, i, 0)).collect();
        let all = Task::All;
        let round = |bin| Task::Round { first: 6, count: 4, bin };
        let shifted = |count, column| Task::Shifted { first: 6, count, column };
        let second = [round(3), shifted(3, 3), shifted(5, 0), all];
        assert_eq!(tasks[..8], [[all; 4], second].concat());
        assert_eq!(tasks[8..], [round(0), shifted(3, 2)]);
        assert_eq!(head.task(&[&ids[..], &[7]].concat(), 10, 0), all);
        // 3 and two steps more round a circle of 4; 1 and two more, up to the last of 3
        assert_eq!((head.task(&ids, 4, 2 << 16), head.task(&ids, 5, 2 << 16)), (round(1), shifted(3, 2)));
        assert_eq!((shifted(5, 4).columns(11), round(0).columns(11)), (4..9, 0..4));
    }

    #[test]
    fn steps_go_round_or_are_shifted() {
        // a row whose product with column j is j
        let weights = StackWeights::new(&[], Stack { layers: 0, heads: 1, width: 1 }, WeightKind::F32, None);
        let mut stack = StackDecoder::new(&weights, KvKind::F32, 1, 2, 2, 192);
        stack.push(Run { stream: 0, place: 0, rows: 2 });
        stack.norm(&Norm::new((&[0.0], &[1.0]), 1), 0..2);
        let mut logits = [-1.0; 8];
        let product = stack.product(&matrix(192), 0..2, 125..130);
        Task::Shifted { first: 2, count: 5, column: 125 }.write(&mut logits, &product, 1);
        assert_eq!(logits, [-1.0, -1.0, 125.0, 126.0, 127.0, 128.0, 129.0, -1.0]);
        let product = stack.product(&matrix(192), 0..2, 0..192);
        Task::Round { first: 1, count: 6, bin: 2 }.write(&mut logits, &product, 0);
        assert_eq!(logits, [-1.0, 4.0, 5.0, 0.0, 1.0, 2.0, 3.0, -1.0]);
    }
}
