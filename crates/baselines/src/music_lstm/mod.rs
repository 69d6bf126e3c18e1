//! Dances from spectra: the music-to-dance dissertation's own system, as a baseline beside the GPT that is told beats.
//!
//! The spectrum of a frame of music goes through linear layers and layers of LSTM to a last LSTM whose units are the four
//! numbers of each joint's quaternion. Nothing but the music goes in; no place in the world comes out. In training the last
//! layer sees, at some steps, the true frame in place of its own output. Source: the music-to-dance dissertation;
//! docs/music-lstm.md says what of it is printed and what is ours.
//!
//! Letters: F frames, J joints, B sequences of a batch, T steps, N numbers of a frame of music (6,150).

pub mod config;
pub mod dance;
pub mod data;
pub mod effort;
pub mod evaluate;
#[cfg(test)]
mod golden;
pub mod loss;
pub mod network;
pub mod run;
pub mod train;

pub use config::Config;

/// Frames a second that all is learned and made at.
pub const FPS: f64 = crate::aclstm::FPS;
/// N.
pub const HEARD: usize = kinelm_music::stft::COLUMNS * kinelm_music::stft::BINS;
