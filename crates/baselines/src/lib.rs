//! Two baselines without tokens: the auto-conditioned LSTM ([`aclstm`]) and the music LSTM ([`music_lstm`]).
#![forbid(unsafe_code)]

pub mod aclstm;
pub mod music_lstm;
pub mod sidecar;

pub use kinelm_model::{Error, Result};
