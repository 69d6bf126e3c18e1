//! The oracle: every operation once more as plain loops over one number at a time, for the tests.
pub mod adamw;
pub mod attention;
pub mod bf16;
pub mod bias;
pub mod block;
pub mod cross_entropy;
pub mod dots;
pub mod embedding;
pub mod gelu;
pub mod layer_norm;
pub mod lstm;
pub mod matmul;
pub mod rope;
