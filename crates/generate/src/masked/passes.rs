//! The passes over one window.

use super::window::Window;
use super::{Dance, MaskedModel, slot};
use crate::Result;
use crate::sampler::guidance;
use crate::sampling;
use kinelm_tokenizer::Special;
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_2;

/// A character sampled in a pass.
struct Sampled {
    /// Its index among the window's tokens.
    at: usize,
    id: u32,
    /// ln p of the id among those that the grammar allows.
    certainty: f64,
}

impl Dance<'_> {
    /// Fills a window, and stores its words before `window.kept`.
    pub(super) fn fill(&mut self, window: &Window, model: &mut dyn MaskedModel) -> Result<()> {
        let tokens = window.words.start * self.length..window.words.end * self.length;
        let mut ids = self.ids[tokens.clone()].to_vec();
        let front = self.plan.front_of(self.whole);
        let mut open: Vec<usize> = (0..ids.len()).filter(|&at| ids[at] == Special::Mask.id()).collect();
        let (all, passes) = (open.len(), self.plan.passes.max(1));
        for pass in 1..=passes {
            if open.is_empty() {
                break;
            }
            let (logits, conditioned) = self.logits(front, &ids, model)?;
            let sample = |&at: &usize| self.sample(tokens.start, &ids, at, &logits, conditioned.as_deref());
            let mut sampled: Vec<Sampled> = open.par_iter().map(sample).collect::<Result<_>>()?;
            // ties by position, so that threads and sort order change no dance
            sampled.sort_by(|a, b| b.certainty.total_cmp(&a.certainty).then(a.at.cmp(&b.at)));
            // at least one stays in every pass, or a pass would repeat the one before
            let stay = sampled.len() - still_open(all, pass, passes).min(sampled.len() - 1);
            sampled[..stay].iter().for_each(|sampled| ids[sampled.at] = sampled.id);
            open = sampled[stay..].iter().map(|sampled| sampled.at).collect();
        }
        let kept = window.kept * self.length - tokens.start;
        self.ids[tokens.start..tokens.start + kept].copy_from_slice(&ids[..kept]);
        self.advance();
        Ok(())
    }

    /// (n, V) the logits of each of a window's n tokens; of guided ones the conditioned ones too.
    fn logits(&self, front: &[u32], ids: &[u32], model: &mut dyn MaskedModel) -> Result<(Vec<f32>, Option<Vec<f32>>)> {
        let mut read = |front: &[u32]| -> Result<Vec<f32>> {
            let tokens = [front, ids].concat();
            let mut logits = model.logits(&tokens)?;
            logits.drain(..logits.len() / tokens.len() * front.len());
            Ok(logits)
        };
        let mut logits = read(front)?;
        let Some(guidance) = &self.plan.guidance else { return Ok((logits, None)) };
        let mut other = read(&guidance.unconditioned)?;
        guidance::mix(guidance.scale, &mut logits, &mut other);
        Ok((logits, Some(other)))
    }

    /// Samples one character of a window that begins with token `start` of the dance.
    fn sample(
        &self,
        start: usize,
        ids: &[u32],
        at: usize,
        logits: &[f32],
        conditioned: Option<&[f32]>,
    ) -> Result<Sampled> {
        let (word, tokens) = ((start + at) / self.length, (start + at) % self.length);
        let vocabulary = logits.len() / ids.len();
        let own = at * vocabulary..(at + 1) * vocabulary;
        let row = &logits[own.clone()];
        let guided = self.plan.guidance.as_ref().zip(conditioned).map(|(guidance, all)| (guidance.scale, &all[own]));
        let allowed = self.plan.grammar.allowed(slot(tokens));
        let before = (1..=self.plan.sampling.looks_back()).map_while(|words| at.checked_sub(words * self.length));
        let recent: Vec<u32> = before.map(|at| ids[at]).filter(|&id| id != Special::Mask.id()).collect();
        let id = self.plan.draw(self.seed, (word, slot(tokens)), row, guided, &recent)?;
        Ok(Sampled { at, id, certainty: sampling::log_probability(row, &allowed, id) })
    }
}

/// How many of `all` characters are masked after a pass, counted from 1: a quarter of a cosine, none after the last.
fn still_open(all: usize, pass: usize, passes: usize) -> usize {
    match pass < passes {
        true => (all as f64 * (FRAC_PI_2 * pass as f64 / passes as f64).cos()) as usize,
        false => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::still_open;

    #[test]
    fn few_characters_stay_at_first_and_many_at_last() {
        let open = |passes: usize| (1..=passes).map(|pass| still_open(100, pass, passes)).collect::<Vec<_>>();
        assert_eq!(open(1), [0]);
        assert_eq!(open(2), [70, 0]);
        assert_eq!(open(4), [92, 70, 38, 0]);
    }
}
