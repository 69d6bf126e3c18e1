//! Windows as a model with heads reads them.

use super::batches::{IdsOf, Numbers};
use super::class_scores::{ClassScores, normalised};
use crate::{Error, Result};
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_engine::arena::Floats;
use kinelm_model::Scores;
use kinelm_model::class_windows::{Layout, Window};
use kinelm_model::fast::Fast;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Windows that are read side by side.
const TOGETHER: usize = 16;

/// Clips as ids.
pub(super) struct Source<'a> {
    /// Largest number of windows, evenly spread; 0: all.
    pub most: usize,
    /// Ends reading between two batches.
    pub stop: Option<&'a AtomicBool>,
    /// Words of every clip.
    pub words: Vec<usize>,
    /// The ids of a window.
    pub ids: Box<IdsOf<'a>>,
}

impl<'a> Source<'a> {
    pub fn of(corpus: &'a Corpus, clips: &'a [&ClipRecord]) -> Source<'a> {
        Source {
            most: 0,
            stop: None,
            words: clips.iter().map(|c| corpus.words(c).len()).collect(),
            ids: Box::new(move |w| Ok(corpus.word_ids(clips[w.clip], w.word..w.word + w.words)?)),
        }
    }

    /// The windows that are read, in order.
    pub fn windows(&self, layout: &Layout) -> Vec<Window> {
        let all = || self.words.iter().enumerate().flat_map(|(clip, &words)| layout.windows(clip, words));
        if self.most == 0 {
            return all().collect();
        }
        let (there, mut next) = (all().count(), 0);
        let taken = self.most.min(there);
        let spread = all().enumerate().filter(|(number, _)| {
            let is_taken = next < taken && *number == next * there / taken;
            next += usize::from(is_taken);
            is_taken
        });
        spread.map(|(_, window)| window).collect()
    }
}

/// The classes of every window of `source`, by a model with these heads.
///
/// # Errors
/// What the model refuses.
pub(super) fn read_windows(
    model: &mut Fast,
    heads: &[Floats],
    layout: &Layout,
    compat: bool,
    source: &Source,
) -> Result<Vec<ClassScores>> {
    let width = Scores::config(model).width;
    let scores = |w: &Window, vectors: &[f32]| {
        let logits = |(head, h): (&Floats, &[f32])| {
            let dot = |row: &[f32]| row.iter().zip(h).map(|(a, b)| f64::from(a * b)).sum::<f64>();
            normalised(head.chunks(width).map(dot).collect())
        };
        let log_p = heads.iter().zip(vectors.chunks(width)).map(logits).collect();
        ClassScores { clip: w.clip, words: w.word..w.word + w.words, log_p }
    };
    each_window(model, layout, compat, source, &|w| layout.rows(w.words), &scores)
}

/// The mean final vector of the motion's tokens of every window, (D) each.
///
/// # Errors
/// What the model refuses.
pub(super) fn pooled(model: &mut Fast, layout: &Layout, source: &Source) -> Result<Vec<Vec<f64>>> {
    let width = Scores::config(model).width;
    let mean = |_: &Window, vectors: &[f32]| {
        let mut mean = vec![0.0; width];
        let n = (vectors.len() / width) as f64;
        for h in vectors.chunks(width) {
            mean.iter_mut().zip(h).for_each(|(m, x)| *m += f64::from(*x) / n);
        }
        mean
    };
    each_window(model, layout, true, source, &|w| layout.motion_rows(w.words), &mean)
}

/// Maps the final vectors of some rows of every window by `read`.
///
/// # Errors
/// What the model refuses; [`kinelm_store::Error::Stopped`] where the source is stopped.
fn each_window<T>(
    model: &mut Fast,
    layout: &Layout,
    compat: bool,
    source: &Source,
    rows_of: &dyn Fn(&Window) -> Range<usize>,
    read: &dyn Fn(&Window, &[f32]) -> T,
) -> Result<Vec<T>> {
    let windows = source.windows(layout);
    let width = Scores::config(model).width;
    let mut all = Vec::with_capacity(windows.len());
    for some in windows.chunks(TOGETHER) {
        if source.stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            return Err(Error::stopped("stopped while windows were read"));
        }
        let numbers = Numbers::of(layout, &source.ids, some, compat)?;
        let rows = some.iter().enumerate().flat_map(|(i, w)| rows_of(w).map(move |r| i * layout.places() + r));
        let vectors = model.final_vectors(numbers.as_windows(layout), &rows.collect::<Vec<usize>>())?;
        let mut rest = vectors.as_slice();
        for w in some {
            let (of_window, others) = rest.split_at(rows_of(w).len() * width);
            rest = others;
            all.push(read(w, of_window));
        }
    }
    Ok(all)
}
