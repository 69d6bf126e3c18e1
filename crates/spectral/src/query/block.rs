//! The windows that a search reads at a time.

use super::candidates::Candidates;
use super::distance::{SearchOptions, Side};
use super::part::{BLOCK, Part};
use super::promise::{BESIDE, Extent};
use super::quantize::{Query, Size, cosine};
use crate::Result;
use kinelm_engine::op::matmul::{self, Left, Panels, Store};
use std::borrow::Cow;
use std::ops::Range;

/// Some windows of a part.
pub struct Block<'a> {
    part: &'a Part,
    /// The number of the part.
    pub number: usize,
    /// The number of the part's first window.
    first: usize,
    /// In the part.
    rows: Range<usize>,
    /// What the sizes of the windows are within.
    pub extent: &'a Extent,
}

/// A thread's room for products of matrices.
#[derive(Default)]
pub struct Scratch {
    /// ([`BLOCK`], k) rows of heads and what is beside them.
    left: Vec<f32>,
    /// ([`BLOCK`], Q).
    products: Vec<f32>,
    /// (Q) the greatest of each column.
    greatest: Vec<f32>,
}

impl<'a> Block<'a> {
    /// The blocks of the part with this number, whose first window is `first`.
    pub fn of(part: &'a Part, number: usize, first: usize) -> impl Iterator<Item = Block<'a>> {
        let all = part.sizes.len();
        part.extents.iter().zip((0..).step_by(BLOCK)).map(move |(extent, begin)| {
            let rows = begin..(begin + BLOCK).min(all);
            Block { part, number, first, rows, extent }
        })
    }

    fn heads(&self) -> Result<Cow<'_, [i8]>> {
        self.part.bytes(0, self.rows.clone())
    }

    fn beside(&self) -> &[[f32; BESIDE]] {
        &self.part.beside[self.rows.clone()]
    }

    /// The greatest promise of the windows to one query.
    pub fn promise(&self, query: &Query, farthest: bool) -> Result<f32> {
        let mut products = [0; BLOCK];
        query.heads(&mut products[..self.rows.len()], &self.heads()?);
        let promise = |(&product, &beside)| query.promise(product, beside, farthest);
        Ok(products.iter().zip(self.beside()).map(promise).fold(f32::NEG_INFINITY, f32::max))
    }

    /// The same to each of Q queries, whose promising vectors are in `panels`.
    pub fn promises<'s>(&self, panels: &[f32], queries: usize, scratch: &'s mut Scratch) -> Result<&'s [f32]> {
        let width = self.part.widths[0];
        let k = width + BESIDE;
        let Scratch { left, products, greatest } = scratch;
        left.resize(BLOCK * k, 0.0);
        products.resize(BLOCK * queries, 0.0);
        for ((row, head), beside) in left.chunks_exact_mut(k).zip(self.heads()?.chunks_exact(width)).zip(self.beside())
        {
            row[..width].iter_mut().zip(head).for_each(|(x, &byte)| *x = f32::from(byte));
            row[width..].copy_from_slice(beside);
        }
        let (left, panels) = (Left::Rows { a: left, lda: k }, Panels { numbers: panels, block: k });
        matmul::product(products, queries, (self.rows.len(), k, queries), left, panels, Store::Set);
        greatest.clear();
        greatest.resize(queries, f32::NEG_INFINITY);
        for row in products.chunks_exact(queries).take(self.rows.len()) {
            greatest.iter_mut().zip(row).for_each(|(most, &x)| *most = if x > *most { x } else { *most });
        }
        Ok(greatest)
    }

    /// Offers the windows that may be among the nearest by their heads, by all of their bytes.
    pub fn offer(
        &self,
        query: &Query,
        wanted: SearchOptions,
        allowed: &dyn Fn(usize) -> bool,
        found: &mut Candidates<'_>,
    ) -> Result<()> {
        let rank = |squares, size: &Size, side| {
            wanted.rank(|side| cosine(squares, size.error, side), side, query.norm, size.norm)
        };
        let mut products = [0; BLOCK];
        query.heads(&mut products[..self.rows.len()], &self.heads()?);
        for (row, &head) in self.rows.clone().zip(&products) {
            let size = &self.part.sizes[row];
            let promised = rank(query.by_head(head, size), size, Side::Greatest);
            // the bound first: it is cheaper than looking up whether a window is allowed
            if !found.may(promised) || !allowed(self.first + row) {
                continue;
            }
            let squares = query.by_all([head, query.rest(&self.part.bytes(1, row..row + 1)?)], size);
            let [least, greatest] = [Side::Least, Side::Greatest].map(|side| rank(squares, size, side));
            // both bound it: so it doesn't depend on threads which windows are left
            found.offer(self.first + row, [least, greatest.min(promised)]);
        }
        Ok(())
    }
}
