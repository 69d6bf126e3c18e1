//! The nearest windows, or the farthest, exactly.
//!
//! Cosines with all windows come first from signed bytes (one query: reading memory is all it waits for) or from a product
//! of matrices (many queries), each with a bound on how far it is off. Whatever may then be among the k nearest is measured
//! again from the features themselves, in f64. The answer is that of measuring everything, whatever the number of threads.
//!
//! Of bytes a query reads the heads of all windows, a ninth where features have 1,152 numbers, and the rests of those alone
//! that may still be among the k nearest. A mark that k windows surely reach is known after a few blocks, those whose heads
//! promise most.

use super::candidates::Candidates;
use super::database::Database;
use super::distance::{SearchOptions, Side};
use super::part::Part;
use super::quantize::{Query, Size, cosine};
use crate::{Error, Result};
use kinelm_engine::op::matmul::{self, Left, Panels, Store};
use rayon::prelude::*;
use std::ops::Range;

/// Windows that a thread reads at a time.
const ROWS: usize = 256;
/// Blocks of windows whose heads promise most, which the first mark is found in.
const PROMISING: usize = 32;

/// A window that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Its number in the database.
    pub window: usize,
    /// As `Distance::score`.
    pub score: f64,
}

/// Cosines of one query with all windows, and how far each may be off.
pub struct Cosines<'a> {
    /// (N).
    pub near: &'a [f32],
    /// By the product they come from, as a share of both lengths.
    pub error: f64,
}

/// Some windows of a part, and what they are compared with.
struct Block<'a> {
    part: &'a Part,
    query: &'a Query,
    /// The number of the part's first window.
    first: usize,
    /// In the part.
    rows: Range<usize>,
    wanted: SearchOptions,
    /// The length of the query.
    norm: f64,
}

/// What the heads of a block promise.
struct Promise {
    /// The greatest rank that each window may have, rounded up.
    ranks: Vec<f32>,
    /// The greatest of them.
    most: f32,
}

impl Block<'_> {
    /// The ranks that windows may have by their heads.
    fn promise(&self) -> Result<Promise> {
        let mut products = [0; ROWS];
        let products = &mut products[..self.rows.len()];
        self.query.heads(products, &self.part.bytes(0, self.rows.clone())?);
        let sizes = &self.part.sizes[self.rows.clone()];
        // up, so that no window is dropped by rounding
        let rank =
            |(&product, size)| (self.rank(self.query.by_head(product, size), size, Side::Greatest) as f32).next_up();
        let ranks: Vec<f32> = products.iter().zip(sizes).map(rank).collect();
        let most = ranks.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        Ok(Promise { ranks, most })
    }

    /// Offers the windows that may be among the nearest by their heads, by all of their bytes.
    fn offer(
        &self,
        promise: &Promise,
        allowed: &(dyn Fn(usize) -> bool + Sync),
        found: &mut Candidates<'_>,
    ) -> Result<()> {
        for (row, &promised) in self.rows.clone().zip(&promise.ranks) {
            let promised = f64::from(promised);
            // the bound first: it is cheaper than looking up whether a window is allowed
            if !found.may(promised) || !allowed(self.first + row) {
                continue;
            }
            let size = &self.part.sizes[row];
            let mut head = [0];
            self.query.heads(&mut head, &self.part.bytes(0, row..row + 1)?);
            let squares = self.query.by_all([head[0], self.query.rest(&self.part.bytes(1, row..row + 1)?)], size);
            let [least, greatest] = [Side::Least, Side::Greatest].map(|side| self.rank(squares, size, side));
            // both bound it: so it doesn't depend on threads which windows are left
            found.offer(self.first + row, [least, greatest.min(promised)]);
        }
        Ok(())
    }

    #[inline]
    fn rank(&self, squares: [f64; 2], size: &Size, side: Side) -> f64 {
        self.wanted.rank(|side| cosine(squares, size, side), side, self.norm, size.norm)
    }
}

impl Database {
    /// The k windows nearest to `feature` (D), or farthest from it, of those that are `allowed`: nearest or farthest
    /// first, of equal ones the first in the database first. Fewer where fewer are allowed.
    ///
    /// # Errors
    /// An index whose files were cut while it was in use.
    ///
    /// # Panics
    /// When the feature has another length, or the database was made without bytes.
    pub fn nearest(
        &self,
        feature: &[f32],
        wanted: SearchOptions,
        allowed: &(dyn Fn(usize) -> bool + Sync),
    ) -> Result<Vec<Hit>> {
        self.measure(feature, &self.scan(feature, wanted, allowed)?, wanted)
    }

    /// The windows that may be among the k nearest by the bounds of their bytes, in order: what [`Database::nearest`]
    /// measures.
    ///
    /// # Errors
    /// As [`Database::nearest`].
    ///
    /// # Panics
    /// As [`Database::nearest`].
    pub fn scan(
        &self,
        feature: &[f32],
        wanted: SearchOptions,
        allowed: &(dyn Fn(usize) -> bool + Sync),
    ) -> Result<Vec<usize>> {
        assert_eq!(feature.len(), self.numbers(), "a feature of another length");
        let norm = Size::of(feature).norm;
        let parts: Vec<_> = self.parts().iter().map(|part| (part, part.scales.query(feature, norm))).collect();
        let blocks = parts.iter().zip(self.firsts()).flat_map(|((part, query), &first)| {
            let rows = part.sizes.len();
            let rows = (0..rows).step_by(ROWS).map(move |row| row..(row + ROWS).min(rows));
            rows.map(move |rows| Block { part, query, first, rows, wanted, norm })
        });
        let blocks: Vec<_> = blocks.collect();
        let promised: Vec<Promise> = blocks.par_iter().map(Block::promise).collect::<Result<_>>()?;
        let mut order: Vec<usize> = (0..blocks.len()).collect();
        order.sort_unstable_by(|&a, &b| promised[b].most.total_cmp(&promised[a].most).then(a.cmp(&b)));
        order.truncate(PROMISING);
        // in the order of the windows, as those of a clip are to follow each other
        order.sort_unstable();
        let mut first = Candidates::new(self, wanted);
        order.iter().try_for_each(|&block| blocks[block].offer(&promised[block], allowed, &mut first))?;
        let mark = first.mark();
        let none = || Candidates::new(self, wanted).above(mark);
        let all = blocks.par_iter().zip(&promised).filter(|(_, promise)| f64::from(promise.most) >= mark);
        let found = all.try_fold(none, |mut found, (block, promise)| {
            block.offer(promise, allowed, &mut found)?;
            Ok::<_, Error>(found)
        });
        Ok(found.try_reduce(none, |a, b| Ok(a.merge(b)))?.finish())
    }

    /// Cosines (Q, N) of windows of the database with all its windows, by a product of matrices, and how far they may be
    /// off.
    ///
    /// # Errors
    /// As [`Database::nearest`].
    pub(crate) fn cosines(&self, windows: &[usize]) -> Result<(Vec<f32>, f64)> {
        let (k, count) = (self.numbers(), windows.len());
        let mut queries: Vec<f32> = Vec::with_capacity(k * count);
        for &window in windows {
            queries.extend_from_slice(&self.feature(window)?);
        }
        let mut packed = vec![0.0; matmul::panels_len(k, count)];
        matmul::pack_transposed(&mut packed, &queries, k, k, count);
        let panels = Panels { numbers: &packed, block: k };
        let norms: Vec<f64> = windows.iter().map(|&w| self.size(w).norm).collect();
        let mut turned = vec![0.0f32; self.windows() * count];
        let mut first = 0;
        for part in self.parts() {
            let here = &mut turned[first * count..][..part.sizes.len() * count];
            first += part.sizes.len();
            let blocks = here.par_chunks_mut(ROWS * count).zip(part.sizes.par_chunks(ROWS)).enumerate();
            blocks.try_for_each(|(block, (out, sizes))| {
                let first = block * ROWS;
                let rows = part.features(first * k..(first + sizes.len()) * k)?;
                let left = Left::Rows { a: &rows, lda: k };
                matmul::product(out, count, (sizes.len(), k, count), left, panels, Store::Set);
                for (row, size) in out.chunks_exact_mut(count).zip(sizes) {
                    row.iter_mut().zip(&norms).for_each(|(x, norm)| *x = over(f64::from(*x), norm * size.norm) as f32);
                }
                Ok::<_, Error>(())
            })?;
        }
        let mut near = vec![0.0; turned.len()];
        near.par_chunks_mut(self.windows().max(1)).enumerate().for_each(|(query, row)| {
            row.iter_mut().zip(turned.chunks_exact(count)).for_each(|(x, all)| *x = all[query]);
        });
        // k products and sums and a few more, each off by at most half a unit of f32
        let roundings = (k + 4) as f64 * 0.5f64.powi(24);
        // Higham's gamma: (1 + u)^n - 1 is at most n u / (1 - n u)
        Ok((near, roundings / (1.0 - roundings)))
    }

    /// The k nearest by cosines that are nearly right.
    ///
    /// # Errors
    /// As [`Database::nearest`].
    pub(super) fn select(
        &self,
        feature: &[f32],
        cosines: Cosines<'_>,
        wanted: SearchOptions,
        allowed: &(dyn Fn(usize) -> bool + Sync),
    ) -> Result<Vec<Hit>> {
        let norm = Size::of(feature).norm;
        let none = || Candidates::new(self, wanted);
        let found = (0..self.windows()).into_par_iter().with_min_len(ROWS).fold(none, |mut found, window| {
            let near = f64::from(cosines.near[window]);
            let cosine = |side| match side {
                Side::Least => near - cosines.error,
                Side::Greatest => near + cosines.error,
            };
            let rank = |side| wanted.rank(cosine, side, norm, self.size(window).norm);
            let greatest = rank(Side::Greatest);
            if found.may(greatest) && allowed(window) {
                found.offer(window, [rank(Side::Least), greatest]);
            }
            found
        });
        self.measure(feature, &found.reduce(none, Candidates::merge).finish(), wanted)
    }

    /// The k nearest of some windows, by their features.
    ///
    /// # Errors
    /// As [`Database::nearest`].
    pub fn measure(&self, feature: &[f32], windows: &[usize], wanted: SearchOptions) -> Result<Vec<Hit>> {
        let exact = |&window: &usize| Ok(Hit { window, score: wanted.distance.score(feature, &self.feature(window)?) });
        let mut hits: Vec<Hit> = windows.par_iter().with_min_len(32).map(exact).collect::<Result<_>>()?;
        // ties by place, whatever thread measured first
        hits.sort_by(|a, b| {
            let (first, second) = if wanted.farthest { (a, b) } else { (b, a) };
            first.score.total_cmp(&second.score).then(a.window.cmp(&b.window))
        });
        if wanted.one_per_clip {
            let mut seen = vec![false; self.clips().len()];
            hits.retain(|h| !std::mem::replace(&mut seen[self.window(h.window).clip], true));
        }
        hits.truncate(wanted.k);
        Ok(hits)
    }
}

fn over(x: f64, size: f64) -> f64 {
    if size > 0.0 { x / size } else { 0.0 }
}
