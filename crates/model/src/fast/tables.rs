//! Sums of rows of tables on all threads, and their gradients.

use kinelm_engine::op::embedding::{self, Lookup, NONE};
use rayon::prelude::*;

/// Rows that a piece computes.
const ROWS: usize = 64;

/// `out` (n, D) becomes the sums of rows of tables, D = `width`.
pub(super) fn embed(out: &mut [f32], width: usize, lookups: &[Lookup]) {
    let pieces = out.par_chunks_mut(ROWS * width).enumerate();
    pieces.for_each(|(i, out)| embedding::forward(out, width, i * ROWS, lookups));
}

/// Adds to each row of `x` (n, D) that of a table by its id; [`NONE`] adds nothing.
pub(super) fn add_rows(x: &mut [f32], width: usize, table: &[f32], ids: &[u32]) {
    let rows = x.par_chunks_mut(width).zip(ids).filter(|(_, row)| **row != NONE);
    rows.for_each(|(x, &row)| x.iter_mut().zip(&table[row as usize * width..][..width]).for_each(|(x, y)| *x += y));
}

/// `table` becomes the sums of the rows of `dout` by their ids.
pub(super) fn into_table(table: &mut [f32], width: usize, ids: &[u32], dout: &[f32]) {
    // backward adds to the rows that occur: the others have to be 0
    table.fill(0.0);
    embedding::backward(table, width, ids, dout);
}
