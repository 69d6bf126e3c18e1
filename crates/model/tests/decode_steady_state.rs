//! Reading token after token allocates nothing.
#![allow(unsafe_code)]

use kinelm_model::config::SlotRun;
use kinelm_model::{
    Architecture, DecoderConfig, Gpt, KvKind, Logits, ModelConfig, Positions, Reader, ReaderOptions, TokenLayout,
    WeightKind,
};
use kinelm_tokenizer::SlotIds;
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

fn tokens() -> TokenLayout {
    let slot = |first, count, circular| SlotRun { number: 1, kind: SlotIds { first, count, circular } };
    TokenLayout {
        vocabulary: 300,
        word: 4,
        varying: false,
        front: 1,
        pad: 0,
        bos: 1,
        space: 5,
        places: vec![slot(6, 294, true), slot(6, 294, false), slot(6, 90, true)],
    }
}

/// Models that look back and don't, and one of two levels.
fn configs() -> [ModelConfig; 3] {
    let flat = ModelConfig { layers: 2, heads: 4, width: 256, context: 201, ..Default::default() };
    let decoder = Some(DecoderConfig { layers: 2, heads: 4, width: 96, character_width: 8 });
    let levels = ModelConfig { architecture: Architecture::TwoLevel, window: Some(51), decoder, ..flat.clone() };
    [
        ModelConfig { previous_frame: Some(false), head: Some(kinelm_model::HeadKind::Absolute), ..flat.clone() },
        ModelConfig { positions: Positions::Rope, ..flat },
        levels,
    ]
}

#[test]
fn a_token_allocates_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    for config in configs() {
        let gpt = Gpt::new(&config.resolved(&tokens()), &tokens(), 1).unwrap();
        for (weights, kv) in [(WeightKind::F32, KvKind::F32), (WeightKind::Int8, KvKind::F16)] {
            let mut reader = Reader::new(&gpt, ReaderOptions { streams: 3, weights, kv }).unwrap();
            let mut step = |i: usize| {
                // back into the frame before now and then
                if i % 50 == 49 {
                    reader.truncate(1, i - 6);
                    reader.read(&[&[], &[7, 8, 9, 7, 8, 9], &[]], Logits::All).unwrap();
                }
                // bins of every slot
                let ids = [i, i + 7, i + 9].map(|i| 6 + i as u32 % 90);
                let logits = reader.read(&[&ids[..1], &ids[1..2], &ids[2..]], Logits::Last).unwrap();
                assert!(logits.iter().any(|x| x.is_finite()));
            };
            pool.install(|| {
                // the threads' queues grow in the first steps
                (0..60).for_each(&mut step);
                let before = TAKEN.load(Ordering::Relaxed);
                (60..200).for_each(&mut step);
                let taken = TAKEN.load(Ordering::Relaxed) - before;
                assert_eq!(taken, 0, "{config:?}, {weights:?} {kv:?}: allocations in 140 tokens");
            });
        }
    }
}
