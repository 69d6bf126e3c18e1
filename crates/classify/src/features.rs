//! Features of motion windows for the plain classifiers.

use crate::Result;
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_model::class_windows::Window;
use kinelm_motion::Clip;
use kinelm_spectral::{LowDct, Series, Transform, WindowSpec};
use kinelm_tokenizer::UncodedPose;

/// Mean, standard deviation and mean absolute first difference of some frames of a channel.
pub fn moments_of(x: &[f64]) -> [f64; 3] {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let deviation = (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt();
    let steps = x.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>() / (n - 1.0).max(1.0);
    [mean, deviation, steps]
}

/// The channels of a clip over time, as its corpus codes it.
pub(super) struct Motion {
    clip: Clip,
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
    pub fn of(corpus: &Corpus, record: &ClipRecord) -> Result<Motion> {
        let tokenizer = corpus.tokenizer();
        let clip = tokenizer.decode(&corpus.clip_words(record)?, UncodedPose::Identity)?;
        let joints: Vec<usize> = tokenizer.config().joints.clone();
        let series = Series::of(&clip, &joints, clip.fps(), false)?;
        let steps = [0, 1, 2].map(|axis| {
            let at = |frame: usize| clip.root()[frame][axis];
            let step = |frame: usize| (at(frame) - at(frame.saturating_sub(1))) * clip.fps();
            (0..clip.frames()).map(step).collect()
        });
        Ok(Motion { clip, series, steps })
    }

    /// [`moments_of`] every channel of a window (docs/classification.md, "Plain classifiers").
    pub fn window(&self, window: &Window, frames_per_word: usize) -> Vec<f64> {
        let from = window.word * frames_per_word;
        let to = ((window.word + window.words) * frames_per_word).min(self.clip.frames());
        let rotations = self.series.window(from, to - from);
        let steps = self.steps.iter().map(|steps| &steps[from..to]);
        rotations.chunks_exact(to - from).chain(steps).flat_map(moments_of).collect()
    }

    /// What doesn't move: the logarithm of the number of frames, and the first pose.
    pub fn start(&self) -> Vec<f64> {
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
            let mut feature = transform.feature(&window, series.channels.len());
            let norm = feature.iter().map(|x| x * x).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
            feature.iter_mut().for_each(|x| *x /= norm);
            feature
        };
        let starts: Vec<usize> = spec.starts(series.frames.max(spec.frames), 0).collect();
        Ok(starts.into_iter().map(one).collect())
    }
}
