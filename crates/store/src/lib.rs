//! Durable files and folders, hashes, random streams, and what a call may write over.
//!
//! Nothing here knows motion. Every file is read through [`input`], so that no call writes over what it has read
//! ([`output`]); what later steps depend on is written whole or not at all ([`files`], [`sidecar`]); every random number
//! comes from a stream of its own ([`random`]).
#![forbid(unsafe_code)]

pub mod error;
pub mod files;
pub mod hash;
pub mod input;
pub mod memory;
pub mod output;
pub mod presets;
pub mod random;
pub mod sidecar;
pub mod suggest;

pub use error::{Error, Kind, Result, SourcePos};
pub use hash::FileRecord;

/// So many of what a word in the plural names: "1 clip", "2 clips".
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
