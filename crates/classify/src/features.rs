//! Features of motion windows for the plain classifiers.

use crate::Result;
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_model::class_windows::half_apart;
use kinelm_motion::{Clip, mirror};
use kinelm_spectral::{LowDct, Series, Transform, WindowSpec};
use kinelm_tokenizer::{Tokenizer, UncodedPose, Words};
use std::ops::Range;

/// Mean, standard deviation and mean absolute first difference of some frames of a channel.
pub fn moments_of(x: &[f64]) -> [f64; 3] {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let deviation = (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt();
    // a single frame has no step: 0 / 1
    let steps = x.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>() / (n - 1.0).max(1.0);
    [mean, deviation, steps]
}

/// Numbers of [`Motion::window`].
pub(super) fn count(tokenizer: &Tokenizer) -> usize {
    // three moments of three numbers: of each joint's rotation vector, and of the root's step
    3 * (3 * tokenizer.config().joints.len() + 3)
}

/// The channels of a clip over time, as its corpus codes it.
pub(super) struct Motion {
    clip: Clip,
    frames_per_word: usize,
    /// Rotation vectors of the coded joints.
    series: Series,
    /// (3, F): the root's steps in metres a second.
    steps: [Vec<f64>; 3],
}

impl Motion {
    /// Decodes a clip.
    ///
    /// # Errors
    /// A corpus that doesn't hold together.
    pub(crate) fn of(corpus: &Corpus, record: &ClipRecord) -> Result<Motion> {
        Motion::of_words(corpus.tokenizer(), &corpus.clip_words(record)?)
    }

    /// Decodes words.
    ///
    /// # Errors
    /// Words of another tokenizer.
    pub(crate) fn of_words(tokenizer: &Tokenizer, words: &Words) -> Result<Motion> {
        Motion::new(tokenizer, tokenizer.decode(words, UncodedPose::Identity)?)
    }

    /// The motion in a mirror.
    ///
    /// # Errors
    /// None in practice.
    pub fn mirrored(&self, tokenizer: &Tokenizer) -> Result<Motion> {
        Motion::new(tokenizer, mirror::mirror(&self.clip)?)
    }

    fn new(tokenizer: &Tokenizer, clip: Clip) -> Result<Motion> {
        let joints: Vec<usize> = tokenizer.config().joints.clone();
        let series = Series::of(&clip, &joints, clip.fps(), false)?;
        let steps = [0, 1, 2].map(|axis| {
            let at = |frame: usize| clip.root()[frame][axis];
            // the first frame has no step, 0
            let step = |frame: usize| (at(frame) - at(frame.saturating_sub(1))) * clip.fps();
            (0..clip.frames()).map(step).collect()
        });
        Ok(Motion { clip, frames_per_word: tokenizer.frames_per_word(), series, steps })
    }

    /// [`moments_of`] every channel over some words (docs/classification.md, "Plain classifiers").
    pub fn window(&self, words: &Range<usize>) -> Vec<f64> {
        let from = words.start * self.frames_per_word;
        // the last tile may reach beyond the clip
        let to = (words.end * self.frames_per_word).min(self.clip.frames());
        let rotations = self.series.window(from, to - from);
        let steps = self.steps.iter().map(|steps| &steps[from..to]);
        rotations.chunks_exact(to - from).chain(steps).flat_map(moments_of).collect()
    }

    /// [`Motion::window`] of `seconds`, at least a word, at a hop of half of that, the last of them to the clip's end;
    /// the whole of a shorter clip.
    pub fn windows(&self, seconds: f64) -> Vec<Vec<f64>> {
        let all = self.clip.frames().div_ceil(self.frames_per_word);
        // rounding must not take a word from a length of whole words
        let words = (seconds * self.clip.fps() / self.frames_per_word as f64 + 1e-9) as usize;
        half_apart(words.max(1), all).map(|words| self.window(&words)).collect()
    }

    /// Static features: the logarithm of the number of frames, and the first pose.
    pub(crate) fn start(&self) -> Vec<f64> {
        let pose = self.series.window(0, 1).into_iter().chain(self.steps.iter().map(|steps| steps[0]));
        std::iter::once((self.clip.frames() as f64).ln()).chain(pose).collect()
    }

    /// Low cosine coefficients of its windows of 128 frames at 60 a second (docs/query.md), of norm 1; a shorter clip holds
    /// its last pose.
    ///
    /// # Errors
    /// A rate that the clip can't be resampled to.
    pub fn spectra(&self, joints: &[usize]) -> Result<Vec<Vec<f64>>> {
        let spec = WindowSpec::default();
        let transform = Transform::Dct(LowDct::new(spec.frames, 16));
        let series = Series::of(&self.clip, joints, spec.fps, false)?;
        let frames = series.frames.min(spec.frames);
        let one = |start: usize| {
            let held = |x: &[f64]| (0..spec.frames).map(|f| x[f.min(frames - 1)]).collect::<Vec<f64>>();
            let window: Vec<f64> = series.window(start, frames).chunks_exact(frames).flat_map(held).collect();
            transform.unit_feature(&window, series.channels.len())
        };
        let starts: Vec<usize> = spec.starts(series.frames.max(spec.frames), 0).collect();
        Ok(starts.into_iter().map(one).collect())
    }
}
