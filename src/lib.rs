//! From motion to text, from text to a model, from a model to new dances.
//!
//! Everything a command of the `kinelm` program does is a function of one of these crates. In the way of the data:
//!
//! [`motion`] reads files into clips, and [`tokenizer`] writes clips as words; here of two dances that are made up:
//!
//! ```
//! use kinelm::motion::synth;
//! use kinelm::tokenizer::{Tokenizer, TokenizerConfig};
//!
//! let dances: Vec<_> = synth::corpus(1, 2, 4.0, 20.0)?.into_iter().map(|dance| dance.clip).collect();
//! let tokenizer = Tokenizer::fit(&dances, TokenizerConfig::default())?;
//! let words = tokenizer.encode(&dances[0])?.words;
//! assert_eq!(words.len(), dances[0].frames(), "a frame is a word");
//! let ids = tokenizer.ids_of_words(&words)?;
//! let back = tokenizer.decode(&tokenizer.words_of_ids(&ids).words, tokenizer.uncoded_pose())?;
//! assert_eq!(back.frames(), dances[0].frames());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`corpus`] keeps the words of many clips, [`train`] a run of a [`model`] that learns them, [`generate`] makes new dances:
//!
//! ```no_run
//! use kinelm::generate::{Length, OpenRequest, PromptRequest, Request};
//!
//! let prompt = PromptRequest { joints: Some("root,torso,right_arm".into()), ..PromptRequest::of("dances/03.bvh") };
//! let request = Request { prompt: Some(prompt), length: Some(Length::Seconds(10.0)), ..Request::of("run") };
//! OpenRequest::open(&request)?.write("dance.bvh")?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`view`] makes a page to watch them on:
//!
//! ```
//! use kinelm::motion::synth;
//! use kinelm::view::{Figure, write_page};
//!
//! let dance = synth::corpus(1, 1, 4.0, 20.0)?.remove(0).clip;
//! let folder = tempfile::tempdir()?;
//! write_page(&folder.path().join("page.html"), &[Figure::new("made up", &dance).note("4 seconds")])?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Beside them: [`evaluate`] measures tokens, models and dances, [`classify`] names dancer and genre, [`spectral`] searches,
//! filters and interpolates, [`baselines`] are networks without tokens; [`music`] reads sound, [`engine`] computes,
//! [`store`] writes files whole.
#![forbid(unsafe_code)]

pub mod cli;
mod demo;
pub mod presets;
mod shell;

pub use kinelm_baselines as baselines;
pub use kinelm_classify as classify;
pub use kinelm_corpus as corpus;
pub use kinelm_engine as engine;
pub use kinelm_evaluate as evaluate;
pub use kinelm_generate as generate;
pub use kinelm_model as model;
pub use kinelm_model::{Error, Result};
pub use kinelm_motion as motion;
pub use kinelm_music as music;
pub use kinelm_ready as ready;
pub use kinelm_spectral as spectral;
pub use kinelm_store as store;
pub use kinelm_tokenizer as tokenizer;
pub use kinelm_train as train;
pub use kinelm_view as view;
