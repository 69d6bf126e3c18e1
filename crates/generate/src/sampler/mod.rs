//! The sampler: an iterator over the frames of one or more dances.
//!
//! A word is sampled token by token. A given character is taken from the prompt; a free one is sampled from the ids that
//! the tokenizer's grammar allows in its slot, so every dance decodes. Known tokens enter the model in one block with the
//! next free one. A full window drops its older half, whole words, and is read again.
//!
//! Dances sampled side by side share every read of the model's weights. Each free character of each dance has a random
//! stream of its own, so neither the dances beside it nor tokens guessed ahead change a dance.

mod first_frames;
mod goals;
pub(crate) mod guidance;
mod look_ahead;
mod model;
mod plan;
mod sequence;
mod way;

pub use first_frames::FIRST_FRAMES;
pub(crate) use first_frames::has_given_after_free;
pub use guidance::Guidance;
pub use look_ahead::{Chooser, LookAhead};
pub(crate) use model::check_f32;
pub use model::{NextToken, reader, readers};
pub use plan::{GUESSES, MOST_FRAMES, SamplingPlan, check_frames, variation_seed};
pub use way::Way;

use crate::{Error, Result};
use kinelm_model::Logits;
use rayon::prelude::*;
use sequence::Sequence;
use std::ops::{ControlFlow, DerefMut, Range};
use std::sync::Arc;

/// The tokens of sampled dances.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SampledTokens {
    /// The ids of each dance, spaces included.
    pub ids: Vec<Vec<u32>>,
    /// What the model would have sampled in given characters: index into the dance's ids, and id. See
    /// [`SamplingPlan::lookahead`].
    pub lookahead: Vec<Vec<(usize, u32)>>,
    /// Tokens that were guessed ahead.
    pub guessed: u64,
    /// The number of right guesses.
    pub right: u64,
}

impl SampledTokens {
    /// The ids of a dance with its look-ahead tokens in their places.
    pub fn with_lookahead(&self, dance: usize) -> Vec<u32> {
        let mut ids = self.ids[dance].clone();
        self.lookahead[dance].iter().for_each(|&(at, id)| ids[at] = id);
        ids
    }
}

/// Samples dances side by side and yields, word by word, the ids of that word of each dance, spaces included. It can be
/// dropped at any word. After an error it ends.
///
/// ```
/// use kinelm_generate::sampler::{NextToken, Sampler, SamplingPlan};
/// use kinelm_generate::sampling::Sampling;
/// use kinelm_model::{ModelConfig, Reader, ReaderOptions, TokenLayout, fixtures};
/// use kinelm_tokenizer::{Tokenizer, TokenizerConfig};
///
/// let walk = kinelm_corpus::samples::walk(5);
/// let tokenizer = Tokenizer::fit([&walk], TokenizerConfig::uniform(&[0], 20.0, 10))?;
/// let config = ModelConfig { layers: 1, heads: 1, width: 8, context: 40, ..ModelConfig::default() };
/// let mut model = Reader::new(&fixtures::model(&config, &TokenLayout::of(&tokenizer)), ReaderOptions::default())?;
///
/// let plan = SamplingPlan::free(tokenizer.grammar(), 600, Sampling::default(), 7);
/// let mut words = Sampler::new(&mut model, plan)?;
/// let first = words.next().unwrap()?;
/// assert_eq!((first.len(), first[0].len()), (1, 7)); // one dance; six characters and a space
/// assert_eq!(words.by_ref().take(2).count(), 2); // the other 597 words are never sampled
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Sampler<M> {
    plan: Arc<SamplingPlan>,
    parts: Vec<Part<M>>,
    /// Blocks that are decided, and the words of them.
    blocks: usize,
    decided: usize,
    yielded: usize,
    has_failed: bool,
}

/// A model, and the dances that it is read for.
struct Part<M> {
    model: M,
    batch: Batch,
}

impl<M: DerefMut<Target: NextToken> + Send> Sampler<M> {
    /// As many dances as `model` has sequences for, see `SamplingPlan::streams` and [`LookAhead`]. The first has the plan's seed, the others
    /// seeds derived from it.
    ///
    /// # Errors
    /// A context that holds fewer than two words of the one length that all have, or two tokens; sequences that are no whole
    /// number of dances; fronts, goals or music of other lengths; what choosing a first frame reads from the model.
    pub fn new(model: M, plan: impl Into<Arc<SamplingPlan>>) -> Result<Sampler<M>> {
        Sampler::side_by_side(vec![model], plan)
    }

    /// As many dances as all `models` have sequences for, those of different models at the same time: the same dances as of one
    /// model.
    ///
    /// # Errors
    /// Those of [`Sampler::new`].
    pub(crate) fn side_by_side(models: Vec<M>, plan: impl Into<Arc<SamplingPlan>>) -> Result<Sampler<M>> {
        let plan: Arc<SamplingPlan> = plan.into();
        let mut begun = Vec::with_capacity(models.len());
        let mut first = 0;
        for model in models {
            plan.check(&*model)?;
            let numbers = first..first + model.streams() / plan.streams();
            first = numbers.end;
            begun.push((model, numbers));
        }
        if !first.is_multiple_of(plan.candidates()) {
            let expected = format!("a multiple of the {} candidates of a dance", plan.candidates());
            return Err(Error::invalid("the number of sequences", first, expected));
        }
        let parts = at_once(begun, |(model, numbers)| Part::new(model, &plan, numbers))?;
        Ok(Sampler { plan, parts, blocks: 0, decided: 0, yielded: 0, has_failed: false })
    }

    /// Samples the next block of all dances, and goes on with the best candidates for it.
    fn decide(&mut self) -> Result<()> {
        let words = self.plan.decided(self.blocks);
        if self.plan.look_ahead.is_some() {
            let sequences = self.parts.iter_mut().flat_map(|part| &mut part.batch.sequences);
            sequences.for_each(|sequence| sequence.wait_at(words));
        }
        at_once(self.parts.iter_mut().collect(), |part| part.sample(words - 1))?;
        self.blocks += 1;
        if let Some(ahead) = self.plan.look_ahead.clone() {
            self.choose(&ahead, self.decided..words)?;
        }
        self.decided = words;
        Ok(())
    }

    /// Of every dance, all candidates go on from the one that has the best words `block`.
    fn choose(&mut self, ahead: &LookAhead, block: Range<usize>) -> Result<()> {
        let each = self.plan.streams();
        let parts = self.parts.iter().enumerate();
        let places: Vec<(usize, usize)> =
            parts.flat_map(|(part, own)| (0..own.batch.sequences.len()).map(move |i| (part, i))).collect();
        for candidates in places.chunks(ahead.candidates) {
            let first = block.start.saturating_sub(ahead.before);
            let words = |&(part, i): &(usize, usize)| self.parts[part].batch.sequences[i].words_in(first..block.end);
            let dances: Vec<&[u32]> = candidates.iter().map(words).collect();
            let (part, i) = candidates[ahead.chooser.best(&dances, first, block.clone())?];
            let own = &self.parts[part];
            let saved: Option<Vec<_>> = (0..each).map(|stream| own.model.save(i * each + stream)).collect();
            let best = own.batch.sequences[i].since(block.start);
            for &(to_part, to) in candidates {
                let other = &mut self.parts[to_part];
                // what the best one has read stays
                let is_best = (to_part, to) == (part, i);
                let saved = saved.iter().flatten().filter(|_| !is_best);
                (to * each..).zip(saved.clone()).for_each(|(stream, saved)| other.model.restore(stream, saved));
                let has_read = is_best || saved.count() > 0;
                other.batch.sequences[to].go_on_from(&best, self.blocks, has_read);
            }
        }
        Ok(())
    }

    /// The tokens sampled so far.
    pub(crate) fn into_tokens(self) -> SampledTokens {
        let mut all = SampledTokens::default();
        let candidates = self.plan.candidates();
        for (i, sequence) in self.parts.into_iter().flat_map(|part| part.batch.sequences).enumerate() {
            (all.guessed, all.right) = (all.guessed + sequence.guessed, all.right + sequence.right);
            // all candidates of a dance are the best one in the end
            if i % candidates > 0 {
                continue;
            }
            let (ids, lookahead) = sequence.into_tokens();
            all.ids.push(ids);
            all.lookahead.push(lookahead);
        }
        all
    }
}

impl<M: DerefMut<Target: NextToken> + Send> Iterator for Sampler<M> {
    type Item = Result<Vec<Vec<u32>>>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.has_failed || self.yielded == self.plan.words {
            return None;
        }
        let word = self.yielded;
        if self.yielded == self.decided
            && let Err(e) = self.decide()
        {
            self.has_failed = true;
            return Some(Err(e));
        }
        self.yielded += 1;
        let sequences = self.parts.iter().flat_map(|part| &part.batch.sequences).step_by(self.plan.candidates());
        Some(Ok(sequences.map(|sequence| sequence.word(word).to_vec()).collect()))
    }
}

impl<M: DerefMut<Target: NextToken>> Part<M> {
    /// The sequences with these numbers among all candidates of all dances.
    fn new(mut model: M, plan: &Arc<SamplingPlan>, numbers: Range<usize>) -> Result<Part<M>> {
        let first = numbers.start;
        let seeds = numbers.map(|number| plan.seed_of(number / plan.candidates())).collect();
        let seeds = first_frames::best_seeds(&mut *model, plan, seeds)?;
        let batch = Batch::new(plan, first, &seeds, model.context());
        Ok(Part { model, batch })
    }

    /// Samples until all dances have this word.
    fn sample(&mut self, word: usize) -> Result<()> {
        while self.batch.words() <= word {
            self.batch.step(&mut *self.model)?;
        }
        Ok(())
    }
}

/// Each of `all` on a thread of the pool; of several errors the first.
fn at_once<T: Send, R: Send>(all: Vec<T>, each: impl Fn(T) -> Result<R> + Sync + Send) -> Result<Vec<R>> {
    if all.len() < 2 {
        return all.into_iter().map(each).collect();
    }
    // one task a model, and all run to their end: which error is the first doesn't depend on timing
    let done: Vec<Result<R>> = all.into_par_iter().with_max_len(1).map(each).collect();
    done.into_iter().collect()
}

/// Watches a sampling: it gets the number of words that every dance has and the ids of the last word of each, spaces
/// included. `Break` stops the sampling.
pub type SamplingProgress<'a> = dyn FnMut(usize, &[Vec<u32>]) -> ControlFlow<()> + 'a;

/// The [`SamplingProgress`] of a sampling that nobody watches.
pub fn unwatched(_: usize, _: &[Vec<u32>]) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// All words of as many dances as `model` has sequences for.
///
/// # Errors
/// Those of [`Sampler::new`]; logits that allow no token (word and slot are named), and what reading fails with;
/// [`kinelm_store::Error::Stopped`] when `progress` stopped it.
pub fn sample(
    model: &mut dyn NextToken,
    plan: &SamplingPlan,
    progress: &mut SamplingProgress<'_>,
) -> Result<SampledTokens> {
    all_words(Sampler::new(model, plan.clone())?, progress)
}

/// The same of all `models`, those of different models at the same time.
///
/// # Errors
/// Those of [`sample`].
pub fn sample_side_by_side(
    models: &mut [Box<dyn NextToken>],
    plan: &SamplingPlan,
    progress: &mut SamplingProgress<'_>,
) -> Result<SampledTokens> {
    let models: Vec<&mut dyn NextToken> = models.iter_mut().map(|model| &mut **model as _).collect();
    all_words(Sampler::side_by_side(models, plan.clone())?, progress)
}

fn all_words(mut sampler: Sampler<&mut dyn NextToken>, progress: &mut SamplingProgress<'_>) -> Result<SampledTokens> {
    while let Some(word) = sampler.next() {
        if progress(sampler.yielded, &word?).is_break() {
            return Err(Error::stopped("stopped before the dance was whole"));
        }
    }
    Ok(sampler.into_tokens())
}

/// The ids of one dance, spaces included.
///
/// # Errors
/// Those of [`sample`]; a model of more sequences than one dance takes.
pub fn sample_one(
    model: &mut dyn NextToken,
    plan: &SamplingPlan,
    progress: &mut SamplingProgress<'_>,
) -> Result<Vec<u32>> {
    let (found, expected) = (model.streams(), plan.streams());
    if found != expected {
        return Err(Error::invalid("the number of sequences", found, format!("{expected}, for one dance")));
    }
    Ok(sample(model, plan, progress)?.ids.remove(0))
}

/// Dances that are sampled side by side.
struct Batch {
    plan: Arc<SamplingPlan>,
    sequences: Vec<Sequence>,
    logits: Vec<f32>,
    /// Whether the first words are only scored, up to [`Sequence::is_scored`].
    scores: bool,
}

impl Batch {
    /// A sequence for each dance's seed, numbered from `first` on.
    fn new(plan: &Arc<SamplingPlan>, first: usize, seeds: &[u64], context: usize) -> Batch {
        let sequences = (first..).zip(seeds).map(|(number, &seed)| Sequence::new(plan.clone(), number, seed, context));
        Batch { plan: plan.clone(), sequences: sequences.collect(), logits: Vec::new(), scores: false }
    }

    /// Whole words that every dance has.
    fn words(&self) -> usize {
        self.sequences.iter().map(Sequence::words).min().unwrap_or(self.plan.words)
    }

    fn is_done(&self) -> bool {
        self.sequences.iter().all(|sequence| sequence.is_done() || sequence.is_scored())
    }

    /// Reads the model once and samples what its logits allow to.
    fn step(&mut self, model: &mut (impl NextToken + ?Sized)) -> Result<()> {
        let guesses = if model.is_exact() { self.plan.guesses } else { 0 };
        // a guided dance has two streams: the conditioned one, then the other
        let each = self.plan.streams();
        for (i, sequence) in self.sequences.iter_mut().enumerate() {
            let read = sequence.prepare(guesses);
            for stream in i * each..(i + 1) * each {
                match read {
                    0 => model.begin_after(stream, sequence.before()),
                    read => model.truncate(stream, read),
                }
            }
            // the unconditioned reading gets neither goals nor music
            sequence.condition(model, i * each)?;
        }
        let wanted =
            if self.scores || self.sequences.iter().any(Sequence::has_guesses) { Logits::All } else { Logits::Last };
        let blocks: Vec<&[u32]> =
            self.sequences.iter().flat_map(|s| std::iter::once(s.block()).chain(s.unconditioned_block())).collect();
        model.read(&blocks, wanted, &mut self.logits)?;
        let rows = |s: &Sequence| if wanted == Logits::All { s.block().len() } else { s.block().len().min(1) };
        let all: usize = self.sequences.iter().map(|s| rows(s) * each).sum();
        let vocabulary = self.logits.len() / all.max(1);
        let mut rest = self.logits.as_mut_slice();
        for sequence in &mut self.sequences {
            let (own, after) = rest.split_at_mut(rows(sequence) * each * vocabulary);
            let (conditioned, unconditioned) = own.split_at_mut(rows(sequence) * vocabulary);
            let scale = sequence.scale().filter(|_| each > 1);
            if let Some(scale) = scale {
                guidance::mix(scale, conditioned, unconditioned);
            }
            if self.scores {
                sequence.score(conditioned, vocabulary);
            }
            sequence.take(conditioned, scale.map(|scale| (scale, &*unconditioned)), vocabulary)?;
            rest = after;
        }
        Ok(())
    }
}

#[cfg(test)]
mod form_tests;
#[cfg(test)]
mod tests;
