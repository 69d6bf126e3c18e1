//! Sums of rows of tables on all threads, and their gradients.

use kinelm_engine::op::embedding::{self, Lookup};
use rayon::prelude::*;

/// Rows that a piece computes.
const ROWS: usize = 64;

/// `out` (n, D) becomes the sums of rows of tables, D = `width`.
pub(super) fn embed(out: &mut [f32], width: usize, lookups: &[Lookup]) {
    let pieces = out.par_chunks_mut(ROWS * width).enumerate();
    pieces.for_each(|(i, out)| embedding::forward(out, width, i * ROWS, lookups));
}

/// `table` becomes the sums of the rows of `dout` by their ids.
pub(super) fn into_table(table: &mut [f32], width: usize, ids: &[u32], dout: &[f32]) {
    table.fill(0.0);
    embedding::backward(table, width, ids, dout);
}
