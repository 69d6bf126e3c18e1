//! Dances of a masked model, which sees what is given on both sides of what is free.
//!
//! Free characters are `<mask>` at first. The model reads a window, each of its free characters is sampled from the ids that
//! the grammar allows in its slot, and the most certain ones stay: in one pass all, in N passes as many as a cosine schedule
//! says, so that later passes see what earlier ones have chosen (`passes`). Windows follow one another through a dance of
//! any length (`window`).
//!
//! Every free character has the random stream that it has in a causal model's dance: of its seed, word and slot. It is the same
//! in every pass and in every window, so that a character is sampled anew only as far as its distribution changes.
//!
//! Source: Chang et al., "MaskGIT: Masked Generative Image Transformer" (2022), without its noise on the certainty.

mod model;
mod passes;
mod window;

pub use model::MaskedModel;
pub(crate) use model::masked_model;

use crate::sampler::{SampledTokens, SamplingPlan, SamplingProgress};
use crate::{Error, Result};
use kinelm_tokenizer::{Slot, Special};
use window::Window;

/// Passes over a window, where a request doesn't say how many.
pub const PASSES: usize = 8;

/// The most passes over a window.
pub const MOST_PASSES: usize = 255;

/// Samples `dances` dances side by side: the same ones as each alone. Look-ahead tokens, goals, music, first-frame candidates
/// and guesses of the plan are left out.
///
/// # Errors
/// Words that differ in length; a context that holds fewer than two words; fronts of other lengths; logits that allow no token
/// (word and slot are named), and what reading fails with; [`kinelm_store::Error::Stopped`] when `progress` stopped it.
pub fn fill(
    model: &mut dyn MaskedModel,
    plan: &SamplingPlan,
    dances: usize,
    progress: &mut SamplingProgress<'_>,
) -> Result<SampledTokens> {
    plan.check_inputs()?;
    let Some(word) = plan.grammar.tokens_per_word() else {
        let why = "its characters need slots that are known beforehand, and the words of this tokenizer differ in length; \
                   take a causal model";
        return Err(Error::unsupported("generation by a masked model", why));
    };
    let most = model.context().saturating_sub(plan.front_length()) / word;
    if most < 2 {
        let why = format!("the window holds {most} words of {word}; expected at least 2: train with a longer context");
        return Err(Error::unsupported(format!("a context of {} tokens", model.context()), why));
    }
    let mut all: Vec<Dance> = (0..dances).map(|dance| Dance::new(plan, dance, word)).collect();
    let mut done = 0;
    while done < plan.words {
        for dance in &mut all {
            if let Some(window) = dance.window(most) {
                dance.fill(&window, model)?;
            }
        }
        // reported in step: a word is done when all dances have it
        let whole = all.iter().map(|dance| dance.whole).min().unwrap_or(plan.words);
        for word in done..whole {
            let last: Vec<Vec<u32>> = all.iter().map(|dance| dance.word(word).to_vec()).collect();
            if progress(word + 1, &last).is_break() {
                return Err(Error::stopped("stopped before the dance was whole"));
            }
        }
        done = whole;
    }
    let ids: Vec<Vec<u32>> = all.into_iter().map(|dance| dance.ids).collect();
    Ok(SampledTokens { lookahead: vec![Vec::new(); ids.len()], ids, ..SampledTokens::default() })
}

/// One dance being filled.
struct Dance<'a> {
    plan: &'a SamplingPlan,
    seed: u64,
    /// W.
    length: usize,
    /// (words, W) `<mask>` where a character is not sampled yet.
    ids: Vec<u32>,
    /// Words before the first that has masked characters.
    whole: usize,
}

impl<'a> Dance<'a> {
    fn new(plan: &'a SamplingPlan, dance: usize, length: usize) -> Dance<'a> {
        let known = |at: usize| {
            let (word, tokens) = (at / length, at % length);
            let begun = plan.beginning(dance).get(at).copied();
            let known = begun.or_else(|| plan.given(word, tokens));
            // a space is the only id of its slot: it is never masked
            known.or_else(|| plan.grammar.only(slot(tokens))).unwrap_or(Special::Mask.id())
        };
        let ids = (0..plan.words * length).map(known).collect();
        let mut dance = Dance { plan, seed: plan.seed_of(dance), length, ids, whole: 0 };
        dance.advance();
        dance
    }

    fn word(&self, word: usize) -> &[u32] {
        &self.ids[word * self.length..][..self.length]
    }

    fn is_open(&self, word: usize) -> bool {
        self.word(word).contains(&Special::Mask.id())
    }

    /// Counts the words that are whole by now.
    fn advance(&mut self) {
        let open = (self.whole..self.plan.words).find(|&word| self.is_open(word));
        self.whole = open.unwrap_or(self.plan.words);
    }

    /// The window of at most `most` words to fill next; `None` where the dance is whole. Where the front changes, a
    /// window stores nothing beyond.
    fn window(&self, most: usize) -> Option<Window> {
        let window = Window::next(self.whole, self.plan.words, most, &|word| self.is_open(word))?;
        let changes = self.plan.fronts.iter().map(|(word, _)| *word).find(|word| *word > self.whole);
        Some(Window { kept: window.kept.min(changes.unwrap_or(usize::MAX)), ..window })
    }
}

/// A slot of words of one length without merged tokens.
fn slot(tokens: usize) -> Slot {
    Slot { tokens, characters: tokens }
}

#[cfg(test)]
mod tests;
