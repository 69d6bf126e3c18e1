//! Windows that may be among the k nearest, by bounds.

use super::database::Database;
use super::distance::SearchOptions;

/// The least number of windows from which on those that can't be among the k nearest are dropped.
const MANY: usize = 512;

/// Windows that may be among the k nearest of all that were offered, in their order.
///
/// Which windows are left in the end depends on all that were offered, not on how they were shared among threads: a
/// window is dropped only where k others are surely nearer.
pub struct Candidates<'a> {
    database: &'a Database,
    wanted: SearchOptions,
    /// Windows, each with the least and greatest that its rank may be.
    kept: Vec<(usize, [f64; 2])>,
    /// The k-th greatest of the least ranks: who can't reach it is not among the k nearest.
    least: f64,
    /// The number of windows at which some are dropped next.
    room: usize,
}

impl<'a> Candidates<'a> {
    /// None so far.
    pub fn new(database: &'a Database, wanted: SearchOptions) -> Candidates<'a> {
        let least = if wanted.k == 0 { f64::INFINITY } else { f64::NEG_INFINITY };
        Candidates { database, wanted, kept: Vec::new(), least, room: room(wanted.k) }
    }

    /// The same, of windows that can't be among the nearest unless they reach this rank.
    pub fn above(self, least: f64) -> Candidates<'a> {
        Candidates { least: self.least.max(least), ..self }
    }

    /// Whether a window of at most this rank may still be among the nearest.
    #[inline]
    pub fn may(&self, greatest: f64) -> bool {
        greatest >= self.least
    }

    /// Offers the next window, by the least and greatest that its rank may be.
    pub fn offer(&mut self, window: usize, limits: [f64; 2]) {
        if self.may(limits[1]) {
            self.kept.push((window, limits));
            if self.kept.len() >= self.room {
                self.prune();
                // twice what is left, so that pruning costs a constant per window even where nothing can be dropped
                self.room = room(self.wanted.k).max(2 * self.kept.len());
            }
        }
    }

    /// These, and those of later windows.
    pub fn merge(mut self, later: Candidates<'a>) -> Candidates<'a> {
        // both bounds are proven: k windows are surely that near, whichever half has them
        self.least = self.least.max(later.least);
        self.kept.extend(later.kept);
        self.room = self.room.max(later.room);
        self
    }

    /// The rank that k of them surely reach.
    pub fn mark(mut self) -> f64 {
        self.prune();
        self.least
    }

    /// The windows that are left.
    pub fn finish(mut self) -> Vec<usize> {
        self.prune();
        self.kept.into_iter().map(|(window, _)| window).collect()
    }

    fn prune(&mut self) {
        let mut lows: Vec<f64> = match self.wanted.one_per_clip {
            false => self.kept.iter().map(|(_, [low, _])| *low).collect(),
            // the best of each clip, whose windows follow each other
            true => {
                let clip = |window: usize| self.database.window(window).clip;
                let best =
                    |clip: &[(usize, [f64; 2])]| clip.iter().fold(f64::NEG_INFINITY, |m, (_, [low, _])| m.max(*low));
                self.kept.chunk_by(|a, b| clip(a.0) == clip(b.0)).map(best).collect()
            }
        };
        if let Some(last) = self.wanted.k.checked_sub(1).filter(|&last| last < lows.len()) {
            self.least = self.least.max(*lows.select_nth_unstable_by(last, |a, b| b.total_cmp(a)).1);
        }
        let least = self.least;
        // `>=`: a tie may win by its place in the database
        self.kept.retain(|(_, [_, high])| *high >= least);
    }
}

fn room(k: usize) -> usize {
    k.saturating_mul(4).max(MANY)
}
