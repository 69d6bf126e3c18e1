//! How work falls into pieces that threads share, and the scratch memory that a thread has for one.

use crate::op::matmul::{ROWS, TILES};
use std::sync::{Mutex, PoisonError};

/// Rows that a piece of `rows` rows has: about 64, so that the weights are read once for so many, and an even number of
/// pieces, so that few threads end together. A function of the number of rows alone.
pub fn rows(rows: usize) -> usize {
    let pieces = match rows.div_ceil(64) {
        few @ 0..4 => few.max(1),
        many => many.next_multiple_of(4),
    };
    rows.div_ceil(pieces).max(1)
}

/// Rows of a weight's gradient that one piece computes: up to 144, whole tiles, in an even number of pieces. The more
/// rows, the less often the right factor is fetched.
pub fn gradient_rows(rows: usize) -> usize {
    let pieces = rows.div_ceil(ROWS).next_multiple_of(2);
    rows.div_ceil(pieces).next_multiple_of(TILES)
}

/// Scratch memory for each thread of the pool, allocated once.
pub struct PerThread<T>(Vec<Mutex<T>>);

impl<T> PerThread<T> {
    /// What `make` gives, for each thread of the pool this is called in.
    pub fn new(make: impl Fn() -> T) -> PerThread<T> {
        PerThread((0..rayon::current_num_threads()).map(|_| Mutex::new(make())).collect())
    }

    /// Hands `work` this thread's memory, whatever it holds. `work` must not wait for other pieces.
    pub fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        let thread = rayon::current_thread_index().unwrap_or(0) % self.0.len();
        work(&mut self.0[thread].lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_many_alike_and_cover_all_rows() {
        for n in 1..5000 {
            let (r, g) = (rows(n), gradient_rows(n));
            assert!(r <= 64 && r * n.div_ceil(r) >= n, "{n}: {r}");
            assert!(g <= ROWS && g % TILES == 0, "{n}: {g}");
        }
        assert_eq!([rows(1), rows(64), rows(1024), rows(2048)], [1, 64, 64, 64]);
    }

    #[test]
    fn a_thread_finds_its_own_numbers() {
        let scratch = PerThread::new(|| [0.0; 3]);
        scratch.with(|x| x.fill(2.0));
        scratch.with(|x| assert_eq!(*x, [2.0; 3]));
    }
}
