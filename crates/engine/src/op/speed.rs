//! The speed of the operations on one thread: `cargo test --release -p kinelm-engine speed -- --ignored --nocapture`.

use super::check::numbers;
use super::dropout::Mask;
use super::{adamw, bias, cross_entropy, embedding, gelu, layer_norm};
use crate::bins::Bins;
use std::time::Instant;

/// Numbers of a run: they stay in the second-level cache.
const N: usize = 128;
const WIDTH: usize = 256;
/// More numbers than this come from memory, and take long.
const CACHED: usize = 1 << 20;

/// Prints numbers a second, the best of several runs.
fn rate(what: &str, len: usize, mut run: impl FnMut()) {
    let (runs, repeats) = if len > CACHED { (1, 5) } else { (20, 30) };
    let mut time = || {
        let start = Instant::now();
        (0..runs).for_each(|_| run());
        start.elapsed().as_secs_f64() / runs as f64
    };
    let best = (0..repeats).map(|_| time()).fold(f64::INFINITY, f64::min);
    println!("{what:32} {:8.2} 10^9 numbers/s", len as f64 / best * 1e-9);
}

#[test]
#[ignore = "prints speeds, judges nothing"]
fn speed_of_rows() {
    let len = N * WIDTH;
    let [x, y] = [1, 2].map(|seed| numbers(seed, len, 3.0));
    let [weight, shift] = [3, 4].map(|seed| numbers(seed, WIDTH, 1.0));
    let [mut out, mut d, mut stats] = [vec![0.0; len], numbers(5, len, 1e-3), vec![0.0; 2 * N]];
    let [mut dweight, mut dbias] = [vec![0.0; WIDTH], vec![0.0; WIDTH]];
    rate("copy", len, || out.copy_from_slice(&x));
    rate("gelu", len, || gelu::forward(&mut out, &x));
    rate("gelu backward", len, || {
        d.copy_from_slice(&y);
        gelu::backward(&mut d, &mut out, &x)
    });
    rate("layer norm", len, || layer_norm::forward(&mut out, &mut stats, &x, &weight, &shift));
    rate("layer norm again", len, || layer_norm::again(&mut out, &x, &stats, &weight, &shift));
    let saved = layer_norm::Saved { x: &x, stats: &stats, weight: &weight };
    rate("layer norm backward", len, || layer_norm::backward(&mut d, &mut dweight, &mut dbias, saved, &y));
    rate("bias", len, || bias::add(&mut out, &shift));
    rate("column sums", len, || bias::add_column_sums(&mut dbias, &y));
    rate("residual", len, || bias::residual(&mut out, &y, &shift, Mask::NONE));
    let mask = Mask { key: 1, first_row: 0, share: 0.1 };
    rate("residual with dropout", len, || bias::residual(&mut out, &y, &shift, mask));
    rate("residual backward with dropout", len, || bias::residual_backward(&mut out, &y, WIDTH, mask));
}

#[test]
#[ignore = "prints speeds, judges nothing"]
fn speed_of_heads_embeddings_and_updates() {
    let len = N * WIDTH;
    let logits = numbers(1, len, 5.0);
    let targets: Vec<u32> = (0..N).map(|r| (r * 7 % N) as u32).collect();
    let target_of =
        |&target: &u32| cross_entropy::RowTarget { target, first: 0, count: WIDTH as u32, bins: Bins::NONE };
    let row_targets: Vec<cross_entropy::RowTarget> = targets.iter().map(target_of).collect();
    let (mut d, mut nats) = (logits.clone(), vec![0.0; N]);
    rate("cross-entropy with its gradient", len, || {
        d.copy_from_slice(&logits);
        cross_entropy::forward_backward(&mut d, &row_targets, None, 0.1);
    });
    rate("cross-entropy", len, || cross_entropy::nats(&mut nats, &logits, &targets, u32::MAX));
    let places: Vec<u32> = (0..N as u32).collect();
    let lookups = [&targets, &places].map(|ids| embedding::Lookup { table: &logits, ids });
    rate("two embeddings", len, || embedding::forward(&mut d, WIDTH, 0, &lookups));
    let mut table = vec![0.0; len];
    rate("embedding backward, parallel", len, || embedding::backward(&mut table, WIDTH, &targets, &logits));
    let [mut x, mut m, mut v] = [logits.clone(), vec![0.0; len], vec![0.0; len]];
    let step = adamw::Step::new(5, 1e-3, [0.9, 0.95], 1e-8, 0.1, 1.0);
    rate("adamw, one piece in the cache", len, || adamw::update(&mut x, &mut m, &mut v, &logits, &step));
    let large = 1 << 24;
    let [mut x, mut m, mut v, g] = [1, 2, 3, 4].map(|seed| numbers(seed, large, 1.0));
    v.iter_mut().for_each(|v| *v *= *v);
    rate("norm, one piece in the cache", len, || assert!(adamw::norm_squared(&g[..len]) > 0.0));
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for (pool, threads) in [(Some(&one), "one thread"), (None, "all threads")] {
        let mut both = || {
            rate(&format!("adamw from memory, {threads}"), large, || adamw::update(&mut x, &mut m, &mut v, &g, &step));
            rate(&format!("norm from memory, {threads}"), large, || assert!(adamw::norm_squared(&g) > 0.0));
        };
        match pool {
            Some(pool) => pool.install(both),
            None => both(),
        }
    }
}
