//! Products against plain loops, on every width of vector.

use super::*;
use crate::op::check;
use crate::scalar;

fn numbers(n: usize, seed: u64) -> Vec<f32> {
    check::numbers(seed, n, 0.5)
}

/// Sums of k products of numbers below 0.5 in f32: k/4 times 2^-24 twice over, and some room.
fn bound(k: usize) -> f64 {
    1e-6 + k as f64 * 6e-8
}

fn check<S: Simd>(simd: S, (m, k, n): (usize, usize, usize), columns: bool, block: usize) {
    let width = 2 * S::F32_LANES;
    let (lda, ldc) = (if columns { m + 3 } else { k + 3 }, n + 2);
    let left = numbers(if columns { k * lda } else { m * lda }, 1);
    let a = if columns { Left::Columns { a: &left, lda } } else { Left::Rows { a: &left, lda } };
    let b = numbers(k * n, 2);
    let turned: Vec<f32> = (0..k * n).map(|x| b[x % k * n + x / k]).collect();
    let truth = scalar::matmul::product((m, k, n), a, &b);
    let mut packed = vec![f32::NAN; n.next_multiple_of(width) * k];
    for from_turned in [false, true] {
        let mut at = 0;
        for first in (0..k).step_by(block) {
            let rows = block.min(k - first);
            let to = &mut packed[at..];
            match from_turned {
                false => pack_width(width, to, &b[first * n..], n, rows, n),
                true => pack_transposed_width(width, to, &turned[first..], k, rows, n),
            }
            at += rows * n.next_multiple_of(width);
        }
        let before = numbers(m * ldc, 3);
        for store in [Store::Set, Store::Add] {
            let mut c = before.clone();
            let panels = Panels { numbers: &packed, block };
            let turned = &mut vec![f32::NAN; ROWS * DEPTH];
            Product { c: &mut c, ldc, m, k, n, a, panels, store, turned }.with_simd(simd);
            for (i, (c, before)) in c.iter().zip(&before).enumerate() {
                let (row, column) = (i / ldc, i % ldc);
                let there = if store == Store::Add { *before as f64 } else { 0.0 };
                let expected = match column < n {
                    true => there + truth[row * n + column],
                    false => *before as f64,
                };
                let apart = (*c as f64 - expected).abs();
                let what = format!("({m}, {k}, {n}) columns {columns} block {block} {store:?} at ({row}, {column})");
                assert!(apart <= bound(k), "{what}: {c}, expected {expected}");
            }
        }
    }
}

fn check_all<S: Simd + Copy>(simd: S) {
    for m in [1, 2, 5, 6, 7, 12, 13, 97, 100] {
        for (k, n) in [(1, 1), (3, 15), (5, 16), (8, 33), (31, 64), (31, 65), (300, 7), (257, 90)] {
            for columns in [false, true] {
                for block in [k, 1, 7, 64, 256] {
                    check(simd, (m, k, n), columns, block.min(k));
                }
            }
        }
    }
}

#[test]
fn every_shape_is_what_plain_loops_give_on_these_kernels() {
    struct All;
    impl WithSimd for All {
        type Output = ();
        fn with_simd<S: Simd>(self, simd: S) {
            check_all(simd);
        }
    }
    dispatch::run(All);
}

#[test]
fn every_width_of_vector_gives_the_same() {
    check_all(pulp::Scalar);
    for shape in [(1, 5, 70), (13, 300, 33), (7, 9, 64), (13, 300, 70)] {
        for columns in [false, true] {
            check(pulp::Scalar128b, shape, columns, 4);
            check(pulp::Scalar256b, shape, columns, 4);
            check(pulp::Scalar512b, shape, columns, 4);
        }
    }
}

#[test]
fn nothing_times_nothing_is_nothing() {
    let mut c = vec![3.0; 4];
    product(&mut c, 2, (2, 0, 2), Left::Rows { a: &[], lda: 0 }, Panels { numbers: &[], block: 1 }, Store::Set);
    assert_eq!(c, [0.0; 4]);
    product(&mut c, 2, (0, 3, 2), Left::Rows { a: &[], lda: 3 }, Panels { numbers: &[], block: 3 }, Store::Set);
}

#[test]
fn a_product_may_take_some_of_the_packed_rows() {
    let (m, k, n) = (7, 40, 2 * panel() + 3);
    let (a, b) = (numbers(m * k, 1), numbers(k * n, 2));
    let mut packed = vec![0.0; panels_len(k, n)];
    pack(&mut packed, &b, n, k, n);
    for (first, steps) in [(0, 40), (0, 13), (5, 35), (8, 1), (39, 1)] {
        let left = Left::Rows { a: &a[first..], lda: k };
        let some = Panels { numbers: &packed[first * panel()..], block: k };
        let mut c = vec![0.0; m * n];
        product(&mut c, n, (m, steps, n), left, some, Store::Set);
        let truth = scalar::matmul::product((m, steps, n), Left::Rows { a: &a[first..], lda: k }, &b[first * n..]);
        let apart = c.iter().zip(truth).map(|(c, t)| (*c as f64 - t).abs()).fold(0.0, f64::max);
        assert!(apart <= bound(k), "steps {first}..{}: {apart:e} apart", first + steps);
    }
}

#[test]
fn a_row_does_not_depend_on_the_rows_beside_it() {
    let (k, n) = (300, 40);
    let (a, b) = (numbers(9 * k, 1), numbers(k * n, 2));
    let mut packed = vec![0.0; panels_len(k, n)];
    pack(&mut packed, &b, n, k, n);
    let rows = |first: usize, m: usize| {
        let mut c = vec![0.0; m * n];
        let left = Left::Rows { a: &a[first * k..], lda: k };
        product(&mut c, n, (m, k, n), left, Panels { numbers: &packed, block: k }, Store::Set);
        c
    };
    let all = rows(0, 9);
    for (first, m) in [(0, 1), (3, 2), (1, 6), (8, 1)] {
        assert_eq!(rows(first, m), all[first * n..][..m * n]);
    }
}
