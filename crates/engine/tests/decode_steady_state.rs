//! Decoding row after row allocates nothing.
#![allow(unsafe_code)]

use kinelm_engine::decode::{BlockParts, KvKind, Matrix, Norm, Run, Stack, StackDecoder, StackWeights, WeightKind};
use kinelm_engine::op::rope::Angles;
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

const STACK: Stack = Stack { layers: 2, heads: 4, width: 256 };
const STREAMS: usize = 3;
const PLACES: usize = 200;
const VOCABULARY: usize = 300;

#[test]
fn a_row_allocates_nothing() {
    let width = STACK.width;
    let numbers: Vec<f32> = (0..4 * width * VOCABULARY).map(|i| ((i * 7919) % 1000) as f32 / 5000.0 - 0.1).collect();
    let linear = |k: usize, n: usize| (&numbers[..k * n], &numbers[..n]);
    let norm = (&numbers[..width], &numbers[..width]);
    let block = BlockParts {
        norm1: norm,
        qkv: linear(width, 3 * width),
        out: linear(width, width),
        norm2: norm,
        up: linear(width, 4 * width),
        down: linear(4 * width, width),
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    for (kind, kv) in
        [(WeightKind::F32, KvKind::F32), (WeightKind::Int8, KvKind::F16), (WeightKind::Int8, KvKind::Int8)]
    {
        let angles = Angles::new(PLACES, width / STACK.heads);
        let weights = StackWeights::new(&[block, block], STACK, kind, Some(angles));
        let head = Matrix::transposed(&numbers[..VOCABULARY * width], VOCABULARY, width, kind);
        let norm = Norm::new(norm, width);
        let mut decoder = StackDecoder::new(&weights, kv, STREAMS, PLACES, 8, head.columns());
        let mut logits = [0.0; VOCABULARY];
        let mut step = |place: usize| {
            for stream in 0..STREAMS {
                let first = decoder.push(Run { stream, place, rows: 1 });
                decoder.rows_mut(first).copy_from_slice(&numbers[(place + 7 * stream) * width..][..width]);
                decoder.positions_mut(first).fill(place as u32);
            }
            decoder.forward(&weights);
            decoder.norm(&norm, 0..STREAMS);
            decoder.product(&head, 0..STREAMS, 0..VOCABULARY).copy(1, 0, &mut logits);
            decoder.clear();
            assert!(logits[6].is_finite());
        };
        pool.install(|| {
            // the threads' queues grow in the first steps
            (0..60).for_each(&mut step);
            let before = TAKEN.load(Ordering::Relaxed);
            (60..PLACES).for_each(&mut step);
            let taken = TAKEN.load(Ordering::Relaxed) - before;
            assert_eq!(taken, 0, "{kind:?} {kv:?}: allocations in 140 rows");
        });
    }
}
