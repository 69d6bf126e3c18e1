//! The kernels one by one, on one thread, at shapes of a block 512 wide.
//!
//! `cargo bench -p kinelm-engine --bench kernels [-- NAME ..]` prints the rate of those whose names begin so, or of all.
//! `-- --count NAME REPEATS` runs one so often and prints nothing: `scripts/bench/instructions.sh` counts its
//! instructions, which a busy machine does not change.

use kinelm_engine::dispatch;
use kinelm_engine::op::dropout::Mask;
use kinelm_engine::op::matmul::{Left, Panels, Store};
use kinelm_engine::op::{adamw, attention, bias, cross_entropy, embedding, gelu, layer_norm, matmul};
use std::hint::black_box;
use std::time::Instant;

/// N: rows that a kernel is given; a multiple of no tile.
const N: usize = 100;
/// D: the width.
const D: usize = 512;
/// V: the vocabulary.
const V: usize = 400;

/// A kernel with its operands.
struct Case {
    /// What it is told apart by.
    name: &'static str,
    /// Done by a run, in 10^9 operations or bytes.
    amount: f64,
    unit: &'static str,
    run: Box<dyn FnMut()>,
}

fn case(name: &'static str, unit: &'static str, amount: usize, run: impl FnMut() + 'static) -> Case {
    Case { name, amount: amount as f64 / 1e9, unit, run: Box::new(run) }
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

fn product(name: &'static str, turned: bool, n: usize) -> Case {
    let (a, b) = (numbers(N * D), numbers(D * n));
    let mut panels = vec![0.0; matmul::panels_len(D, n)];
    matmul::pack(&mut panels, &b, n, D, n);
    let mut c = vec![0.0; N * n];
    case(name, "GFLOP/s", 2 * N * D * n, move || {
        let a = if turned { Left::Columns { a: &a, lda: N } } else { Left::Rows { a: &a, lda: D } };
        let panels = Panels { numbers: &panels, block: D };
        matmul::product(black_box(&mut c), n, (N, D, n), a, panels, 1.0, Store::Set);
    })
}

fn packing(name: &'static str, turned: bool) -> Case {
    let b = numbers(D * D);
    let mut panels = vec![0.0; matmul::panels_len(D, D)];
    case(name, "GB/s", 8 * D * D, move || match turned {
        true => matmul::pack_transposed(black_box(&mut panels), &b, D, D, D),
        false => matmul::pack(black_box(&mut panels), &b, D, D, D),
    })
}

fn layer_norms() -> [Case; 2] {
    let (x, dy) = (numbers(N * D), numbers(N * D));
    let [weight, bias] = [0; 2].map(|_| numbers(D));
    let (mut out, mut stats) = (vec![0.0; N * D], vec![0.0; 2 * N]);
    layer_norm::forward(&mut out, &mut stats, &x, &weight, &bias);
    let (saved_x, saved_stats, saved_weight) = (x.clone(), stats.clone(), weight.clone());
    let (mut dx, mut dweight, mut dbias) = (vec![0.0; N * D], vec![0.0; D], vec![0.0; D]);
    [
        case("layer_norm", "GB/s", 8 * N * D, move || {
            layer_norm::forward(black_box(&mut out), &mut stats, &x, &weight, &bias);
        }),
        case("layer_norm_backward", "GB/s", 16 * N * D, move || {
            let saved = layer_norm::Saved { x: &saved_x, stats: &saved_stats, weight: &saved_weight };
            layer_norm::backward(black_box(&mut dx), &mut dweight, &mut dbias, saved, &dy);
        }),
    ]
}

fn gelus() -> [Case; 2] {
    let x = numbers(N * D);
    let (before, dy) = (x.clone(), x.clone());
    let (mut out, mut again, mut d) = (vec![0.0; N * D], vec![0.0; N * D], vec![0.0; N * D]);
    [
        case("gelu", "GB/s", 8 * N * D, move || gelu::forward(black_box(&mut out), &x)),
        case("gelu_backward", "GB/s", 16 * N * D, move || {
            // in place: anew each time, or it shrinks until its numbers are subnormal
            d.copy_from_slice(&dy);
            gelu::backward(black_box(&mut d), &mut again, &before);
        }),
    ]
}

fn sums() -> [Case; 3] {
    let (y, shift) = (numbers(N * D), numbers(D));
    let (dy, also_y, also_shift) = (y.clone(), y.clone(), shift.clone());
    let (mut x, mut also_x, mut sums) = (numbers(N * D), numbers(N * D), vec![0.0; D]);
    let dropped = Mask { share: 0.1, key: 7, first_row: 0 };
    [
        case("column_sums", "GB/s", 4 * N * D, move || bias::add_column_sums(black_box(&mut sums), &dy)),
        case("residual", "GB/s", 12 * N * D, move || bias::residual(black_box(&mut x), &y, &shift, Mask::NONE)),
        case("residual_dropped", "GB/s", 12 * N * D, move || {
            bias::residual(black_box(&mut also_x), &also_y, &also_shift, dropped);
        }),
    ]
}

/// Two heads over a sequence that no tile divides.
fn attentions() -> [Case; 2] {
    let shape = attention::Shape { batch: 1, tokens: 300, heads: 2, width: 64 };
    let rules = attention::Rules { mask: attention::Mask::Causal, dropout: None };
    let (qkv, d_out) = (numbers(shape.rows() * 3 * shape.columns()), numbers(shape.rows() * shape.columns()));
    let [space, also_space] = [0; 2].map(|_| attention::Workspace::new(shape));
    let (mut out, mut log_sums) = (vec![0.0; shape.rows() * shape.columns()], vec![0.0; shape.rows() * shape.heads]);
    attention::forward(shape, &qkv, rules, &space, &mut out, &mut log_sums);
    let (also_qkv, done_out, done_sums) = (qkv.clone(), out.clone(), log_sums.clone());
    let mut d_qkv = vec![0.0; qkv.len()];
    // a pair of tokens costs two products of d forward, four backward
    let pairs = shape.heads * shape.tokens * (shape.tokens + 1) / 2;
    [
        case("attention", "GFLOP/s", 4 * pairs * shape.width, move || {
            attention::forward(shape, &qkv, rules, &space, black_box(&mut out), &mut log_sums);
        }),
        case("attention_backward", "GFLOP/s", 8 * pairs * shape.width, move || {
            let done = attention::Done { qkv: &also_qkv, out: &done_out, log_sums: &done_sums, d_out: &d_out };
            attention::backward(shape, done, rules, &also_space, black_box(&mut d_qkv));
        }),
    ]
}

/// What is at both ends of a model.
fn ends() -> [Case; 3] {
    let ids: Vec<u32> = (0..N as u32).map(|i| i * 37 % V as u32).collect();
    let (also_ids, targets) = (ids.clone(), ids.clone());
    let (logits, table, d_out) = (numbers(N * V), numbers(V * D), numbers(N * D));
    let (mut changed, mut out, mut d_table) = (logits.clone(), vec![0.0; N * D], vec![0.0; V * D]);
    [
        case("cross_entropy", "GB/s", 8 * N * V, move || {
            changed.copy_from_slice(&logits);
            black_box(cross_entropy::forward_backward(&mut changed, &targets, 0, 0.01));
        }),
        case("embedding", "GB/s", 8 * N * D, move || {
            embedding::forward(black_box(&mut out), D, 0, &[embedding::Lookup { table: &table, ids: &ids }]);
        }),
        case("embedding_backward", "GB/s", 12 * N * D, move || {
            embedding::backward(black_box(&mut d_table), D, &also_ids, &d_out);
        }),
    ]
}

fn optimizer() -> [Case; 2] {
    let len = N * D;
    let (gradients, also_gradients) = (numbers(len), numbers(len));
    let (mut x, mut first, mut second) = (numbers(len), vec![0.0; len], vec![0.0; len]);
    let step = adamw::Step::new(10, 1e-3, [0.9, 0.95], 1e-8, 0.1, 1.0);
    [
        case("adamw", "GB/s", 28 * len, move || {
            adamw::update(black_box(&mut x), &mut first, &mut second, &gradients, &step);
        }),
        case("norm_squared", "GB/s", 4 * len, move || {
            black_box(adamw::norm_squared(&also_gradients));
        }),
    ]
}

fn cases() -> Vec<Case> {
    let mut all = vec![
        product("product", false, 3 * D),
        product("product_turned", true, 3 * D),
        packing("pack", false),
        packing("pack_transposed", true),
    ];
    all.extend(layer_norms());
    all.extend(gelus());
    all.extend(sums());
    all.extend(attentions());
    all.extend(ends());
    all.extend(optimizer());
    all
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

fn work(arguments: &[String]) -> Result<(), String> {
    let mut cases = cases();
    if arguments.first().is_some_and(|a| a == "--names") {
        println!("# {}", dispatch::name());
        cases.iter().for_each(|c| println!("{}", c.name));
        return Ok(());
    }
    if arguments.first().is_some_and(|a| a == "--count") {
        let [_, name, repeats] = arguments else { return Err("expected --count NAME REPEATS".into()) };
        let case = cases.iter_mut().find(|c| c.name == name).ok_or(format!("no kernel is called {name}"))?;
        let repeats = repeats.parse::<u32>().map_err(|e| format!("{repeats} repeats: {e}"))?;
        (0..repeats).for_each(|_| (case.run)());
        return Ok(());
    }
    println!("kernels: {}", dispatch::name());
    let wanted = |c: &&mut Case| arguments.is_empty() || arguments.iter().any(|a| c.name.starts_with(a.as_str()));
    for case in cases.iter_mut().filter(wanted) {
        let taken = seconds(&mut case.run);
        println!("{:<24} {:>10.1} us {:>8.1} {}", case.name, taken * 1e6, case.amount / taken, case.unit);
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
