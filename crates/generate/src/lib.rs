//! New dances: some characters of every word are given, or the first words are, and the model draws the rest.
//!
//! A word is drawn token by token. A given place takes the prompt's character; a free one is drawn from the tokens that the
//! tokenizer's grammar allows there and from nothing else, so whatever comes out decodes. Known tokens go into the model in
//! one block with the next free one. When the context is full, the oldest half of it is dropped, whole words, and the rest
//! read again.
//!
//! Several dances can be drawn side by side, sharing every read of the model's weights. Each free place of each dance
//! draws from a random stream of its own, so neither company nor guessing ahead changes what is drawn.
#![forbid(unsafe_code)]

pub mod apart;
pub mod best;
pub mod conditions;
pub mod cut;
mod dance;
pub mod draws;
pub mod edit;
pub mod feet;
pub mod followed;
pub mod free;
pub mod guidance;
pub mod labels;
mod likely;
pub mod music;
pub mod open;
pub mod place;
pub mod prompt;
pub mod provenance;
pub mod request;
pub mod resolve;
pub mod rest;
pub mod sampling;
pub mod starts;
pub mod timeline;

use dance::Dance;
use guidance::Guidance;
use kinelm_engine::decode::{FrameConditioning, KvKind, Logits, WeightKind};
use kinelm_model::goal::GoalTrack;
use kinelm_model::{Cache, Compute, LoadedRun, ModelKind, Reader, ReaderOptions};
pub use kinelm_model::{Error, Result};
use kinelm_tokenizer::{Grammar, Special};
use rand_chacha::rand_core::RngCore;
use sampling::Draw;

/// What generation asks of a model: sequences that are read side by side.
pub trait NextToken: Send {
    /// T: tokens that one window holds, the front token included.
    fn context(&self) -> usize;

    /// Sequences.
    fn streams(&self) -> usize;

    /// Whether tokens have the very same logits however blocks are cut, so that tokens may be guessed ahead.
    fn is_exact(&self) -> bool;

    /// A sequence forgets all but its first `length` tokens, and what later frames were told.
    fn truncate(&mut self, stream: usize, length: usize);

    /// Tells a frame of a sequence, counted from its window's first, what is given ahead of it, and (M) its music if there is
    /// any, before the token is read that it is spelled behind. Models that can't be told do nothing.
    ///
    /// # Errors
    /// Whatever keeps the model from it.
    fn condition(
        &mut self,
        _stream: usize,
        _frame: usize,
        _told: Option<FrameConditioning>,
        _music: &[f32],
    ) -> Result<()> {
        Ok(())
    }

    /// Reads a block of tokens a sequence, which may be empty, and puts the logits (rows, V) of what follows into `logits`:
    /// behind the last token of each block, or behind every token, in the order of the sequences.
    ///
    /// # Errors
    /// Whatever keeps the model from it; more tokens than the context holds.
    fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()>;
}

impl NextToken for Reader {
    fn context(&self) -> usize {
        Reader::context(self)
    }

    fn streams(&self) -> usize {
        Reader::streams(self)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn truncate(&mut self, stream: usize, length: usize) {
        Reader::truncate(self, stream, length);
    }

    fn condition(&mut self, stream: usize, frame: usize, told: Option<FrameConditioning>, music: &[f32]) -> Result<()> {
        Reader::condition(self, stream, frame, told, music)
    }

    fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()> {
        logits.clear();
        logits.extend_from_slice(Reader::read(self, blocks, wanted)?);
        Ok(())
    }
}

/// The plain form: a cache a sequence, read one after the other.
impl NextToken for Vec<Cache> {
    fn context(&self) -> usize {
        self.first().map_or(0, Cache::context)
    }

    fn streams(&self) -> usize {
        self.len()
    }

    fn is_exact(&self) -> bool {
        false
    }

    fn truncate(&mut self, stream: usize, length: usize) {
        self[stream].truncate(length);
    }

    fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()> {
        logits.clear();
        for (cache, block) in self.iter_mut().zip(blocks).filter(|(_, block)| !block.is_empty()) {
            match wanted {
                Logits::Last => logits.extend(cache.read(block)?),
                Logits::All => logits.extend(cache.read_all(block)?.flatten_all()?.to_vec1::<f32>()?),
            }
        }
        Ok(())
    }
}

/// The model of a run in the form that is wanted, ready to read.
///
/// # Errors
/// A masked model: it tells a token from those on both sides of it, and those behind it aren't there yet.
/// Weights that don't fit the configuration, a device that isn't there, a reading that the form doesn't have.
pub fn reader(run: &LoadedRun, compute: Compute, reading: ReaderOptions) -> Result<Box<dyn NextToken>> {
    if run.config.kind == ModelKind::Masked {
        let what = "the model is masked: it tells a token from those on both sides, and of a new dance there are none \
                    behind it; train one with model.kind = \"causal\"";
        return Err(Error::call(format!("{}: {what}", run.checkpoint.display())));
    }
    if compute.is_fast() {
        return Ok(Box::new(run.reader(reading)?));
    }
    if (reading.weights, reading.kv) != (WeightKind::F32, KvKind::F32) {
        return Err(Error::call(format!(
            "weights as {:?}, keys and values as {:?}: the plain form of the model has F32 alone; leave them out, or use \
             the form auto on the cpu",
            reading.weights, reading.kv
        )));
    }
    let model = run.plain(&compute.device.open()?)?;
    let caches = (0..reading.streams).map(|_| model.cache()).collect::<Result<Vec<Cache>>>()?;
    Ok(Box::new(caches))
}

/// Guesses ahead for greedy dances. On a model of 5 million parameters trained on real dances, 99.8 % of them are right and
/// 60 frames take 0.42 of the time; of those for characters drawn by probability 24 % are, which saves nothing.
const GUESSES: usize = 8;

/// Frames of a dance, at most: half a day at 20 frames a second, whose ids fit into memory.
pub const MOST_FRAMES: usize = 1 << 20;

/// Refuses a dance that is too long, whether a call or a file asks for it.
///
/// # Errors
/// [`kinelm_store::Error::Call`] with both numbers.
pub fn check_frames(frames: usize) -> Result<()> {
    match frames {
        0..=MOST_FRAMES => Ok(()),
        _ => Err(Error::call(format!("{frames} frames; expected {MOST_FRAMES} at most"))),
    }
}

/// What is to be danced.
#[derive(Debug, Clone)]
pub struct SamplingPlan<'a> {
    /// Words wanted.
    pub words: usize,
    /// Of these the first ones that only lead in: free or the beginning's, the prompt's first word behind them.
    pub lead_in: usize,
    /// Which ids may stand where.
    pub grammar: Grammar,
    /// Ids of whole words, spaces included, that the dance begins with.
    pub beginning: &'a [u32],
    /// The same of each dance drawn side by side, where they begin with words of their own; empty: [`SamplingPlan::beginning`].
    pub beginnings: &'a [&'a [u32]],
    /// (C) which places of a word are given, where all words have C characters and none are merged, or (P, C) which of each
    /// word of the prompt; empty: none.
    pub given: &'a [bool],
    /// (P, C) given places that are first drawn, to tell what the model would have done there, and then taken back with
    /// their word; empty: none.
    pub foretold: &'a [bool],
    /// (P, W) ids of the P words that these places are taken from, spaces included; words beyond them are free.
    pub prompt: &'a [u32],
    /// The tokens in front of every window: `<bos>`, then those of conditions.
    pub front: &'a [u32],
    /// From which words on, the lead-in's counted, other tokens stand there, as many; ascending.
    pub fronts: &'a [(usize, Vec<u32>)],
    /// How far the conditions in front are followed; `None`: as the model has learned them, in half the time.
    pub guidance: Option<Guidance<'a>>,
    /// What is given, where the model is to be told ahead of it; its frames are the lead-in's and the prompt's.
    pub course: Option<&'a GoalTrack>,
    /// How far frames are led to what is given ahead, 1: as the model has learned it; 0: it is told nothing. Other numbers
    /// take twice the time.
    pub ahead: f64,
    /// (words, M) what each word is told of music, the lead-in's among them; empty: nothing.
    pub music: &'a [f32],
    /// How free places are drawn.
    pub draw: Draw,
    /// The seed of the draws.
    pub seed: u64,
    /// What the draws come from beside the seed, see [`draws`]; 0: nothing.
    pub given_number: u64,
    /// First words that are drawn where one is given in part, see [`starts`]; 1: the dance's own alone.
    pub starts: usize,
    /// Free tokens that are guessed ahead and verified in one read; it changes no id, only the time.
    pub guesses: usize,
}

/// What stands in front of a window without conditions.
const FRONT: &[u32] = &[Special::Bos.id()];

impl SamplingPlan<'_> {
    /// A free dance of so many words of a grammar.
    pub fn free(grammar: Grammar, words: usize, draw: Draw, seed: u64) -> Self {
        let guesses = if draw.greedy { GUESSES } else { 0 };
        let (beginning, given, foretold, prompt) = (&[][..], &[][..], &[][..], &[][..]);
        SamplingPlan {
            words,
            lead_in: 0,
            grammar,
            beginning,
            beginnings: &[],
            given,
            foretold,
            prompt,
            front: FRONT,
            fronts: &[],
            guidance: None,
            course: None,
            ahead: 1.0,
            music: &[],
            draw,
            seed,
            given_number: 0,
            starts: 1,
            guesses,
        }
    }

    /// Sequences that a dance takes: two where it is guided, or led ahead in other measure than learned.
    pub fn streams(&self) -> usize {
        1 + usize::from(self.guidance.is_some() || (self.told().is_some() && self.ahead != 1.0))
    }

    /// What the model is told of.
    fn told(&self) -> Option<&GoalTrack> {
        self.course.filter(|_| self.ahead != 0.0)
    }
}

/// The ids of a new dance, spaces included. `progress` is told the number of words done.
///
/// The same model, plan and seed give the same ids.
///
/// # Errors
/// As [`dances`]; a model of several sequences.
pub fn dance(model: &mut dyn NextToken, plan: &SamplingPlan, progress: &mut dyn FnMut(usize)) -> Result<Vec<u32>> {
    if model.streams() != plan.streams() {
        let (found, expected) = (model.streams(), plan.streams());
        return Err(Error::call(format!("one dance from a model of {found} sequences; expected {expected}")));
    }
    Ok(dances(model, plan, progress)?.ids.remove(0))
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledTokens {
    /// The ids of each dance, spaces included.
    pub ids: Vec<Vec<u32>>,
    /// What was drawn of each where it was given: the place among its ids, and the id. See [`SamplingPlan::foretold`].
    pub foretold: Vec<Vec<(usize, u32)>>,
    /// Tokens that were guessed ahead.
    pub guessed: u64,
    /// Of these the ones that were drawn.
    pub right: u64,
}

/// As many dances as the model has sequences for, see [`SamplingPlan::streams`]. The first is the plan's; the others draw from
/// seeds of their own, made from the plan's. `progress` is told the number of words that all of them have.
///
/// # Errors
/// A context that holds fewer than two words of the one length that all have, or two tokens; sequences that are no whole
/// number of dances; fronts of other lengths than the first; a course of other words, music of another number of them; logits
/// that allow no token (word
/// and place are named), and what the model's own reading fails with.
pub fn dances(
    model: &mut dyn NextToken,
    plan: &SamplingPlan,
    progress: &mut dyn FnMut(usize),
) -> Result<SampledTokens> {
    check(model, plan)?;
    let variations = 0..model.streams() / plan.streams();
    let seeds = variations.map(|i| draws::seed(variation_seed(plan.seed, i), plan.given_number)).collect();
    let seeds = starts::chosen(model, plan, seeds)?;
    let dances = drawn(model, plan, &seeds, false, progress)?;
    let count = |f: &dyn Fn(&Dance) -> u64| dances.iter().map(f).sum();
    let (guessed, right) = (count(&|d| d.guessed), count(&|d| d.right));
    let (ids, foretold) = dances.into_iter().map(Dance::into_drawn).unzip();
    Ok(SampledTokens { ids, foretold, guessed, right })
}

/// A dance for each seed, drawn side by side; or, to weigh it, what comes up to [`Dance::is_weighed`].
fn drawn<'a>(
    model: &mut dyn NextToken,
    plan: &'a SamplingPlan<'a>,
    seeds: &[u64],
    weigh: bool,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<Dance<'a>>> {
    let guesses = if model.is_exact() { plan.guesses } else { 0 };
    let (context, each) = (model.context(), plan.streams());
    let beginning = |i: usize| plan.beginnings.get(i).copied().unwrap_or(plan.beginning);
    let begun = seeds.iter().enumerate().map(|(i, &seed)| Dance::new(plan, (seed, beginning(i)), context));
    let mut dances: Vec<Dance> = begun.collect();
    let mut logits = Vec::new();
    while dances.iter().any(|dance| !dance.is_done() && !dance.is_weighed()) {
        for (i, dance) in dances.iter_mut().enumerate() {
            let read = dance.prepare(guesses);
            (0..each).for_each(|stream| model.truncate(i * each + stream, read));
            // the second reading is told nothing, neither what is ahead nor music
            dance.tell(model, i * each)?;
        }
        let wanted = if weigh || dances.iter().any(Dance::guesses) { Logits::All } else { Logits::Last };
        let blocks: Vec<&[u32]> =
            dances.iter().flat_map(|d| std::iter::once(d.block()).chain(d.block_without())).collect();
        model.read(&blocks, wanted, &mut logits)?;
        let rows = |dance: &Dance| if wanted == Logits::All { dance.block().len() } else { dance.block().len().min(1) };
        let all: usize = dances.iter().map(|d| rows(d) * each).sum();
        let vocabulary = logits.len() / all.max(1);
        let mut rest = logits.as_mut_slice();
        for dance in &mut dances {
            let (own, behind) = rest.split_at_mut(rows(dance) * each * vocabulary);
            let (with, without) = own.split_at_mut(rows(dance) * vocabulary);
            if let Some(scale) = dance.scale().filter(|_| each > 1) {
                guidance::mix(scale, with, without);
            }
            if weigh {
                dance.weigh(with, vocabulary);
            }
            dance.take(with, vocabulary)?;
            rest = behind;
        }
        progress(dances.iter().map(Dance::words).min().unwrap_or(0));
    }
    Ok(dances)
}

/// Refuses a model and a plan that make no dances together.
fn check(model: &dyn NextToken, plan: &SamplingPlan) -> Result<()> {
    let (context, word) = (model.context(), plan.grammar.tokens_per_word());
    // a window of n words reads the front and n words but for the last space
    let room = (context + 1).saturating_sub(plan.front.len());
    let (what, most) = word.map_or(("tokens".into(), room), |word| (format!("words of {word}"), room / word.max(1)));
    if most < 2 {
        return Err(Error::call(format!(
            "the model's context of {context} tokens holds {most} {what}; expected at least 2: train with a longer context"
        )));
    }
    let (streams, each) = (model.streams(), plan.streams());
    if !streams.is_multiple_of(each) {
        return Err(Error::call(format!("{streams} sequences for dances of {each} each; expected a multiple")));
    }
    if let Some(course) = plan.told().filter(|course| word != Some(course.characters() + 1)) {
        let what = format!("frames of {} characters given ahead of words of another length", course.characters());
        return Err(Error::call(what));
    }
    if !plan.music.is_empty() && (word.is_none() || !plan.music.len().is_multiple_of(plan.words.max(1))) {
        let what = format!("{} numbers of music for {} words; expected as many for each", plan.music.len(), plan.words);
        return Err(Error::call(what));
    }
    if let Some((word, front)) = plan.fronts.iter().find(|(_, front)| front.len() != plan.front.len()) {
        let (found, expected) = (front.len(), plan.front.len());
        return Err(Error::call(format!(
            "a front of {found} tokens from word {word} on; expected {expected} as before"
        )));
    }
    match plan.guidance {
        Some(guidance) if guidance.without.len() != plan.front.len() => Err(Error::call(format!(
            "a front of {} tokens without conditions, of {} with them; expected as many",
            guidance.without.len(),
            plan.front.len()
        ))),
        _ => Ok(()),
    }
}

/// The seed of a variation, counted from 0; the first has the plan's own.
pub fn variation_seed(seed: u64, variation: usize) -> u64 {
    match variation {
        0 => seed,
        i => kinelm_store::random::stream(seed, "variation", 0, i as u64).next_u64(),
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_of_forms;
