//! The nearest windows to each of some features, or the farthest, exactly.
//!
//! First every block of windows promises, by heads and what is beside them, how near one of its windows may be: to one query
//! by products with signed bytes, where reading memory is all it waits for, to many by one product of matrices. The blocks
//! that promise most give a mark that k windows surely reach, after which few blocks are read by window, and of few windows
//! the rests. Whatever may then be among the k nearest is measured again from the features themselves, in f64. The answer is
//! that of measuring everything, whatever the number of threads and whatever is searched beside it.

use super::block::{Block, Scratch};
use super::candidates::Candidates;
use super::database::Database;
use super::distance::SearchOptions;
use super::quantize::{Query, Size};
use crate::{Error, Result};
use kinelm_engine::op::matmul;
use rayon::prelude::*;

/// A mark is found in the blocks that promise most: a share of all, at most so many.
const SHARE: usize = 8;
const PROMISING: usize = 32;
/// So many times as many are read where those give none, as too few of their windows are allowed.
const MORE: usize = 4;

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

/// A search for the windows nearest to each of Q features, before it is known which are allowed.
pub struct Search<'a> {
    database: &'a Database,
    wanted: SearchOptions,
    features: &'a [&'a [f32]],
    /// (Q, parts) to be compared with the bytes of each part.
    queries: Vec<Vec<Query>>,
    blocks: Vec<Block<'a>>,
    /// (blocks, Q) the greatest rank that a window of each block may have.
    most: Vec<f64>,
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
        let found = Search::new(self, &[feature], wanted)?.nearest(&|_, window| allowed(window));
        found.map(|mut found| found.remove(0))
    }
}

impl<'a> Search<'a> {
    /// A search for each of some features (D), at once.
    ///
    /// # Errors
    /// As [`Database::nearest`].
    ///
    /// # Panics
    /// As [`Database::nearest`].
    pub fn new(database: &'a Database, features: &'a [&'a [f32]], wanted: SearchOptions) -> Result<Search<'a>> {
        let query = |feature: &&[f32]| {
            assert_eq!(feature.len(), database.numbers(), "a feature of another length");
            let norm = Size::of(feature).norm;
            database.parts().iter().map(|part| part.scales.query(feature, norm)).collect()
        };
        let queries = features.par_iter().map(query).collect();
        let parts = database.parts().iter().zip(database.firsts()).enumerate();
        let blocks = parts.flat_map(|(number, (part, &first))| Block::of(part, number, first)).collect();
        let mut search = Search { database, wanted, features, queries, blocks, most: Vec::new() };
        search.most = search.promises()?;
        Ok(search)
    }

    fn promises(&self) -> Result<Vec<f64>> {
        let (queries, farthest) = (self.queries.len(), self.wanted.farthest);
        let mut most = vec![0.0; self.blocks.len() * queries];
        // one query has no use for a matrix
        let panels = |part| if queries > 1 { panels(&self.queries, part, farthest) } else { Vec::new() };
        let panels: Vec<Vec<f32>> = (0..self.database.parts().len()).map(panels).collect();
        let rows = most.par_chunks_mut(queries.max(1)).zip(&self.blocks);
        rows.try_for_each_init(Scratch::default, |scratch, (most, block)| {
            let of_part = self.queries.iter().map(|query| &query[block.number]);
            let one;
            let promises = match &self.queries[..] {
                [query] => {
                    one = [block.promise(&query[block.number], farthest)?];
                    &one[..]
                }
                _ => block.promises(&panels[block.number], queries, scratch)?,
            };
            for ((most, query), &promise) in most.iter_mut().zip(of_part).zip(promises) {
                *most = query.most(promise, block.extent, self.wanted);
            }
            Ok::<_, Error>(())
        })?;
        Ok(most)
    }

    /// What is found for each of the features among the windows that are allowed.
    ///
    /// # Errors
    /// As [`Database::nearest`].
    pub fn nearest(&self, allowed: Allowed<'_>) -> Result<Vec<Found>> {
        let found = |query: usize| {
            let candidates = self.candidates(query, allowed)?;
            Ok(Found { hits: self.measure(query, &candidates)?, measured: candidates.len() })
        };
        (0..self.features.len()).into_par_iter().map(found).collect()
    }

    /// The windows that may be among the k nearest by the bounds of their bytes, in order.
    pub(super) fn candidates(&self, query: usize, allowed: Allowed<'_>) -> Result<Vec<usize>> {
        let allowed = |window| allowed(query, window);
        let most = |block: usize| self.most[block * self.queries.len() + query];
        let offer = |block: usize, found: &mut Candidates<'_>| {
            let block = &self.blocks[block];
            block.offer(&self.queries[query][block.number], self.wanted, &allowed, found)
        };
        let none = || Candidates::new(self.database, self.wanted);
        let mark = self.mark(&most, &offer)?;
        let all = (0..self.blocks.len()).into_par_iter().filter(|&block| most(block) >= mark);
        let found = all.try_fold(
            || none().above(mark),
            |mut found, block| {
                offer(block, &mut found)?;
                Ok::<_, Error>(found)
            },
        );
        Ok(found.try_reduce(|| none().above(mark), |a, b| Ok(a.merge(b)))?.finish())
    }

    /// A rank that k allowed windows surely reach, by those of the blocks that promise most.
    fn mark(
        &self,
        most: &dyn Fn(usize) -> f64,
        offer: &dyn Fn(usize, &mut Candidates<'_>) -> Result<()>,
    ) -> Result<f64> {
        let all = self.blocks.len();
        let by_most = |&a: &usize, &b: &usize| most(b).total_cmp(&most(a)).then(a.cmp(&b));
        let mut promising = (all / SHARE).clamp(1, PROMISING).min(all);
        loop {
            let mut order: Vec<usize> = (0..all).collect();
            if promising < all {
                order.select_nth_unstable_by(promising, by_most);
                order.truncate(promising);
            }
            // in the order of the windows, as those of a clip are to follow each other
            order.sort_unstable();
            let mut found = Candidates::new(self.database, self.wanted);
            order.iter().try_for_each(|&block| offer(block, &mut found))?;
            let mark = found.mark();
            if mark > f64::NEG_INFINITY || promising == all {
                return Ok(mark);
            }
            promising = (MORE * promising).min(all);
        }
    }

    /// The k nearest of some windows, by their features.
    fn measure(&self, query: usize, windows: &[usize]) -> Result<Vec<Hit>> {
        let SearchOptions { k, distance, one_per_clip, farthest } = self.wanted;
        let (database, feature) = (self.database, self.features[query]);
        let exact = |&window: &usize| Ok(Hit { window, score: distance.score(feature, &database.feature(window)?) });
        let mut hits: Vec<Hit> = windows.par_iter().with_min_len(32).map(exact).collect::<Result<_>>()?;
        // ties by place, whatever thread measured first
        hits.sort_by(|a, b| {
            let (first, second) = if farthest { (a, b) } else { (b, a) };
            first.score.total_cmp(&second.score).then(a.window.cmp(&b.window))
        });
        if one_per_clip {
            let mut seen = vec![false; database.clips().len()];
            hits.retain(|h| !std::mem::replace(&mut seen[database.window(h.window).clip], true));
        }
        hits.truncate(k);
        Ok(hits)
    }
}

/// The promising vectors of all queries for a part, as the right factor of a product.
fn panels(queries: &[Vec<Query>], part: usize, farthest: bool) -> Vec<f32> {
    let columns: Vec<f32> = queries.iter().flat_map(|query| query[part].promising(farthest)).collect();
    let k = columns.len() / queries.len();
    let mut panels = vec![0.0; matmul::panels_len(k, queries.len())];
    matmul::pack_transposed(&mut panels, &columns, k, k, queries.len());
    panels
}
