//! The operations, each a safe function on slices that checks its shapes.

#[cfg(test)]
pub(crate) mod check;
pub mod dropout;
pub(crate) mod math;
pub mod matmul;
