//! The nearest windows, exactly.
//!
//! Cosines with all windows come first from half floats (one query: reading memory is all it waits for) or from a product
//! of matrices (many queries), each with a bound on how far it is off. Whatever may then be among the k nearest is measured
//! again from the features themselves, in f64. The answer is that of measuring everything, whatever the number of threads.

use super::database::Database;
use super::part::{SCALE, Size, dot, squared_distance};
use crate::{Error, Result};
use kinelm_engine::op::dots::Query;
use kinelm_engine::op::matmul::{self, Left, Panels, Store};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Windows that a thread reads at a time.
const ROWS: usize = 256;

/// What f64 sums of a feature's numbers may be off, as a share: far below what their order changes.
const SLACK: f64 = 1e-11;

/// What "near" means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Distance {
    /// Greatest cosine `a.b / (|a||b|)`; 0 where either is zero.
    Cosine,
    /// Least Euclidean distance.
    Euclid,
}

impl Distance {
    /// Its name in tables and flags.
    pub fn name(self) -> &'static str {
        match self {
            Distance::Cosine => "cosine",
            Distance::Euclid => "euclid",
        }
    }

    /// How near two features are: the cosine, or minus the distance. More is nearer.
    pub fn score(self, a: &[f32], b: &[f32]) -> f64 {
        match self {
            Distance::Euclid => -squared_distance(a, b).sqrt(),
            Distance::Cosine => match (dot(a, a) * dot(b, b)).sqrt() {
                size if size > 0.0 => dot(a, b) / size,
                _ => 0.0,
            },
        }
    }

    /// Least and greatest that a rank (the cosine, or minus the squared distance) may be, of a cosine that may be off by
    /// `error`.
    fn limits(self, cosine: f64, error: f64, a: f64, b: f64) -> [f64; 2] {
        let (rank, off) = match self {
            Distance::Cosine if a * b == 0.0 => (0.0, 0.0),
            Distance::Cosine => (cosine, error + SLACK),
            Distance::Euclid => {
                let squares = a * a + b * b;
                (2.0 * a * b * cosine - squares, 2.0 * a * b * error + SLACK * squares)
            }
        };
        [rank - off, rank + off]
    }
}

/// What is looked for.
#[derive(Debug, Clone, Copy)]
pub struct SearchOptions {
    /// k.
    pub k: usize,
    /// What "near" means.
    pub distance: Distance,
    /// Of each clip only its nearest window.
    pub one_per_clip: bool,
}

/// A window that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Its number in the database.
    pub window: usize,
    /// As [`Distance::score`].
    pub score: f64,
}

/// Cosines of one query with all windows, and how far each may be off.
pub struct Cosines<'a> {
    /// (N).
    pub near: &'a [f32],
    /// By the product they come from, as a share of both lengths.
    pub error: f64,
}

impl Database {
    /// The k windows nearest to `feature` (D) of those that are `allowed`: nearest first, of equal ones the first in the
    /// database first. Fewer where there are not so many.
    ///
    /// # Errors
    /// An index whose files were cut while it was in use.
    ///
    /// # Panics
    /// When the feature has another length, or the database was made without half floats.
    pub fn nearest(
        &self,
        feature: &[f32],
        wanted: SearchOptions,
        allowed: &(dyn Fn(usize) -> bool + Sync),
    ) -> Result<Vec<Hit>> {
        assert_eq!(feature.len(), self.numbers(), "a feature of another length");
        let (near, error) = self.scan(feature)?;
        self.select(feature, Cosines { near: &near, error }, wanted, allowed)
    }

    /// Cosines from half floats.
    fn scan(&self, feature: &[f32]) -> Result<(Vec<f32>, f64)> {
        let norm = Size::of(feature).norm;
        let over = if norm > 0.0 { 1.0 / norm } else { 0.0 };
        let unit: Vec<f32> = feature.iter().map(|&x| (f64::from(x) * over) as f32).collect();
        let query = Query::new(&unit);
        let mut near = vec![0.0; self.windows()];
        let mut rest: &mut [f32] = &mut near;
        for part in self.parts() {
            let (here, behind) = rest.split_at_mut(part.sizes.len());
            rest = behind;
            let padded = query.padded();
            here.par_chunks_mut(ROWS).enumerate().try_for_each(|(block, out)| {
                let first = block * ROWS;
                query.dots(out, &part.halves(first * padded..(first + out.len()) * padded)?);
                out.iter_mut().for_each(|x| *x /= SCALE);
                Ok::<_, Error>(())
            })?;
        }
        // rounding the unit vector, and the division, which is by a power of two
        Ok((near, query.error() + 0.5f64.powi(23)))
    }

    /// Cosines (Q, N) of windows of the database with all its windows, by a product of matrices, and how far they may be
    /// off.
    ///
    /// # Errors
    /// As [`Database::nearest`].
    pub fn cosines(&self, windows: &[usize]) -> Result<(Vec<f32>, f64)> {
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
        let roundings = (k + 4) as f64 * 0.5f64.powi(24);
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
        let limits = |window: usize| {
            let size = self.size(window);
            let error = size.error + cosines.error * (1.0 + size.error);
            wanted.distance.limits(cosines.near[window].into(), error, norm, size.norm)
        };
        let all: Vec<(usize, [f64; 2])> = (0..self.windows()).filter(|&w| allowed(w)).map(|w| (w, limits(w))).collect();
        let least = self.least(&all, wanted);
        let may = |&&(_, [_, high]): &&(usize, [f64; 2])| high >= least;
        let candidates: Vec<usize> = all.iter().filter(may).map(|&(w, _)| w).collect();
        let exact = |&window: &usize| Ok(Hit { window, score: wanted.distance.score(feature, &self.feature(window)?) });
        let mut hits: Vec<Hit> = candidates.par_iter().with_min_len(32).map(exact).collect::<Result<_>>()?;
        hits.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.window.cmp(&b.window)));
        if wanted.one_per_clip {
            let mut seen = vec![false; self.clips().len()];
            hits.retain(|h| !std::mem::replace(&mut seen[self.window(h.window).clip], true));
        }
        hits.truncate(wanted.k);
        Ok(hits)
    }

    /// A lower bound of the k-th nearest's similarity; with one window per clip, of each clip's best.
    fn least(&self, all: &[(usize, [f64; 2])], wanted: SearchOptions) -> f64 {
        let mut lows: Vec<f64> = match wanted.one_per_clip {
            false => all.iter().map(|(_, [low, _])| *low).collect(),
            true => {
                let mut best = vec![f64::NEG_INFINITY; self.clips().len()];
                for (window, [low, _]) in all {
                    let best = &mut best[self.window(*window).clip];
                    *best = best.max(*low);
                }
                best
            }
        };
        match wanted.k.checked_sub(1) {
            Some(last) if last < lows.len() => *lows.select_nth_unstable_by(last, |a, b| b.total_cmp(a)).1,
            Some(_) => f64::NEG_INFINITY,
            None => f64::INFINITY,
        }
    }
}

fn over(x: f64, size: f64) -> f64 {
    if size > 0.0 { x / size } else { 0.0 }
}
