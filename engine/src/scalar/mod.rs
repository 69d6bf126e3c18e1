//! The oracle: every operation once more as plain loops over one number at a time, for the tests.
pub mod matmul;
