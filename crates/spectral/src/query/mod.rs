//! Search in a collection of dances: windows of clips by their spectra or by a language model's own embedding.
//!
//! [`Index::build`] makes an index or adds to one, [`Index::find`] answers "what else moves like this",
//! [`evaluate`](evaluate::evaluate) measures how often neighbours share a window's labels. Source: the motion-language
//! thesis (docs/query.md); the model's embedding is ours.
//!
//! **Letters**: N windows, D numbers of a feature, Q queries, k neighbours.

mod block;
pub mod build;
mod candidates;
mod database;
mod distance;
pub mod embedding;
pub mod evaluate;
mod exclude;
mod extract;
mod find;
mod index;
mod options;
mod part;
mod promise;
mod quantize;
pub(crate) mod record;
mod search;
pub mod synthetic;
pub mod tables;
#[cfg(test)]
mod tests;
mod vote;
mod writer;

pub use build::{BuildReport, IndexRequest};
pub use database::Database;
pub use distance::{Distance, SearchOptions};
pub use embedding::{Models, WindowEmbedding};
pub use evaluate::{EvaluateOptions, Report, evaluate};
pub use exclude::Exclude;
pub use find::{Match, Query, SearchResult};
pub use index::Index;
pub use options::{FeatureKind, IndexOptions, joint_names};
pub use search::{Allowed, Found, Hit, Search};
