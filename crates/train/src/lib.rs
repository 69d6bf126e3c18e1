//! Training: from a corpus to a run folder.
//!
//! [`trainer`] is the one training loop; a [`trainer::Task`] is what it trains: a GPT ([`pretrain`](fn@pretrain),
//! [`finetune`](fn@finetune)), the learning-rate range test, and the classifiers and LSTMs of other crates.
#![forbid(unsafe_code)]

mod adamw;
mod augment;
pub mod batches;
pub mod branch;
pub mod config;
pub mod data;
pub mod ema;
mod factory;
pub mod fast;
#[cfg(any(test, feature = "fixtures"))]
#[doc(hidden)]
pub mod fixture;
pub mod folder;
mod gaps;
pub mod import;
mod lead_ins;
pub mod learner;
mod limits;
pub mod lr_find;
mod memory;
pub mod metrics;
mod music;
pub mod optimizer;
pub mod order;
#[cfg(test)]
mod parity;
mod plain;
mod precision;
pub mod pretrain;
pub mod progress;
pub mod provenance;
pub mod resize;
pub mod run;
pub mod runs;
pub mod sample;
pub mod schedule;
#[cfg(test)]
mod shapes;
mod stages;
mod tensorboard;
pub mod train_file;
pub mod trainer;
mod window;

pub use branch::Branch;
pub use config::{Schedule, TrainConfig};
pub use data::{CorpusPart, Data};
pub use factory::learner;
pub use kinelm_model::{Error, Result};
pub use learner::{BatchLoss, Learner};
pub use precision::Precision;
pub use pretrain::{PretrainOptions, RESUMABLE, Summary, finetune, pretrain};
pub use progress::{NoProgress, Progress};
pub use train_file::TrainFile;
pub use trainer::{Task, Trainer};
