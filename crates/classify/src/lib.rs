//! Classification of dances: class tokens at the end of a window, each with a linear head, and plain classifiers as baselines.
//!
//! A window is `<bos>`, its labels hidden, m words of W tokens, then a class token per field. Motion stays causal; a class
//! token attends to all motion and itself. A linear layer maps its final vector to the logits of its field. The loss is
//! the language model's on the motion plus the cross-entropies. Source: the thesis's figure 4.13; docs/classification.md.
//!
//! Letters: B batch, T tokens of a window, K tokens in front, m words of W tokens, n fields, D width.
#![forbid(unsafe_code)]

mod batches;
mod class_scores;
pub mod embedding;
pub mod evaluate;
pub mod features;
pub mod fields;
pub mod folder;
mod fusion;
pub mod lda;
mod learner;
pub mod metrics;
pub mod options;
mod plain;
mod predict;
mod report;
mod scores;
mod state;
#[cfg(test)]
mod tests;
pub mod train;
mod unfinished;

pub use class_scores::ClassScores;
pub use evaluate::Comparison;
pub use fields::{Field, Fields};
pub use folder::Classifier;
pub use kinelm_model::{Error, Result};
pub use metrics::{Metrics, Outcome};
pub use options::TrainOptions;
pub use predict::Prediction;
pub use train::train;
