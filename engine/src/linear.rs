//! What every layer with weights is made of: the weight laid out in panels, products of a piece of rows, the gradients.
//!
//! A layer (k, n) is packed once a pass. Its output is computed a piece of rows at a time ([`times`]); so is the gradient of
//! its input, with the transposed weight. The gradient of its output is packed by the same pieces, and
//! [`weight_gradient`] multiplies them all; biases and norms add up [`Sums`] over the pieces.

use crate::op::matmul::{Left, Panels, Store, pack, pack_transposed, panel, panels_len, product};
use crate::pieces;
use rayon::prelude::*;

/// Panels that one piece of the threads' work packs.
const PANELS: usize = 4;

/// [`pack`] of a whole weight (k, n), some panels a piece.
pub fn pack_parallel(panels: &mut [f32], weight: &[f32], k: usize, n: usize) {
    let columns = PANELS * panel();
    panels[..panels_len(k, n)].par_chunks_mut(k * columns).enumerate().for_each(|(i, part)| {
        let first = i * columns;
        pack(part, &weight[first..], n, k, columns.min(n - first));
    });
}

/// [`pack_transposed`] of a whole weight, given as (n, k), some panels a piece.
pub fn pack_transposed_parallel(panels: &mut [f32], weight: &[f32], k: usize, n: usize) {
    let columns = PANELS * panel();
    panels[..panels_len(k, n)].par_chunks_mut(k * columns).enumerate().for_each(|(i, part)| {
        let first = i * columns;
        pack_transposed(part, &weight[first * k..], k, k, columns.min(n - first));
    });
}

/// `out` (R, n) = `a` (R, k) times the weight in `panels`.
pub fn times(out: &mut [f32], a: &[f32], k: usize, panels: &[f32], n: usize) {
    let panels = Panels { numbers: panels, block: k };
    product(out, n, (out.len() / n, k, n), Left::Rows { a, lda: k }, panels, 1.0, Store::Set);
}

/// The gradient (k, n) of a weight: the transposed `x` (N, k) times the gradient (N, n) of the output in `panels`, in blocks
/// of `block` rows.
pub fn weight_gradient(
    gradient: &mut [f32],
    x: &[f32],
    k: usize,
    (panels, block): (&[f32], usize),
    rows: usize,
    store: Store,
) {
    let n = gradient.len() / k;
    let (high, block) = (pieces::gradient_rows(k), block.min(rows));
    gradient.par_chunks_mut(high * n).enumerate().for_each(|(i, part)| {
        let left = Left::Columns { a: &x[i * high..], lda: k };
        product(part, n, (part.len() / n, rows, n), left, Panels { numbers: panels, block }, 1.0, store);
    });
}

/// Sums over the pieces, taken from rows of `width` numbers from left to right.
pub struct Sums<'a> {
    /// A row of sums for each piece.
    pub partial: &'a [f32],
    /// Numbers of a row.
    pub width: usize,
    /// Whether what is there is kept.
    pub store: Store,
}

impl Sums<'_> {
    /// The next `to.len()` columns, added up piece by piece.
    pub fn take(&mut self, to: &mut [f32]) {
        if self.store == Store::Set {
            to.fill(0.0);
        }
        for row in self.partial.chunks(self.width) {
            to.iter_mut().zip(row).for_each(|(to, x)| *to += x);
        }
        self.partial = self.partial.get(to.len()..).unwrap_or(&[]);
    }
}
