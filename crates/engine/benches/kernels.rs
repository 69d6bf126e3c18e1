//! The kernels one by one, on one thread, at shapes of a block 512 wide.
//!
//! `cargo bench -p kinelm-engine --bench kernels [-- NAME ..]` prints the rate of those whose names begin so, or of all.
//! `-- --count NAME` runs one twice, the second time inside a function of its own: `scripts/bench/instructions.sh` counts
//! the instructions in there, which a busy machine does not change.

use kinelm_engine::bins::Bins;
use kinelm_engine::decode::{BlockParts, KvKind, Matrix, Norm, Run, Stack, StackDecoder, StackWeights, WeightKind};
use kinelm_engine::dispatch;
use kinelm_engine::op::dots;
use kinelm_engine::op::dropout::Mask;
use kinelm_engine::op::matmul::{Left, Panels, Store};
use kinelm_engine::op::products::Products;
use kinelm_engine::op::rope::Angles;
use kinelm_engine::op::{adamw, attention, bias, cross_entropy, embedding, gelu, layer_norm, matmul, rope};
use std::hint::black_box;
use std::time::Instant;

/// N: rows that a kernel is given; a multiple of no tile.
const N: usize = 100;
/// D: the width.
const D: usize = 512;
/// V: the vocabulary.
const V: usize = 400;

type Make = fn() -> Case;

/// Kernels by their names, each with what makes its operands.
const CASES: [(&str, Make); 23] = [
    ("product", || product(false)),
    ("product_turned", || product(true)),
    ("pack", || packing(false)),
    ("pack_transposed", || packing(true)),
    ("layer_norm", norm),
    ("layer_norm_backward", norm_backward),
    ("gelu", gelu),
    ("gelu_backward", gelu_backward),
    ("column_sums", column_sums),
    ("residual", || residual(Mask::NONE)),
    ("residual_dropped", || residual(Mask { share: 0.1, key: 7, first_row: 0 })),
    ("attention", attention),
    ("attention_backward", attention_backward),
    ("cross_entropy", cross_entropy),
    ("rope", turn),
    ("embedding", embedding),
    ("embedding_backward", embedding_backward),
    ("adamw", adamw),
    ("norm_squared", norm_squared),
    ("dots", byte_dots),
    ("token_f32", || token(WeightKind::F32, KvKind::F32, false)),
    ("token_f32_rotary", || token(WeightKind::F32, KvKind::F32, true)),
    ("token_int8_f16", || token(WeightKind::Int8, KvKind::F16, false)),
];

/// A kernel with its operands.
struct Case {
    /// Done by a run, in 10^9 operations or bytes.
    amount: f64,
    unit: &'static str,
    run: Box<dyn FnMut()>,
}

fn case(unit: &'static str, amount: usize, run: impl FnMut() + 'static) -> Case {
    Case { amount: amount as f64 / 1e9, unit, run: Box::new(run) }
}

fn zeros(len: usize) -> Vec<f32> {
    vec![0.0; len]
}

/// Numbers between -1 and 1, always the same ones.
fn numbers(len: usize) -> Vec<f32> {
    let mut state = 1u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    (0..len).map(|_| next()).collect()
}

fn product(turned: bool) -> Case {
    let n = 3 * D;
    let (a, b, mut c) = (numbers(N * D), numbers(D * n), zeros(N * n));
    let mut panels = zeros(matmul::panels_len(D, n));
    matmul::pack(&mut panels, &b, n, D, n);
    case("GFLOP/s", 2 * N * D * n, move || {
        let a = if turned { Left::Columns { a: &a, lda: N } } else { Left::Rows { a: &a, lda: D } };
        let panels = Panels { numbers: &panels, block: D };
        matmul::product(black_box(&mut c), n, (N, D, n), a, panels, Store::Set);
    })
}

fn packing(turned: bool) -> Case {
    let (b, mut panels) = (numbers(D * D), zeros(matmul::panels_len(D, D)));
    let pack = if turned { matmul::pack_transposed } else { matmul::pack };
    case("GB/s", 8 * D * D, move || pack(black_box(&mut panels), &b, D, D, D))
}

fn norm() -> Case {
    let (x, weight, bias) = (numbers(N * D), numbers(D), numbers(D));
    let (mut out, mut stats) = (zeros(N * D), zeros(2 * N));
    case("GB/s", 8 * N * D, move || layer_norm::forward(black_box(&mut out), &mut stats, &x, &weight, &bias))
}

fn norm_backward() -> Case {
    let (x, dy, weight) = (numbers(N * D), numbers(N * D), numbers(D));
    let (mut stats, mut dx, mut dweight, mut dbias) = (zeros(2 * N), zeros(N * D), zeros(D), zeros(D));
    layer_norm::forward(&mut dx, &mut stats, &x, &weight, &weight);
    case("GB/s", 16 * N * D, move || {
        let saved = layer_norm::Saved { x: &x, stats: &stats, weight: &weight };
        layer_norm::backward(black_box(&mut dx), &mut dweight, &mut dbias, saved, &dy);
    })
}

fn gelu() -> Case {
    let (x, mut out) = (numbers(N * D), zeros(N * D));
    case("GB/s", 8 * N * D, move || gelu::forward(black_box(&mut out), &x))
}

fn gelu_backward() -> Case {
    let (x, dy, mut out, mut d) = (numbers(N * D), numbers(N * D), zeros(N * D), zeros(N * D));
    case("GB/s", 16 * N * D, move || {
        // in place: anew each time, or it shrinks until its numbers are subnormal
        d.copy_from_slice(&dy);
        gelu::backward(black_box(&mut d), &mut out, &x);
    })
}

fn column_sums() -> Case {
    let (dy, mut sums) = (numbers(N * D), zeros(D));
    case("GB/s", 4 * N * D, move || bias::add_column_sums(black_box(&mut sums), &dy))
}

fn residual(mask: Mask) -> Case {
    let (y, shift, mut x) = (numbers(N * D), numbers(D), numbers(N * D));
    case("GB/s", 12 * N * D, move || bias::residual(black_box(&mut x), &y, &shift, mask))
}

/// Two heads over a sequence that no tile divides.
const ATTENTION: attention::Shape = attention::Shape { batch: 1, tokens: 300, heads: 2, width: 64 };
const CAUSAL: attention::Rules = attention::Rules { mask: attention::Mask::Causal, dropout: None };

/// Operations of a product between every query and the keys it sees.
fn pair_product() -> usize {
    ATTENTION.columns() * ATTENTION.tokens * (ATTENTION.tokens + 1)
}

fn attention() -> Case {
    let (space, qkv) =
        (attention::Workspace::new(ATTENTION, Products::F32), numbers(ATTENTION.rows() * 3 * ATTENTION.columns()));
    let (mut out, mut sums) = (zeros(qkv.len() / 3), zeros(ATTENTION.rows() * ATTENTION.heads));
    case("GFLOP/s", 2 * pair_product(), move || {
        attention::forward(ATTENTION, &qkv, CAUSAL, &space, black_box(&mut out), &mut sums);
    })
}

fn attention_backward() -> Case {
    let (space, qkv) =
        (attention::Workspace::new(ATTENTION, Products::F32), numbers(ATTENTION.rows() * 3 * ATTENTION.columns()));
    let (mut out, mut log_sums) = (zeros(qkv.len() / 3), zeros(ATTENTION.rows() * ATTENTION.heads));
    attention::forward(ATTENTION, &qkv, CAUSAL, &space, &mut out, &mut log_sums);
    let (d_out, mut d_qkv) = (numbers(out.len()), zeros(qkv.len()));
    case("GFLOP/s", 4 * pair_product(), move || {
        let done = attention::Done { qkv: &qkv, out: &out, log_sums: &log_sums, d_out: &d_out };
        attention::backward(ATTENTION, done, CAUSAL, &space, black_box(&mut d_qkv));
    })
}

fn ids() -> Vec<u32> {
    (0..N as u32).map(|i| i * 37 % V as u32).collect()
}

fn cross_entropy() -> Case {
    let target_of = |target| cross_entropy::RowTarget { target, first: 0, count: V as u32, bins: Bins::NONE };
    let targets: Vec<cross_entropy::RowTarget> = ids().into_iter().map(target_of).collect();
    let (logits, mut changed) = (numbers(N * V), zeros(N * V));
    case("GB/s", 8 * N * V, move || {
        changed.copy_from_slice(&logits);
        black_box(cross_entropy::forward_backward(&mut changed, &targets, None, 0.01));
    })
}

fn turn() -> Case {
    let (mut qkv, angles) = (numbers(N * 3 * D), rope::Angles::new(N, 64));
    let words: Vec<u32> = (0..N as u32).collect();
    case("GB/s", 16 * N * D, move || {
        rope::turn(black_box(&mut qkv), D / 64, 0, rope::Rope { angles: &angles, words: &words }, false);
    })
}

fn embedding() -> Case {
    let (table, ids, mut out) = (numbers(V * D), ids(), zeros(N * D));
    case("GB/s", 8 * N * D, move || {
        embedding::forward(black_box(&mut out), D, 0, &[embedding::Lookup { table: &table, ids: &ids }]);
    })
}

fn embedding_backward() -> Case {
    let (d_out, ids, mut d_table) = (numbers(N * D), ids(), zeros(V * D));
    case("GB/s", 12 * N * D, move || embedding::backward(black_box(&mut d_table), D, &ids, &d_out))
}

fn adamw() -> Case {
    let (gradients, mut x) = (numbers(N * D), numbers(N * D));
    let (mut first, mut second) = (zeros(N * D), zeros(N * D));
    let step = adamw::Step::new(10, 1e-3, [0.9, 0.95], 1e-8, 0.1, 1.0);
    case("GB/s", 28 * N * D, move || adamw::update(black_box(&mut x), &mut first, &mut second, &gradients, &step))
}

fn byte_dots() -> Case {
    let query = dots::Query::new(&numbers(D).iter().map(|&x| x.into()).collect::<Vec<f64>>());
    let bytes: Vec<i8> = numbers(N * D).iter().map(|x| (x * 127.0) as i8).collect();
    let mut out = vec![0; N];
    case("GB/s", N * D, move || query.dots(black_box(&mut out), &bytes))
}

fn norm_squared() -> Case {
    let gradients = numbers(N * D);
    case("GB/s", 4 * N * D, move || {
        black_box(adamw::norm_squared(&gradients));
    })
}

/// A row after N others, through one block and the head; with rotary positions or without.
fn token(kind: WeightKind, kv: KvKind, rotary: bool) -> Case {
    let stack = Stack { layers: 1, heads: 8, width: D };
    let (matrix, bias) = (numbers(4 * D * D), numbers(4 * D));
    let linear = |k: usize, n: usize| (&matrix[..k * n], &bias[..n]);
    let norm = (&bias[..D], &bias[..D]);
    let [qkv, out, up, down] = [linear(D, 3 * D), linear(D, D), linear(D, 4 * D), linear(4 * D, D)];
    let block = BlockParts { norm1: norm, qkv, out, norm2: norm, up, down };
    let angles = rotary.then(|| Angles::new(N + 1, D / 8));
    let weights = StackWeights::new(&[block], stack, kind, angles);
    let (head, norm) = (Matrix::transposed(&matrix[..V * D], V, D, kind), Norm::new(norm, D));
    let bytes = weights.bytes() + head.bytes();
    let mut decoder = StackDecoder::new(&weights, kv, 1, N + 1, N, V);
    let (rows, mut logits) = (numbers((N + 1) * D), zeros(V));
    let mut place = 0;
    while place < N {
        let n = (N - place).min(decoder.free());
        decoder.push(Run { stream: 0, place, rows: n });
        decoder.rows_mut(0).copy_from_slice(&rows[place * D..][..n * D]);
        decoder.forward(&weights);
        decoder.clear();
        place += n;
    }
    case("GB/s", bytes, move || {
        decoder.push(Run { stream: 0, place: N, rows: 1 });
        decoder.rows_mut(0).copy_from_slice(&rows[N * D..]);
        decoder.positions_mut(0).fill(N as u32);
        decoder.forward(&weights);
        decoder.norm(&norm, 0..1);
        decoder.product(&head, 0..1, 0..V).copy(0, 0, &mut logits);
        decoder.clear();
        black_box(&logits);
    })
}

/// Seconds of a run: the median of 21, each of as many as take two milliseconds.
fn seconds(run: &mut dyn FnMut()) -> f64 {
    let mut time = |runs: usize| {
        let started = Instant::now();
        (0..runs).for_each(|_| run());
        started.elapsed().as_secs_f64() / runs as f64
    };
    time(1);
    let runs = ((2e-3 / time(3)) as usize).max(1);
    let mut taken: Vec<f64> = (0..21).map(|_| time(runs)).collect();
    taken.sort_by(f64::total_cmp);
    taken[taken.len() / 2]
}

/// Callgrind looks for this name.
#[inline(never)]
fn counted(run: &mut dyn FnMut()) {
    black_box(run)();
}

fn work(arguments: &[String]) -> Result<(), String> {
    if arguments.first().is_some_and(|a| a == "--names") {
        println!("# {}", dispatch::name());
        CASES.iter().for_each(|(name, _)| println!("{name}"));
        return Ok(());
    }
    if arguments.first().is_some_and(|a| a == "--count") {
        let [_, wanted] = arguments else { return Err("expected --count NAME".into()) };
        let found = CASES.iter().find(|(name, _)| name == wanted);
        let (_, make) = found.ok_or(format!("no kernel is called {wanted}"))?;
        let mut case = make();
        (case.run)();
        counted(&mut case.run);
        return Ok(());
    }
    println!("kernels: {}", dispatch::name());
    let wanted = |name: &str| arguments.is_empty() || arguments.iter().any(|a| name.starts_with(a.as_str()));
    for (name, make) in CASES.iter().filter(|(name, _)| wanted(name)) {
        let mut case = make();
        let taken = seconds(&mut case.run);
        println!("{name:<24} {:>10.1} us {:>8.1} {}", taken * 1e6, case.amount / taken, case.unit);
    }
    Ok(())
}

fn main() {
    // cargo bench adds --bench
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
    let done = pool.map_err(|e| e.to_string()).and_then(|pool| pool.install(|| work(&arguments)));
    if let Err(message) = done {
        eprintln!("kernels: {message}");
        std::process::exit(2);
    }
}
