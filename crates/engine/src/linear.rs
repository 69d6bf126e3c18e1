//! The parts of every layer with weights: the weight packed in panels, products of a piece of rows, gradients.
//!
//! A layer (k, n) is packed once per pass. Its output is computed piece by piece of rows ([`Products::times`]), as is the
//! gradient of its input, with the transposed weight. The gradient of its output is packed in the same pieces, and
//! `Products::weight_gradient` multiplies them all; biases and norms add up `Sums` over the pieces.

use crate::op::bf16;
use crate::op::matmul::{self, Left, Store};
use crate::op::products::Right;
use crate::pieces;
use rayon::prelude::*;

pub use crate::op::products::Products;

/// Panels that one piece of the threads' work packs.
const PANELS: usize = 4;

impl Products {
    /// As [`Products::pack`] of a weight (k, n), on all threads: some panels a piece.
    ///
    /// # Panics
    /// If slices are too short, here and below.
    pub fn pack_parallel(self, panels: &mut [f32], weight: &[f32], k: usize, n: usize) {
        self.in_parts(panels, k, n, |part, first, columns| self.pack(part, &weight[first..], n, k, columns));
    }

    /// The same of a transposed weight, (n, k).
    pub(crate) fn pack_transposed_parallel(self, panels: &mut [f32], weight: &[f32], k: usize, n: usize) {
        self.in_parts(panels, k, n, |part, first, columns| {
            self.pack_transposed(part, &weight[first * k..], k, k, columns);
        });
    }

    /// Calls `pack` with some panels at a time, their first column and how many they are.
    fn in_parts(self, panels: &mut [f32], k: usize, n: usize, pack: impl Fn(&mut [f32], usize, usize) + Sync) {
        if k == 0 || n == 0 {
            return;
        }
        // a multiple of both kinds of panels, so that a part begins at a panel in either
        let columns = PANELS * matmul::panel().max(bf16::PANEL);
        let len = self.panels_len(k, n);
        panels[..len].par_chunks_mut(self.panels_len(k, columns)).enumerate().for_each(|(i, part)| {
            let first = i * columns;
            pack(part, first, columns.min(n - first));
        });
    }

    /// `out` (R, n) = `a` (R, k) times the weight in `panels`.
    pub fn times(self, out: &mut [f32], a: &[f32], k: usize, panels: &[f32], n: usize) {
        let (rows, left) = (out.len() / n, Left::Rows { a, lda: k });
        self.product(out, n, (rows, k, n), left, Right { panels, block: k, first: 0 }, Store::Set);
    }

    /// The gradient (k, n) of a weight: the transposed `x` (N, k) times the gradient (N, n) of the output in `panels`, in
    /// blocks of `block` rows.
    pub(crate) fn weight_gradient(
        self,
        gradient: &mut [f32],
        x: &[f32],
        k: usize,
        (panels, block): (&[f32], usize),
        rows: usize,
        store: Store,
    ) {
        let n = gradient.len() / k;
        // a block that holds all rows may be longer than they are
        let (high, block) = (pieces::gradient_rows(k), block.min(rows));
        gradient.par_chunks_mut(high * n).enumerate().for_each(|(i, part)| {
            let left = Left::Columns { a: &x[i * high..], lda: k };
            self.product(part, n, (part.len() / n, rows, n), left, Right { panels, block, first: 0 }, store);
        });
    }
}

/// Sums over the pieces, taken from rows of `width` numbers from left to right.
pub(crate) struct Sums<'a> {
    /// A row of sums for each piece.
    pub partial: &'a [f32],
    /// Numbers of a row.
    pub width: usize,
    /// Whether the sums overwrite or add.
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
        // rows keep their width: the next columns begin `to.len()` further in each, and the last row just ends earlier
        self.partial = self.partial.get(to.len()..).unwrap_or(&[]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check;
    use crate::scalar;

    /// Error of a sum of k rows, as a share of the largest number.
    fn bound(k: usize) -> f64 {
        1e-6 * (k as f64 / 4096.0).sqrt().max(1.0)
    }

    fn held(found: &[f32], truth: &[f64], k: usize, what: &str) {
        let most = truth.iter().fold(1.0, |most: f64, x| most.max(x.abs()));
        for (i, (x, t)) in found.iter().zip(truth).enumerate() {
            assert!((*x as f64 - t).abs() <= bound(k) * most, "{what}, number {i}: {x}, expected {t}");
        }
    }

    /// The kernels of bf16 that this machine has.
    fn rounding() -> Vec<Products> {
        if Products::bf16() == Products::Bf16 {
            vec![Products::Rounded, Products::Bf16]
        } else {
            vec![Products::Rounded]
        }
    }

    #[test]
    fn layers_in_bf16_are_what_plain_loops_over_rounded_numbers_give() {
        for (rows, k, n) in [(1, 1, 1), (5, 33, 17), (64, 48, 144), (70, 130, 65), (33, 1, 300), (150, 257, 40)] {
            let (a, w) = (check::numbers(1, rows * k, 0.5), check::numbers(2, k * n, 0.5));
            let turned: Vec<f32> = (0..k * n).map(|i| w[i % k * n + i / k]).collect();
            let truth = scalar::bf16::product((rows, k, n), Left::Rows { a: &a, lda: k }, &w);
            for by in rounding() {
                let mut panels = vec![f32::NAN; by.panels_len(k, n)];
                let mut out = vec![f32::NAN; rows * n];
                by.pack_parallel(&mut panels, &w, k, n);
                by.times(&mut out, &a, k, &panels, n);
                held(&out, &truth, k, &format!("{by:?} ({rows}, {k}, {n})"));
                by.pack_transposed_parallel(&mut panels, &turned, k, n);
                by.times(&mut out, &a, k, &panels, n);
                held(&out, &truth, k, &format!("{by:?} ({rows}, {k}, {n}) from the transposed"));
            }
        }
    }

    #[test]
    fn gradients_of_weights_in_bf16_are_what_plain_loops_give() {
        for (rows, k, n, piece) in
            [(1, 3, 2, 1), (100, 40, 33, 43), (257, 150, 64, 64), (64, 17, 5, 64), (90, 1, 70, 7)]
        {
            let (x, d) = (check::numbers(1, rows * k, 0.5), check::numbers(2, rows * n, 0.5));
            let truth = scalar::bf16::product((k, rows, n), Left::Columns { a: &x, lda: k }, &d);
            for by in rounding() {
                let room = by.panels_len(piece, n);
                let mut panels = vec![f32::NAN; rows.div_ceil(piece) * room];
                for (to, d) in panels.chunks_mut(room).zip(d.chunks(piece * n)) {
                    by.pack(to, d, n, d.len() / n, n);
                }
                let mut gradient = vec![f32::NAN; k * n];
                by.weight_gradient(&mut gradient, &x, k, (&panels, piece), rows, Store::Set);
                held(&gradient, &truth, rows, &format!("{by:?} ({rows}, {k}, {n})"));
                by.weight_gradient(&mut gradient, &x, k, (&panels, piece), rows, Store::Add);
                let twice: Vec<f64> = truth.iter().map(|t| 2.0 * t).collect();
                held(&gradient, &twice, rows, &format!("{by:?} ({rows}, {k}, {n}) added"));
            }
        }
    }
}
