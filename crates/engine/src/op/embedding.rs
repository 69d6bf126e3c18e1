//! Embeddings: a row of the stream is a sum of rows of tables, a token's vector, its position's and whatever else a model
//! adds. A kind of input is a table and a list of ids, nothing more.

use super::rows;
use crate::dispatch;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

/// The id of no row: nothing is added here.
pub const NONE: u32 = u32::MAX;

/// A table, and the row of it for each row of the stream.
#[derive(Debug, Clone, Copy)]
pub struct Lookup<'a> {
    /// (rows, D).
    pub table: &'a [f32],
    /// For row r of the stream `ids[r % ids.len()]`: N ids, or T where every sequence has the same. [`NONE`] adds nothing.
    pub ids: &'a [u32],
}

/// Writes the sums into `out` (n, D), rows `first_row..first_row + n` of the stream, D = `width`.
///
/// # Panics
/// Shapes that don't fit; an id outside its table.
pub fn forward(out: &mut [f32], width: usize, first_row: usize, lookups: &[Lookup]) {
    let n = rows("embedding", out.len(), width);
    for lookup in lookups {
        let in_table = rows("embedding's table", lookup.table.len(), width);
        check(lookup.ids, (first_row..first_row + n).map(|r| lookup.ids[r % lookup.ids.len()]), n, in_table);
    }
    dispatch::run(Forward { out, width, first_row, lookups });
}

/// Adds to `dtable` (rows, D) each row of `dout` (N, D), D = `width`, at its id, in the order of the rows. `ids` as in
/// [`Lookup`].
///
/// # Panics
/// Shapes that don't fit; an id outside the table.
pub fn backward(dtable: &mut [f32], width: usize, ids: &[u32], dout: &[f32]) {
    let (in_table, n) = (rows("embedding's table", dtable.len(), width), rows("embedding", dout.len(), width));
    check(ids, ids.iter().copied(), n, in_table);
    // a piece owns rows of the table, not of dout: no two threads add to one row, and the order is that of the rows
    let piece = in_table.div_ceil(PIECES).max(SMALLEST);
    let piece_of = |(i, dtable)| dispatch::run(Backward { dtable, width, first_id: i * piece, ids, dout });
    match in_table <= piece {
        true => piece_of((0, dtable)),
        false => dtable.par_chunks_mut(piece * width).enumerate().for_each(piece_of),
    }
}

/// The most pieces of a table's gradient: each reads all ids.
const PIECES: usize = 16;
/// Rows of a table that no piece has less of.
const SMALLEST: usize = 16;

fn check(all: &[u32], mut ids: impl Iterator<Item = u32>, n: usize, in_table: usize) {
    assert!(n == 0 || !all.is_empty(), "embedding: no ids for {n} rows");
    if let Some(wrong) = ids.find(|&id| id != NONE && id as usize >= in_table) {
        panic!("embedding: id {wrong} outside a table of {in_table} rows");
    }
}

struct Forward<'a> {
    out: &'a mut [f32],
    width: usize,
    first_row: usize,
    lookups: &'a [Lookup<'a>],
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Forward { out, width, first_row, lookups } = self;
        for (r, out) in out.chunks_exact_mut(width).enumerate() {
            let mut empty = true;
            for Lookup { table, ids } in lookups {
                let id = ids[(first_row + r) % ids.len()];
                if id != NONE {
                    let row = &table[id as usize * width..][..width];
                    // the first lookup copies: out needs no zeros, and the sum no addition to 0
                    if empty {
                        out.copy_from_slice(row);
                    } else {
                        add(simd, out, row);
                    }
                    empty = false;
                }
            }
            if empty {
                out.fill(0.0);
            }
        }
    }
}

/// Adds to the rows `first_id..` of a table, as many as `dtable` has.
struct Backward<'a> {
    dtable: &'a mut [f32],
    width: usize,
    first_id: usize,
    ids: &'a [u32],
    dout: &'a [f32],
}

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Backward { dtable, width, first_id, ids, dout } = self;
        let held = dtable.len() / width;
        for (dout, &id) in dout.chunks_exact(width).zip(ids.iter().cycle()) {
            // the ids of the pieces before this one wrap to beyond what is held
            let place = (id as usize).wrapping_sub(first_id);
            if id != NONE && place < held {
                add(simd, &mut dtable[place * width..][..width], dout);
            }
        }
    }
}

#[inline(always)]
fn add<S: Simd>(simd: S, sum: &mut [f32], row: &[f32]) {
    let ((sum, sum_tail), (row, row_tail)) = (S::as_mut_simd_f32s(sum), S::as_simd_f32s(row));
    for (s, x) in sum.iter_mut().zip(row) {
        *s = simd.add_f32s(*s, *x);
    }
    if !row_tail.is_empty() {
        let all = simd.add_f32s(simd.partial_load_f32s(sum_tail), simd.partial_load_f32s(row_tail));
        simd.partial_store_f32s(sum_tail, all);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, near, numbers};
    use crate::scalar::embedding as scalar;

    /// Sums of up to 60 numbers below 1.
    const BOUND: f64 = 2e-6;

    /// Ids below `below`, every seventh none, from `seed`.
    fn ids(seed: usize, n: usize, below: usize) -> Vec<u32> {
        (0..n).map(|i| if (i + seed) % 7 == 6 { NONE } else { ((i * 31 + seed) % below) as u32 }).collect()
    }

    #[test]
    fn rows_are_sums_of_table_rows() {
        let (batch, length) = (3, 7);
        let n = batch * length;
        for (width, lanes) in (1..=67).chain([256]).flat_map(|w| Lanes::ALL.map(|l| (w, l))) {
            let tables: Vec<Vec<f32>> = [11, 7, 3, 2].map(|rows| numbers(rows as u64, rows * width, 1.0)).into();
            // a token, a position in the sequence, a place in the word, and a table that is rarely looked up
            let all_ids = [ids(0, n, 11), (0..7).collect(), (0..7).map(|t| t % 3).collect(), ids(3, length, 2)];
            let all: Vec<Lookup> = tables.iter().zip(&all_ids).map(|(table, ids)| Lookup { table, ids }).collect();
            for lookups in [&all[..], &all[..2], &all[..1], &[]] {
                let what = format!("{lanes:?}, {} tables, width {width}", lookups.len());
                let expected = scalar::forward(n, width, lookups);
                let mut out = vec![7.0; n * width];
                lanes.run(Forward { out: &mut out, width, first_row: 0, lookups });
                near(&what, &out, &expected, BOUND);
                let mut part = vec![7.0; 5 * width];
                lanes.run(Forward { out: &mut part, width, first_row: 9, lookups });
                assert_eq!(part, out[9 * width..][..5 * width], "{what}");
            }
        }
    }

    #[test]
    fn gradients_reach_the_rows_that_were_asked() {
        for (width, lanes) in (1..=67).chain([256]).flat_map(|w| Lanes::ALL.map(|l| (w, l))) {
            for (n, in_table, ids) in
                [(60, 11, ids(1, 60, 11)), (60, 40, ids(2, 12, 40)), (0, 3, vec![]), (4, 1, vec![0])]
            {
                let what = format!("{lanes:?} ({n}, {width}) of {in_table}");
                let (dout, before) = (numbers(1, n * width, 1.0), numbers(2, in_table * width, 1.0));
                let mut expected = scalar::backward(in_table, width, &ids, &dout);
                expected.iter_mut().zip(&before).for_each(|(e, &b)| *e += b as f64);
                let mut dtable = before.clone();
                let half = in_table / 2;
                let (low, high) = dtable.split_at_mut(half * width);
                for (dtable, first_id) in [(low, 0), (high, half)] {
                    lanes.run(Backward { dtable, width, first_id, ids: &ids, dout: &dout });
                }
                near(&what, &dtable, &expected, BOUND);
                let mut whole = before.clone();
                backward(&mut whole, width, &ids, &dout);
                assert_eq!(whole, dtable, "{what}");
            }
        }
    }

    #[test]
    fn ids_stay_in_their_table() {
        let lookup = Lookup { table: &[0.0; 6], ids: &[0, 3, 1] };
        forward(&mut [1.0; 2], 2, 0, &[lookup]);
        let found = std::panic::catch_unwind(|| forward(&mut [1.0; 4], 2, 0, &[lookup])).unwrap_err();
        assert_eq!(found.downcast_ref::<String>().unwrap(), "embedding: id 3 outside a table of 3 rows");
        let found = std::panic::catch_unwind(|| backward(&mut [1.0; 4], 2, &[2], &[1.0, 1.0])).unwrap_err();
        assert_eq!(found.downcast_ref::<String>().unwrap(), "embedding: id 2 outside a table of 2 rows");
    }
}
