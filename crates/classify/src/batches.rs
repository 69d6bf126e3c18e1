//! The windows of an update and their class rows: a function of (seed, update) and of nothing else.

use super::fields::{Field, Fields};
use super::learner::Batch;
use super::options::TrainOptions;
use crate::Result;
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_model::class_windows::{Layout, Window, mask};
use kinelm_model::fast::{ClassRow, Windows};
use kinelm_store::random;

/// The training windows. A pass takes each once, in a random order.
pub(super) struct Batches<'a> {
    corpus: &'a Corpus,
    clips: Vec<&'a ClipRecord>,
    fields: &'a Fields,
    layout: &'a Layout,
    windows: Vec<Window>,
    /// Loss weights, per field and class.
    weights: Vec<Vec<f64>>,
    batch: usize,
    compat: bool,
    seed: u64,
    /// Of the present pass.
    order: Option<(u64, Vec<usize>)>,
}

impl<'a> Batches<'a> {
    /// The windows of `clips`, `options.batch` at a time.
    pub fn new(
        corpus: &'a Corpus,
        clips: Vec<&'a ClipRecord>,
        fields: &'a Fields,
        layout: &'a Layout,
        options: &TrainOptions,
    ) -> Batches<'a> {
        let windows: Vec<Window> =
            clips.iter().enumerate().flat_map(|(i, c)| layout.windows(i, corpus.words(c).len())).collect();
        let weigh = |field: &Field| {
            let mut counts = vec![0usize; field.classes.len()];
            windows.iter().filter_map(|w| field.class_of(clips[w.clip])).for_each(|class| counts[class] += 1);
            let (all, some) = (counts.iter().sum::<usize>() as f64, counts.iter().filter(|&&n| n > 0).count() as f64);
            // each class that occurs gets an equal share of the whole weight
            let one = |&n: &usize| if options.unbalanced || n == 0 { 1.0 } else { all / (some * n as f64) };
            counts.iter().map(one).collect()
        };
        let weights = fields.0.iter().map(weigh).collect();
        let (batch, compat, seed) = (options.batch, options.compat, options.seed);
        Batches { corpus, clips, fields, layout, windows, weights, batch, compat, seed, order: None }
    }

    /// The number of clips.
    pub fn clips(&self) -> usize {
        self.clips.len()
    }

    /// The number of windows.
    pub fn windows(&self) -> usize {
        self.windows.len()
    }

    /// The windows of an update.
    ///
    /// # Errors
    /// A corpus that can no longer be read.
    pub fn batch(&mut self, update: u64) -> Result<Numbers> {
        let first = update * self.batch as u64;
        let chosen: Vec<Window> = (first..first + self.batch as u64).map(|place| self.window(place)).collect();
        let ids_of = |w: &Window| Ok(self.corpus.word_ids(self.clips[w.clip], w.word..w.word + w.words)?);
        let mut numbers = Numbers::of(self.layout, &ids_of, &chosen, self.compat)?;
        let t = self.layout.places();
        for (table, field) in self.fields.0.iter().enumerate() {
            let class = |w: &Window| field.class_of(self.clips[w.clip]);
            // the mean is over the windows with a label, and these differ by field
            let counted = chosen.iter().filter(|w| class(w).is_some()).count().max(1) as f64;
            for (i, window) in chosen.iter().enumerate() {
                let Some(class) = class(window) else { continue };
                let row = i * t + self.layout.rows(window.words).start + table;
                let weight = (self.weights[table][class] / counted) as f32;
                numbers.rows.push(ClassRow { row, table, class: class as u32, weight });
            }
        }
        numbers.clips = chosen.iter().map(|w| self.clips[w.clip].name.clone()).collect();
        Ok(numbers)
    }

    /// The window at an index that is counted through all passes.
    fn window(&mut self, place: u64) -> Window {
        let all = self.windows.len() as u64;
        let (pass, at) = (place / all, (place % all) as usize);
        if self.order.as_ref().is_none_or(|(of, _)| *of != pass) {
            let mut order: Vec<usize> = (0..self.windows.len()).collect();
            random::shuffle(&mut order, &mut random::stream(self.seed, "class windows", pass, 0));
            self.order = Some((pass, order));
        }
        let at = self.order.as_ref().map_or(at, |(_, order)| order[at]);
        self.windows[at]
    }
}

/// The ids of a window.
pub(super) type IdsOf<'a> = dyn Fn(&Window) -> Result<Vec<u32>> + 'a;

/// A batch's numbers.
pub(super) struct Numbers {
    pub inputs: Vec<u32>,
    pub targets: Vec<u32>,
    hiding: Option<Vec<f32>>,
    rows: Vec<ClassRow>,
    clips: Vec<String>,
}

impl Numbers {
    /// Windows without class rows, of the ids that `ids_of` gives.
    ///
    /// # Errors
    /// Those of `ids_of`.
    pub fn of(layout: &Layout, ids_of: &IdsOf<'_>, windows: &[Window], compat: bool) -> Result<Numbers> {
        let t = layout.length();
        let (mut inputs, mut targets) = (vec![0; windows.len() * t], vec![0; windows.len() * t]);
        for ((window, input), target) in windows.iter().zip(inputs.chunks_mut(t)).zip(targets.chunks_mut(t)) {
            layout.fill(&ids_of(window)?, input, target);
        }
        let words: Vec<usize> = windows.iter().map(|w| w.words).collect();
        Ok(Numbers { inputs, targets, hiding: layout.hiding(&words, compat), rows: Vec::new(), clips: Vec::new() })
    }

    /// With their class rows.
    pub fn as_batch(&self, layout: &Layout) -> Batch<'_> {
        Batch { windows: self.as_windows(layout), rows: &self.rows, clips: &self.clips }
    }

    /// Without.
    pub fn as_windows(&self, layout: &Layout) -> Windows<'_> {
        let mask = mask(self.hiding.as_deref());
        Windows {
            inputs: &self.inputs,
            targets: &self.targets,
            length: layout.length(),
            mask,
            history: &[],
            conditioning: None,
        }
    }
}
