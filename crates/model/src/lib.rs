//! The models: their configuration, the plain form, weights.
#![forbid(unsafe_code)]

mod architecture;
mod cache;
pub mod checkpoint;
mod choice;
pub mod class_windows;
pub mod config;
mod decode;
mod device;
mod dropout;
pub mod error;
pub mod exchange;
pub mod fast;
#[cfg(any(test, feature = "fixtures"))]
#[doc(hidden)]
pub mod fixtures;
pub mod forecast;
mod frames;
pub mod goal;
#[cfg(test)]
mod golden;
mod gpt;
mod head_groups;
pub mod layout;
pub mod lead_in;
pub mod likelihood;
pub mod music;
mod net;
mod ops;
mod position;
mod previous;
mod pseudo_likelihood;
pub mod run;
pub mod scored_windows;
mod scores;
mod sequence;
pub mod weights;
pub mod words;

pub use cache::Cache;
pub use choice::{CheckpointChoice, Keep};
pub use config::{Architecture, DecoderConfig, HeadKind, ModelConfig, ModelKind, Positions, TokenLayout};
pub use decode::{FrameConditioning, KvKind, Logits, Reader, ReaderOptions, SavedSequence, WeightKind};
pub use device::{Compute, DeviceName, Form};
pub use dropout::Dropout;
pub use error::{Error, Result};
pub use gpt::Gpt;
pub use ops::Mask;
pub use run::{LoadedRun, load_run};
pub use scores::{Scores, TokenWindows};
