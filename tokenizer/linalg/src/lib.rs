//! Eigenvectors, principal components, triangles and products of small matrices.
//!
//! A crate of its own because faer is generic: its code is compiled here once (half a minute), not with every change of the
//! crates that use it. Matrices are slices, row by row. Everything runs on one thread: the same input gives the same bytes.
#![forbid(unsafe_code)]

mod pca;

pub use pca::{Pca, largest_positive, mean, principal_components};

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par, Side};

/// Eigenvalues of a symmetric matrix (n, n), falling, and its unit eigenvectors as the rows of (n, n).
///
/// Only the lower triangle is read. The sign of a vector is arbitrary. `None` when numbers are not finite or too large.
///
/// ```
/// let (values, vectors) = kinelm_linalg::symmetric_eigen(2, &[2.0, 0.0, 0.0, 5.0]).unwrap();
/// assert_eq!((values, vectors[1].abs()), (vec![5.0, 2.0], 1.0));
/// ```
///
/// # Panics
/// When `matrix` isn't n x n.
pub fn symmetric_eigen(n: usize, matrix: &[f64]) -> Option<(Vec<f64>, Vec<f64>)> {
    assert_eq!(matrix.len(), n * n, "a matrix of {n} x {n}");
    if matrix.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let found = MatRef::from_row_major_slice(matrix, n, n).self_adjoint_eigen(Side::Lower).ok()?;
    let (u, s) = (found.U(), found.S().column_vector());
    let values: Vec<f64> = (0..n).rev().map(|i| s[i]).collect();
    let vectors: Vec<f64> = (0..n).rev().flat_map(|i| (0..n).map(move |j| u[(j, i)])).collect();
    values.iter().chain(&vectors).all(|x| x.is_finite()).then_some((values, vectors))
}

/// `a` (m, k) times `b` (k, n), or where `transposed` times the transpose of `b` (n, k): (m, n).
///
/// # Panics
/// When a slice doesn't have its shape's length.
pub fn product([m, k, n]: [usize; 3], a: &[f64], b: &[f64], transposed: bool) -> Vec<f64> {
    let mut out = vec![0.0; m * n];
    let a = MatRef::from_row_major_slice(a, m, k);
    let b = if transposed {
        MatRef::from_row_major_slice(b, n, k).transpose()
    } else {
        MatRef::from_row_major_slice(b, k, n)
    };
    matmul(MatMut::from_row_major_slice_mut(&mut out, m, n), Accum::Replace, a, b, 1.0, Par::Seq);
    out
}

/// The lower triangle L of a symmetric matrix (n, n) that is L times its transpose, (n, n) with zeros above the diagonal.
/// `None` when the matrix isn't positive definite.
///
/// Only the lower triangle is read.
///
/// ```
/// assert_eq!(kinelm_linalg::cholesky(2, &[4.0, 0.0, 2.0, 10.0]), Some(vec![2.0, 0.0, 1.0, 3.0]));
/// ```
///
/// # Panics
/// When `matrix` isn't n x n.
pub fn cholesky(n: usize, matrix: &[f64]) -> Option<Vec<f64>> {
    assert_eq!(matrix.len(), n * n, "a matrix of {n} x {n}");
    let found = MatRef::from_row_major_slice(matrix, n, n).llt(Side::Lower).ok()?;
    let lower: Vec<f64> = (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).map(|at| found.L()[at]).collect();
    lower.iter().all(|x| x.is_finite()).then_some(lower)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let (values, vectors) = symmetric_eigen(2, &[2.0, 1.0, 1.0, 2.0]).unwrap();
        assert!((values[0] - 3.0).abs() < 1e-14 && (values[1] - 1.0).abs() < 1e-14);
        assert!((vectors[0] - vectors[1]).abs() < 1e-14 && (vectors[2] + vectors[3]).abs() < 1e-14);
        assert!((vectors[0].powi(2) + vectors[1].powi(2) - 1.0).abs() < 1e-14);
        assert_eq!(symmetric_eigen(0, &[]), Some((vec![], vec![])));
        assert_eq!(symmetric_eigen(1, &[f64::NAN]), None);
        assert_eq!((cholesky(2, &[1.0, 0.0, 2.0, 1.0]), cholesky(1, &[f64::NAN])), (None, None));
        let (a, b) = ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [1.0, 0.0, 2.0, -1.0, 1.0, 3.0]);
        assert_eq!(product([2, 3, 2], &a, &b, false), [8.0, 7.0, 20.0, 13.0]);
        assert_eq!(product([2, 3, 2], &a, &b, true), [7.0, 10.0, 16.0, 19.0]);
        assert_eq!(product([0, 3, 2], &[], &b, false), []);
    }
}
