//! Plain classifiers, as baselines for a trained one.

use super::class_scores::{ClassScores, normalised};
use super::features::Motion;
use super::lda::{COMPONENTS, Lda};
use super::scores::{Source, pooled};
use crate::Result;
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_model::LoadedRun;
use kinelm_model::class_windows::{Layout, Window};
use kinelm_model::fast::Fast;
use rayon::prelude::*;

/// Neighbours that vote: docs/query.md, "Do neighbours share labels?".
const NEIGHBOURS: usize = 10;

/// The classes by one of them.
pub(super) struct Classified {
    /// Its name.
    pub name: &'static str,
    /// Of windows, or of whole clips.
    pub scores: Vec<ClassScores>,
    /// Whether of windows.
    pub by_window: bool,
}

/// Features of the training clips, and of the clips to classify.
pub(super) struct Plain {
    /// A row per clip: its length and first pose.
    static_features: [Vec<Vec<f64>>; 2],
    /// Rows per clip: low cosine coefficients.
    spectra: [Vec<Vec<Vec<f64>>>; 2],
    /// A row per window: means, deviations and steps of its channels.
    moments: [Rows; 2],
    /// A row per window: the mean of a run's final vectors.
    vectors: Option<[Rows; 2]>,
}

/// A row per window.
type Rows = Vec<(Window, Vec<f64>)>;

impl Plain {
    /// Reads the training clips and those to classify; vectors only with a run.
    ///
    /// # Errors
    /// A corpus that doesn't hold together, or of another tokenizer than the run's.
    pub fn read(
        corpus: &Corpus,
        layout: &Layout,
        run: Option<&LoadedRun>,
        clips: [&[&ClipRecord]; 2],
    ) -> Result<Plain> {
        let [train, test] =
            clips.map(|clips| clips.par_iter().map(|c| Motion::of(corpus, c)).collect::<Result<Vec<_>>>());
        let motions = [train?, test?];
        let joints = &corpus.tokenizer().config().joints;
        let [train, test] =
            motions.each_ref().map(|motions| motions.par_iter().map(|m| m.spectra(joints)).collect::<Result<Vec<_>>>());
        let moments = [0, 1].map(|part| {
            let windows = Source::of(corpus, clips[part]).windows(layout);
            windows.into_iter().map(|w| (w, motions[part][w.clip].window(&(w.word..w.word + w.words)))).collect()
        });
        Ok(Plain {
            static_features: motions.each_ref().map(|motions| motions.iter().map(Motion::start).collect()),
            spectra: [train?, test?],
            moments,
            vectors: run.map(|run| vectors(corpus, run, clips)).transpose()?,
        })
    }

    /// The classes of one field by every classifier; `labels` are those of the training clips.
    ///
    /// # Errors
    /// No labels; numbers that are not finite.
    pub fn classify(&self, labels: &[Option<usize>], classes: usize) -> Result<Vec<Classified>> {
        let whole = |name, log_p: Vec<Vec<f64>>| {
            let scores = |(clip, log_p)| ClassScores { clip, words: 0..0, log_p: vec![log_p] };
            Classified { name, scores: log_p.into_iter().enumerate().map(scores).collect(), by_window: false }
        };
        let windows = |name, rows: &[Rows; 2]| -> Result<Classified> {
            let lda = linear(rows[0].iter().map(|(w, row)| (row, labels[w.clip])), classes)?;
            let scores = |(w, row): &(Window, Vec<f64>)| ClassScores {
                clip: w.clip,
                words: w.word..w.word + w.words,
                log_p: vec![lda.log_p(row)],
            };
            Ok(Classified { name, scores: rows[1].iter().map(scores).collect(), by_window: true })
        };
        let still = linear(self.static_features[0].iter().zip(labels).map(|(row, label)| (row, *label)), classes)?;
        let mut found = vec![
            whole("majority class", vec![majority(labels, classes); self.static_features[1].len()]),
            whole("length and first pose", self.static_features[1].iter().map(|row| still.log_p(row)).collect()),
            whole("nearest spectra", self.nearest(labels, classes)),
            windows("LDA", &self.moments)?,
        ];
        if let Some(vectors) = &self.vectors {
            found.push(windows("LDA of the model's vectors", vectors)?);
        }
        Ok(found)
    }

    /// ln p of every clip by the votes of its windows' neighbours.
    fn nearest(&self, labels: &[Option<usize>], classes: usize) -> Vec<Vec<f64>> {
        let [train, test] = &self.spectra;
        let known: Vec<(&Vec<f64>, usize)> = train
            .iter()
            .zip(labels)
            .filter_map(|(windows, label)| Some((windows, (*label)?)))
            .flat_map(|(windows, label)| windows.iter().map(move |w| (w, label)))
            .collect();
        let votes = |windows: &Vec<Vec<f64>>| {
            let mut votes = vec![1.0; classes]; // one each: a share of 0 has no logarithm
            for window in windows {
                let near = |(known, label): &(&Vec<f64>, usize)| {
                    (known.iter().zip(window).map(|(a, b)| a * b).sum::<f64>(), *label)
                };
                let mut all: Vec<(f64, usize)> = known.iter().map(near).collect();
                let k = NEIGHBOURS.min(all.len());
                all.sort_by(|a, b| b.0.total_cmp(&a.0));
                all[..k].iter().for_each(|(_, label)| votes[*label] += 1.0);
            }
            normalised(votes.iter().map(|v: &f64| v.ln()).collect())
        };
        test.par_iter().map(votes).collect()
    }
}

/// ln p of a class by its share of the training clips.
fn majority(labels: &[Option<usize>], classes: usize) -> Vec<f64> {
    let count = |class: usize| labels.iter().filter(|l| **l == Some(class)).count() as f64;
    // a class without clips: 0 has no logarithm
    normalised((0..classes).map(|class| count(class).max(f64::MIN_POSITIVE).ln()).collect())
}

/// LDA of the rows that have a label.
fn linear<'a>(rows: impl Iterator<Item = (&'a Vec<f64>, Option<usize>)>, classes: usize) -> Result<Lda> {
    let labelled = rows.filter_map(|(row, label)| Some((row.clone(), label?)));
    let (rows, labels): (Vec<_>, Vec<_>) = labelled.unzip();
    Lda::fit(&rows, &labels, classes, COMPONENTS)
}

/// The mean of a run's final vectors over every window.
fn vectors(corpus: &Corpus, run: &LoadedRun, clips: [&[&ClipRecord]; 2]) -> Result<[Rows; 2]> {
    super::train::run_tokenizer(run, corpus)?;
    let mut model = Fast::from_weights(&run.config, &run.tokens, &run.weights)?;
    // the model has no class tokens
    let layout = Layout::new(&run.config, &run.tokens, 0)?;
    let mut read = |clips: &[&ClipRecord]| -> Result<Rows> {
        let source = Source::of(corpus, clips);
        Ok(source.windows(&layout).into_iter().zip(pooled(&mut model, &layout, &source)?).collect())
    };
    Ok([read(clips[0])?, read(clips[1])?])
}
