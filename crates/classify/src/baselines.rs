//! A trained classifier beside plain ones, on the same clips.

use super::Classifier;
use super::eval::{Named, name_windows, of_clips};
use super::fields::{self, Field};
use super::measures::{Figures, Outcome};
use super::plain::Plain;
use super::train::learned_from;
use crate::{Error, Result};
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_model::LoadedRun;
use serde::Serialize;

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
    let plain = plain.then(|| Plain::read(corpus, &classifier.layout, run, [&train, &clips])).transpose()?;
    let mut rows = Vec::new();
    let mut left_out = Vec::new();
    for (table, field) in fields.0.iter().enumerate() {
        let truth: Vec<Option<usize>> = clips.iter().map(|c| field.class_of(c)).collect();
        left_out.push(truth.iter().filter(|t| t.is_none()).count());
        let judge = Judge { field, truth: &truth, dir: corpus };
        if let Some(plain) = &plain {
            let labels: Vec<Option<usize>> = train.iter().map(|c| field.class_of(c)).collect();
            for said in plain.say(&labels, field.classes.len())? {
                rows.push(judge.row(said.name, &said.named, said.by_window)?);
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
