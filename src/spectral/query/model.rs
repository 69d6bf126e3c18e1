//! A language model's own embedding of a window: the mean of its final vectors over the window's tokens.
//!
//! The window's frames are brought to the run's rate and tokenized with the run's tokenizer; what stands in front says of
//! every label that it is unknown. Windows longer than the context are read in overlapping pieces as when a model is
//! measured ([`eval_windows`]), each token counting once. Not in the thesis.

use super::options::Kind;
use crate::corpus::words::ClipWords;
use crate::corpus::{Conditions, EvalWindow, eval_windows};
use crate::model::fast::{Fast, Windows};
use crate::model::{Kind as ModelKind, Which, load_run};
use crate::{Error, Result};
use kinelm_motion::Clip;
use kinelm_motion::resample::{Method, resample};
use kinelm_tokenizer::{SPACE, Tokenizer};
use std::path::Path;

/// Tokens that the model reads at a time.
const BATCH: usize = 4096;

/// The tokens of a window.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tokens {
    ids: Vec<u32>,
    /// The first token of each word.
    starts: Vec<u32>,
}

/// Says windows in the words of a run.
pub struct Speaker(Tokenizer);

/// Reads them.
pub struct Reader {
    model: Fast,
    front: Vec<u32>,
    pad: u32,
    context: usize,
    width: usize,
}

/// The kind of index that a run makes.
///
/// # Errors
/// As [`load_run`]; weights that can't be read; a two-level model.
pub fn kind_of(run: &Path) -> Result<Kind> {
    let loaded = load_run(run, Which::Auto)?;
    if !loaded.config.architecture.is_flat() {
        let help = "give a run of `architecture = \"flat\"`";
        return Err(Error::file(run, "a two-level model", "one whose vectors are of tokens", help));
    }
    let weights = loaded.weights_sha256();
    Ok(Kind::Model { run: std::path::absolute(run).map_err(Error::io(run))?, weights })
}

/// Opens the run that an index was made with.
///
/// # Errors
/// As [`load_run`]; other weights than `weights`; a model that isn't causal or whose context holds no word.
pub fn open(run: &Path, weights: &str) -> Result<(Speaker, Reader)> {
    let loaded = load_run(run, Which::Auto)?;
    let found = loaded.weights_sha256();
    if found != weights {
        let (found, expected) = (format!("weights {found}"), format!("weights {weights}, as the index was built with"));
        return Err(Error::file(run, found, expected, "the run was trained on: build the index again with it"));
    }
    if loaded.config.kind != ModelKind::Causal {
        return Err(Error::file(run, "a masked model", "a causal one", "give a run of `kind = \"causal\"`"));
    }
    // labels must not stand in what is compared by labels
    let conditions: Conditions = loaded.load_conditions()?.unknown();
    let front = conditions.front(&Default::default());
    let (context, width, pad) = (loaded.config.context, loaded.config.width, loaded.tokens.pad);
    if context <= front.len() {
        return Err(Error::file(run, format!("a context of {context} tokens"), "room for words", ""));
    }
    let speaker = Speaker(loaded.load_tokenizer()?);
    let model = Fast::from_tensors(&loaded.config, &loaded.tokens, loaded.weights)?;
    Ok((speaker, Reader { model, front, pad, context, width }))
}

impl Speaker {
    /// The tokens of a window, which is on the 24 SMPL joints at any rate.
    ///
    /// # Errors
    /// A clip that the tokenizer can't say.
    pub fn tokens(&self, window: &Clip) -> Result<Tokens> {
        let clip = resample(window, self.0.fps(), Method::Auto)?;
        let ids = self.0.ids_of_words(&self.0.encode(&clip)?.words)?;
        let behind = ids.iter().enumerate().filter(|(_, id)| **id == SPACE).map(|(i, _)| i as u32 + 1);
        let starts = std::iter::once(0).chain(behind).filter(|&start| (start as usize) < ids.len()).collect();
        Ok(Tokens { ids, starts })
    }
}

impl Reader {
    /// D, the model's width.
    pub fn width(&self) -> usize {
        self.width
    }

    /// (N, D) the embeddings of windows.
    ///
    /// # Errors
    /// Ids outside the vocabulary; a model whose vectors are not finite.
    pub fn embed(&mut self, windows: &[Tokens]) -> Result<Vec<f32>> {
        let words = windows.iter().map(|w| ClipWords::Varying { starts: &w.starts, tokens: w.ids.len() });
        let pieces = eval_windows(words, self.context - self.front.len())?;
        let longest = pieces.iter().map(|p| p.tokens).max().unwrap_or(0);
        let length = self.front.len() + longest;
        let mut sums = vec![0.0f64; windows.len() * self.width];
        for batch in pieces.chunks((BATCH / length).max(1)) {
            self.read(windows, batch, length, &mut sums)?;
        }
        let mean = |(sum, window): (&mut [f64], &Tokens)| {
            sum.iter_mut().for_each(|x| *x /= window.ids.len().max(1) as f64);
        };
        sums.chunks_exact_mut(self.width).zip(windows).for_each(mean);
        if sums.iter().any(|x| !x.is_finite()) {
            return Err(Error::Call("the model's vectors are not finite; its training went wrong".into()));
        }
        Ok(sums.into_iter().map(|x| x as f32).collect())
    }

    /// Adds the vectors of what counts of each piece to the sum of its window.
    fn read(&mut self, windows: &[Tokens], pieces: &[EvalWindow], length: usize, sums: &mut [f64]) -> Result<()> {
        let mut inputs = vec![self.pad; pieces.len() * length];
        let mut rows = Vec::new();
        for (i, (row, piece)) in inputs.chunks_exact_mut(length).zip(pieces).enumerate() {
            let (front, rest) = row.split_at_mut(self.front.len());
            front.copy_from_slice(&self.front);
            rest[..piece.tokens].copy_from_slice(&windows[piece.clip].ids[piece.start..piece.start + piece.tokens]);
            rows.extend(piece.scored.clone().map(|t| i * length + self.front.len() + t));
        }
        let mask = self.model.mask();
        let vectors =
            self.model.final_vectors(Windows { inputs: &inputs, targets: &inputs, length, mask, told: None }, &rows)?;
        for (row, vector) in rows.iter().zip(vectors.chunks_exact(self.width)) {
            let sum = &mut sums[pieces[row / length].clip * self.width..][..self.width];
            sum.iter_mut().zip(vector).for_each(|(s, x)| *s += f64::from(*x));
        }
        Ok(())
    }
}
