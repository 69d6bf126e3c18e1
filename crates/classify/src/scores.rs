//! The classes of windows and clips, as probabilities.

use super::Classifier;
use super::batches::{IdsOf, Numbers};
use super::features::Motion;
use super::fusion::fuse;
use crate::{Error, Result};
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_engine::arena::Floats;
use kinelm_model::Scores;
use kinelm_model::class_windows::{Layout, Window};
use kinelm_model::fast::Fast;
use kinelm_tokenizer::Words;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Windows that are read side by side.
const TOGETHER: usize = 16;

/// Class probabilities of a window, or of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct ClassScores {
    /// Index into the clips.
    pub clip: usize,
    /// The words that it shows.
    pub words: Range<usize>,
    /// ln p, per field and class.
    pub log_p: Vec<Vec<f64>>,
}

impl ClassScores {
    /// The most likely class of a field; of equals the first.
    pub fn likeliest(&self, field: usize) -> usize {
        likeliest(&self.log_p[field])
    }
}

/// The index of the largest number; of equals the first.
pub fn likeliest(log_p: &[f64]) -> usize {
    (0..log_p.len()).fold(0, |best, i| if log_p[i] > log_p[best] { i } else { best })
}

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

impl Classifier {
    fn read(&mut self, source: &Source) -> Result<Vec<ClassScores>> {
        read_windows(&mut self.model, &self.heads, &self.layout, self.manifest.compat, source)
    }

    /// The classes of every window of these clips of a corpus, in their order, by class tokens alone.
    ///
    /// # Errors
    /// A corpus of another tokenizer.
    pub fn classify_windows(&mut self, corpus: &Corpus, clips: &[&ClipRecord]) -> Result<Vec<ClassScores>> {
        super::train::same_tokenizer(&self.manifest.tokenizer, corpus)?;
        self.read(&Source::of(corpus, clips))
    }

    /// The classes of clips of a corpus by the scores of their windows together with the discriminants.
    ///
    /// # Errors
    /// A corpus that doesn't hold together.
    pub fn classify_clips(
        &self,
        corpus: &Corpus,
        clips: &[&ClipRecord],
        windows: &[ClassScores],
    ) -> Result<Vec<ClassScores>> {
        let one = |s: &ClassScores| Ok(fuse(&self.fusions, s, &Motion::of(corpus, clips[s.clip])?));
        of_clips(windows).par_iter().map(one).collect()
    }

    /// The classes of every window of a clip in words of its tokenizer, all of one length, by class tokens alone, and of the
    /// clip, together with the discriminants; none of a clip without a word.
    ///
    /// # Errors
    /// What the model refuses.
    pub fn classify_words(&mut self, words: &Words) -> Result<(Vec<ClassScores>, Option<ClassScores>)> {
        let ids = self.tokenizer.ids_of_words(words)?;
        let word = self.manifest.tokens.word;
        let ids_of = |w: &Window| Ok(ids[w.word * word..(w.word + w.words) * word].to_vec());
        let source = Source { most: 0, stop: None, words: vec![ids.len() / word], ids: Box::new(ids_of) };
        let windows = self.read(&source)?;
        let Some(tokens) = of_clips(&windows).pop() else { return Ok((windows, None)) };
        let clip = fuse(&self.fusions, &tokens, &Motion::of_words(&self.tokenizer, words)?);
        Ok((windows, Some(clip)))
    }
}

/// The classes of clips from those of their windows, which follow each other clip by clip: the mean ln p, normalised.
pub fn of_clips(windows: &[ClassScores]) -> Vec<ClassScores> {
    let one = |windows: &[ClassScores]| {
        let fields = windows[0].log_p.len();
        let mean = |field: usize| {
            let of_field: Vec<&Vec<f64>> = windows.iter().map(|w| &w.log_p[field]).collect();
            mean_log_p(&of_field)
        };
        let words = windows[0].words.start..windows[windows.len() - 1].words.end;
        ClassScores { clip: windows[0].clip, words, log_p: (0..fields).map(mean).collect() }
    };
    windows.chunk_by(|a, b| a.clip == b.clip).map(one).collect()
}

/// ln p of every class of a clip: the mean over its windows, one or more, normalised.
pub(super) fn mean_log_p(windows: &[impl AsRef<[f64]>]) -> Vec<f64> {
    let sum = |class: usize| windows.iter().map(|w| w.as_ref()[class]).sum::<f64>();
    let classes = windows[0].as_ref().len();
    normalised((0..classes).map(|class| sum(class) / windows.len() as f64).collect())
}

/// Logits as ln p: log-softmax.
pub(super) fn normalised(logits: Vec<f64>) -> Vec<f64> {
    let most = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum = most + logits.iter().map(|l| (l - most).exp()).sum::<f64>().ln();
    logits.into_iter().map(|l| l - sum).collect()
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
