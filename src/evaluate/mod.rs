//! Measures: what a corpus costs without a model, and later what a model makes of it.

pub mod baselines;
pub mod codes;
pub mod kernels;
pub mod likelihood;
pub mod xz;

pub use baselines::{Baselines, measure};
pub use codes::{CodeClips, CodeSplits};
