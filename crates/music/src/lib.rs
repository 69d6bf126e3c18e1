//! Reads music files; computes features and beats; a small synthesiser.
//!
//! Conventions:
//!
//! - sound is **mono**, the mean of a file's channels; samples are f32, full scale is -1 to 1; times are **seconds**;
//! - frame `f` of features of rate `s` frames per second is *centred* at time `f / s`;
//! - F frames, C channels, K bands or bins; the last index runs fastest: `(F, C)` is `frame * channels + channel`.
//!
//! Files are streamed: memory grows with the result, not with the length of the sound. This crate knows nothing of motion.
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

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
