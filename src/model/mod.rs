//! The models: their configuration, the plain form, weights.

pub mod ahead;
pub mod architecture;
mod cache;
pub mod checkpoint;
pub mod config;
mod device;
mod dropout;
pub mod exchange;
pub mod fast;
#[cfg(test)]
pub(crate) mod forms;
mod frames;
#[cfg(test)]
mod golden;
pub mod gpt;
pub mod layout;
pub mod lead_in;
pub mod music;
mod net;
pub mod ops;
pub mod past;
mod position;
mod questions;
mod reader;
pub mod run;
mod scores;
pub mod weights;

pub use architecture::{Architecture, DecoderConfig};
pub use cache::Cache;
pub use checkpoint::Which;
pub use config::{HeadKind, Kind, ModelConfig, Positions, TokenLayout};
pub use device::{Compute, DeviceName, Form};
pub use dropout::Dropout;
pub use gpt::Gpt;
pub use ops::Mask;
pub use reader::{Reader, Reading};
pub use run::{LoadedRun, load_run};
pub use scores::Scores;
