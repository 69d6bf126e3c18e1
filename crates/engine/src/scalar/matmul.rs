//! Products, number by number, summed in f64.

use crate::op::matmul::Left;

/// `a` (m, k) times `b` (k, n).
pub fn product((m, k, n): (usize, usize, usize), a: Left, b: &[f32]) -> Vec<f64> {
    let a = |i: usize, j: usize| match a {
        Left::Rows { a, lda } => a[i * lda + j] as f64,
        Left::Columns { a, lda } => a[j * lda + i] as f64,
    };
    let at = |i: usize, j: usize| (0..k).map(|l| a(i, l) * b[l * n + j] as f64).sum();
    (0..m * n).map(|x| at(x / n, x % n)).collect()
}
