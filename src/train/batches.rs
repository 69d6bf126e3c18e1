//! Which windows a step trains on: a function of (seed, step, place in the batch) and of nothing else.
//!
//! A pass over the corpus takes, of a clip of so many words where n whole ones fit into a window, words/n windows, rounded
//! up (of words that differ in length: of its tokens one in T): its possible starts are cut into that many equal
//! stretches and one start is drawn in each. So a pass sees nearly every word about once, and every pass sees them at other
//! places of the window. The order of a pass is a random one.

use crate::corpus::windows::{fill_sequence, whole_words};
use crate::corpus::{ClipRecord, ClipWords, Corpus, Split};
use crate::{Error, Result, random};
use kinelm_tokenizer::Special;
use rand_chacha::rand_core::RngCore;

/// The windows of one step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Batch {
    /// (B, T) ids: `<bos>` and all tokens but the last.
    pub inputs: Vec<u32>,
    /// (B, T) ids: the tokens; `<pad>` where the clip has ended.
    pub targets: Vec<u32>,
    /// Names of the windows' clips, with the frame at which the window starts.
    pub clips: Vec<String>,
}

impl Batch {
    /// T: tokens of a window.
    pub fn length(&self) -> usize {
        self.inputs.len() / self.clips.len().max(1)
    }

    /// Targets that count, those that aren't `pad`.
    pub fn counted(&self, pad: u32) -> usize {
        self.targets.iter().filter(|&&t| t != pad).count()
    }
}

/// The training windows of a corpus, in order.
pub struct Batches<'a> {
    corpus: &'a Corpus,
    clips: Vec<(&'a ClipRecord, ClipWords<'a>)>,
    ends: Vec<usize>, // per clip: windows of a pass up to and with it
    context: usize,
    batch: usize,
    seed: u64,
    order: Option<(u64, Vec<u32>)>, // of the pass drawn last
}

impl<'a> Batches<'a> {
    /// The windows of `context` tokens of the training clips, `batch` at a time.
    ///
    /// # Errors
    /// No training clip with a frame; a context that doesn't hold a word of the one length that all have.
    pub fn new(corpus: &'a Corpus, context: usize, batch: usize, seed: u64) -> Result<Batches<'a>> {
        let whole = corpus.manifest().tokens_per_word.map(|word| whole_words(context, word)).transpose()?;
        whole_words(context, 1)?;
        let clips = corpus.split(Split::Train).filter(|c| c.frames > 0);
        let clips: Vec<_> = clips.map(|c| (c, corpus.words(c))).collect();
        if clips.is_empty() {
            let help = "give some clips the split `train` when making it";
            return Err(Error::file(corpus.dir(), "no training clip", "a corpus with training clips", help));
        }
        let ends = clips.iter().scan(0, |total, (_, words)| {
            *total += match whole {
                Some(n) => words.len().div_ceil(n),
                None => words.tokens().div_ceil(context),
            };
            Some(*total)
        });
        Ok(Batches { corpus, ends: ends.collect(), clips, context, batch, seed, order: None })
    }

    /// Windows of one pass over the corpus.
    pub fn pass(&self) -> usize {
        self.ends.last().copied().unwrap_or(0)
    }

    /// The windows of step `step`.
    pub fn batch(&mut self, step: u64) -> Batch {
        let (b, t) = (self.batch, self.context);
        let mut batch = Batch { inputs: vec![0; b * t], targets: vec![0; b * t], clips: Vec::with_capacity(b) };
        let rows = batch.inputs.chunks_mut(t).zip(batch.targets.chunks_mut(t));
        for (i, (input, target)) in rows.enumerate() {
            let place = step * b as u64 + i as u64;
            let (pass, at) = (place / self.pass() as u64, place % self.pass() as u64);
            let window = self.order(pass)[at as usize] as usize;
            let (clip, word, start) = self.start(pass, window);
            let ids = self.corpus.ids(clip, start..clip.tokens.min(start + t));
            fill_sequence(&ids, &[Special::Bos.id()], Special::Pad.id(), input, target);
            let frame = self.corpus.frames_of(clip, 0..word);
            batch.clips.push(format!("{} from frame {frame}", clip.name));
        }
        batch
    }

    /// The clip, first word and first token of a window of a pass.
    fn start(&self, pass: u64, window: usize) -> (&'a ClipRecord, usize, usize) {
        let index = self.ends.partition_point(|&end| end <= window);
        let (clip, words) = self.clips[index];
        let before = if index == 0 { 0 } else { self.ends[index - 1] };
        let (stretch, stretches) = (window - before, self.ends[index] - before);
        // up to the first word from which on the whole rest fits
        let starts = (words.before(words.tokens().saturating_sub(self.context)) + 1).min(words.len());
        let (low, high) = (starts * stretch / stretches, starts * (stretch + 1) / stretches);
        let mut rng = random::stream(self.seed, "window", pass, window as u64);
        let word = low + (random::unit(&mut rng) * (high - low) as f64) as usize;
        let (start, end) = (words.start(word), words.start(word + 1));
        let inside = match end - start > self.context {
            // a word that is longer than a window is begun anywhere, so that its end is seen too
            true => (random::unit(&mut rng) * (end - start - self.context + 1) as f64) as usize,
            false => 0,
        };
        (clip, word, start + inside)
    }

    /// The windows of a pass in the order of Fisher and Yates.
    fn order(&mut self, pass: u64) -> &[u32] {
        if self.order.as_ref().is_none_or(|(p, _)| *p != pass) {
            let mut rng = random::stream(self.seed, "order", pass, 0);
            let mut order: Vec<u32> = (0..self.pass() as u32).collect();
            for last in (1..order.len()).rev() {
                // 64 bits over at most 2^32 windows: no bias that could be seen
                order.swap(last, (rng.next_u64() % (last as u64 + 1)) as usize);
            }
            self.order = Some((pass, order));
        }
        self.order.as_ref().map_or(&[], |(_, order)| order)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::fixture;

    #[test]
    fn a_pass_has_every_stretch_once_and_steps_can_be_asked_in_any_order() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(30, Split::Train), (3, Split::Train), (9, Split::Valid)]);
        // W = 7, T = 36: 5 whole words; 6 stretches of the first clip, one of the second
        let mut batches = Batches::new(&corpus, 36, 2, 5).unwrap();
        assert_eq!(batches.pass(), 7);
        let steps: Vec<Batch> = (0..7).map(|s| batches.batch(s)).collect();
        for pass in 0..2 {
            let windows = steps.iter().flat_map(|b| &b.clips).skip(7 * pass).take(7);
            let mut starts: Vec<(String, usize)> = windows
                .map(|c| c.split_once(" from frame ").map(|(n, f)| (n.to_string(), f.parse().unwrap())).unwrap())
                .collect();
            starts.sort();
            // 26 starts in 6 stretches
            for (i, (name, frame)) in starts[..6].iter().enumerate() {
                assert_eq!(name, "clip0");
                assert!((26 * i / 6..26 * (i + 1) / 6).contains(frame), "{starts:?}");
            }
            assert_eq!(starts[6], ("clip1".to_string(), 0));
        }
        assert_eq!(batches.batch(3), steps[3]);
        assert_ne!(Batches::new(&corpus, 36, 2, 6).unwrap().batch(0), steps[0]);
    }

    #[test]
    fn windows_start_at_a_frame_behind_bos_and_short_clips_are_padded() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(3, Split::Train)]);
        let batch = Batches::new(&corpus, 36, 1, 5).unwrap().batch(0);
        let ids = corpus.clip_ids(&corpus.clips()[0]);
        assert_eq!(batch.targets[..21], ids);
        assert!(batch.targets[21..].iter().all(|&t| t == 0));
        assert_eq!(batch.inputs[0], 1);
        assert_eq!(batch.inputs[1..22], ids);
    }

    #[test]
    fn windows_of_words_of_any_length_start_at_words_and_a_pass_sees_nearly_all() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::merged(dir.path(), &[(200, Split::Train), (3, Split::Train), (50, Split::Valid)]);
        let clip = &corpus.clips()[0];
        // the second context is shorter than a word
        for context in [40, 3] {
            let mut batches = Batches::new(&corpus, context, 1, 5).unwrap();
            assert_eq!(batches.pass(), clip.tokens.div_ceil(context) + corpus.clips()[1].tokens.div_ceil(context));
            let (mut inside, mut seen) = (0, vec![false; clip.tokens]);
            for step in 0..4 * batches.pass() as u64 {
                let batch = batches.batch(step);
                let (name, frame) = batch.clips[0].split_once(" from frame ").unwrap();
                if name != "clip0" {
                    continue;
                }
                let word = frame.parse().unwrap();
                let (from, to) = (corpus.words(clip).start(word), corpus.words(clip).start(word + 1));
                let ids: Vec<u32> = batch.targets.iter().copied().filter(|&id| id != 0).collect();
                let start = (from..to).find(|&s| corpus.ids(clip, s..clip.tokens.min(s + context)) == ids).unwrap();
                assert!(start == from || to - from > context, "{} from token {start}", batch.clips[0]);
                inside += usize::from(start > from);
                assert!(ids.len() == context || start + ids.len() == clip.tokens);
                seen[start..start + ids.len()].fill(true);
            }
            assert_eq!(inside > 0, context == 3);
            let share = seen.iter().filter(|s| **s).count() as f64 / clip.tokens as f64;
            assert!(share > 0.9, "context {context}: {share} of the tokens in four passes");
        }
    }

    #[test]
    fn a_corpus_without_training_clips_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(3, Split::Test)]);
        assert!(Batches::new(&corpus, 36, 1, 5).err().unwrap().to_string().contains("no training clip"));
    }
}
