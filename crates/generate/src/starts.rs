//! Which of several first words a dance goes on from, where some joints are given from its first frame on and others are free.
//!
//! A frame is drawn character by character, and a free one doesn't know the given ones behind it. Later frames have those before
//! them to go by; the first has nothing, so that a left arm may come out that goes with another right one, and a model may hold it
//! for the whole dance. So the first word is drawn several times, each time with numbers of its own, and the dance is drawn
//! with those under which what is given up to the second word's first free place is likeliest (docs/results/two-level.md).
//! Sources: Rubin, "The SIR algorithm" (1987), of which the likeliest sample is kept here; Lew et al., "Sequential Monte Carlo
//! Steering of Large Language Models" (2023).

use super::followed::Followed;
use super::open::OpenRequest;
use super::sampling::Draw;
use super::{NextToken, SamplingPlan, drawn};
use crate::Result;
use rand_chacha::rand_core::RngCore;

/// Starts that are drawn where nobody says how many.
pub const STARTS: usize = 64;

impl SamplingPlan<'_> {
    /// Whether its start can be chosen: something of its first word is given behind what is drawn, and nothing stands before.
    fn begins_in_part(&self) -> bool {
        let characters = self.grammar.tokens_per_word().map_or(0, |word| word - 1);
        let first = &self.given[..self.given.len().min(characters)];
        let is_drawn =
            !self.draw.greedy && self.lead_in == 0 && self.beginning.is_empty() && self.beginnings.is_empty();
        is_drawn && !self.prompt.is_empty() && has_given_behind_drawn(first)
    }

    /// How the free places of a word are drawn: those of a first one that is chosen among several with nothing cut, since
    /// the choice weeds out what is rare and doesn't fit, and the one that fits may be rare.
    pub(super) fn draw_of(&self, word: usize) -> Draw {
        if word > 0 || self.starts < 2 || !self.begins_in_part() {
            return self.draw;
        }
        Draw { top_k: None, top_p: None, min_p: None, ..self.draw }
    }
}

/// Whether what is drawn of a word, whose given places are flagged, makes some given one more or less likely.
pub(super) fn has_given_behind_drawn(given: &[bool]) -> bool {
    given.iter().skip_while(|is_given| **is_given).any(|is_given| *is_given)
}

/// For each seed of a dance the one of its starts under which what is given is likeliest, of equals the first.
///
/// # Errors
/// Those of [`super::dances`].
pub(super) fn chosen(model: &mut dyn NextToken, plan: &SamplingPlan, seeds: Vec<u64>) -> Result<Vec<u64>> {
    if plan.starts < 2 || !plan.begins_in_part() {
        return Ok(seeds);
    }
    // what is given at the end of the first word is read with the second
    let words = plan.words.min(2);
    let music = &plan.music[..plan.music.len() / plan.words.max(1) * words];
    let begun = SamplingPlan { words, music, guesses: 0, ..plan.clone() };
    let mut best: Vec<(f64, u64)> = seeds.iter().map(|&seed| (f64::NEG_INFINITY, seed)).collect();
    for start in 0..plan.starts {
        let own: Vec<u64> = seeds.iter().map(|&seed| start_seed(seed, start)).collect();
        let dances = drawn(model, &begun, &own, true, &mut |_| {})?;
        for ((best, dance), seed) in best.iter_mut().zip(&dances).zip(own) {
            if dance.likelihood() > best.0 {
                *best = (dance.likelihood(), seed);
            }
        }
    }
    Ok(best.into_iter().map(|(_, seed)| seed).collect())
}

/// The seed of a start, counted from 0; the first has the dance's own.
fn start_seed(seed: u64, start: usize) -> u64 {
    match start {
        0 => seed,
        i => kinelm_store::random::stream(seed, "start", 0, i as u64).next_u64(),
    }
}

impl OpenRequest {
    /// Whether some joints are given in the first frame, and others drawn before them.
    pub fn begins_in_part(&self) -> bool {
        let begins = self.prompt.as_ref().is_some_and(|prompt| prompt.beginning.is_empty());
        begins && !self.recipe.draw.greedy && has_given_behind_drawn(&self.first_given())
    }

    /// (C) which places of the prompt's first word are given; empty: none, or there is no prompt.
    pub(super) fn first_given(&self) -> Vec<bool> {
        let given =
            |prompt: &Followed| prompt.edit.as_ref().map_or_else(|| prompt.given.clone(), |edit| edit.given(1).0);
        self.prompt.as_ref().map(given).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Summing, model, plan, run};
    use super::super::{dances, variation_seed};
    use super::*;
    use kinelm_engine::decode::Logits;

    /// Finds every token as likely as any other.
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
    fn what_is_given_up_to_the_second_words_free_places_is_weighed_once() {
        let (f, t) = (false, true);
        for (given, weighed) in [([f, t, f, t, f], 2), ([t, t, f, f, t], 5), ([t, f, t, t, f], 4), ([f, f, f, t, t], 2)]
        {
            for context in [12, 40] {
                let plan = plan(2, &given, &PROMPT, Draw::temperature(3.0));
                let dances = drawn(&mut Even(model(context, 2)), &plan, &[1, 2], true, &mut |_| {}).unwrap();
                for dance in dances {
                    // one of 10 is drawn, the space is certain
                    let expected = -10f64.ln() * f64::from(weighed);
                    assert!((dance.likelihood() - expected).abs() < 1e-9, "{given:?} {}", dance.likelihood());
                }
            }
        }
    }

    #[test]
    fn a_dance_goes_on_from_the_start_under_which_what_is_given_is_likeliest() {
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
        let draw = Draw::temperature(3.0);
        let one = plan(12, &given, &PROMPT, draw);
        let mut seen = 0;
        for seed in 0..20 {
            let of_starts = |starts| run(100, &SamplingPlan { seed, starts, ..one.clone() }).unwrap().0;
            let (first, best) = (of_starts(1), of_starts(40));
            assert!(likelihood(&best) >= likelihood(&first), "seed {seed}");
            seen += usize::from(likelihood(&best) > likelihood(&first) + 1.0);
            // as likely as the likeliest of all starts, each drawn for itself
            let start = |start: usize| start_seed(seed, start);
            let all: Vec<Vec<u32>> =
                (0..40).map(|i| run(100, &SamplingPlan { seed: start(i), ..one.clone() }).unwrap().0).collect();
            let most = all.iter().map(|ids| likelihood(ids)).fold(f64::NEG_INFINITY, f64::max);
            assert!((likelihood(&best) - most).abs() < 1e-4, "seed {seed}: {} of {most}", likelihood(&best));
            assert!(all.contains(&best), "the whole dance is that of its start");
        }
        assert!(seen > 15, "{seen} of 20 starts are better than the first");
        // each of several side by side has its own
        let plan = SamplingPlan { starts: 40, ..one.clone() };
        let together = dances(&mut model(100, 3), &plan, &mut |_| {}).unwrap().ids;
        for (i, ids) in together.iter().enumerate() {
            assert_eq!(ids, &run(100, &SamplingPlan { seed: variation_seed(plan.seed, i), ..plan.clone() }).unwrap().0);
        }
    }

    #[test]
    fn nothing_of_a_start_is_cut_and_all_that_follows_it_is() {
        let given = [false, true, false, true, true];
        let certain = Draw { top_k: Some(1), ..Draw::temperature(3.0) };
        let mut other = 0;
        for seed in 0..20 {
            let cut = SamplingPlan { seed, ..plan(12, &given, &PROMPT, certain) };
            let first = run(100, &cut).unwrap().0;
            let best = run(100, &SamplingPlan { starts: 40, ..cut.clone() }).unwrap().0;
            let uncut = SamplingPlan { draw: Draw::temperature(3.0), starts: 40, ..cut.clone() };
            assert_eq!(best[..6], run(100, &uncut).unwrap().0[..6], "seed {seed}");
            other += usize::from(best[..6] != first[..6]);
            // what is cut to one token draws the same from a beginning
            let behind = SamplingPlan { beginning: &best[..6], ..cut.clone() };
            assert_eq!(best, run(100, &behind).unwrap().0, "seed {seed}");
        }
        assert!(other > 10, "{other} of 20 starts are not the likeliest tokens");
    }

    #[test]
    fn a_start_is_chosen_only_where_something_of_it_is_given() {
        let (free, all, root, some) =
            ([false; 5], [true; 5], [true, false, false, false, false], [false, true, false, true, true]);
        let (hot, beginning) = (Draw::temperature(3.0), &PROMPT[..6]);
        let plans = [
            plan(6, &free, &[], hot),
            plan(6, &all, &PROMPT, hot),
            plan(6, &root, &PROMPT, hot),
            plan(6, &some, &PROMPT, Draw::greedy()),
            SamplingPlan { beginning, ..plan(6, &some, &PROMPT, hot) },
            SamplingPlan { lead_in: 1, ..plan(6, &some, &PROMPT, hot) },
        ];
        for plan in plans {
            let found = [1, 40].map(|starts| run(100, &SamplingPlan { starts, ..plan.clone() }).unwrap());
            assert_eq!(found[0], found[1], "the same ids, of as many reads");
        }
    }
}
