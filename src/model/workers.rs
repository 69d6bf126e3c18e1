//! Independent pieces of work side by side.
//!
//! A batch falls into pieces by its size alone; every piece is computed on its own and the results come back in order,
//! so neither values nor sums depend on the number of threads. Pieces side by side also serve the cores better than
//! threads inside one product, most of all in small models.

use crate::{Error, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Threads, split into groups of like size.
pub struct Workers {
    pools: Vec<ThreadPool>,
}

impl Workers {
    /// `threads` (all cores if `None`) for work that falls into `pieces` at a time.
    ///
    /// # Errors
    /// No thread to be had.
    pub fn new(threads: Option<usize>, pieces: usize) -> Result<Workers> {
        let cores = || std::thread::available_parallelism().map_or(1, |n| n.get());
        let threads = threads.unwrap_or_else(cores).max(1);
        let groups = threads.min(pieces.max(1));
        let pool = |g| {
            let size = threads / groups + usize::from(g < threads % groups);
            let built = ThreadPoolBuilder::new().num_threads(size).build();
            built.map_err(|e| Error::Call(format!("no {size} threads to be had: {e}")))
        };
        Ok(Workers { pools: (0..groups).map(pool).collect::<Result<_>>()? })
    }

    /// Hands `take` the result of `work` on every piece, in order; no more results wait than there are groups.
    ///
    /// # Errors
    /// The first that `work` or `take` returns.
    pub fn each<T: Send>(
        &self,
        pieces: usize,
        work: &(dyn Fn(usize) -> Result<T> + Sync),
        take: &mut dyn FnMut(usize, T) -> Result<()>,
    ) -> Result<()> {
        for first in (0..pieces).step_by(self.pools.len()) {
            let round: Vec<Result<T>> = std::thread::scope(|scope| {
                let mut running = Vec::with_capacity(self.pools.len());
                for (pool, piece) in self.pools.iter().zip(first..pieces) {
                    running.push(scope.spawn(move || pool.install(|| work(piece))));
                }
                let joined = running.into_iter().map(|r| r.join());
                joined.map(|r| r.unwrap_or_else(|p| std::panic::resume_unwind(p))).collect()
            });
            for (i, result) in round.into_iter().enumerate() {
                take(first + i, result?)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_order_and_errors_come_through() {
        for threads in [1, 2, 5] {
            let workers = Workers::new(Some(threads), 3).unwrap();
            let mut seen = Vec::new();
            workers
                .each(7, &|i| Ok(i * i), &mut |i, x| {
                    seen.push((i, x));
                    Ok(())
                })
                .unwrap();
            assert_eq!(seen, (0..7).map(|i| (i, i * i)).collect::<Vec<_>>());
            let fails = |i| if i == 4 { Err(Error::Call("four".into())) } else { Ok(i) };
            let error = workers.each(7, &fails, &mut |_, _| Ok(())).unwrap_err();
            assert_eq!(error.to_string(), "four");
        }
    }
}
