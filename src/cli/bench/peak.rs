//! What the processor reaches at most, seen in the same run as what is compared with it.

use kinelm_engine::op::matmul::{self, Left, Panels, Store};
use std::time::Instant;

/// Rows, depth and columns of a product whose three matrices stay in a core's own cache.
const SIDE: usize = 192;
/// Products a thread makes between two looks at the clock.
const TURNS: usize = 32;

/// fp32 operations a second, in 10^9, that all threads of this rayon pool reach together on products: the best of 12.
pub fn gflops() -> f64 {
    (0..12).map(|_| once()).fold(0.0, f64::max)
}

fn once() -> f64 {
    let rates = rayon::broadcast(|_| {
        let numbers = vec![0.5; SIDE * SIDE];
        let mut packed = vec![0.0; matmul::panels_len(SIDE, SIDE)];
        matmul::pack(&mut packed, &numbers, SIDE, SIDE, SIDE);
        let mut out = vec![0.0; SIDE * SIDE];
        let mut product = || {
            let (a, panels) = (Left::Rows { a: &numbers, lda: SIDE }, Panels { numbers: &packed, block: SIDE });
            matmul::product(&mut out, SIDE, (SIDE, SIDE, SIDE), a, panels, 1.0, Store::Set);
        };
        product();
        let started = Instant::now();
        (0..TURNS).for_each(|_| product());
        (2 * TURNS * SIDE * SIDE * SIDE) as f64 / started.elapsed().as_secs_f64() / 1e9
    });
    rates.iter().sum()
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_rate_that_a_machine_may_have_comes_out() {
        let rate = super::once();
        assert!((0.01..1e6).contains(&rate), "{rate}");
    }
}
