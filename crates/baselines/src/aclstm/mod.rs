//! The auto-conditioned LSTM: the field's first method against freezing, as a baseline for the GPT.
//!
//! An LSTM that predicts the next frame drifts when it reads its own outputs. Training therefore alternates ground-truth
//! inputs with the network's own. Source: Li, Zhou, Xiao, He, Huang and Li, "Auto-conditioned recurrent networks for
//! extended complex human motion synthesis" (2018), and their published code.
//!
//! Letters: F frames, J joints, E end sites, C channels, B sequences of a batch, T steps.

pub mod config;
pub mod dance;
pub mod evaluate;
#[cfg(test)]
mod golden;
mod loss;
pub mod network;
#[cfg(test)]
mod plain;
mod rollout;
pub mod run;
mod sequences;
pub mod train;

pub use crate::form::Form;
pub use config::Config;
