//! Baselines without tokens: the auto-conditioned LSTM ([`aclstm`]) and the music LSTM ([`music_lstm`]).
//!
//! What both share: motion ([`data`], [`rig`], [`form`]), run folders ([`run`]), training ([`train`], a loss of [`Parts`]),
//! sidecars of dances ([`sidecar`]).
#![forbid(unsafe_code)]

pub mod aclstm;
pub mod data;
pub mod form;
mod mean;
pub mod music_lstm;
mod parts;
pub mod rig;
pub mod run;
pub mod sidecar;
pub mod train;

pub use kinelm_model::{Error, Result};
pub use mean::Mean;
pub use parts::{Loss, PartWeights, Parts};
pub use run::{Changes, RunConfig, Settings};

/// Frames a second of training and generation.
pub const FPS: f64 = 30.0;
