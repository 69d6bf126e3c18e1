//! The nearest windows to each of some features, or the farthest, exactly.
//!
//! First every block of windows promises, by heads alone, how near one of its windows may be: for one query by its products
//! with signed bytes, where reading memory is all it waits for, for many by one product of matrices. The blocks that promise
//! most give a mark that k windows surely reach, after which few blocks are read by window, and of few windows the rests.
//! Whatever may then be among the k nearest is measured again from the features themselves, in f64. The answer is that of
//! measuring everything, whatever the number of threads and whatever is searched beside it.

use super::candidates::Candidates;
use super::database::Database;
use super::distance::{SearchOptions, Side};
use super::part::{BLOCK, Part};
use super::promise::{BESIDE, Extent};
use super::quantize::{Query, Size, cosine};
use crate::{Error, Result};
use kinelm_engine::op::matmul::{self, Left, Panels, Store};
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;

/// Blocks of windows whose heads promise most, which the first mark is found in, at most; and as a share of all.
const PROMISING: usize = 32;
const SHARE: usize = 8;

/// A window that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Its number in the database.
    pub window: usize,
    /// As `Distance::score`.
    pub score: f64,
}

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Nearest or farthest first, of equal ones the first in the database first.
    pub hits: Vec<Hit>,
    /// Windows whose features were measured.
    pub measured: usize,
}

/// Decides for a query, by its number, and a window whether it may be found.
pub type Allowed<'a> = &'a (dyn Fn(usize, usize) -> bool + Sync);

/// Some windows of a part.
struct Block<'a> {
    part: &'a Part,
    /// The number of the part, and that of its first window.
    number: usize,
    first: usize,
    /// In the part.
    rows: Range<usize>,
    extent: &'a Extent,
}

/// A feature that windows are compared with.
struct Asked {
    /// To be compared with the bytes of each part.
    by_part: Vec<Query>,
    norm: f64,
    wanted: SearchOptions,
}

impl Block<'_> {
    fn bytes(&self, half: usize) -> Result<Cow<'_, [i8]>> {
        self.part.bytes(half, self.rows.clone())
    }

    /// Products of the rows' heads with one query.
    fn heads(&self, query: &Query, products: &mut [i64; BLOCK]) -> Result<()> {
        query.heads(&mut products[..self.rows.len()], &self.bytes(0)?);
        Ok(())
    }

    /// The greatest promise of the rows to one query.
    fn promise(&self, query: &Query, farthest: bool) -> Result<f32> {
        let mut products = [0; BLOCK];
        self.heads(query, &mut products)?;
        let promise = |(&product, &beside)| query.promise(product, beside, farthest);
        let all = products.iter().zip(&self.part.beside[self.rows.clone()]).map(promise);
        Ok(all.fold(f32::NEG_INFINITY, f32::max))
    }

    /// The same to Q queries, whose promising vectors are in `panels`.
    fn promises(&self, panels: &[f32], most: &mut [f32], scratch: &mut Scratch) -> Result<()> {
        let width = self.part.widths[0];
        let (k, queries, rows) = (width + BESIDE, most.len(), self.rows.len());
        let Scratch { left, products } = scratch;
        left.resize(BLOCK * k, 0.0);
        products.resize(BLOCK * queries, 0.0);
        let heads = self.bytes(0)?;
        let beside = &self.part.beside[self.rows.clone()];
        for ((row, head), beside) in left.chunks_exact_mut(k).zip(heads.chunks_exact(width)).zip(beside) {
            row[..width].iter_mut().zip(head).for_each(|(x, &byte)| *x = f32::from(byte));
            row[width..].copy_from_slice(beside);
        }
        let (left, panels) = (Left::Rows { a: left, lda: k }, Panels { numbers: panels, block: k });
        matmul::product(products, queries, (rows, k, queries), left, panels, Store::Set);
        most.fill(f32::NEG_INFINITY);
        for row in products.chunks_exact(queries).take(rows) {
            most.iter_mut().zip(row).for_each(|(most, &x)| *most = if x > *most { x } else { *most });
        }
        Ok(())
    }

    /// Offers the windows that may be among the nearest by their heads, by all of their bytes.
    fn offer(&self, asked: &Asked, allowed: impl Fn(usize) -> bool, found: &mut Candidates<'_>) -> Result<()> {
        let query = &asked.by_part[self.number];
        let rank = |squares, size: &Size, side| {
            asked.wanted.rank(|side| cosine(squares, size.error, side), side, asked.norm, size.norm)
        };
        let mut products = [0; BLOCK];
        self.heads(query, &mut products)?;
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

/// What a thread needs for products of matrices.
#[derive(Default)]
struct Scratch {
    left: Vec<f32>,
    products: Vec<f32>,
}

impl Database {
    /// The k windows nearest to `feature` (D), or farthest from it, of those that are `allowed`; fewer where fewer are.
    ///
    /// # Errors
    /// An index whose files were cut while it was in use.
    ///
    /// # Panics
    /// When the feature has another length.
    pub fn nearest(
        &self,
        feature: &[f32],
        wanted: SearchOptions,
        allowed: &(dyn Fn(usize) -> bool + Sync),
    ) -> Result<Found> {
        Ok(self.nearest_to_each(&[feature], wanted, &|_, window| allowed(window))?.remove(0))
    }

    /// The same for each of some features, at once.
    ///
    /// # Errors
    /// As [`Database::nearest`].
    ///
    /// # Panics
    /// As [`Database::nearest`].
    pub fn nearest_to_each(
        &self,
        features: &[&[f32]],
        wanted: SearchOptions,
        allowed: Allowed<'_>,
    ) -> Result<Vec<Found>> {
        let near = self.scan(features, wanted, allowed)?;
        let found = features
            .par_iter()
            .zip(&near)
            .map(|(feature, near)| Ok(Found { hits: self.measure(feature, near, wanted)?, measured: near.len() }));
        found.collect()
    }

    /// The windows that may be among the k nearest to each of some features by the bounds of their bytes, in order.
    pub(super) fn scan(
        &self,
        features: &[&[f32]],
        wanted: SearchOptions,
        allowed: Allowed<'_>,
    ) -> Result<Vec<Vec<usize>>> {
        let ask = |feature: &&[f32]| {
            assert_eq!(feature.len(), self.numbers(), "a feature of another length");
            let norm = Size::of(feature).norm;
            let by_part = self.parts().iter().map(|part| part.scales.query(feature, norm)).collect();
            Asked { by_part, norm, wanted }
        };
        let asked: Vec<Asked> = features.par_iter().map(ask).collect();
        let parts = self.parts().iter().zip(self.firsts()).enumerate();
        let blocks = parts.flat_map(|(number, (part, &first))| {
            let all = part.sizes.len();
            part.extents.iter().zip((0..).step_by(BLOCK)).map(move |(extent, begin)| {
                let rows = begin..(begin + BLOCK).min(all);
                Block { part, number, first, rows, extent }
            })
        });
        let blocks: Vec<Block> = blocks.collect();
        let most = self.promised(&blocks, &asked, wanted)?;
        let one = |(query, asked): (usize, &Asked)| {
            let allowed = |window| allowed(query, window);
            self.among(&blocks, asked, &|block| most[block * features.len() + query], &allowed)
        };
        asked.par_iter().enumerate().map(one).collect()
    }

    /// (blocks, Q) the greatest rank that a window of each block may have for each query, rounded up.
    fn promised(&self, blocks: &[Block], asked: &[Asked], wanted: SearchOptions) -> Result<Vec<f32>> {
        let queries = asked.len();
        let mut most = vec![0.0; blocks.len() * queries];
        if queries == 0 {
            return Ok(most);
        }
        let panels: Vec<Vec<f32>> = match queries {
            1 => vec![],
            _ => self.parts().iter().enumerate().map(|(part, _)| panels(asked, part, wanted.farthest)).collect(),
        };
        let rows = most.par_chunks_mut(queries).zip(blocks);
        rows.try_for_each_init(Scratch::default, |scratch, (most, block)| {
            match asked {
                [one] => most[0] = block.promise(&one.by_part[block.number], wanted.farthest)?,
                _ => block.promises(&panels[block.number], most, scratch)?,
            }
            for (most, asked) in most.iter_mut().zip(asked) {
                // up, so that no window is dropped by rounding
                *most = (asked.by_part[block.number].most(*most, block.extent, wanted) as f32).next_up();
            }
            Ok::<_, Error>(())
        })?;
        Ok(most)
    }

    /// The windows that may be among the k nearest to one feature, by the `most` that each block promises.
    fn among(
        &self,
        blocks: &[Block],
        asked: &Asked,
        most: &(dyn Fn(usize) -> f32 + Sync),
        allowed: &(dyn Fn(usize) -> bool + Sync),
    ) -> Result<Vec<usize>> {
        let mut order: Vec<usize> = (0..blocks.len()).collect();
        let by_most = |&a: &usize, &b: &usize| most(b).total_cmp(&most(a)).then(a.cmp(&b));
        let promising = (order.len() / SHARE).clamp(1, PROMISING);
        if order.len() > promising {
            order.select_nth_unstable_by(promising, by_most);
            order.truncate(promising);
        }
        // in the order of the windows, as those of a clip are to follow each other
        order.sort_unstable();
        let mut first = Candidates::new(self, asked.wanted);
        order.iter().try_for_each(|&block| blocks[block].offer(asked, allowed, &mut first))?;
        let mark = first.mark();
        let none = || Candidates::new(self, asked.wanted).above(mark);
        let all = blocks.par_iter().enumerate().filter(|&(block, _)| f64::from(most(block)) >= mark);
        let found = all.try_fold(none, |mut found, (_, block)| {
            block.offer(asked, allowed, &mut found)?;
            Ok::<_, Error>(found)
        });
        Ok(found.try_reduce(none, |a, b| Ok(a.merge(b)))?.finish())
    }

    /// The k nearest of some windows, by their features.
    fn measure(&self, feature: &[f32], windows: &[usize], wanted: SearchOptions) -> Result<Vec<Hit>> {
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

/// The promising vectors of all queries for a part, as the right factor of a product.
fn panels(asked: &[Asked], part: usize, farthest: bool) -> Vec<f32> {
    let columns: Vec<f32> = asked.iter().flat_map(|asked| asked.by_part[part].promising(farthest)).collect();
    let k = columns.len() / asked.len();
    let mut panels = vec![0.0; matmul::panels_len(k, asked.len())];
    matmul::pack_transposed(&mut panels, &columns, k, k, asked.len());
    panels
}
