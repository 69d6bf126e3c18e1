//! Encodes motion as words and ids, and decodes them.
//!
//! A frame of motion is a *word*: C characters, one per channel (the root's translation x y z, then the rotation vector x y z of
//! each coded joint by ascending id), then a space. A character is one of the bins of its channel. In tile schemes a word is a
//! tile of frames, and its characters are coefficients of a transform over time.
//!
//! ```
//! use kinelm_motion::{Clip, Quat, Vec3, smpl};
//! use kinelm_tokenizer::{UncodedPose, Tokenizer, TokenizerConfig};
//!
//! let standing = Clip::new(smpl::neutral(), 20.0, vec![Vec3::new(0.0, 0.97, 0.0); 3], vec![Quat::IDENTITY; 72])?;
//! let tokenizer = Tokenizer::fit([&standing], TokenizerConfig::default())?;
//! let words = tokenizer.encode(&standing)?.words;
//! let text = tokenizer.text(&words)?;
//! assert_eq!(text.split(' ').next().unwrap().chars().count(), 57);
//! assert_eq!(tokenizer.words_of_text(&text)?, words);
//! assert_eq!(tokenizer.decode(&words, UncodedPose::Identity)?.frames(), 3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! From the outside in: [`Tokenizer`] is the artefact on disk; a [`scheme`] turns clips into [`Words`] of codes (integers
//! below the number of symbols) and back; [`alphabet`] maps codes to characters; [`Vocabulary`] gives every character,
//! merged, special and conditioning token its id; [`Grammar`] defines which ids each slot of a word allows.
//!
//! **Features**: `fit` ([`Fit`], [`Tokenizer::fit`]) needs a matrix library, `merges` Hugging Face's trainer of byte-pair
//! merges; a fitted tokenizer needs neither. `ndarray` gives codes as its arrays. All are on by default.
#![forbid(unsafe_code)]
// parts that only fitting uses
#![cfg_attr(not(feature = "fit"), allow(dead_code, unused_imports))]

pub mod alphabet;
mod artifact;
mod channel;
mod config;
#[cfg(test)]
mod contract;
mod error;
#[cfg(feature = "fit")]
mod fit;
mod grammar;
#[cfg(feature = "fit")]
mod mean_pose;
pub mod meaning;
#[cfg(test)]
mod meaning_tests;
mod merges;
pub mod rate;
pub mod root_path;
#[cfg(feature = "fit")]
mod sample;
pub mod scheme;
#[cfg(test)]
mod streams;
mod tokenizer;
pub mod transform;
mod vocab;
mod word;
mod words;

pub use artifact::{FORMAT_VERSION, MAX_FILE_BYTES};
pub use channel::{Channel, Channels, RootRotation};
pub use config::TokenizerConfig;
pub use error::{Error, Result};
#[cfg(feature = "fit")]
pub use fit::Fit;
pub use grammar::{Grammar, Slot, SlotIds};
pub use scheme::angle::Form;
pub use scheme::dct::{DctConfig, Quantizer, Steps};
pub use scheme::lapped::{Lapped, LappedConfig, LappedMix};
pub use scheme::mix::JointTransform;
pub use scheme::quantile::{Pooled, QuantileConfig};
pub use scheme::uniform::{Height, Travel, UniformConfig};
pub use scheme::{Encoded, Scheme, SchemeConfig, UncodedPose, WordLength};
pub use tokenizer::Tokenizer;
pub use vocab::{SPACE, Special, Vocabulary};
pub use word::Words;
pub use words::ParsedWords;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
