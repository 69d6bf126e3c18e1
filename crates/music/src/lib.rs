//! Music files to samples, features and beats; and a small synthesiser.
//!
//! The conventions, stated once and kept everywhere:
//!
//! - sound is **mono**, the mean of a file's channels; samples are f32, full scale is -1 to 1; times are **seconds**;
//! - frame `f` of features of rate `s` frames per second is *centred* at time `f / s`;
//! - F frames, C channels, K bands or bins; the last index runs fastest: `(F, C)` is `frame * channels + channel`.
//!
//! Everything that reads a file streams it: memory grows with what is asked for, not with the sound. This crate knows
//! nothing of motion.
#![forbid(unsafe_code)]

pub mod beat;
pub mod error;
pub mod feature;
pub mod frames;
pub mod read;
pub mod resample;
pub mod stft;
pub mod synth;
pub mod wav;

pub use error::{Error, FaultKind, FileError, Result};

/// The examples of the README are tested with those of the code.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
