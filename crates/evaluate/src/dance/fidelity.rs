//! Whether the dances show their label: docs/referee.md, "Does a label show?".
//!
//! A linear discriminant learns from windows of the real train clips. It reads of every free channel the mean, the deviation
//! and the mean step; not of the pelvis, for a dance may face and go anywhere.
//!
//! Limits: a label that shows only in the order of movements, or in the path through the room, is not recognised.

use super::coded::Dance;
use crate::{Error, Result};
use kinelm_classify::features::moments_of;
use kinelm_classify::fields::Fields;
use kinelm_classify::lda::{COMPONENTS, Lda};
use kinelm_classify::metrics::wilson;
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_spectral::Series;
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;
use std::iter::StepBy;
use std::ops::Range;

/// Length of a window and the hop to the next, seconds.
const WINDOW_S: f64 = 2.0;
const HOP_S: f64 = 1.0;
/// About as many windows of train clips are learned from; more are thinned evenly, clip by clip.
const MOST: usize = 10_000;

/// How often clips are classified as requested.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fidelity {
    /// The label field.
    pub field: String,
    /// Its values, as the train clips have them.
    pub classes: Vec<String>,
    /// The joints that are read, SMPL ids.
    pub joints: Vec<usize>,
    /// Real valid and test clips, dances.
    pub groups: Vec<Confusion>,
    /// One train window in this many was learned from, where there are more than 10,000.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub one_window_in: Option<usize>,
}

/// One group of clips.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Confusion {
    /// What they are.
    pub name: String,
    /// (requested, classified): clips.
    pub confusion: Vec<Vec<usize>>,
    /// Clips of no known label, or shorter than a window: they count nowhere.
    pub left_out: usize,
}

impl Confusion {
    /// Clips that are classified as requested, and all.
    pub fn count(&self) -> [usize; 2] {
        let right = (0..self.confusion.len()).map(|class| self.confusion[class][class]).sum();
        [right, self.confusion.iter().flatten().sum()]
    }
}

/// Classifies dances, each with its requested label, and the held-out real clips beside them. `given`: joints
/// that were given to a dance, SMPL ids, which say nothing of what was made.
///
/// # Errors
/// A field that the train clips don't have; no joint left to read; words that can't be decoded.
pub fn fidelity(
    corpus: &Corpus,
    field: &str,
    given: &[usize],
    dances: &[(&Dance, Option<String>)],
) -> Result<Fidelity> {
    let records: Vec<&ClipRecord> = corpus.clips().iter().collect();
    let fields = Fields::of(corpus, &records, &[field.to_owned()])?;
    let of_field = &fields.0[0];
    let coded = corpus.tokenizer().channels().joints();
    let joints: Vec<usize> = coded.iter().copied().filter(|j| *j != 0 && !given.contains(j)).collect();
    if joints.is_empty() {
        let help = "of the coded joints all but the pelvis were given";
        return Err(Error::missing(format!("free joint to tell the label {field} by"), help));
    }
    let seen = corpus.split(Split::Train).filter_map(|record| Some((record, of_field.class_of(record)?)));
    let seen: Vec<(&ClipRecord, usize)> = seen.collect();
    let fps = corpus.tokenizer().fps();
    let every = seen.iter().map(|(record, _)| starts(record.frames, fps).len()).sum::<usize>().div_ceil(MOST).max(1);
    let read = |&(record, class): &(&ClipRecord, usize)| -> Result<Vec<(Vec<f64>, usize)>> {
        let rows = windows(&Dance::of_corpus(corpus, record)?, &joints, every)?;
        Ok(rows.into_iter().map(|row| (row, class)).collect())
    };
    let seen: Vec<Vec<(Vec<f64>, usize)>> = seen.par_iter().map(read).collect::<Result<_>>()?;
    let (rows, labels): (Vec<Vec<f64>>, Vec<usize>) = seen.into_iter().flatten().unzip();
    let classes = of_field.classes.len();
    let lda = Lda::fit(&rows, &labels, classes, COMPONENTS)?;
    let name = |dance: &Dance| -> Result<Option<usize>> { Ok(named(&lda, &windows(dance, &joints, 1)?)) };
    let group = |name: String, clips: Vec<(Option<usize>, Option<usize>)>| {
        let mut hits = Confusion { name, confusion: vec![vec![0; classes]; classes], left_out: 0 };
        for clip in clips {
            match clip {
                (Some(requested), Some(named)) => hits.confusion[requested][named] += 1,
                _ => hits.left_out += 1,
            }
        }
        hits
    };
    let mut groups = Vec::new();
    for split in [Split::Valid, Split::Test] {
        let clips: Vec<&ClipRecord> = corpus.split(split).collect();
        let named = |record: &&ClipRecord| Ok((of_field.class_of(record), name(&Dance::of_corpus(corpus, record)?)?));
        groups.push(group(format!("real, {split}"), clips.par_iter().map(named).collect::<Result<_>>()?));
    }
    let of_dance = |(dance, requested): &(&Dance, Option<String>)| {
        // a field's classes are sorted
        let requested = requested.as_ref().and_then(|label| of_field.classes.binary_search(label).ok());
        Ok((requested, name(dance)?))
    };
    groups.push(group("dances".into(), dances.par_iter().map(of_dance).collect::<Result<_>>()?));
    let one_window_in = Some(every).filter(|every| *every > 1);
    Ok(Fidelity { field: field.into(), classes: of_field.classes.clone(), joints, groups, one_window_in })
}

/// Frames of a window and to the next one.
fn sizes(fps: f64) -> [usize; 2] {
    // a mean step needs two frames
    [WINDOW_S, HOP_S].map(|s| ((s * fps).round() as usize).max(2))
}

/// First frames of the windows of a clip.
fn starts(frames: usize, fps: f64) -> StepBy<Range<usize>> {
    let [size, hop] = sizes(fps);
    (0..(frames + 1).saturating_sub(size)).step_by(hop)
}

/// The features of every n-th window of a dance, n = `every`; none of one that is shorter than a window.
fn windows(dance: &Dance, joints: &[usize], every: usize) -> Result<Vec<Vec<f64>>> {
    let fps = dance.clip.fps();
    let size = sizes(fps)[0];
    let series = Series::of(&dance.clip, joints, fps, false)?;
    let one = |at: usize| -> Vec<f64> { series.window(at, size).chunks_exact(size).flat_map(moments_of).collect() };
    Ok(starts(series.frames, fps).step_by(every).map(one).collect())
}

/// The class with the largest sum of ln p, as if windows were independent; only the order of classes is used.
fn named(lda: &Lda, windows: &[Vec<f64>]) -> Option<usize> {
    let each: Vec<Vec<f64>> = windows.iter().map(|row| lda.log_p(row)).collect();
    let sum = |class: usize| each.iter().map(|log_p| log_p[class]).sum::<f64>();
    (0..each.first()?.len()).max_by(|a, b| sum(*a).total_cmp(&sum(*b)))
}

impl fmt::Display for Fidelity {
    /// A table, without a line end after the last line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.classes.iter().map(|class| class.chars().count() + 1).max().unwrap_or(0).max(10);
        write!(f, "{:<18} {:>9} {:>18}", self.field, "as requested", "% (95 %)")?;
        self.classes.iter().try_for_each(|class| write!(f, " {class:>width$}"))?;
        for group in &self.groups {
            let [right, all] = group.count();
            write!(f, "\n{:<18} {:>9}", group.name, format!("{right} of {all}"))?;
            let share = match all {
                0 => "n/a".into(),
                _ => {
                    let [low, high] = wilson(right, all).map(|x| 100.0 * x);
                    format!("{:.0} ({low:.0} to {high:.0})", 100.0 * right as f64 / all as f64)
                }
            };
            write!(f, " {share:>18}")?;
            for (class, row) in group.confusion.iter().enumerate() {
                let of: usize = row.iter().sum();
                let cell = if of == 0 { "-".into() } else { format!("{} of {of}", row[class]) };
                write!(f, " {cell:>width$}")?;
            }
        }
        if let Some(every) = self.one_window_in {
            write!(f, "\nlearned from one window in {every} of the train clips, a sample of {MOST} at most")?;
        }
        let left_out = self.groups.last().map_or(0, |dances| dances.left_out);
        if left_out > 0 {
            write!(
                f,
                "\n{left_out} dances without a {} requested throughout, edited, or under two seconds",
                self.field
            )?;
        }
        Ok(())
    }
}
