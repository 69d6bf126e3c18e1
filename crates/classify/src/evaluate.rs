//! A classifier's metrics on a split, beside those of plain classifiers on the same clips.

use super::Classifier;
use super::class_scores::{ClassScores, of_clips};
use super::fields::{self, Field, Fields};
use super::metrics::{Metrics, Outcome};
use super::plain::Plain;
use super::train::training_clips;
use crate::{Error, Result};
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_model::LoadedRun;
use serde::Serialize;

/// The rows of the measured classifier, without and with linear discriminants beside the class tokens.
pub(super) const CLASSIFIER: [&str; 2] = ["class tokens", "class tokens and LDA"];

/// A classifier's metrics on one field.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The classifier's name.
    pub name: String,
    /// The field.
    pub field: String,
    /// By window; `None` for those that read whole clips.
    pub windows: Option<Metrics>,
    /// By clip.
    pub clips: Metrics,
}

/// Metrics of classifiers on a split.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The layout's version.
    pub schema: u32,
    /// The fields and their classes.
    pub fields: Fields,
    /// The split.
    pub split: Split,
    /// Training clips, and clips of the split.
    pub clips: [usize; 2],
    /// Clips whose label no training clip has, by field. They are left out.
    pub left_out: Vec<usize>,
    /// A row per classifier and field.
    pub rows: Vec<Row>,
}

impl Classifier {
    /// Measures the classifier on a split. With `plain` it is compared to plain classifiers that learn from the same
    /// training clips: majority class, what doesn't move (length and first pose), nearest spectra, LDA on window features,
    /// and, with `run`, LDA on the pooled final vectors of that run.
    ///
    /// # Errors
    /// A corpus of another tokenizer, a split without labelled clips.
    pub fn evaluate(
        &mut self,
        corpus: &Corpus,
        split: Split,
        run: Option<&LoadedRun>,
        plain: bool,
    ) -> Result<Comparison> {
        let all = fields::clips(corpus, &self.manifest.only)?;
        let fields = self.manifest.fields.clone();
        let train = training_clips(&all, &fields, self.manifest.share, self.manifest.seed);
        let clips: Vec<&ClipRecord> = all.iter().copied().filter(|c| c.split == split).collect();
        if clips.is_empty() {
            let help = "see kinelm corpus stats for the splits";
            return Err(Error::file(corpus.dir(), format!("no {split} clips"), "clips of that split", help));
        }
        let tokens = self.classify_windows(corpus, &clips)?;
        let both = self.classify_clips(corpus, &clips, &tokens)?;
        let plain = plain.then(|| Plain::read(corpus, &self.layout, run, [&train, &clips])).transpose()?;
        let (mut rows, mut left_out) = (Vec::new(), Vec::new());
        for (table, field) in fields.0.iter().enumerate() {
            let truth: Vec<Option<usize>> = clips.iter().map(|c| field.class_of(c)).collect();
            left_out.push(truth.iter().filter(|t| t.is_none()).count());
            let row = |name, scores: &[ClassScores], by_window| row(corpus, (field, &truth), name, scores, by_window);
            if let Some(plain) = &plain {
                let labels: Vec<Option<usize>> = train.iter().map(|c| field.class_of(c)).collect();
                for found in plain.classify(&labels, field.classes.len())? {
                    rows.push(row(found.name, &found.scores, found.by_window)?);
                }
            }
            let of_field = |s: &ClassScores| ClassScores { log_p: vec![s.log_p[table].clone()], ..s.clone() };
            for (name, (scores, by_window)) in CLASSIFIER.into_iter().zip([(&tokens, true), (&both, false)]) {
                rows.push(row(name, &scores.iter().map(of_field).collect::<Vec<_>>(), by_window)?);
            }
        }
        Ok(Comparison { schema: 1, fields, split, clips: [train.len(), clips.len()], left_out, rows })
    }
}

/// The metrics of some scores of one field, whose true classes are known by clip.
fn row(
    corpus: &Corpus,
    (field, truth): (&Field, &[Option<usize>]),
    name: &str,
    scores: &[ClassScores],
    by_window: bool,
) -> Result<Row> {
    let metrics = |scores: &[ClassScores]| {
        let outcome =
            |s: &ClassScores| Some(Outcome { clip: s.clip, class: truth[s.clip]?, log_p: s.log_p[0].clone() });
        Metrics::of(&scores.iter().filter_map(outcome).collect::<Vec<_>>(), field.classes.len(), 1)
    };
    let none = || {
        let found = format!("no clip with a known {}", field.name);
        let expected = format!("one of {}", field.classes.join(", "));
        Error::file(corpus.dir(), found, expected, "take another split")
    };
    Ok(Row {
        name: name.into(),
        field: field.name.clone(),
        windows: if by_window { metrics(scores) } else { None },
        clips: metrics(&of_clips(scores)).ok_or_else(none)?,
    })
}
