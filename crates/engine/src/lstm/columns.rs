//! A product of few rows whose columns are shared by threads.

use super::UNITS;
use crate::arena::Floats;
use crate::op::matmul::{self, Left, Panels, Store, panel};
use rayon::prelude::*;

/// A right factor (k, n), some columns a part.
pub struct Columns {
    k: usize,
    n: usize,
    parts: Vec<Part>,
}

struct Part {
    first: usize,
    columns: usize,
    panels: Floats,
    /// (rows, columns) of the product.
    out: Floats,
}

impl Columns {
    /// Memory for products of up to `rows` rows.
    pub fn new(k: usize, n: usize, rows: usize) -> Columns {
        let wide = UNITS.next_multiple_of(panel());
        let part = |first: usize| {
            let columns = wide.min(n - first);
            let (panels, out) = (Floats::new(matmul::panels_len(k, columns)), Floats::new(rows * columns));
            Part { first, columns, panels, out }
        };
        Columns { k, n, parts: (0..n).step_by(wide).map(part).collect() }
    }

    /// Takes a weight (k, n).
    pub fn pack(&mut self, weight: &[f32]) {
        let (k, n) = (self.k, self.n);
        self.parts.par_iter_mut().for_each(|p| matmul::pack(&mut p.panels, &weight[p.first..], n, k, p.columns));
    }

    /// Takes a weight (n, k), transposed.
    pub fn pack_transposed(&mut self, weight: &[f32]) {
        let k = self.k;
        self.parts.par_iter_mut().for_each(|p| {
            matmul::pack_transposed(&mut p.panels, &weight[p.first * k..], k, k, p.columns);
        });
    }

    /// `out` (R, n) = `a` (R, k) times the weight, plus `bias` (n) where there is one.
    pub fn times(&mut self, out: &mut [f32], a: &[f32], bias: Option<&[f32]>) {
        let (k, n) = (self.k, self.n);
        let rows = out.len() / n;
        self.parts.par_iter_mut().for_each(|p| {
            let (panels, left) = (Panels { numbers: &p.panels, block: k }, Left::Rows { a, lda: k });
            matmul::product(&mut p.out, p.columns, (rows, k, p.columns), left, panels, Store::Set);
        });
        // parts have memory of their own, since rayon can't hand out columns of a row-major `out`
        for p in &self.parts {
            for (to, from) in out.chunks_exact_mut(n).zip(p.out.chunks_exact(p.columns)) {
                matmul::copy(&mut to[p.first..][..p.columns], from);
            }
        }
        if let Some(bias) = bias {
            crate::op::bias::add(out, bias);
        }
    }
}
