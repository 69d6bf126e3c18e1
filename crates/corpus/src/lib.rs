//! Corpora: labels, splits, the token store on disk, windows.
//!
//! A corpus is a folder: `corpus.json` ([`Manifest`]), `tokens.u16` or `tokens.u32` (little-endian, the words of all
//! clips one after the other), `clips.jsonl` (a [`ClipRecord`] a line) and `tokenizer.json`. Four lines of numpy read
//! it, whether words have one length or any; the space that ends a word is 5:
//!
//! ```python
//! clips = [json.loads(line) for line in open("corpus/clips.jsonl")]
//! tokens = np.fromfile("corpus/tokens.u16", "<u2")
//! first = tokens[clips[0]["offset"]:][:clips[0]["tokens"]]
//! words = np.split(first, np.flatnonzero(first == 5) + 1)[:-1]
//! ```
#![forbid(unsafe_code)]

pub mod archive;
pub mod array_file;
pub mod artifacts;
pub mod build;
mod clip_info;
pub mod conditions;
mod csv;
pub mod dataset;
pub mod error;
pub mod exclude;
#[cfg(any(test, feature = "fixtures"))]
#[doc(hidden)]
pub mod fixture;
pub mod in_out;
mod item;
pub mod label_table;
pub mod labels;
pub mod load;
mod masking;
pub mod merge;
pub mod music;
pub mod pattern;
pub mod record;
#[cfg(any(test, feature = "fixtures"))]
#[doc(hidden)]
pub mod samples;
mod segments;
pub mod settings;
mod shared_runs;
pub mod sidecar;
mod splits;
pub mod stats;
pub mod store;
mod tokens;
pub mod windows;
pub mod words;
pub mod writer;

pub use build::{BuildEvent, BuildOptions, BuildProgress, Summary, fit, for_each_clip, tokenize};
pub use conditions::Conditions;
pub use dataset::Dataset;
pub use error::{Error, Result};
pub use item::Item;
pub use load::{ClipSpec, ModelClip};
pub use masking::{SpanMasking, WindowTokens, fill_masked};
pub use merge::merge;
pub use record::{ClipRecord, Count, Manifest, Shard, Split};
pub use settings::Settings;
pub use stats::{Stats, stats};
pub use store::{Corpus, CorpusOptions};
pub use tokens::Tokens;
pub use windows::{EvalWindow, each_eval_window, eval_windows, fill_sequence};
pub use words::ClipWords;
pub use writer::{CorpusWriter, NewClip};
