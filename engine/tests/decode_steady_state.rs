//! Reading token after token takes no memory: no allocation.

use kinelm_engine::decode::{BlockParts, Decoder, DecoderWeights, KvKind, Logits, Parts, Positions, Shape, WeightKind};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
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

const SHAPE: Shape = Shape { layers: 2, heads: 4, width: 256, vocabulary: 300, context: 200 };

fn decoder(streams: usize, weights: WeightKind, kv: KvKind) -> Decoder {
    let Shape { width, vocabulary, context, .. } = SHAPE;
    let numbers: Vec<f32> = (0..4 * width * width).map(|i| ((i * 7919) % 1000) as f32 / 5000.0 - 0.1).collect();
    let of = |n: usize| &numbers[..n];
    let linear = |k: usize, n: usize| (of(k * n), of(n));
    let block = BlockParts {
        norm1: (of(width), of(width)),
        qkv: linear(width, 3 * width),
        out: linear(width, width),
        norm2: (of(width), of(width)),
        up: linear(width, 4 * width),
        down: linear(4 * width, width),
    };
    let parts = Parts {
        shape: SHAPE,
        token: of(vocabulary * width),
        positions: Positions::Places(of(context * width)),
        blocks: vec![block; SHAPE.layers],
        norm: (of(width), of(width)),
        head: of(vocabulary * width),
    };
    Decoder::new(Arc::new(DecoderWeights::new(&parts, weights)), streams, kv)
}

#[test]
fn a_token_allocates_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    pool.install(|| {
        for (weights, kv) in [(WeightKind::F32, KvKind::F32), (WeightKind::Int8, KvKind::F16)] {
            let mut decoder = decoder(3, weights, kv);
            let mut step = |i: u32| {
                let tokens = [i % 300, (i + 7) % 300, (i + 9) % 300];
                decoder.read(&[&tokens[..1], &tokens[1..2], &tokens[2..]], Logits::Last)[0]
            };
            // the threads' queues grow in the first ones
            (0..60).for_each(|i| assert!(step(i).is_finite()));
            let before = TAKEN.load(Ordering::Relaxed);
            (60..200).for_each(|i| assert!(step(i).is_finite()));
            let taken = TAKEN.load(Ordering::Relaxed) - before;
            assert_eq!(taken, 0, "{weights:?} {kv:?}: allocations in 140 tokens");
        }
    });
}
