//! The plan of a sampling.

use super::guidance::{self, Guidance};
use super::look_ahead::LookAhead;
use super::model::NextToken;
use super::way::Way;
use crate::sampling::Sampling;
use crate::{Error, Result};
use kinelm_model::goal::GoalTrack;
use kinelm_tokenizer::{Grammar, SPACE, Slot, Special};
use rand_chacha::rand_core::RngCore;
use std::sync::Arc;

/// Guesses per read for greedy dances. On a model of 5 million parameters trained on real dances 99.8 % of them are right
/// and 60 frames take 0.42 of the time; of guesses at sampled characters 24 % are right, which saves nothing.
pub const GUESSES: usize = 8;

/// The most frames of a dance: half a day at 20 frames per second, whose ids fit into memory.
pub const MOST_FRAMES: usize = 1 << 20;

/// Refuses a dance of more than [`MOST_FRAMES`] frames.
///
/// # Errors
/// [`kinelm_store::Error::Limit`] with both numbers.
pub fn check_frames(frames: usize) -> Result<()> {
    match frames {
        0..=MOST_FRAMES => Ok(()),
        _ => Err(Error::limit("a dance", format!("{frames} frames"), MOST_FRAMES, "")),
    }
}

/// The plan of a sampling. Words count from the first lead-in word; a word has C characters and a space.
#[derive(Debug, Clone)]
pub struct SamplingPlan {
    /// Words to sample, the lead-in included.
    pub words: usize,
    /// Lead-in words: free or from `beginnings`; the prompt's first word comes after them.
    pub lead_in: usize,
    /// Which ids are allowed where.
    pub grammar: Grammar,
    /// Ids of whole words, spaces included, that each dance begins with. One entry serves all dances.
    pub beginnings: Vec<Vec<u32>>,
    /// Which characters are given: (C), the same in all words, or (P, C) per word of the prompt. Empty: none. Only for words
    /// of one length without merged tokens.
    pub given: Vec<bool>,
    /// (P, C) given characters that are first sampled, to learn where the model would have gone; then their word is taken
    /// back and the given characters take their places. Empty: none.
    pub lookahead: Vec<bool>,
    /// (P, C + 1) ids of the P words that given characters come from, spaces included. Later words are free.
    pub prompt: Vec<u32>,
    /// The fronts of windows, conditioning tokens with `<bos>` first, each with its first word:
    /// ascending from 0, all of one length.
    pub fronts: Vec<(usize, Vec<u32>)>,
    /// Classifier-free guidance; `None`: the model as trained, in half the time.
    pub guidance: Option<Guidance>,
    /// The goals of frames before given ones, for a goal-conditioned model. Its frames are those of lead-in and prompt.
    pub goals: Option<Arc<GoalTrack>>,
    /// Scale of guidance towards the goals: 1 is the model as trained, 0 leaves the goals out, other numbers take twice the
    /// time.
    pub goal_guidance: f64,
    /// The way that the root keeps close to, from the end of the lead-in on.
    pub way: Option<Arc<Way>>,
    /// (words, M) conditioning on music; empty: none.
    pub music: Vec<f32>,
    /// How free characters are sampled.
    pub sampling: Sampling,
    /// Seed of the random streams.
    pub seed: u64,
    /// A hash of what the dance is given, which the random streams derive from too; 0: none.
    pub inputs_hash: u64,
    /// Candidates for a first word that is given in part; 1: no choice.
    pub first_frames: usize,
    /// Which of several continuations a dance goes on with; `None`: the one that is sampled.
    pub look_ahead: Option<LookAhead>,
    /// Free tokens that are guessed ahead and verified in one read. They change the time, no id.
    pub guesses: usize,
    /// Passes of a masked model over a window; a causal one makes none.
    pub passes: usize,
}

impl SamplingPlan {
    /// An unprompted dance of `words` words.
    pub fn free(grammar: Grammar, words: usize, sampling: Sampling, seed: u64) -> SamplingPlan {
        SamplingPlan {
            words,
            lead_in: 0,
            grammar,
            beginnings: Vec::new(),
            given: Vec::new(),
            lookahead: Vec::new(),
            prompt: Vec::new(),
            fronts: vec![(0, vec![Special::Bos.id()])],
            guidance: None,
            goals: None,
            goal_guidance: 1.0,
            way: None,
            music: Vec::new(),
            sampling,
            seed,
            inputs_hash: 0,
            first_frames: 1,
            look_ahead: None,
            guesses: if sampling.greedy { GUESSES } else { 0 },
            passes: 1,
        }
    }

    /// Sequences that a dance takes: two where it is guided by a scale other than 1.
    pub(crate) fn streams(&self) -> usize {
        1 + usize::from(self.guidance.is_some() || (self.used_goals().is_some() && self.goal_guidance != 1.0))
    }

    /// Continuations that are sampled of each dance.
    pub(crate) fn candidates(&self) -> usize {
        self.look_ahead.as_ref().map_or(1, |ahead| ahead.candidates.max(1))
    }

    /// Words of the dances that are decided once block `block` is; without look-ahead every word is a block.
    pub(super) fn decided(&self, block: usize) -> usize {
        let Some(ahead) = &self.look_ahead else { return self.words.min(block + 1) };
        self.words.min(self.known_words() + ahead.first.max(1) + block * ahead.block.max(1))
    }

    /// Whole words that all dances begin with, or the lead-in.
    fn known_words(&self) -> usize {
        let words = |ids: &Vec<u32>| ids.iter().filter(|id| **id == SPACE).count();
        self.lead_in.max(self.beginnings.iter().map(words).min().unwrap_or(0))
    }

    /// The goals, if they aren't left out.
    pub(super) fn used_goals(&self) -> Option<&Arc<GoalTrack>> {
        self.goals.as_ref().filter(|_| self.goal_guidance != 0.0)
    }

    /// The seed of a dance, counted from 0.
    pub(crate) fn seed_of(&self, dance: usize) -> u64 {
        seed_with_inputs(variation_seed(self.seed, dance), self.inputs_hash)
    }

    /// The prompt's token in a slot of a word, if it is given. Only words of one length have given characters.
    pub(crate) fn given(&self, word: usize, slot: usize) -> Option<u32> {
        let length = self.grammar.tokens_per_word()?;
        let prompted = word.checked_sub(self.lead_in)?;
        let given = self.is_flagged(&self.given, word, slot);
        self.prompt.get(prompted * length + slot).copied().filter(|_| given)
    }

    /// Whether `flags`, (C) for every word or (P, C), are set for a slot of a word.
    pub(super) fn is_flagged(&self, flags: &[bool], word: usize, slot: usize) -> bool {
        let characters = self.grammar.tokens_per_word().map_or(0, |word| word - 1);
        let Some(prompted) = word.checked_sub(self.lead_in) else { return false };
        // (C) flags hold for every word, (P, C) for the prompt's
        let word = if flags.len() > characters { prompted } else { 0 };
        slot < characters && flags.get(word * characters + slot).copied().unwrap_or(false)
    }

    /// The tokens in front of a window in which a word is sampled.
    pub(crate) fn front_of(&self, word: usize) -> &[u32] {
        let last = self.fronts.iter().rev().find(|(from, _)| *from <= word);
        last.map_or(&[], |(_, front)| front)
    }

    /// The ids that a dance begins with, counted from 0.
    pub(crate) fn beginning(&self, dance: usize) -> &[u32] {
        self.beginnings.get(dance).or(self.beginnings.first()).map_or(&[], Vec::as_slice)
    }

    /// Samples a free character of a dance with this seed, by the `logits` (V) of all ids; the penalty looks back on `recent`
    /// ids. Of guided logits the scale, and the conditioned ones.
    pub(crate) fn draw(
        &self,
        seed: u64,
        (word, slot): (usize, Slot),
        logits: &[f32],
        guided: Option<(f64, &[f32])>,
        recent: &[u32],
    ) -> Result<u32> {
        let (found, expected) = (logits.len(), self.grammar.vocabulary());
        if found != expected as usize {
            return Err(Error::invalid("the model's vocabulary", found, format!("{expected} tokens, the tokenizer's")));
        }
        // every character has a stream of its own, whatever is sampled beside or before it
        let mut rng = kinelm_store::random::stream(seed, "character", word as u64, slot.tokens as u64);
        let allowed = self.grammar.allowed(slot);
        let allowed = match guided {
            // the steps that music asks for are rare ones
            Some((scale, conditioned)) if self.music.is_empty() => guidance::likely(scale, conditioned, allowed),
            _ => allowed,
        };
        let id = self.sampling_of(word).sample(logits, &allowed, recent, &mut rng);
        let broken = "the model's logits allow no token; the run is broken";
        id.ok_or_else(|| Error::NotFinite(format!("word {word}, slot {}: {broken}", slot.tokens)))
    }

    /// Tokens in front of a window.
    pub(crate) fn front_length(&self) -> usize {
        self.fronts.first().map_or(0, |(_, front)| front.len())
    }

    /// M, numbers of music per word.
    pub(super) fn music_width(&self) -> usize {
        self.music.len() / self.words.max(1)
    }

    /// Refuses a model that can't carry out this plan.
    pub(super) fn check(&self, model: &(impl NextToken + ?Sized)) -> Result<()> {
        let (context, word, front) = (model.context(), self.grammar.tokens_per_word(), self.front_length());
        // a window of n words reads the front and n words but for the last space
        let room = (context + 1).saturating_sub(front);
        let (what, most) =
            word.map_or(("tokens".into(), room), |word| (format!("words of {word}"), room / word.max(1)));
        if most < 2 {
            let why = format!("the window holds {most} {what}; expected at least 2: train with a longer context");
            return Err(Error::unsupported(format!("a context of {context} tokens"), why));
        }
        let (streams, each) = (model.streams(), self.streams());
        if !streams.is_multiple_of(each) {
            let expected = format!("a multiple of the {each} sequences of a dance");
            return Err(Error::invalid("the number of sequences", streams, expected));
        }
        self.check_inputs()
    }

    /// Refuses inputs that don't go with the words or with one another.
    pub(crate) fn check_inputs(&self) -> Result<()> {
        let (word, front) = (self.grammar.tokens_per_word(), self.front_length());
        if let Some(goals) = self.used_goals().filter(|goals| word != Some(goals.characters() + 1)) {
            let found = format!("{} characters per frame", goals.characters());
            return Err(Error::invalid("the goals' length", found, "the length of the dance's words"));
        }
        if !self.music.is_empty() && (word.is_none() || !self.music.len().is_multiple_of(self.words.max(1))) {
            let (found, words) = (self.music.len(), self.words);
            return Err(Error::invalid(
                "music",
                format!("{found} numbers"),
                format!("as many for each of {words} words"),
            ));
        }
        if let Some((word, other)) = self.fronts.iter().find(|(_, other)| other.len() != front) {
            let found = format!("{} tokens", other.len());
            return Err(Error::invalid(format!("the front from word {word} on"), found, format!("{front} tokens")));
        }
        match &self.guidance {
            Some(guidance) if guidance.unconditioned.len() != front => {
                let found = format!("{} tokens", guidance.unconditioned.len());
                Err(Error::invalid("the front without conditions", found, format!("{front} tokens")))
            }
            _ => Ok(()),
        }
    }
}

/// The seed of a variation, counted from 0. The first has the request's own.
pub fn variation_seed(seed: u64, variation: usize) -> u64 {
    match variation {
        0 => seed,
        i => kinelm_store::random::stream(seed, "variation", 0, i as u64).next_u64(),
    }
}

/// The seed of a dance that is given something.
fn seed_with_inputs(seed: u64, inputs_hash: u64) -> u64 {
    match inputs_hash {
        0 => seed,
        hash => kinelm_store::random::stream(seed, "given", hash, 0).next_u64(),
    }
}
