//! Measures: what a corpus costs without a model and with one, and what the dances are that it makes.
#![forbid(unsafe_code)]

pub mod blind;
pub mod bootstrap;
pub mod dance;
pub mod floors;
pub mod gap_bits;
pub mod gaps;
pub mod likelihood;
pub mod music;
mod number;
pub mod per_joint;
pub mod prediction;
pub mod study;
pub mod words_page;

pub use floors::{ChannelFloors, CodeSplits, Extent, Floors};
pub use kinelm_model::{Error, Result};
