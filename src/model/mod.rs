//! The models: their configuration, the plain form, weights.

mod cache;
pub mod config;
mod dropout;
pub mod gpt;
pub mod layout;
pub mod ops;
pub mod weights;

pub use cache::Cache;
pub use config::{Kind, ModelConfig, Positions, TokenLayout};
pub use dropout::Dropout;
pub use gpt::Gpt;
