//! The operations, each a safe function on slices that checks its shapes.

pub mod adamw;
pub mod attention;
pub(crate) mod bf16;
pub mod bias;
pub(crate) mod cell;
#[cfg(test)]
pub(crate) mod check;
pub mod cross_entropy;
pub mod dots;
pub mod dropout;
pub mod embedding;
pub mod exp64;
pub mod gelu;
pub mod layer_norm;
pub(crate) mod math;
pub mod matmul;
pub mod products;
pub mod rope;
pub mod smoothing;

/// How many rows of `width` numbers `len` numbers are.
///
/// # Panics
/// If they aren't whole rows.
#[track_caller]
fn rows(what: &str, len: usize, width: usize) -> usize {
    assert!(width > 0 && len.is_multiple_of(width), "{what}: {len} numbers are no rows of {width}");
    len / width
}
