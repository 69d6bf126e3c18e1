//! Clips to the features of their windows.

use super::model::{self, Reader, Speaker, Tokens};
use super::options::{IndexOptions, Kind, unfitted};
use crate::pca::PcaFit;
use crate::{Error, PcaBasis, Result, Series, Transform};
use kinelm_motion::Clip;

/// What makes features; many clips side by side. A model then reads its part one after the other ([`Finisher`]).
pub struct Maker {
    options: IndexOptions,
    how: How,
}

enum How {
    Transform(Transform),
    Words(Box<Speaker>),
}

/// What comes of a clip before a model reads.
pub enum Made {
    /// (N, D).
    Features(Vec<f32>),
    /// (N).
    Tokens(Vec<Tokens>),
}

/// What is left to do after [`Maker::make`].
pub struct Finisher(Option<Reader>);

impl Maker {
    /// What makes the features of `options`; `basis` is that of a fitted transform.
    ///
    /// # Errors
    /// A run that can't be read or isn't the one of the options.
    ///
    /// # Panics
    /// When there is no basis where one is needed.
    pub fn new(options: &IndexOptions, basis: Option<&PcaBasis>) -> Result<(Maker, Finisher)> {
        let (how, reader) = match (&options.transform, unfitted(&options.transform, options.windows.frames)) {
            (_, Some(transform)) => (How::Transform(transform), None),
            (Kind::Model { run, weights }, _) => {
                let (speaker, reader) = model::open(run, weights)?;
                (How::Words(Box::new(speaker)), Some(reader))
            }
            _ => {
                let basis = basis.unwrap_or_else(|| panic!("a fitted transform without its basis"));
                (How::Transform(Transform::Pca(basis.clone())), None)
            }
        };
        Ok((Maker { options: options.clone(), how }, Finisher(reader)))
    }

    /// The windows of `clip`, which is on the 24 SMPL joints at the options' rate, that begin at `starts`.
    ///
    /// # Errors
    /// A clip that the run's tokenizer can't say.
    pub fn make(&self, clip: &Clip, starts: &[usize]) -> Result<Made> {
        let frames = self.options.windows.frames;
        match &self.how {
            How::Transform(transform) => {
                let series = series(clip, &self.options)?;
                let feature = |&start: &usize| transform.feature(&series.window(start, frames), series.channels.len());
                Ok(Made::Features(starts.iter().flat_map(feature).map(|x| x as f32).collect()))
            }
            How::Words(speaker) => {
                let tokens = starts.iter().map(|&start| speaker.tokens(&clip.slice(start..start + frames)));
                Ok(Made::Tokens(tokens.collect::<Result<_>>()?))
            }
        }
    }

    /// D.
    pub fn numbers(&self, finisher: &Finisher) -> usize {
        match (&self.how, &finisher.0) {
            (How::Transform(t), _) => t.kept() * self.options.channels(),
            (_, reader) => reader.as_ref().map_or(0, Reader::width),
        }
    }
}

impl Finisher {
    /// (N, D).
    ///
    /// # Errors
    /// As [`Reader::embed`].
    pub fn finish(&mut self, made: Made) -> Result<Vec<f32>> {
        match (made, &mut self.0) {
            (Made::Features(features), _) => Ok(features),
            (Made::Tokens(windows), Some(reader)) => reader.embed(&windows),
            (Made::Tokens(_), None) => Err(Error::call("tokens without a model to read them")),
        }
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
