//! The choice of a first frame where some joints of it are given after free ones.
//!
//! A frame is sampled character by character, and a free one doesn't depend on the given ones after it. Later frames have the
//! previous frames to follow. The first has nothing: a left arm may come out that doesn't go with the given right one, and a
//! model may hold it for the whole dance. So several candidates for the first word are sampled, each with a random stream of
//! its own, and the dance continues from the candidate under which the given characters, up to the second word's first free
//! slot, are most likely (docs/results/two-level.md). Sources: Rubin, "The SIR algorithm" (1987), of which the most likely
//! sample is taken here; Lew et al., "Sequential Monte Carlo Steering of Large Language Models" (2023).

use super::sequence::Sequence;
use super::{Batch, NextToken, SamplingPlan};
use crate::Result;
use crate::sampling::Sampling;
use rand_chacha::rand_core::RngCore;
use std::sync::Arc;

/// Candidates where a request doesn't say how many.
pub const FIRST_FRAMES: usize = 64;

impl SamplingPlan {
    /// Whether there is a first word to choose: some of its characters are given after free ones, and nothing comes before.
    fn has_first_word_to_choose(&self) -> bool {
        let characters = self.grammar.tokens_per_word().map_or(0, |word| word - 1);
        let first = &self.given[..self.given.len().min(characters)];
        let is_first = self.lead_in == 0 && self.beginnings.is_empty();
        is_first && !self.sampling.greedy && !self.prompt.is_empty() && has_given_after_free(first)
    }

    /// Whether the first word of a dance is the best of several candidates for it.
    pub(super) fn has_chosen_first_word(&self) -> bool {
        self.first_frames > 1 && self.has_first_word_to_choose()
    }

    /// How the free characters of a word are sampled: those of candidates for the first word without truncation, since the
    /// choice removes what is rare and doesn't fit, and the one that fits may be rare.
    pub(super) fn sampling_of(&self, word: usize) -> Sampling {
        if word > 0 || !self.has_chosen_first_word() {
            return self.sampling;
        }
        self.sampling.untruncated()
    }
}

/// Whether some given character of a word comes after a free one. `given`: (C).
pub(crate) fn has_given_after_free(given: &[bool]) -> bool {
    given.iter().skip_while(|is_given| **is_given).any(|is_given| *is_given)
}

/// For each dance's seed, the seed of the candidate under which the given characters are most likely; of equals the first.
///
/// # Errors
/// Those of [`super::sample`].
pub(super) fn best_seeds(
    model: &mut (impl NextToken + ?Sized),
    plan: &SamplingPlan,
    seeds: Vec<u64>,
) -> Result<Vec<u64>> {
    if !plan.has_chosen_first_word() {
        return Ok(seeds);
    }
    // what is given at the end of the first word is read with the second
    let words = plan.words.min(2);
    let music = plan.music[..plan.music_width() * words].to_vec();
    // without guesses, whose rows the scores would count
    let begun = Arc::new(SamplingPlan { words, music, guesses: 0, look_ahead: None, ..plan.clone() });
    let mut best: Vec<(f64, u64)> = seeds.iter().map(|&seed| (f64::NEG_INFINITY, seed)).collect();
    let mut prefix = Vec::new();
    for candidate in 0..plan.first_frames {
        let own: Vec<u64> = seeds.iter().map(|&seed| candidate_seed(seed, candidate)).collect();
        let scored = scored(model, &begun, &own, &mut prefix)?;
        for ((best, sequence), seed) in best.iter_mut().zip(&scored.sequences).zip(own) {
            // the first candidate has the dance's own seed, and wins ties
            if sequence.log_likelihood() > best.0 {
                *best = (sequence.log_likelihood(), seed);
            }
        }
    }
    Ok(best.into_iter().map(|(_, seed)| seed).collect())
}

/// Dances of these seeds, sampled until their given characters are scored. `prefix`: the log-likelihoods of what is given
/// before the first free slot, where `model` has read it already; else they are put there.
fn scored(
    model: &mut (impl NextToken + ?Sized),
    plan: &Arc<SamplingPlan>,
    seeds: &[u64],
    prefix: &mut Vec<f64>,
) -> Result<Batch> {
    let mut batch = Batch { scores: true, ..Batch::new(plan, 0, seeds, model.context()) };
    batch.sequences.iter_mut().zip(&*prefix).for_each(|(sequence, scored)| sequence.skip_prefix(*scored));
    while !batch.is_done() {
        batch.step(model)?;
        if prefix.is_empty() {
            prefix.extend(batch.sequences.iter().map(Sequence::log_likelihood));
        }
    }
    Ok(batch)
}

/// The seed of a candidate, counted from 0. The first has the dance's own.
fn candidate_seed(seed: u64, candidate: usize) -> u64 {
    match candidate {
        0 => seed,
        i => kinelm_store::random::stream(seed, "start", 0, i as u64).next_u64(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Summing, model, plan, run};
    use super::super::{sample, unwatched, variation_seed};
    use super::*;
    use kinelm_model::Logits;

    /// All tokens are equally likely.
    struct Even(Summing);

    impl NextToken for Even {
        fn context(&self) -> usize {
            self.0.context
        }

        fn streams(&self) -> usize {
            self.0.read.len()
        }

        fn is_exact(&self) -> bool {
            true
        }

        fn truncate(&mut self, stream: usize, length: usize) {
            self.0.truncate(stream, length);
        }

        fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()> {
            self.0.read(blocks, wanted, logits)?;
            logits.fill(0.0);
            Ok(())
        }
    }

    /// Words of 5 characters.
    const PROMPT: [u32; 12] = [6, 7, 8, 9, 10, 5, 12, 13, 14, 6, 9, 5];

    #[test]
    fn what_is_given_up_to_the_second_words_first_free_slot_is_scored_once() {
        let (f, t) = (false, true);
        for (given, count) in [([f, t, f, t, f], 2), ([t, t, f, f, t], 5), ([t, f, t, t, f], 4), ([f, f, f, t, t], 2)] {
            for context in [12, 40] {
                let plan = plan(2, &given, &PROMPT, Sampling::temperature(3.0));
                let batch = scored(&mut Even(model(context, 2)), &Arc::new(plan), &[1, 2], &mut Vec::new()).unwrap();
                for sequence in batch.sequences {
                    // one of 10 is sampled, the space is certain
                    let (expected, found) = (-10f64.ln() * f64::from(count), sequence.log_likelihood());
                    assert!((found - expected).abs() < 1e-9, "{given:?} {found}");
                }
            }
        }
    }

    #[test]
    fn a_dance_continues_from_the_candidate_under_which_the_given_characters_are_most_likely() {
        let given = [false, true, false, true, true];
        // ln p of the given characters of the first word, from all tokens before each; the second begins with a free one
        let likelihood = |ids: &[u32]| -> f64 {
            let of = |at: usize| {
                let wanted = 6 + (1 + ids[..at].iter().sum::<u32>() + 1) % 10;
                let all = f64::exp(5.0) + 9.0;
                (if wanted == ids[at] { f64::exp(5.0) / all } else { all.recip() }).ln()
            };
            of(1) + of(3) + of(4)
        };
        let sampling = Sampling::temperature(3.0);
        let one = plan(12, &given, &PROMPT, sampling);
        let mut seen = 0;
        for seed in 0..20 {
            let with_candidates =
                |first_frames| run(100, &SamplingPlan { seed, first_frames, ..one.clone() }).unwrap().0;
            let (first, best) = (with_candidates(1), with_candidates(40));
            assert!(likelihood(&best) >= likelihood(&first), "seed {seed}");
            seen += usize::from(likelihood(&best) > likelihood(&first) + 1.0);
            // as likely as the most likely of all candidates, each sampled for itself
            let seed_of = |candidate: usize| candidate_seed(seed, candidate);
            let all: Vec<Vec<u32>> =
                (0..40).map(|i| run(100, &SamplingPlan { seed: seed_of(i), ..one.clone() }).unwrap().0).collect();
            let most = all.iter().map(|ids| likelihood(ids)).fold(f64::NEG_INFINITY, f64::max);
            assert!((likelihood(&best) - most).abs() < 1e-4, "seed {seed}: {} of {most}", likelihood(&best));
            assert!(all.contains(&best), "the whole dance is that of its candidate");
        }
        assert!(seen > 15, "{seen} of 20 choices are better than the first candidate");
        // of several dances side by side each has its own choice
        let plan = SamplingPlan { first_frames: 40, ..one.clone() };
        let together = sample(&mut model(100, 3), &plan, &mut unwatched).unwrap().ids;
        for (i, ids) in together.iter().enumerate() {
            assert_eq!(ids, &run(100, &SamplingPlan { seed: variation_seed(plan.seed, i), ..plan.clone() }).unwrap().0);
        }
    }

    #[test]
    fn labels_before_a_free_first_slot_are_read_once() {
        let given = [false, true, false, true, true];
        for front in [vec![1], vec![1, 3], vec![1, 3, 4]] {
            let one = SamplingPlan { fronts: vec![(0, front)], ..plan(3, &given, &PROMPT, Sampling::temperature(3.0)) };
            let best = run(100, &SamplingPlan { first_frames: 4, ..one.clone() }).unwrap().0;
            let of = |candidate: usize| {
                run(100, &SamplingPlan { seed: candidate_seed(one.seed, candidate), ..one.clone() }).unwrap().0
            };
            assert!((0..4).map(of).any(|ids| ids == best), "{best:?}");
        }
    }

    #[test]
    fn candidates_are_sampled_without_truncation_and_later_words_with_it() {
        let given = [false, true, false, true, true];
        let certain = Sampling { top_k: Some(1), ..Sampling::temperature(3.0) };
        let mut other = 0;
        for seed in 0..20 {
            let truncated = SamplingPlan { seed, ..plan(12, &given, &PROMPT, certain) };
            let first = run(100, &truncated).unwrap().0;
            let best = run(100, &SamplingPlan { first_frames: 40, ..truncated.clone() }).unwrap().0;
            let untruncated =
                SamplingPlan { sampling: Sampling::temperature(3.0), first_frames: 40, ..truncated.clone() };
            assert_eq!(best[..6], run(100, &untruncated).unwrap().0[..6], "seed {seed}");
            other += usize::from(best[..6] != first[..6]);
            // truncated to one token, the dance is the same from a beginning
            let continued = SamplingPlan { beginnings: vec![best[..6].to_vec()], ..truncated.clone() };
            assert_eq!(best, run(100, &continued).unwrap().0, "seed {seed}");
        }
        assert!(other > 10, "{other} of 20 first words are not the most likely tokens");
    }

    #[test]
    fn a_first_word_is_chosen_only_where_some_of_it_is_given_after_free_characters() {
        let (free, all, root, some) =
            ([false; 5], [true; 5], [true, false, false, false, false], [false, true, false, true, true]);
        let (hot, beginnings) = (Sampling::temperature(3.0), vec![PROMPT[..6].to_vec()]);
        let plans = [
            plan(6, &free, &[], hot),
            plan(6, &all, &PROMPT, hot),
            plan(6, &root, &PROMPT, hot),
            plan(6, &some, &PROMPT, Sampling::greedy()),
            SamplingPlan { beginnings, ..plan(6, &some, &PROMPT, hot) },
            SamplingPlan { lead_in: 1, ..plan(6, &some, &PROMPT, hot) },
        ];
        for plan in plans {
            let found = [1, 40].map(|first_frames| run(100, &SamplingPlan { first_frames, ..plan.clone() }).unwrap());
            assert_eq!(found[0], found[1], "the same ids, of as many reads");
        }
    }
}
