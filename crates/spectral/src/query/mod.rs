//! Search in a collection of dances: windows of clips by their spectra or by a language model's own embedding.
//!
//! [`build`](build::build) makes an [`Index`] or adds to one, [`find`](find::find) answers "what else moves like this",
//! [`evaluate`](evaluate::evaluate) measures how well neighbours tell a window's labels. Source: the motion-language
//! thesis (docs/query.md); the model's embedding is ours.
//!
//! **Letters**: N windows, D numbers of a feature, Q queries, k neighbours.

pub mod build;
pub mod database;
pub mod evaluate;
pub mod exclude;
pub mod find;
pub mod index;
pub mod made_up;
pub mod maker;
pub mod model;
pub mod options;
pub mod part;
pub mod record;
pub mod search;
pub mod sheet;
#[cfg(test)]
mod tests;
mod vote;

pub use build::{Asked, Built, build};
pub use database::Database;
pub use evaluate::{EvaluateOptions, Report, evaluate};
pub use exclude::Exclude;
pub use find::{Answer, Question, find};
pub use index::Index;
pub use options::{IndexOptions, Kind};
pub use search::{Distance, Hit, Wanted};
