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

pub mod build;
pub mod conditions;
pub mod csv;
pub mod error;
#[cfg(any(test, feature = "fixtures"))]
#[doc(hidden)]
pub mod fixture;
pub mod gather;
pub mod in_out;
pub mod labels;
pub mod left_out;
pub mod load;
pub mod masking;
pub mod merge;
pub mod music;
pub mod ours;
pub mod pattern;
pub mod record;
mod rows;
#[cfg(any(test, feature = "fixtures"))]
#[doc(hidden)]
pub mod samples;
pub mod settings;
pub mod shared_runs;
pub mod sidecar;
pub mod splits;
pub mod stats;
pub mod store;
pub mod stored;
pub mod timed;
pub mod windows;
pub mod words;
pub mod writer;

pub use build::{BuildOptions, Event, Summary, fit, tokenize};
pub use conditions::Conditions;
pub use error::{Error, Result};
pub use gather::{Gathered, Item, gather};
pub use load::{Loaded, load_item};
pub use masking::fill_masked;
pub use merge::merge;
pub use record::{ClipRecord, Count, Manifest, Shard, Split, TokenType};
pub use settings::Settings;
pub use stats::{Stats, stats};
pub use store::{Coding, Corpus, Opening, Tokens};
pub use windows::{EvalWindow, each_eval_window, eval_windows, fill_sequence};
pub use words::ClipWords;
pub use writer::{CorpusWriter, NewClip};
