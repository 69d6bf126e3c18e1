//! Tiles and dots against plain loops over rounded numbers.

use super::*;
use crate::op::check;
use crate::scalar;
use std::io::Write;

fn numbers(n: usize, seed: u64) -> Vec<f32> {
    check::numbers(seed, n, 0.5)
}

/// Of the largest number, for K summed rows: sums in f32 against sums in f64.
fn bound(k: usize) -> f64 {
    1e-6 * (k as f64 / 4096.0).sqrt().max(1.0)
}

fn check((m, k, n): (usize, usize, usize), columns: bool, block: usize) {
    let (lda, ldc) = (if columns { m + 3 } else { k + 3 }, n + 2);
    let left = numbers(if columns { k * lda } else { m * lda }, 1);
    let a = if columns { Left::Columns { a: &left, lda } } else { Left::Rows { a: &left, lda } };
    let b = numbers(k * n, 2);
    let turned: Vec<f32> = (0..k * n).map(|x| b[x % k * n + x / k]).collect();
    let truth = scalar::bf16::product((m, k, n), a, &b);
    let most = truth.iter().fold(1.0, |most: f64, x| most.max(x.abs()));
    let mut packed = vec![f32::NAN; k.div_ceil(block) * panels_len(block, n)];
    for from_turned in [false, true] {
        for (i, first) in (0..k).step_by(block).enumerate() {
            let (rows, to) = (block.min(k - first), &mut packed[i * panels_len(block, n)..]);
            match from_turned {
                false => pack(to, &b[first * n..], n, rows, n),
                true => pack_transposed(to, &turned[first..], k, rows, n),
            }
        }
        let before = numbers(m * ldc, 3);
        for store in [Store::Set, Store::Add] {
            let mut c = before.clone();
            product(&mut c, ldc, (m, k, n), a, (&packed, block), store);
            for (i, (c, before)) in c.iter().zip(&before).enumerate() {
                let (row, column) = (i / ldc, i % ldc);
                let there = if store == Store::Add { *before as f64 } else { 0.0 };
                let expected = if column < n { there + truth[row * n + column] } else { *before as f64 };
                let apart = (*c as f64 - expected).abs();
                let what = format!("({m}, {k}, {n}) columns {columns} block {block} {store:?} at ({row}, {column})");
                assert!(apart <= bound(k) * most, "{what}: {c}, expected {expected}");
            }
        }
    }
}

#[test]
fn every_shape_is_what_plain_loops_give() {
    if Instructions::here().is_none() {
        // past the test runner's capture, as a line that .ci/run counts
        let _ = writeln!(std::io::stderr(), "SKIPPED op::bf16: this processor doesn't multiply bf16");
        return;
    }
    for m in [1, 2, 15, 16, 17, 31, 32, 33, 64, 97, 161] {
        for (k, n) in [(1, 1), (3, 15), (5, 16), (8, 33), (31, 64), (32, 32), (33, 65), (300, 7), (1100, 90)] {
            for columns in [false, true] {
                for block in [k, 1, 7, 64, 256] {
                    check((m, k, n), columns, block.min(k));
                }
            }
        }
    }
}

#[test]
fn a_product_may_take_some_of_the_packed_rows() {
    if Instructions::here().is_none() {
        return; // printed above
    }
    let (m, k, n) = (40, 96, 70);
    let (a, b) = (numbers(m * k, 1), numbers(k * n, 2));
    let mut packed = vec![f32::NAN; panels_len(k, n)];
    pack(&mut packed, &b, n, k, n);
    for (first, steps) in [(0, 96), (0, 33), (32, 64), (32, 7), (64, 32), (64, 1)] {
        let mut c = vec![f32::NAN; m * n];
        let left = Left::Rows { a: &a[first..], lda: k };
        product(&mut c, n, (m, steps, n), left, (&packed[row(first)..], k), Store::Set);
        let truth = scalar::bf16::product((m, steps, n), left, &b[first * n..]);
        let most = truth.iter().fold(1.0, |most: f64, x| most.max(x.abs()));
        let apart = c.iter().zip(&truth).map(|(c, t)| (*c as f64 - t).abs()).fold(0.0, f64::max);
        assert!(apart <= bound(steps) * most, "{steps} rows from {first}: {apart:e} apart");
    }
}

#[test]
fn rounding_is_to_the_nearest_even() {
    for x in numbers(10_000, 4).into_iter().chain([0.0, -0.0, f32::INFINITY, f32::NEG_INFINITY, 1e-40, 3.4e38]) {
        assert_eq!(round(x), half::bf16::from_f32(x).to_bits().into(), "{x}");
    }
    for bits in [0x7fff_ffff, 0xffff_ffff, 0x7f80_0001] {
        assert!(f32::from_bits(round(f32::from_bits(bits)) << 16).is_nan(), "{bits:x}");
    }
}
