//! The models: their configuration, the plain form, weights.

mod cache;
pub mod checkpoint;
pub mod config;
mod dropout;
pub mod gpt;
pub mod layout;
pub mod ops;
pub mod run;
pub mod weights;
pub mod workers;

pub use cache::Cache;
pub use checkpoint::Which;
pub use config::{Kind, ModelConfig, Positions, TokenLayout};
pub use dropout::Dropout;
pub use gpt::Gpt;
pub use run::{LoadedRun, load_run};
