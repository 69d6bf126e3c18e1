//! The windows of a step: a function of (seed, step, index in the batch) and of nothing else.
//!
//! Where n whole words fit into a window, a pass takes ceil(words / n) windows of a clip. (Where words differ in length:
//! ceil(tokens / window).) The possible starts of the clip are divided into that many equal stretches, with one random start
//! in each. So a pass sees nearly every word about once, and each pass sees it elsewhere in the window. The order of a pass
//! is random.
//!
//! A round takes all windows of a corpus once. A pass takes weight times as many windows of each corpus, rounded, at least
//! one: whole rounds, and a random part of a round, of which the next pass takes the rest.

use super::augment::{Augment, Changed};
use super::config::TrainConfig;
use super::data::{Data, Part};
use super::gaps::Gaps;
use super::music::MusicConditioning;
use super::run::RunFile;
use super::window::{WindowId, WindowSpan};
use crate::{Error, Result};
use kinelm_corpus::music::tempo;
use kinelm_corpus::windows::{fill_sequence, whole_words};
use kinelm_corpus::{ClipRecord, ClipWords, Corpus, SpanMasking, Split, WindowTokens, fill_masked};
use kinelm_model::ModelKind;
use kinelm_model::goal::Conditioning;
use kinelm_model::scored_windows;
use kinelm_store::random;
use kinelm_tokenizer::Special;
use rayon::prelude::*;

/// The windows of one step.
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    /// (B, T) ids: the front, and all tokens but the last.
    pub inputs: Vec<u32>,
    /// (B, T) ids: the tokens, from the last position of the front on; `<pad>` before, and after the end of the clip.
    /// For a masked model the masked tokens, each at its own position, and `<pad>` elsewhere.
    pub targets: Vec<u32>,
    /// (B, H W) ids: the frames before each window, `<pad>` where there are none; empty where the model reads none.
    pub history: Vec<u32>,
    /// Names of the windows' clips, with the window's first frame.
    pub clips: Vec<String>,
    /// Goals and music of the windows' frames, if any have them.
    pub conditioning: Option<Conditioning>,
}

impl Batch {
    /// T: tokens of a window.
    pub fn length(&self) -> usize {
        self.inputs.len() / self.clips.len().max(1)
    }

    /// The number of targets that aren't `pad`.
    pub fn counted(&self, pad: u32) -> usize {
        self.targets.iter().filter(|&&t| t != pad).count()
    }
}

/// Share of the windows in which a span is hidden, where any are.
const SPANS: f64 = 0.5;

/// The training windows of a run's corpora, in order.
pub struct Batches<'a> {
    data: &'a Data,
    clips: Vec<TrainClip<'a>>,
    ends: Vec<usize>, // per clip: windows of a round up to it, inclusive
    shares: Vec<Share>,
    context: usize,
    history: usize, // H: frames before a window
    word: usize,    // W, or the length of the longest word
    room: usize,    // tokens of words that are targets in a window
    batch: usize,
    seed: u64,
    label_dropout: f64,
    history_dropout: f64,
    masked: bool,
    spans: Option<SpanMasking>,
    augment: Option<Augment>,
    gaps: Option<Gaps>,
    music: Option<MusicConditioning>,
    order: Option<(u64, Vec<WindowId>)>, // of the present pass
}

/// A clip of one of the corpora.
#[derive(Clone, Copy)]
struct TrainClip<'a> {
    corpus: &'a Corpus,
    record: &'a ClipRecord,
    words: ClipWords<'a>,
}

/// What a window has beside its tokens.
struct Filled {
    /// The name of its clip, with its first frame.
    clip: String,
    goals: Option<Conditioning>,
    /// (F, M).
    music: Vec<f32>,
    /// (H W).
    history: Vec<u32>,
}

/// A corpus's share of a pass.
struct Share {
    /// The first of its windows, counted over all corpora.
    first: usize,
    /// Its windows: one round takes them all once.
    windows: usize,
    /// The number that a pass takes: those after the last pass's, round after round.
    a_pass: usize,
}

impl<'a> Batches<'a> {
    /// The windows of `context` tokens of the training clips, `train.batch` at a time, with their labels in front.
    ///
    /// # Errors
    /// A corpus without a training clip that has a frame; a context shorter than a word, where all words have one length;
    /// more than 2^32 windows a pass.
    pub(crate) fn new(data: &'a Data, context: usize, train: &TrainConfig) -> Result<Batches<'a>> {
        // the last token is a target and no input, so a window shows one token more than it reads
        let room = (context + 1).saturating_sub(data.conditions().len());
        whole_words(room, 1)?;
        let (mut clips, mut ends, mut shares, mut total) = (Vec::new(), Vec::new(), Vec::new(), 0);
        for Part { corpus, weight } in data.parts() {
            let whole = corpus.manifest().tokens_per_word.map(|word| whole_words(room, word)).transpose()?;
            let first = total;
            for record in corpus.split(Split::Train).filter(|c| c.frames > 0) {
                let words = corpus.words(record);
                // rounded up: with one window fewer, some words of a pass would be in none
                total += match whole {
                    Some(n) => words.len().div_ceil(n),
                    None => words.tokens().div_ceil(room),
                };
                clips.push(TrainClip { corpus, record, words });
                ends.push(total);
            }
            let windows = total - first;
            if windows == 0 {
                let help = "give some clips the split `train` when making it";
                return Err(Error::file(corpus.dir(), "no training clip", "a corpus with training clips", help));
            }
            // a corpus of small weight has one window
            shares.push(Share { first, windows, a_pass: ((weight * windows as f64).round() as usize).max(1) });
        }
        let pass: usize = shares.iter().map(|s| s.a_pass).sum();
        // the order of a pass is in memory, 16 bytes a window
        if u32::try_from(pass).is_err() {
            return Err(Error::limit(
                "a pass",
                format!("{pass} windows"),
                "2^32 - 1 windows",
                "lower the weights of the corpora",
            ));
        }
        let word = data.tokenizer().longest_word();
        let (batch, seed) = (train.batch, train.seed);
        Ok(Batches {
            data,
            clips,
            ends,
            shares,
            context,
            history: 0,
            word,
            room,
            batch,
            seed,
            label_dropout: train.label_dropout,
            history_dropout: train.history_dropout,
            masked: false,
            spans: None,
            augment: None,
            gaps: None,
            music: None,
            order: None,
        })
    }

    /// The windows of a run, with its augmentation and conditioning.
    ///
    /// # Errors
    /// As [`Batches::new`] and [`Augment::new`].
    pub(crate) fn of_run(run: &RunFile, data: &'a Data) -> Result<Batches<'a>> {
        let masked = run.model.kind == ModelKind::Masked;
        // a masked model's last input predicts no next token: the window is one shorter
        let context = run.model.context - usize::from(masked);
        let batches = Batches::new(data, context, &run.train)?;
        Ok(Batches {
            masked,
            spans: run.train.masking.spans(data.tokenizer())?,
            context: run.model.context,
            history: run.model.history(),
            augment: Augment::new(&run.augment, data.tokenizer(), run.train.seed)?,
            gaps: Gaps::new(run.train.gaps, data.tokenizer(), run.train.seed)?,
            music: MusicConditioning::new(
                &run.model,
                run.train.seed,
                batches.room / batches.word,
                data.tokenizer().fps(),
            ),
            ..batches
        })
    }

    /// Windows of one pass over the corpora.
    pub fn pass(&self) -> usize {
        self.shares.iter().map(|s| s.a_pass).sum()
    }

    /// The windows of step `step`.
    ///
    /// # Errors
    /// A corpus that can no longer be read.
    pub fn batch(&mut self, step: u64) -> Result<Batch> {
        let (b, t) = (self.batch, self.context);
        // before the parallel part, since a new pass shuffles the order that all share
        let windows: Vec<WindowId> = (0..b as u64).map(|i| self.window(step * b as u64 + i)).collect();
        let (mut inputs, mut targets) = (vec![0; b * t], vec![0; b * t]);
        let rows = (inputs.par_chunks_mut(t), targets.par_chunks_mut(t), &windows);
        let fill = |(input, target, &window): (&mut [u32], &mut [u32], &WindowId)| self.fill(window, input, target);
        let filled: Vec<Filled> = rows.into_par_iter().map(fill).collect::<Result<_>>()?;
        let (mut clips, mut goals, mut music, mut history) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for window in filled {
            clips.push(window.clip);
            goals.push(window.goals);
            music.extend(window.music);
            history.extend(window.history);
        }
        let mut conditioning = concatenated(goals);
        if !music.is_empty() {
            conditioning.get_or_insert_default().music = music;
        }
        Ok(Batch { inputs, targets, history, clips, conditioning })
    }

    /// Fills a window (T).
    fn fill(&self, window: WindowId, input: &mut [u32], target: &mut [u32]) -> Result<Filled> {
        let span = self.span(window);
        let TrainClip { corpus, record, words } = self.clips[span.clip];
        let augment = self.augment.as_ref();
        let gaps = self.gaps.as_ref().filter(|gaps| gaps.takes(window));
        // gaps reach beyond the window
        let beyond = gaps.map_or(0, |gaps| gaps.reach() * self.word);
        let before = self.before(window, span.word);
        // changed together with the window: frames before and goals after it have to be of the same mirrored, turned, stretched
        // motion
        let wide = WindowSpan {
            word: span.word - before,
            start: words.start(span.word - before) + (span.start - words.start(span.word)),
            tokens: (record.tokens - span.start).min(span.tokens + beyond) + before * self.word,
            ..span
        };
        let changed =
            augment.and_then(|a| a.ids(corpus, record, &wide, window, self.room + beyond + before * self.word));
        let (mut ids, first, factor) = match changed {
            Some(Changed { ids, first, factor }) => (ids, first + before as f64 * factor, factor),
            None => (corpus.ids(record, wide.start..wide.start + wide.tokens)?, span.word as f64, 1.0),
        };
        // a clip that is faster now may end before the window
        let mut history: Vec<u32> = ids.drain(..ids.len().min(before * self.word)).collect();
        let of_music = |music: &MusicConditioning| music.of_window(corpus, record, window, first, factor);
        let music = self.music.as_ref().map_or(Ok(Vec::new()), of_music)?;
        let front = self.front(record, window, factor);
        let (pad, dropped) = (Special::Pad.id(), augment.map_or_else(Vec::new, |a| a.dropped(window)));
        let shown = ids.len().min(span.tokens);
        let goals =
            gaps.map(|gaps| gaps.conditioning(window, &ids, shown / self.word, self.room / self.word, &dropped));
        // only now: the goals have read the words after the window
        ids.truncate(shown);
        if self.masked {
            let may = |k: usize| !dropped.contains(&(k % self.word));
            let mut rng = random::stream(self.seed, "mask", window.round, window.number as u64);
            let tokens = WindowTokens { front: &front, tokens: &ids, pad };
            match self.spans.as_ref().filter(|_| random::unit(&mut rng) < SPANS) {
                Some(spans) => spans.fill(tokens, &may, &mut rng, input, target),
                None => fill_masked(tokens, &may, &mut rng, input, target),
            }
        } else {
            fill_sequence(&ids, &front, pad, input, target);
        }
        if let Some(augment) = augment {
            // after the targets and goals were taken from the clean ids
            let mut read = [&history[..], &input[front.len()..]].concat();
            augment.disturb(window, &mut read);
            let (before, shown) = read.split_at(history.len());
            history.copy_from_slice(before);
            input[front.len()..].copy_from_slice(shown);
        }
        if !dropped.is_empty() {
            hide(&dropped, self.word, &mut history, &mut []);
            // a causal target is one place before its input, a masked one at the same place
            let first = front.len() - usize::from(!self.masked);
            hide(&dropped, self.word, &mut input[front.len()..], &mut target[first..]);
        }
        let clip = format!("{} from frame {}", record.name, corpus.frames_of(record, 0..span.word));
        Ok(Filled { clip, goals, music, history: scored_windows::history(&history, self.history * self.word, pad) })
    }

    /// Words before a window that it is read after.
    fn before(&self, WindowId { round, number }: WindowId, word: usize) -> usize {
        let mut rng = random::stream(self.seed, "history", round, number as u64);
        match self.history > 0 && random::unit(&mut rng) < self.history_dropout {
            true => 0,
            false => word.min(self.history),
        }
    }

    /// The window at an index of the data: window i of step s has s B + i.
    pub fn window(&mut self, place: u64) -> WindowId {
        let (pass, at) = (place / self.pass() as u64, place % self.pass() as u64);
        if self.order.as_ref().is_none_or(|(p, _)| *p != pass) {
            self.order = Some((pass, self.shuffled(pass)));
        }
        self.order.as_ref().map_or(WindowId { round: 0, number: 0 }, |(_, order)| order[at as usize])
    }

    /// The windows of a pass in random order (Fisher and Yates).
    fn shuffled(&self, pass: u64) -> Vec<WindowId> {
        let mut order: Vec<WindowId> = Vec::with_capacity(self.pass());
        for share in &self.shares {
            let (windows, a_pass) = (share.windows as u64, share.a_pass as u64);
            let (from, to) = (pass * a_pass, (pass + 1) * a_pass);
            for round in from / windows..to.div_ceil(windows) {
                let (low, high) =
                    (from.max(round * windows) - round * windows, to.min((round + 1) * windows) - round * windows);
                let mut numbers: Vec<usize> = (share.first..share.first + share.windows).collect();
                // a random part of the round, where the pass doesn't take all
                if (low, high) != (0, windows) {
                    random::shuffle(&mut numbers, &mut random::stream(self.seed, "round", round, share.first as u64));
                }
                let mut taken = numbers[low as usize..high as usize].to_vec();
                // sorted, so that the order comes from the shuffle of the whole pass alone
                taken.sort_unstable();
                order.extend(taken.into_iter().map(|number| WindowId { round, number }));
            }
        }
        random::shuffle(&mut order, &mut random::stream(self.seed, "order", pass, 0));
        order
    }

    /// The front of a window that is `factor` times as fast as its clip: the clip's labels, each hidden in a share of the
    /// windows.
    fn front(&self, clip: &ClipRecord, WindowId { round, number }: WindowId, factor: f64) -> Vec<u32> {
        let conditions = self.data.conditions();
        let mut front = match tempo::faster(&clip.labels, &conditions.values(tempo::FIELD), factor) {
            Some(labels) => conditions.front(&labels),
            None => conditions.front(&clip.labels),
        };
        let mut rng = random::stream(self.seed, "label dropout", round, number as u64);
        // `<bos>` is never hidden
        for id in &mut front[1..] {
            if random::unit(&mut rng) < self.label_dropout {
                *id = Special::Unk.id();
            }
        }
        front
    }

    /// The tokens that a window shows.
    pub fn span(&self, WindowId { round, number }: WindowId) -> WindowSpan {
        let index = self.ends.partition_point(|&end| end <= number);
        let TrainClip { record, words, .. } = self.clips[index];
        let before = if index == 0 { 0 } else { self.ends[index - 1] };
        let (stretch, stretches) = (number - before, self.ends[index] - before);
        // up to the first word from which the whole rest fits
        let starts = (words.before(words.tokens().saturating_sub(self.room)) + 1).min(words.len());
        // of equal words no stretch is empty: w - n + 1 starts are at least ceil(w / n) for all w >= n
        let (low, high) = (starts * stretch / stretches, starts * (stretch + 1) / stretches);
        let mut rng = random::stream(self.seed, "window", round, number as u64);
        let word = low + (random::unit(&mut rng) * (high - low) as f64) as usize;
        let (start, end) = (words.start(word), words.start(word + 1));
        let inside = match end - start > self.room {
            // a word that is longer than a window begins anywhere, so that its end is seen too
            true => (random::unit(&mut rng) * (end - start - self.room + 1) as f64) as usize,
            false => 0,
        };
        let start = start + inside;
        WindowSpan { clip: index, word, start, tokens: (record.tokens - start).min(self.room) }
    }

    /// The training clips, corpus after corpus.
    #[cfg(test)]
    pub fn clips(&self) -> impl Iterator<Item = (&'a Corpus, &'a ClipRecord)> + '_ {
        self.clips.iter().map(|c| (c.corpus, c.record))
    }
}

/// The goals of all windows, if any window has some.
fn concatenated(windows: Vec<Option<Conditioning>>) -> Option<Conditioning> {
    let none = windows.iter().flatten().next()?.none_like();
    let mut all = Conditioning::default();
    windows.iter().for_each(|goals| all.extend(goals.as_ref().unwrap_or(&none)));
    Some(all)
}

/// Replaces the tokens at these slots of each word of `word` tokens by `<mask>`, and their targets by `<pad>`. Both begin
/// with a word's first token.
fn hide(places: &[usize], word: usize, inputs: &mut [u32], targets: &mut [u32]) {
    let pad = Special::Pad.id();
    let hidden = |k: usize| places.contains(&(k % word));
    inputs
        .iter_mut()
        .enumerate()
        .filter(|(k, id)| hidden(*k) && **id != pad)
        .for_each(|(_, id)| *id = Special::Mask.id());
    targets.iter_mut().enumerate().filter(|(k, _)| hidden(*k)).for_each(|(_, id)| *id = pad);
}

#[cfg(test)]
mod tests;
