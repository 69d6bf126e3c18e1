//! Measures: what a corpus costs without a model and with one, and what the dances are that it makes.
#![forbid(unsafe_code)]

pub mod baselines;
pub mod codes;
pub mod dance;
pub mod floors;
pub mod gap_bits;
pub mod gaps;
pub mod kernels;
pub mod music;
pub mod per_joint;
pub mod prediction;
pub mod sample;
pub mod study;
pub mod takes;
pub mod token_floors;
pub mod xz;

pub use baselines::{Baselines, measure};
pub use codes::{CodeClips, CodeSplits};
pub use floors::Floors;
pub use kinelm_model::{Error, Result};
pub use sample::Extent;
