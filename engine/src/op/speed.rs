//! How fast the operations are on one thread: `cargo test --release -p kinelm-engine speed -- --ignored --nocapture`.

use super::check::numbers;
use super::dropout::Mask;
use super::{bias, gelu, layer_norm};
use std::time::Instant;

/// Numbers of a run: they stay in the second-level cache.
const N: usize = 128;
const WIDTH: usize = 256;

/// Prints numbers a second, the best of several runs.
fn rate(what: &str, len: usize, mut run: impl FnMut()) {
    let mut time = || {
        let start = Instant::now();
        (0..20).for_each(|_| run());
        start.elapsed().as_secs_f64() / 20.0
    };
    let best = (0..30).map(|_| time()).fold(f64::INFINITY, f64::min);
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
