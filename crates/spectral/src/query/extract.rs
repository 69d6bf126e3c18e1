//! Clips to the features of their windows.

use super::database::Database;
use super::embedding::{Models, Tokens, WindowEmbedding};
use super::options::{FeatureKind, IndexOptions, unfitted};
use super::part::Part;
use super::record::ClipEntry;
use crate::pca::PcaFit;
use crate::{PcaBasis, Result, Series, Transform};
use kinelm_motion::Clip;
use rayon::prelude::*;

/// Makes features; many clips side by side. A model then reads its part one after the other
/// ([`FeatureExtractor::embed`]).
pub struct FeatureExtractor {
    options: IndexOptions,
    source: Source,
}

enum Source {
    Transform(Transform),
    Model(Box<dyn WindowEmbedding>),
}

/// The windows of a clip before a model reads them.
pub enum Extracted {
    /// (N, D).
    Features(Vec<f32>),
    /// (N).
    Tokens(Vec<Tokens>),
}

impl FeatureExtractor {
    /// The extractor of the features of `options`; `basis` is that of a fitted transform.
    ///
    /// # Errors
    /// A run that can't be read or isn't the one of the options.
    ///
    /// # Panics
    /// When there is no basis where one is needed.
    pub fn new(options: &IndexOptions, basis: Option<&PcaBasis>, models: Models) -> Result<FeatureExtractor> {
        let source = match (&options.transform, unfitted(&options.transform, options.windows.frames)) {
            (_, Some(transform)) => Source::Transform(transform),
            (FeatureKind::Model { run, weights }, _) => Source::Model(models.0(run, weights)?),
            _ => {
                let basis = basis.unwrap_or_else(|| panic!("a fitted transform without its basis"));
                Source::Transform(Transform::Pca(basis.clone()))
            }
        };
        Ok(FeatureExtractor { options: options.clone(), source })
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
            Source::Model(model) => {
                let tokens = starts.iter().map(|&start| model.tokens(&clip.slice(start..start + frames)));
                Ok(Extracted::Tokens(tokens.collect::<Result<_>>()?))
            }
        }
    }

    /// D.
    pub fn numbers(&self) -> usize {
        match &self.source {
            Source::Transform(t) => t.kept() * self.options.channels(),
            Source::Model(model) => model.width(),
        }
    }

    /// (N, D) of what [`FeatureExtractor::extract`] gave.
    ///
    /// # Errors
    /// As [`WindowEmbedding::embed`].
    pub fn embed(&self, extracted: Extracted) -> Result<Vec<f32>> {
        match (extracted, &self.source) {
            (Extracted::Features(features), _) => Ok(features),
            (Extracted::Tokens(windows), Source::Model(model)) => model.embed(&windows),
            (Extracted::Tokens(_), _) => unreachable!("tokens come from an extractor that has a model"),
        }
    }
}

/// Clips whose features are computed side by side before a model reads them.
const BLOCK: usize = 64;

impl Database {
    /// The windows of clips in memory, which are on the 24 SMPL joints at the options' rate. A basis is fitted to them where the
    /// transform needs one.
    ///
    /// # Errors
    /// Those of [`FeatureExtractor`] and of fitting a basis.
    pub(crate) fn of_clips(options: &IndexOptions, clips: Vec<(&Clip, ClipEntry)>, models: Models) -> Result<Database> {
        let basis = match options.transform {
            FeatureKind::Pca { keep } => {
                let mut all = PcaFit::new(options.windows.frames);
                for block in clips.chunks(BLOCK) {
                    let fits = block.par_iter().map(|(clip, entry)| fit_of(clip, &entry.starts, options));
                    // in the clips' order: sums have the same bits on any number of threads
                    fits.collect::<Result<Vec<_>>>()?.iter().for_each(|one| all.merge(one));
                }
                Some(all.finish(keep)?)
            }
            _ => None,
        };
        let extractor = FeatureExtractor::new(options, basis.as_ref(), models)?;
        let (numbers, mut features) = (extractor.numbers(), Vec::new());
        for block in clips.chunks(BLOCK) {
            let extracted = block.par_iter().map(|(clip, entry)| extractor.extract(clip, &entry.starts));
            for one in extracted.collect::<Result<Vec<_>>>()? {
                features.extend(extractor.embed(one)?);
            }
        }
        let entries = clips.into_iter().map(|(_, entry)| entry).collect();
        Ok(Database::new(numbers, vec![(Part::held(features, numbers), entries)]))
    }
}

/// The sums of one clip that a basis is fitted on.
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
