//! A language model's own embedding of a window: the mean of its final vectors over the window's tokens, of a two-level model
//! the mean of its trunk's vectors over the rows after each of the window's frames.
//!
//! The window's frames are brought to the run's rate and tokenized with the run's tokenizer; in the front every label
//! is unknown. Windows longer than the context are read in overlapping pieces as when a model is measured
//! ([`eval_windows`]), each token counting once. Not in the thesis.

use crate::{Error, Result};
use kinelm_corpus::words::ClipWords;
use kinelm_corpus::{Conditions, EvalWindow, eval_windows};
use kinelm_model::checkpoint::Checkpoints;
use kinelm_model::fast::{Fast, Windows};
use kinelm_model::{CheckpointChoice, ModelKind, load_run};
use kinelm_motion::Clip;
use kinelm_motion::resample::{Method, resample};
use kinelm_spectral::query::embedding::Tokens;
use kinelm_spectral::query::{FeatureKind, Models, WindowEmbedding};
use kinelm_tokenizer::{SPACE, Tokenizer};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Tokens that the model reads at a time.
const BATCH: usize = 4096;

/// A causal model that reads windows, and its tokenizer.
struct ModelEmbedding {
    tokenizer: Tokenizer,
    reader: Mutex<Reader>,
}

/// The model and what its inputs are made of.
struct Reader {
    model: Fast,
    front: Vec<u32>,
    pad: u32,
    context: usize,
    width: usize,
    /// W of a two-level model, whose vectors are of frames.
    frame: Option<usize>,
}

/// Opens the models of indices.
pub const MODELS: Models = Models(|run, weights| Ok(Box::new(open(run, weights)?)));

/// The embedding of a trained run's model at a checkpoint, identified by the hash of its weights.
///
/// # Errors
/// As [`load_run`]; weights that can't be read.
pub fn of_run(run: &Path, which: CheckpointChoice) -> Result<FeatureKind> {
    let loaded = load_run(run, which)?;
    let weights = loaded.weights_sha256();
    Ok(FeatureKind::Model { run: std::path::absolute(run).map_err(Error::io(run))?, weights })
}

/// Opens the run that an index was made with.
///
/// # Errors
/// As [`load_run`]; other weights than `weights`; a model that isn't causal or whose context holds no word.
fn open(run: &Path, weights: &str) -> Result<ModelEmbedding> {
    let loaded = load_run(run, with_weights(run, weights)?)?;
    let found = loaded.weights_sha256();
    if found != weights {
        let (found, expected) = (format!("weights {found}"), format!("weights {weights}, as the index was built with"));
        return Err(Error::file(run, found, expected, "the run was trained on: build the index again with it"));
    }
    if loaded.config.kind != ModelKind::Causal {
        return Err(Error::file(run, "a masked model", "a causal one", "give a run of `kind = \"causal\"`"));
    }
    // embeddings are compared by labels, which the model must therefore not read
    let conditions: Conditions = loaded.load_conditions()?.unknown();
    let front = conditions.front(&Default::default());
    let (context, width, pad) = (loaded.config.context, loaded.config.width, loaded.tokens.pad);
    if context <= front.len() {
        return Err(Error::file(run, format!("a context of {context} tokens"), "room for words", ""));
    }
    let tokenizer = loaded.load_tokenizer()?;
    let frame = (!loaded.config.architecture.is_flat()).then_some(loaded.tokens.word);
    let model = Fast::from_weights(&loaded.config, &loaded.tokens, &loaded.weights)?;
    let reader = Mutex::new(Reader { model, front, pad, context, width, frame });
    Ok(ModelEmbedding { tokenizer, reader })
}

/// The checkpoint with these weights, or the usual one where none has them.
fn with_weights(run: &Path, sha256: &str) -> Result<CheckpointChoice> {
    let all = Checkpoints::of(run);
    let has = |step: &u64| all.state(*step).is_ok_and(|state| state.files.values().any(|file| file.sha256 == sha256));
    Ok(all.steps()?.into_iter().find(has).map_or(CheckpointChoice::Auto, CheckpointChoice::Step))
}

impl ModelEmbedding {
    fn reader(&self) -> MutexGuard<'_, Reader> {
        self.reader.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl WindowEmbedding for ModelEmbedding {
    fn tokens(&self, window: &Clip) -> kinelm_corpus::Result<Tokens> {
        let clip = resample(window, self.tokenizer.fps(), Method::Auto)?;
        let ids = self.tokenizer.ids_of_words(&self.tokenizer.encode(&clip)?.words)?;
        let after = ids.iter().enumerate().filter(|(_, id)| **id == SPACE).map(|(i, _)| i as u32 + 1);
        let starts = std::iter::once(0).chain(after).filter(|&start| (start as usize) < ids.len()).collect();
        Ok(Tokens { ids, starts })
    }

    fn width(&self) -> usize {
        self.reader().width
    }

    fn embed(&self, windows: &[Tokens]) -> kinelm_corpus::Result<Vec<f32>> {
        Ok(self.reader().embed(windows)?)
    }
}

impl Reader {
    /// (N, D) the embeddings of windows.
    ///
    /// # Errors
    /// Ids outside the vocabulary; a model whose vectors are not finite.
    fn embed(&mut self, windows: &[Tokens]) -> Result<Vec<f32>> {
        let words = windows.iter().map(|w| ClipWords::Varying { starts: &w.starts, tokens: w.ids.len() });
        // the row that has read a frame is the one after it
        let room =
            self.frame.map_or(self.context - self.front.len(), |word| self.context + 1 - self.front.len() - word);
        let pieces = eval_windows(words, room)?;
        let longest = pieces.iter().map(|p| p.tokens).max().unwrap_or(0);
        let length = self.front.len() + longest + self.frame.map_or(0, |word| word - 1);
        let mut sums = vec![0.0f64; windows.len() * self.width];
        for batch in pieces.chunks((BATCH / length).max(1)) {
            self.read(windows, batch, length, &mut sums)?;
        }
        let mean = |(sum, window): (&mut [f64], &Tokens)| {
            let vectors = self.frame.map_or(window.ids.len(), |word| window.ids.len() / word);
            sum.iter_mut().for_each(|x| *x /= vectors.max(1) as f64);
        };
        sums.chunks_exact_mut(self.width).zip(windows).for_each(mean);
        if sums.iter().any(|x| !x.is_finite()) {
            return Err(Error::unsupported(
                "an embedding",
                "the model's vectors are not finite; its training went wrong",
            ));
        }
        Ok(sums.into_iter().map(|x| x as f32).collect())
    }

    /// Adds the vectors of each piece's scored tokens to the sum of its window.
    fn read(&mut self, windows: &[Tokens], pieces: &[EvalWindow], length: usize, sums: &mut [f64]) -> Result<()> {
        // padding comes after the tokens, where the rows of a causal model don't see it
        let mut inputs = vec![self.pad; pieces.len() * length];
        let (front, frame) = (self.front.len(), self.frame);
        let places = frame.map_or(length, |word| (length + 1 - front) / word);
        let mut rows = Vec::new();
        for (i, (row, piece)) in inputs.chunks_exact_mut(length).zip(pieces).enumerate() {
            let (front, rest) = row.split_at_mut(self.front.len());
            front.copy_from_slice(&self.front);
            rest[..piece.tokens].copy_from_slice(&windows[piece.clip].ids[piece.start..piece.start + piece.tokens]);
            let scored = &piece.scored;
            let read = match frame {
                Some(word) => 1 + scored.start / word..1 + scored.end / word,
                None => self.front.len() + scored.start..self.front.len() + scored.end,
            };
            rows.extend(read.map(|row| i * places + row));
        }
        let mask = self.model.mask();
        let vectors = self.model.final_vectors(
            Windows { inputs: &inputs, targets: &inputs, length, mask, history: &[], conditioning: None },
            &rows,
        )?;
        for (row, vector) in rows.iter().zip(vectors.chunks_exact(self.width)) {
            let sum = &mut sums[pieces[row / places].clip * self.width..][..self.width];
            sum.iter_mut().zip(vector).for_each(|(s, x)| *s += f64::from(*x));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_model::fixtures;

    /// Every frame of a window counts once by the row after it, in windows that fit and in longer ones.
    #[test]
    fn a_two_level_model_tells_windows_by_the_rows_behind_their_frames() {
        let (levels, tokens) = fixtures::every(36).into_iter().find(|(c, _)| !c.architecture.is_flat()).unwrap();
        let gpt = fixtures::model(&levels, &tokens);
        let (context, width, word, pad) = (levels.context, levels.width, tokens.word, tokens.pad);
        let front = vec![tokens.bos];
        let model = Fast::of(&gpt).unwrap();
        let mut reader = Reader { model, front: front.clone(), pad, context, width, frame: Some(word) };
        // the first of three windows is whole
        let (_, from) = fixtures::batch(&levels, &tokens, 3, context);
        let window = |frames: usize| {
            let ids: Vec<u32> = from[..context].chunks_exact(word).cycle().take(frames).flatten().copied().collect();
            Tokens { starts: (0..frames).map(|f| (f * word) as u32).collect(), ids }
        };
        let vectors = |ids: &[u32], first: usize| {
            let mut inputs = [&front[..], ids].concat();
            inputs.resize(inputs.len() + word - 1, pad);
            let ids = gpt.ids(&inputs, inputs.len()).unwrap();
            let rows = gpt.final_vectors(&ids, &gpt.mask()).unwrap().to_vec2::<f32>().unwrap();
            rows[1 + first..].to_vec()
        };
        // 6 frames hold 5 and the row after them: a hop of 2, and of the second piece what the first has not read
        let windows = [window(5), window(2), window(7)];
        let long = [vectors(&windows[2].ids[..5 * word], 0), vectors(&windows[2].ids[2 * word..], 3)].concat();
        let expected = [vectors(&windows[0].ids, 0), vectors(&windows[1].ids, 0), long];
        let found = reader.embed(&windows).unwrap();
        for (found, rows) in found.chunks(width).zip(&expected) {
            for (i, x) in found.iter().enumerate() {
                let mean = rows.iter().map(|row| row[i]).sum::<f32>() / rows.len() as f32;
                assert!((x - mean).abs() < 1e-5, "{x}, expected {mean}");
            }
        }
        assert_eq!(expected[2].len(), 7);
    }
}
