//! Windows as a language model reads them. Its crates are above this one, so a caller that has them says how a run is
//! opened.

use crate::{Error, Result};
use kinelm_motion::Clip;
use std::fmt::Debug;
use std::path::Path;

/// The tokens of a window.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tokens {
    /// Ids of whole words.
    pub ids: Vec<u32>,
    /// The first token of each word.
    pub starts: Vec<u32>,
}

/// A model that maps a window of motion to a vector.
pub trait WindowEmbedding: Send + Sync {
    /// The tokens of a window, which is on the 24 SMPL joints at any rate; many windows side by side.
    ///
    /// # Errors
    /// A clip that the model's tokenizer can't encode.
    fn tokens(&self, window: &Clip) -> Result<Tokens>;

    /// D.
    fn width(&self) -> usize;

    /// (N, D) the vectors of windows.
    ///
    /// # Errors
    /// Ids outside the vocabulary; a model whose vectors are not finite.
    fn embed(&self, windows: &[Tokens]) -> Result<Vec<f32>>;
}

/// Opens the model of a run's folder if its weights have this SHA-256.
pub(crate) type OpenModel = fn(run: &Path, weights: &str) -> Result<Box<dyn WindowEmbedding>>;

/// How the model of [`super::FeatureKind::Model`] is opened; by default not at all.
#[derive(Debug, Clone, Copy)]
pub struct Models(pub OpenModel);

impl Default for Models {
    fn default() -> Models {
        Models(|run, _| {
            let what = format!("the embedding of {}", run.display());
            Err(Error::unsupported(what, "windows are compared without a language model here"))
        })
    }
}
