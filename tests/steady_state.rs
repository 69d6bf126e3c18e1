//! After the first steps of a shape, training takes no memory from the system: no allocation, no page.
#![allow(unsafe_code)]

use kinelm::model::config::SlotRun;
use kinelm::model::fast::Fast;
use kinelm::model::{Gpt, ModelConfig, Positions, TokenLayout};
use kinelm::train::TrainConfig;
use kinelm::train::batches::Batch;
use kinelm::train::config::Loss;
use kinelm::train::fast::FastLearner;
use kinelm::train::learner::{Learner, clip_share};
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

/// Pages this process has asked for so far; 0 where the system doesn't tell.
fn faults() -> usize {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // behind the name in brackets, the eighth field is the minor faults
    stat.rsplit(')').next().and_then(|rest| rest.split_whitespace().nth(7)?.parse().ok()).unwrap_or(0)
}

const TOKENS: TokenLayout =
    TokenLayout { vocabulary: 90, word: 10, varying: false, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new() };

/// Ids from `first` on.
fn batch(first: u32, windows: usize, length: usize) -> Batch {
    let id = |i: usize| first + (i * i * 7 % 84) as u32;
    let n = windows * length;
    let (inputs, targets) = ((0..n).map(id).collect(), (1..=n).map(id).collect());
    Batch { inputs, targets, history: Vec::new(), clips: vec!["clip".into(); windows], conditioning: None }
}

#[test]
fn a_step_allocates_nothing_and_faults_no_page() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let model = ModelConfig { layers: 2, heads: 4, width: 64, context: 150, dropout: 0.1, ..Default::default() };
    let rope = ModelConfig { positions: Positions::Rope, ..model.clone() };
    let varying = TokenLayout { varying: true, ..TOKENS };
    let kind = |circular| SlotIds { first: 6, count: 84, circular };
    let places = [(6, true), (3, false)].map(|(number, circular)| SlotRun { number, kind: kind(circular) });
    let placed = TokenLayout { places: places.to_vec(), ..TOKENS };
    pool.install(|| {
        steps(&model, &TOKENS);
        steps(&model, &varying);
        steps(&rope, &varying);
        // told of the frame before, over steps
        steps(&model, &placed);
        steps(&rope, &placed);
    });
}

/// Steps of a model.
fn steps(model: &ModelConfig, tokens: &TokenLayout) {
    let gpt = Gpt::new(model, tokens, 1).unwrap();
    let train = TrainConfig { loss: Loss::Ordinal, ..Default::default() };
    let mut learner = FastLearner::new(Fast::of(&gpt).unwrap(), &train);
    let batch = batch(if tokens.places.is_empty() { 5 } else { 6 }, 3, 150);
    let mut step = |i| {
        let found = learner.gradients(&batch, i).unwrap();
        learner.update(clip_share(found.norm, 1.0), 1e-3).unwrap();
        found.loss
    };
    let first = step(0);
    for i in 1..30 {
        step(i);
    }
    let mut last = first;
    // a busy system moves pages about, which faults by the second and not by the step: the calmest stretch counts
    let mut calmest = (usize::MAX, usize::MAX);
    for stretch in 0..5 {
        let before = (TAKEN.load(Ordering::Relaxed), faults());
        for i in 0..20 {
            last = step(30 + 20 * stretch + i);
        }
        let after = (TAKEN.load(Ordering::Relaxed), faults());
        calmest = (calmest.0.min(after.0 - before.0), calmest.1.min(after.1 - before.1));
    }
    assert!(last < first - 0.5, "the loss falls: {first} to {last}");
    // reading /proc allocates: the text, and what it is read into
    let reading = 10;
    assert!(calmest.0 <= reading, "{} allocations in 20 steps", calmest.0);
    assert!(calmest.1 <= reading, "{} page faults in 20 steps", calmest.1);
}
