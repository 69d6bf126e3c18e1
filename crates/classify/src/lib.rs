//! Naming dances: class tokens at the end of a window, each with a linear head, and the plain classifiers they have to beat.
//!
//! A window is `<bos>`, its labels hidden, m words of W tokens, then a class token a field. Motion stays causal; a class
//! token sees all motion and itself. Its final vector goes through one linear layer to the logits of its field. The loss is
//! the language model's on the motion plus the cross-entropies. Source: the thesis's figure 4.13;
//! docs/classification.md.
//!
//! Letters: B batch, T tokens of a window, K tokens in front, m words of W tokens, n fields, D width.
#![forbid(unsafe_code)]

pub mod baselines;
mod batches;
pub mod eval;
pub mod features;
pub mod fields;
pub mod folder;
pub mod lda;
mod learner;
pub mod measures;
mod plain;
pub mod predict;
pub mod report;
#[cfg(test)]
mod tests;
pub mod train;
mod work;

pub use eval::{Named, name_clips};
pub use fields::{Field, Fields, Only};
pub use folder::Classifier;
pub use kinelm_model::{Error, Result};
pub use measures::{Figures, Outcome};
pub use predict::Prediction;
pub use train::{TrainOptions, train};
