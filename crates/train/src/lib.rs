//! Training: from a corpus to a run folder.
#![forbid(unsafe_code)]

pub mod adamw;
pub mod augment;
pub mod average;
pub mod batches;
pub mod config;
pub mod data;
pub mod fast;
pub mod finetune;
#[cfg(any(test, feature = "fixtures"))]
#[doc(hidden)]
pub mod fixture;
pub mod folder;
mod gaps;
pub mod grow;
mod heard;
pub mod import;
pub mod lead_ins;
pub mod learner;
pub mod lr_find;
pub mod metrics;
pub mod order;
pub mod parameters;
#[cfg(test)]
mod parity;
pub mod plain;
pub mod precision;
pub mod pretrain;
pub mod progress;
pub mod provenance;
pub mod room;
pub mod run;
pub mod runs;
pub mod sample;
pub mod schedule;
#[cfg(test)]
mod shapes;
pub mod stages;
mod tensorboard;
pub mod updates;
pub mod window;

pub use config::{TrainConfig, TrainFile};
pub use data::{CorpusPart, Data};
pub use kinelm_model::{Error, Result};
pub use learner::{Found, Learner, learner};
pub use precision::Precision;
pub use pretrain::{PretrainOptions, Summary, pretrain};
pub use progress::{Lines, Progress, Silent};
pub use schedule::Schedule;
