//! The auto-conditioned LSTM: the field's oldest cure for freezing, as a baseline beside the GPT.
//!
//! An LSTM that foretells the next frame drifts once it sees its own frames, so it is fed them in training too, some steps
//! true and some its own by turns. Source: Li, Zhou, Xiao, He, Huang and Li, "Auto-conditioned recurrent networks for
//! extended complex human motion synthesis" (2018), and the code they published.
//!
//! Letters: F frames, J joints, E end sites, C channels, B sequences of a batch, T steps.

pub mod config;
pub mod dance;
pub mod data;
pub mod evaluate;
pub mod form;
mod going_on;
#[cfg(test)]
mod golden;
pub mod loss;
pub mod network;
#[cfg(test)]
mod plain;
pub mod rig;
pub mod run;
pub mod train;

pub use config::Config;
pub use form::Form;
pub use rig::Rig;

/// Frames a second that all is learned and made at.
pub const FPS: f64 = 30.0;
