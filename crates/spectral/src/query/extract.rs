//! Clips to the features of their windows.

use super::database::Database;
use super::embedding::{self, ModelEmbedding, Tokens, WindowTokenizer};
use super::options::{FeatureKind, IndexOptions, unfitted};
use super::part::Part;
use super::record::ClipEntry;
use crate::pca::PcaFit;
use crate::{PcaBasis, Result, Series, Transform};
use kinelm_motion::Clip;
use rayon::prelude::*;

/// What makes features; many clips side by side. A model then reads its part one after the other ([`Embedder`]).
pub struct FeatureExtractor {
    options: IndexOptions,
    source: Source,
}

enum Source {
    Transform(Transform),
    Words(Box<WindowTokenizer>),
}

/// What comes of a clip before a model reads.
pub enum Extracted {
    /// (N, D).
    Features(Vec<f32>),
    /// (N).
    Tokens(Vec<Tokens>),
}

/// What is left to do after [`FeatureExtractor::extract`].
pub struct Embedder(Option<ModelEmbedding>);

impl FeatureExtractor {
    /// What makes the features of `options`; `basis` is that of a fitted transform.
    ///
    /// # Errors
    /// A run that can't be read or isn't the one of the options.
    ///
    /// # Panics
    /// When there is no basis where one is needed.
    pub fn new(options: &IndexOptions, basis: Option<&PcaBasis>) -> Result<(FeatureExtractor, Embedder)> {
        let (source, reader) = match (&options.transform, unfitted(&options.transform, options.windows.frames)) {
            (_, Some(transform)) => (Source::Transform(transform), None),
            (FeatureKind::Model { run, weights }, _) => {
                let (tokenizer, reader) = embedding::open(run, weights)?;
                (Source::Words(Box::new(tokenizer)), Some(reader))
            }
            _ => {
                let basis = basis.unwrap_or_else(|| panic!("a fitted transform without its basis"));
                (Source::Transform(Transform::Pca(basis.clone())), None)
            }
        };
        Ok((FeatureExtractor { options: options.clone(), source }, Embedder(reader)))
    }

    /// The windows of `clip`, which is on the 24 SMPL joints at the options' rate, that begin at `starts`.
    ///
    /// # Errors
    /// A clip that the run's tokenizer can't say.
    pub fn extract(&self, clip: &Clip, starts: &[usize]) -> Result<Extracted> {
        let frames = self.options.windows.frames;
        match &self.source {
            Source::Transform(transform) => {
                let series = series(clip, &self.options)?;
                let feature = |&start: &usize| transform.feature(&series.window(start, frames), series.channels.len());
                Ok(Extracted::Features(starts.iter().flat_map(feature).map(|x| x as f32).collect()))
            }
            Source::Words(tokenizer) => {
                let tokens = starts.iter().map(|&start| tokenizer.tokens(&clip.slice(start..start + frames)));
                Ok(Extracted::Tokens(tokens.collect::<Result<_>>()?))
            }
        }
    }

    /// D.
    pub fn numbers(&self, embedder: &Embedder) -> usize {
        match (&self.source, &embedder.0) {
            (Source::Transform(t), _) => t.kept() * self.options.channels(),
            (_, reader) => reader.as_ref().map_or(0, ModelEmbedding::width),
        }
    }
}

impl Embedder {
    /// (N, D).
    ///
    /// # Errors
    /// As [`ModelEmbedding::embed`].
    pub fn embed(&mut self, made: Extracted) -> Result<Vec<f32>> {
        match (made, &mut self.0) {
            (Extracted::Features(features), _) => Ok(features),
            (Extracted::Tokens(windows), Some(reader)) => reader.embed(&windows),
            (Extracted::Tokens(_), None) => unreachable!("tokens come from an extractor whose embedder has a model"),
        }
    }
}

/// Clips whose features are computed side by side before a model reads them.
const BLOCK: usize = 64;

impl Database {
    /// The windows of clips in memory, which are on the 24 SMPL joints at the options' rate. A basis is fitted to them where the
    /// transform needs one. [`Database::cosines`] can be computed at once, [`Database::nearest`] needs
    /// [`Database::with_bytes`].
    ///
    /// # Errors
    /// Those of [`FeatureExtractor`] and of fitting a basis.
    pub fn of_clips(options: &IndexOptions, clips: Vec<(&Clip, ClipEntry)>) -> Result<Database> {
        let basis = match options.transform {
            FeatureKind::Pca { keep } => {
                let mut all = PcaFit::new(options.windows.frames);
                for block in clips.chunks(BLOCK) {
                    let fits = block.par_iter().map(|(clip, entry)| fit_of(clip, &entry.starts, options));
                    fits.collect::<Result<Vec<_>>>()?.iter().for_each(|one| all.merge(one));
                }
                Some(all.finish(keep)?)
            }
            _ => None,
        };
        let (extractor, mut embedder) = FeatureExtractor::new(options, basis.as_ref())?;
        let (numbers, mut features) = (extractor.numbers(&embedder), Vec::new());
        for block in clips.chunks(BLOCK) {
            let extracted = block.par_iter().map(|(clip, entry)| extractor.extract(clip, &entry.starts));
            for one in extracted.collect::<Result<Vec<_>>>()? {
                features.extend(embedder.embed(one)?);
            }
        }
        let entries = clips.into_iter().map(|(_, entry)| entry).collect();
        Ok(Database::new(numbers, vec![(Part::held(features, numbers), entries)]))
    }
}

/// What a basis is fitted on, of one clip.
pub fn fit_of(clip: &Clip, starts: &[usize], options: &IndexOptions) -> Result<PcaFit> {
    let frames = options.windows.frames;
    let series = series(clip, options)?;
    let mut fit = PcaFit::new(frames);
    starts.iter().for_each(|&start| fit.add(&series.window(start, frames)));
    Ok(fit)
}

fn series(clip: &Clip, options: &IndexOptions) -> Result<Series> {
    Series::of(clip, &options.joints, options.windows.fps, options.raw)
}
