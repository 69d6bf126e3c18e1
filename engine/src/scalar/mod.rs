//! The oracle: every operation once more as plain loops over one number at a time, for the tests.
pub mod bias;
pub mod gelu;
pub mod layer_norm;
pub mod matmul;
