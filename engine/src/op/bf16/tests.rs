//! Tiles against plain loops over rounded numbers.

use super::*;
use crate::op::check;
use crate::scalar;

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
    if !has_tiles() {
        return eprintln!("SKIPPED tiles: this machine has none");
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
fn rounding_is_to_the_nearest_even() {
    for x in numbers(10_000, 4).into_iter().chain([0.0, -0.0, f32::INFINITY, f32::NEG_INFINITY, 1e-40, 3.4e38]) {
        assert_eq!(round(x), half::bf16::from_f32(x).to_bits().into(), "{x}");
    }
    for bits in [0x7fff_ffff, 0xffff_ffff, 0x7f80_0001] {
        assert!(f32::from_bits(round(f32::from_bits(bits)) << 16).is_nan(), "{bits:x}");
    }
}

#[test]
#[ignore = "speed, for a quiet machine"]
fn speed() {
    for (m, k, n) in [(64, 512, 1536), (64, 512, 512), (64, 2048, 512), (64, 512, 2048), (64, 128, 384), (144, 2048, 512), (144, 2048, 2048)] {
        let (a, b) = (numbers(m * k, 1), numbers(k * n, 2));
        let mut panels = Floats::new(panels_len(k, n));
        let mut c = Floats::new(m * n);
        for (what, columns) in [("rows", false), ("columns", true)] {
            let left = if columns { Left::Columns { a: &a, lda: m } } else { Left::Rows { a: &a, lda: k } };
            let block = if columns { 64 } else { k };
            for (i, first) in (0..k).step_by(block).enumerate() {
                pack(&mut panels[i * panels_len(block, n)..], &b[first * n..], n, block, n);
            }
            let mut best = f64::INFINITY;
            for _ in 0..200 {
                let t = std::time::Instant::now();
                product(&mut c, n, (m, k, n), left, (&panels, block), Store::Set);
                best = best.min(t.elapsed().as_secs_f64());
            }
            let part = Part::at(0, k, block, n);
            let mut round = f64::INFINITY;
            LEFT.with_borrow_mut(|l| for _ in 0..200 {
                let t = std::time::Instant::now();
                part.round_left(bytemuck::cast_slice_mut(l), left, 0, m, 0);
                round = round.min(t.elapsed().as_secs_f64());
            });
            let depth = part.blocks * part.high;
            eprintln!("({m}, {k}, {n}) {what}: {:.0} GFLOP/s; rounding {:.2} ns a number", (2 * m * k * n) as f64 / best / 1e9, round * 1e9 / (m * depth) as f64);
        }
        let t = std::time::Instant::now();
        for _ in 0..20 { pack(&mut panels, &b, n, k, n); }
        let p = t.elapsed().as_secs_f64() / 20.0;
        let t = std::time::Instant::now();
        for _ in 0..20 { pack_transposed(&mut panels, &b, k, k, n); }
        let q = t.elapsed().as_secs_f64() / 20.0;
        eprintln!("packing {:.2} transposed {:.2} ns a number", p * 1e9 / (k * n) as f64, q * 1e9 / (k * n) as f64);
    }
}
