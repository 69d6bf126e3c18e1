//! Training: from a corpus to a run folder.

pub mod adamw;
pub mod batches;
pub mod config;
#[cfg(test)]
pub(crate) mod fixture;
pub mod metrics;
#[cfg(test)]
mod parity;
mod pretrain;
pub mod progress;
pub mod run;
pub mod schedule;
pub mod step;
mod tensorboard;

pub use config::{TrainConfig, TrainFile};
pub use pretrain::{PretrainOptions, Summary, pretrain};
pub use progress::{Lines, Progress, Silent};
pub use schedule::Schedule;
