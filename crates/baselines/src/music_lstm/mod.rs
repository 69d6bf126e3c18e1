//! The music LSTM: dances from spectra, the music-to-dance dissertation's own system, as a baseline for the GPT with music
//! conditioning.
//!
//! The spectrum of a frame of music passes linear layers and LSTM layers to a last LSTM whose units are the quaternions of
//! all joints. Music is the only input; the output has no root position. In training, teacher forcing replaces the last
//! layer's own output by the true frame at some steps. Source: the music-to-dance dissertation; docs/baselines.md says what
//! it prints and what is ours.
//!
//! Letters: F frames, J joints, B sequences of a batch, T steps, N numbers of a frame of music (6,150).

pub mod config;
pub mod dance;
pub mod data;
mod effort;
pub mod evaluate;
#[cfg(test)]
mod golden;
mod loss;
mod network;
pub mod run;
pub mod train;

pub use config::Config;

/// N.
pub(crate) const SPECTRUM: usize = kinelm_music::stft::COLUMNS * kinelm_music::stft::BINS;
