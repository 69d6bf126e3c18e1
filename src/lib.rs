//! From motion to text, from text to a model, from a model to new dances.
//!
//! Everything a command of the `kinelm` program does is a function here. The rooms, in the way of the data: `corpus`
//! (labels, splits, the token store), `model`, `train`, `runs`, `generate`, `evaluate`, `clean`, `study`, `spectral`,
//! `music`, `view`; and `aclstm` and `music_lstm`, baselines without tokens.
#![forbid(unsafe_code)]

pub mod aclstm;
pub mod classify;
pub mod clean;
pub mod corpus;
pub mod error;
pub mod evaluate;
pub mod generate;
pub mod model;
pub mod music;
pub mod music_lstm;
pub mod presets;
pub mod runs;
pub mod spectral;
pub mod study;
pub mod train;
pub mod view;

pub use error::{Error, Result};
