//! Durable files and folders, hashes, random streams, errors, and which files a call may overwrite.
//!
//! This crate knows nothing of motion. All files are read through [`input`], so that no call overwrites its inputs
//! ([`output`]); files that later steps depend on are written completely or not at all ([`files`], [`part`], [`sidecar`]); nothing
//! in a folder that kinelm continues leads out of it ([`owned`]); every use of randomness has its own stream
//! ([`random`]).
#![forbid(unsafe_code)]

pub mod error;
pub mod files;
pub mod hash;
pub mod input;
pub mod memory;
pub mod output;
pub mod owned;
pub mod part;
pub mod presets;
pub mod random;
pub mod sidecar;
pub mod suggest;

pub use error::{Error, Fault, Kind, Result, SourcePos, Subject};
pub use hash::FileRecord;

/// A count with its noun, given in the plural: "1 clip", "2 clips".
///
/// ```
/// assert_eq!(kinelm_store::counted(1, "clips"), "1 clip");
/// ```
pub fn counted(n: usize, words: &str) -> String {
    let word = if n == 1 { words.strip_suffix('s').unwrap_or(words) } else { words };
    format!("{n} {word}")
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
