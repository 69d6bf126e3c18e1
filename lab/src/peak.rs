//! What the processor reaches at most, seen in the same run as what is compared with it.

use kinelm::engine::op::matmul::{Left, Store};
use kinelm::engine::op::products::{Products, Right};
use std::time::Instant;

/// Products a thread makes between two looks at the clock.
const TURNS: usize = 32;

/// Operations a second, in 10^9, that all threads of this rayon pool reach together on `products`: the best of 12.
pub fn gflops(products: Products) -> f64 {
    (0..12).map(|_| once(products)).fold(0.0, f64::max)
}

/// Rows, depth and columns whose matrices fit a core's own cache; in bf16 enough columns that rounding the left
/// factor, once for all of them, weighs little.
fn shape(products: Products) -> (usize, usize, usize) {
    if products == Products::Bf16 { (160, 512, 1536) } else { (192, 192, 192) }
}

fn once(products: Products) -> f64 {
    let (m, k, n) = shape(products);
    let rates = rayon::broadcast(|_| {
        let (a, b) = (vec![0.5; m * k], vec![0.5; k * n]);
        let mut panels = vec![0.0; products.panels_len(k, n)];
        products.pack(&mut panels, &b, n, k, n);
        let mut out = vec![0.0; m * n];
        let mut product = || {
            let right = Right { panels: &panels, block: k, first: 0 };
            products.product(&mut out, n, (m, k, n), Left::Rows { a: &a, lda: k }, right, Store::Set);
        };
        // not timed: it fills the caches
        product();
        let started = Instant::now();
        (0..TURNS).for_each(|_| product());
        // a product is a multiplication and an addition
        (2 * TURNS * m * k * n) as f64 / started.elapsed().as_secs_f64() / 1e9
    });
    rates.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_that_a_machine_may_have_comes_out() {
        for products in [Products::F32, Products::bf16()] {
            let rate = once(products);
            assert!((0.01..1e6).contains(&rate), "{products:?}: {rate}");
        }
    }
}
