//! Measures: what a corpus costs without a model, and later what a model makes of it.

pub mod baselines;
pub mod codes;
pub mod floors;
pub mod kernels;
pub mod likelihood;
mod pseudo;
pub mod token_floors;
pub mod xz;

pub use baselines::{Baselines, measure};
pub use codes::{CodeClips, CodeSplits};
pub use floors::Floors;
