//! Products of numbers rounded to bf16, number by number, summed in f64.

use crate::op::matmul::Left;

/// `a` (m, k) times `b` (k, n).
pub fn product(shape: (usize, usize, usize), a: Left, b: &[f32]) -> Vec<f64> {
    let rounded = |x: &[f32]| x.iter().map(|x| half::bf16::from_f32(*x).to_f32()).collect::<Vec<f32>>();
    match a {
        Left::Rows { a, lda } => super::matmul::product(shape, Left::Rows { a: &rounded(a), lda }, &rounded(b)),
        Left::Columns { a, lda } => super::matmul::product(shape, Left::Columns { a: &rounded(a), lda }, &rounded(b)),
    }
}
