//! The scratch memory that a thread has for a piece of work.

use std::sync::{Mutex, PoisonError};

/// Scratch memory for each thread of the pool, allocated once.
pub struct PerThread<T>(Vec<Mutex<T>>);

impl<T> PerThread<T> {
    /// A value of `make` for each thread of the pool that this is called in.
    pub fn new(make: impl Fn() -> T) -> PerThread<T> {
        PerThread((0..rayon::current_num_threads()).map(|_| Mutex::new(make())).collect())
    }

    /// Calls `work` with this thread's memory, whose contents are arbitrary. `work` must not wait for other pieces.
    pub fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        // a pool with more threads than the one it was made in shares entries, and waits at the lock
        let thread = rayon::current_thread_index().unwrap_or(0) % self.0.len();
        // scratch has no invariant that a panic could break
        work(&mut self.0[thread].lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_finds_its_own_numbers() {
        let scratch = PerThread::new(|| [0.0; 3]);
        scratch.with(|x| x.fill(2.0));
        scratch.with(|x| assert_eq!(*x, [2.0; 3]));
    }
}
