//! Passes over a sequence take no memory after the first: no allocation.
#![allow(unsafe_code)]

use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::{Lstm, Shape, Wiring};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

static TAKEN: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator, unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        TAKEN.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_sequence_there_and_back_takes_no_memory() {
    let shape = Shape { channels: 30, width: 100, layers: 3, wiring: Wiring::Fixed };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let like = || shape.tensors().iter().map(|[r, c]| Floats::new(r * c)).collect::<Vec<_>>();
        let (weights, mut gradients) = (like(), like());
        let given: Vec<bool> = (0..20).map(|t| t % 7 < 3).collect();
        let inputs = vec![0.1; given.len() * 5 * shape.channels];
        let mut lstm = Lstm::new(shape, 5, given.len(), true);
        let mut pass = || {
            let before = TAKEN.load(Ordering::Relaxed);
            lstm.pack(&weights);
            lstm.rest();
            lstm.forward(&inputs, &given);
            lstm.backward(&inputs, &mut gradients);
            TAKEN.load(Ordering::Relaxed) - before
        };
        pass();
        assert_eq!(pass(), 0, "allocations");
    });
}
