//! From motion to text, from text to a model, from a model to new dances.
//!
//! Everything a command of the `kinelm` program does is a function of one of these crates.
#![forbid(unsafe_code)]

mod bench;
pub mod cli;
mod demo;
pub mod presets;
mod shell;

pub use kinelm_baselines as baselines;
pub use kinelm_classify as classify;
pub use kinelm_corpus as corpus;
pub use kinelm_engine as engine;
pub use kinelm_evaluate as evaluate;
pub use kinelm_generate as generate;
pub use kinelm_model as model;
pub use kinelm_model::{Error, Result};
pub use kinelm_motion as motion;
pub use kinelm_music as music;
pub use kinelm_spectral as spectral;
pub use kinelm_store as store;
pub use kinelm_tokenizer as tokenizer;
pub use kinelm_train as train;
pub use kinelm_view as view;
