//! Baselines without tokens: the auto-conditioned LSTM ([`aclstm`]) and the music LSTM ([`music_lstm`]).
//!
//! What both share: motion ([`data`], [`rig`], [`form`]), run folders ([`run`]), training ([`train`]), sidecars of dances
//! ([`sidecar`]).
#![forbid(unsafe_code)]

pub mod aclstm;
pub mod data;
pub mod form;
mod mean;
pub mod music_lstm;
pub mod rig;
pub mod run;
pub mod sidecar;
pub mod train;

pub use kinelm_model::{Error, Result};
pub use mean::Mean;
pub use run::{Changes, RunConfig, Settings};

/// Frames a second of training and generation.
pub const FPS: f64 = 30.0;
