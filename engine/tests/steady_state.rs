//! After the first steps of a shape, training takes no memory from the system: no allocation, no page.

use kinelm_engine::arena::Floats;
use kinelm_engine::block::{self, Linear, Norm, Saved, Shape, Tensors};
use kinelm_engine::head;
use kinelm_engine::op::attention::Mask;
use kinelm_engine::op::matmul::Store;
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

/// Small numbers that differ.
fn floats(len: usize) -> Floats {
    let numbers: Vec<f32> = (0..len).map(|i| ((i * 7919) % 1000) as f32 / 1000.0 - 0.5).collect();
    Floats::of(&numbers)
}

const SHAPE: Shape = Shape { batch: 3, tokens: 150, width: 64, heads: 4, hidden: 256 };
const VOCABULARY: usize = 90;

fn tensors() -> Tensors<Floats> {
    let (d, m) = (SHAPE.width, SHAPE.hidden);
    let norm = || Norm { weight: floats(d), bias: floats(d) };
    let linear = |k: usize, n: usize| Linear { weight: floats(k * n), bias: floats(n) };
    Tensors {
        norm1: norm(),
        qkv: linear(d, 3 * d),
        out: linear(d, d),
        norm2: norm(),
        up: linear(d, m),
        down: linear(m, d),
    }
}

struct Training {
    weights: Tensors<Floats>,
    gradients: Tensors<Floats>,
    x: Floats,
    out: Floats,
    dx: Floats,
    head: [Floats; 2],
    norm: [Floats; 2],
    targets: Vec<u32>,
    saved: Saved,
    space: block::Workspace,
    head_space: head::Workspace,
}

impl Training {
    fn new() -> Training {
        let n = SHAPE.rows() * SHAPE.width;
        Training {
            weights: tensors(),
            gradients: tensors(),
            x: floats(n),
            out: floats(n),
            dx: floats(n),
            head: [0; 2].map(|_| floats(VOCABULARY * SHAPE.width)),
            norm: [0; 2].map(|_| floats(SHAPE.width)),
            targets: (0..SHAPE.rows() as u32).map(|i| i % VOCABULARY as u32).collect(),
            saved: Saved::new(SHAPE),
            space: block::Workspace::new(SHAPE, true),
            head_space: head::Workspace::new(SHAPE.rows(), SHAPE.width, VOCABULARY, true),
        }
    }

    fn step(&mut self) -> f64 {
        let weights = self.weights.each_ref();
        block::forward(&mut self.out, &self.x, &weights, Mask::Causal, None, &mut self.saved, &mut self.space);
        let [weight, bias] = &mut self.norm;
        let of_norm = Norm { weight: &mut **weight, bias: &mut **bias };
        let [head, of_head] = &mut self.head;
        let mut gradients = head::Gradients { dx: &mut self.dx, norm: of_norm, head: of_head };
        let norm = weights.norm1;
        let (targets, space) = ((&self.targets[..], u32::MAX), &mut self.head_space);
        let nats = head::loss(&self.out, norm, head, targets, 1.0, &mut gradients, Store::Set, space);
        block::backward(
            &mut self.dx,
            &self.x,
            &weights,
            &mut self.gradients.each_mut(),
            Store::Set,
            Mask::Causal,
            None,
            &self.saved,
            &mut self.space,
        );
        nats
    }
}

#[test]
fn a_step_allocates_nothing_and_faults_no_page() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    pool.install(|| {
        let mut training = Training::new();
        let first = training.step();
        for _ in 0..30 {
            training.step();
        }
        let before = (TAKEN.load(Ordering::Relaxed), faults());
        let mut nats = 0.0;
        for _ in 0..20 {
            nats = training.step();
        }
        let after = (TAKEN.load(Ordering::Relaxed), faults());
        assert_eq!(nats.to_bits(), first.to_bits(), "the same step gives the same bits");
        // reading /proc allocates: the text, and what it is read into
        let reading = 10;
        assert!(after.0 - before.0 <= reading, "{} allocations in 20 steps", after.0 - before.0);
        assert!(after.1 - before.1 <= reading, "{} page faults in 20 steps", after.1 - before.1);
    });
}
