//! Reading token after token takes no memory: no allocation.
#![allow(unsafe_code)]

use kinelm_engine::bins::Bins;
use kinelm_engine::decode::{
    Before, BlockParts, Decoder, DecoderWeights, FrameDecoder, FrameParts, FrameSizes, FrameWeights, KvKind, Logits,
    Parts, Positions, Previous, Relative, Rope, Sizes, Stack, WeightKind,
};
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

const SIZES: Sizes = Sizes { layers: 2, heads: 4, width: 256, vocabulary: 300, context: 200 };

const PLACES: [Bins; 3] = [
    Bins { first: 6, count: 294, circular: true },
    Bins { first: 6, count: 294, circular: false },
    Bins { first: 6, count: 90, circular: true },
];

/// Some numbers, as many as the largest table has.
fn numbers() -> Vec<f32> {
    let Sizes { width, vocabulary, .. } = SIZES;
    (0..4 * width * width.max(vocabulary)).map(|i| ((i * 7919) % 1000) as f32 / 5000.0 - 0.1).collect()
}

fn block(numbers: &[f32], width: usize) -> BlockParts<'_> {
    let of = |n: usize| &numbers[..n];
    let linear = |k: usize, n: usize| (of(k * n), of(n));
    BlockParts {
        norm1: (of(width), of(width)),
        qkv: linear(width, 3 * width),
        out: linear(width, width),
        norm2: (of(width), of(width)),
        up: linear(width, 4 * width),
        down: linear(4 * width, width),
    }
}

fn decoder(streams: usize, weights: WeightKind, kv: KvKind, looks: bool) -> Decoder {
    let Sizes { width, vocabulary, context, .. } = SIZES;
    let numbers = numbers();
    let of = |n: usize| &numbers[..n];
    let parts = Parts {
        sizes: SIZES,
        token: of(vocabulary * width),
        positions: Positions::Places(of(context * width)),
        blocks: vec![block(&numbers, width); SIZES.layers],
        norm: (of(width), of(width)),
        head: of(vocabulary * width),
        rope: looks.then_some(Rope { front: 1, word: Some(4) }),
        before: looks.then_some(Before {
            front: 1,
            places: &PLACES,
            previous: Some(Previous { character: of(vocabulary * width), missing: 0, step: of(295 * width) }),
            relative: Some(Relative { circular: of(294 * width), clamped: of(587 * width) }),
        }),
    };
    Decoder::new(Arc::new(DecoderWeights::new(&parts, weights)), streams, kv)
}

fn frame_decoder(streams: usize, weights: WeightKind, kv: KvKind) -> FrameDecoder {
    let Sizes { width, vocabulary, .. } = SIZES;
    let (d, e, bins, frames) = (96, 8, 294, 50);
    let steps = bins + 2 * bins - 1;
    let numbers = numbers();
    let of = |n: usize| &numbers[..n];
    let linear = |k: usize, n: usize| (of(k * n), of(n));
    let stack = |width: usize| Stack { layers: 2, heads: 4, width };
    let parts = FrameParts {
        sizes: FrameSizes { trunk: stack(width), speller: stack(d), character: e, vocabulary, frames, front: 2 },
        places: &PLACES,
        bins: of(3 * (bins + 1) * e),
        frames: linear(6 * e, width),
        positions: of(frames * width),
        labels: [of(vocabulary * width), of(vocabulary * d)],
        trunk: vec![block(&numbers, width); 2],
        trunk_norm: (of(width), of(width)),
        join: linear(width, d),
        last: of((steps + 1 + bins) * d),
        place: of(4 * d),
        back: of((bins + 1) * d),
        step: of((steps + 1) * d),
        speller: vec![block(&numbers, d); 2],
        norm: (of(d), of(d)),
        head: of(vocabulary * d),
        relative: Relative { circular: of(bins * d), clamped: of((2 * bins - 1) * d) },
        conditioning: None,
    };
    FrameDecoder::new(Arc::new(FrameWeights::new(&parts, weights)), streams, kv)
}

/// Holds 140 steps behind the first 60, in which the threads' queues grow, to no allocation.
fn allocates_nothing(step: &mut dyn FnMut(u32) -> f32, what: &str) {
    (0..60).for_each(|i| assert!(step(i).is_finite()));
    let before = TAKEN.load(Ordering::Relaxed);
    (60..200).for_each(|i| assert!(step(i).is_finite()));
    let taken = TAKEN.load(Ordering::Relaxed) - before;
    assert_eq!(taken, 0, "{what}: allocations in 140 tokens");
}

#[test]
fn a_token_allocates_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    pool.install(|| {
        let kinds = [(WeightKind::F32, KvKind::F32), (WeightKind::Int8, KvKind::F16)];
        for ((weights, kv), looks) in kinds.into_iter().flat_map(|kinds| [(kinds, false), (kinds, true)]) {
            let mut decoder = decoder(3, weights, kv, looks);
            let mut step = |i: u32| {
                // bins of every place
                let tokens = [6 + i % 90, 6 + (i + 7) % 90, 6 + (i + 9) % 90];
                decoder.read(&[&tokens[..1], &tokens[1..2], &tokens[2..]], Logits::Last)[6]
            };
            allocates_nothing(&mut step, &format!("{weights:?} {kv:?}, looking back {looks}"));
        }
        for (weights, kv) in kinds {
            let mut decoder = frame_decoder(3, weights, kv);
            let mut step = |i: u32| {
                // back into the frame before now and then
                if i % 50 == 49 {
                    decoder.truncate(1, i as usize - 6);
                    decoder.read(&[&[], &[7, 8, 9, 7, 8, 9], &[]], Logits::All);
                }
                let tokens = [6 + i % 90, 6 + (i + 7) % 90, 6 + (i + 9) % 90];
                decoder.read(&[&tokens[..1], &tokens[1..2], &tokens[2..]], Logits::Last)[6]
            };
            allocates_nothing(&mut step, &format!("{weights:?} {kv:?}, frames"));
        }
    });
}
