//! The plain classifiers that a trained one stands beside, on the same clips.

use super::Classifier;
use super::eval::{Named, Source, name_windows, of_clips, pooled};
use super::features::Motion;
use super::fields::{self, Field};
use super::lda::{COMPONENTS, Lda};
use super::measures::{Figures, Outcome};
use super::train::learned_from;
use super::windows::{Layout, Window};
use crate::corpus::{ClipRecord, Corpus, Split};
use crate::model::LoadedRun;
use crate::model::fast::Fast;
use crate::{Error, Result};
use rayon::prelude::*;
use serde::Serialize;

/// Neighbours that vote (PROTOCOLS 6.2).
const NEIGHBOURS: usize = 10;

/// A classifier's figures on one field.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Which classifier.
    pub name: String,
    /// The field.
    pub field: String,
    /// By window; none for those that read whole clips.
    pub windows: Option<Figures>,
    /// By clip.
    pub clips: Figures,
}

/// What a comparison is over.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The split.
    pub split: Split,
    /// Clips that were learned from, and clips that are named.
    pub clips: [usize; 2],
    /// Clips whose label training didn't have, by field: they count nowhere.
    pub left_out: Vec<usize>,
    /// A row a classifier and field.
    pub rows: Vec<Row>,
}

/// Measures a classifier on a split; with `run` or `plain` the plain ones beside it, which learn from the clips that it has
/// learned from: majority class, what doesn't move (length and first pose), LDA on window features, LDA on the pooled final
/// vectors of `run`, the nearest spectra.
///
/// # Errors
/// A corpus of another tokenizer, a split without clips that can be counted.
pub fn compare(
    classifier: &mut Classifier,
    corpus: &Corpus,
    split: Split,
    run: Option<&LoadedRun>,
    plain: bool,
) -> Result<Comparison> {
    let all = fields::clips(corpus, &classifier.about.only)?;
    let train = learned_from(&all, &classifier.about.fields, classifier.about.share, classifier.about.seed);
    let clips: Vec<&ClipRecord> = all.iter().copied().filter(|c| c.split == split).collect();
    if clips.is_empty() {
        let help = "see kinelm corpus stats for the splits";
        return Err(Error::file(corpus.dir(), format!("no {split} clips"), "clips of that split", help));
    }
    let fields = classifier.about.fields.clone();
    let named = name_windows(classifier, corpus, &clips)?;
    let motions = |clips: &[&ClipRecord]| clips.par_iter().map(|c| Motion::of(corpus, c)).collect::<Result<Vec<_>>>();
    let (seen, asked) = if plain { (motions(&train)?, motions(&clips)?) } else { (Vec::new(), Vec::new()) };
    let mut rows = Vec::new();
    let mut left_out = Vec::new();
    for (table, field) in fields.0.iter().enumerate() {
        let truth: Vec<Option<usize>> = clips.iter().map(|c| field.class_of(c)).collect();
        left_out.push(truth.iter().filter(|t| t.is_none()).count());
        let judge = Judge { field, truth: &truth, dir: corpus };
        if plain {
            let labels: Vec<Option<usize>> = train.iter().map(|c| field.class_of(c)).collect();
            let material = Material { corpus, layout: &classifier.layout, train: &train, clips: &clips, labels };
            rows.push(judge.row("majority class", &material.majority(field), false)?);
            rows.push(judge.row("length and first pose", &material.still(field, &seen, &asked)?, false)?);
            rows.push(judge.row("nearest spectra", &material.nearest(field, &seen, &asked)?, false)?);
            rows.push(judge.row("LDA", &material.moving(field, &seen, &asked)?, true)?);
            if let Some(run) = run {
                rows.push(judge.row("LDA of the model's vectors", &material.vectors(field, run)?, true)?);
            }
        }
        let one = |n: &Named| Named { log_p: vec![n.log_p[table].clone()], ..n.clone() };
        rows.push(judge.row("class tokens", &named.iter().map(one).collect::<Vec<_>>(), true)?);
    }
    Ok(Comparison { split, clips: [train.len(), clips.len()], left_out, rows })
}

/// Who knows the truth about one field.
struct Judge<'a> {
    field: &'a Field,
    truth: &'a [Option<usize>],
    dir: &'a Corpus,
}

impl Judge<'_> {
    /// The figures of what was said of one field.
    fn row(&self, name: &str, said: &[Named], by_window: bool) -> Result<Row> {
        let figures = |said: &[Named]| {
            let outcome =
                |n: &Named| Some(Outcome { clip: n.clip, class: self.truth[n.clip]?, log_p: n.log_p[0].clone() });
            Figures::of(&said.iter().filter_map(outcome).collect::<Vec<_>>(), self.field.classes.len(), 1)
        };
        let none = || {
            let found = format!("no clip with a known {}", self.field.name);
            Error::file(
                self.dir.dir(),
                found,
                format!("one of {}", self.field.classes.join(", ")),
                "take another split",
            )
        };
        Ok(Row {
            name: name.into(),
            field: self.field.name.clone(),
            windows: if by_window { figures(said) } else { None },
            clips: figures(&of_clips(said)).ok_or_else(none)?,
        })
    }
}

/// What the plain classifiers learn from, for one field.
struct Material<'a> {
    corpus: &'a Corpus,
    layout: &'a Layout,
    train: &'a [&'a ClipRecord],
    clips: &'a [&'a ClipRecord],
    /// Of the training clips.
    labels: Vec<Option<usize>>,
}

impl Material<'_> {
    /// What is said of whole clips.
    fn whole(&self, log_p: impl Fn(usize) -> Vec<f64>) -> Vec<Named> {
        (0..self.clips.len()).map(|clip| Named { clip, words: 0..0, log_p: vec![log_p(clip)] }).collect()
    }

    fn majority(&self, field: &Field) -> Vec<Named> {
        let count = |class: usize| self.labels.iter().filter(|l| **l == Some(class)).count() as f64;
        let shares: Vec<f64> = (0..field.classes.len()).map(|class| count(class).max(f64::MIN_POSITIVE).ln()).collect();
        self.whole(|_| super::eval::normalised(shares.clone()))
    }

    fn still(&self, field: &Field, seen: &[Motion], asked: &[Motion]) -> Result<Vec<Named>> {
        let rows = seen.iter().zip(&self.labels).filter_map(|(m, label)| Some((m.start(), (*label)?)));
        let (rows, labels): (Vec<_>, Vec<_>) = rows.unzip();
        let lda = Lda::fit(&rows, &labels, field.classes.len(), COMPONENTS)?;
        Ok(self.whole(|clip| lda.log_p(&asked[clip].start())))
    }

    fn moving(&self, field: &Field, seen: &[Motion], asked: &[Motion]) -> Result<Vec<Named>> {
        let frames = self.corpus.tokenizer().frames_per_word();
        let windows = |clips: &[&ClipRecord]| -> Vec<Window> {
            clips.iter().enumerate().flat_map(|(i, c)| self.layout.windows(i, self.corpus.words(c).len())).collect()
        };
        let of = |motions: &[Motion], w: &Window| motions[w.clip].window(w, frames);
        let learned = windows(self.train).into_iter().filter_map(|w| Some((of(seen, &w), self.labels[w.clip]?)));
        let (rows, labels): (Vec<_>, Vec<_>) = learned.unzip();
        let lda = Lda::fit(&rows, &labels, field.classes.len(), COMPONENTS)?;
        let name =
            |w: Window| Named { clip: w.clip, words: w.word..w.word + w.words, log_p: vec![lda.log_p(&of(asked, &w))] };
        Ok(windows(self.clips).into_iter().map(name).collect())
    }

    fn vectors(&self, field: &Field, run: &LoadedRun) -> Result<Vec<Named>> {
        super::train::run_tokenizer(run, self.corpus)?;
        let mut model = Fast::from_tensors(&run.config, &run.tokens, run.weights.clone())?;
        // no class tokens: the model doesn't know them
        let layout = Layout::new(&run.config, &run.tokens, 0)?;
        let mut read = |clips: &[&ClipRecord]| -> Result<Vec<(Window, Vec<f64>)>> {
            let vectors = pooled(&mut model, &layout, &Source::of(self.corpus, clips))?;
            let windows = clips.iter().enumerate().flat_map(|(i, c)| layout.windows(i, self.corpus.words(c).len()));
            Ok(windows.zip(vectors).collect())
        };
        let learned = read(self.train)?.into_iter().filter_map(|(w, v)| Some((v, self.labels[w.clip]?)));
        let (rows, labels): (Vec<_>, Vec<_>) = learned.unzip();
        let lda = Lda::fit(&rows, &labels, field.classes.len(), COMPONENTS)?;
        let name = |(w, v): (Window, Vec<f64>)| Named {
            clip: w.clip,
            words: w.word..w.word + w.words,
            log_p: vec![lda.log_p(&v)],
        };
        Ok(read(self.clips)?.into_iter().map(name).collect())
    }

    fn nearest(&self, field: &Field, seen: &[Motion], asked: &[Motion]) -> Result<Vec<Named>> {
        let joints = &self.corpus.tokenizer().config().joints;
        let spectra = |motions: &[Motion]| motions.par_iter().map(|m| m.spectra(joints)).collect::<Result<Vec<_>>>();
        let known: Vec<(Vec<f64>, usize)> = spectra(seen)?
            .into_iter()
            .zip(&self.labels)
            .filter_map(|(windows, label)| Some((windows, (*label)?)))
            .flat_map(|(windows, label)| windows.into_iter().map(move |w| (w, label)))
            .collect();
        let votes = |windows: &Vec<Vec<f64>>| {
            let mut votes = vec![1.0; field.classes.len()]; // one for each: a share of 0 has no logarithm
            for window in windows {
                let near = |(known, label): &(Vec<f64>, usize)| {
                    (known.iter().zip(window).map(|(a, b)| a * b).sum::<f64>(), *label)
                };
                let mut all: Vec<(f64, usize)> = known.iter().map(near).collect();
                let k = NEIGHBOURS.min(all.len());
                all.sort_by(|a, b| b.0.total_cmp(&a.0));
                all[..k].iter().for_each(|(_, label)| votes[*label] += 1.0);
            }
            super::eval::normalised(votes.iter().map(|v: &f64| v.ln()).collect())
        };
        let found: Vec<Vec<f64>> = spectra(asked)?.par_iter().map(votes).collect();
        Ok(self.whole(|clip| found[clip].clone()))
    }
}
