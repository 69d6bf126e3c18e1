//! Sums of table rows, in f64.

use crate::op::embedding::{Lookup, NONE};

/// `rows` sums of the rows that the lookups name.
pub fn forward(rows: usize, width: usize, lookups: &[Lookup]) -> Vec<f64> {
    let mut out = vec![0.0; rows * width];
    for Lookup { table, ids } in lookups {
        for (i, o) in out.iter_mut().enumerate() {
            match ids[i / width % ids.len()] {
                NONE => {}
                id => *o += table[id as usize * width + i % width] as f64,
            }
        }
    }
    out
}

/// The gradient of a table of `rows` rows.
pub fn backward(rows: usize, width: usize, ids: &[u32], dout: &[f32]) -> Vec<f64> {
    let mut dtable = vec![0.0; rows * width];
    for (i, &d) in dout.iter().enumerate() {
        match ids[i / width % ids.len()] {
            NONE => {}
            id => dtable[id as usize * width + i % width] += d as f64,
        }
    }
    dtable
}
