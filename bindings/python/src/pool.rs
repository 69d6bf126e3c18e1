//! Work on the pool of threads, which a forked process doesn't have.

use crate::error::wrong;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// The process that first used the pool; 0 before.
static OWNER: AtomicU32 = AtomicU32::new(0);

/// Runs work that may use the pool, without the interpreter's lock.
///
/// # Errors
/// The call is in a process that was forked from one that has used the pool: the pool's threads are not in it, so its work
/// would wait for ever.
pub fn detach<T: Send>(py: Python<'_>, work: impl FnOnce() -> PyResult<T> + Send) -> PyResult<T> {
    let own = std::process::id();
    match OWNER.compare_exchange(0, own, Ordering::SeqCst, Ordering::SeqCst) {
        Err(owner) if owner != own => Err(wrong(format!(
            "this process ({own}) was forked from one that has used kinelm's threads ({owner}), which a fork leaves \
             behind; expected a process of its own: start it by spawn, as multiprocessing.get_context(\"spawn\") and \
             torch's DataLoader(.., multiprocessing_context=\"spawn\") do"
        ))),
        _ => py.detach(work),
    }
}
