//! Sampling from models whose choices are easy to predict.

mod goals;
mod history;
mod look_ahead;
mod music;

use super::*;
use crate::sampling::Sampling;
use kinelm_model::{Architecture, Gpt, ModelConfig, Reader, ReaderOptions, TokenLayout, fixtures};
use kinelm_tokenizer::{Grammar, SPACE, Slot, Special, Tokenizer, Vocabulary, WordLength};
use std::ops::ControlFlow::{Break, Continue};

/// Prefers the token that is the sum of all it has read, plus one, modulo the characters; checks its context.
pub(super) struct Summing {
    pub context: usize,
    pub read: Vec<Vec<u32>>,
    calls: usize,
}

impl NextToken for Summing {
    fn context(&self) -> usize {
        self.context
    }

    fn streams(&self) -> usize {
        self.read.len()
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn truncate(&mut self, stream: usize, length: usize) {
        self.read[stream].truncate(length);
    }

    fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()> {
        logits.clear();
        self.calls += 1;
        for (read, block) in self.read.iter_mut().zip(blocks) {
            for (i, id) in block.iter().enumerate() {
                read.push(*id);
                assert!(read.len() <= self.context, "{} tokens in {}", read.len(), self.context);
                assert!([1, 2].contains(&read[0]), "every window begins with the front token");
                if wanted == Logits::All || i + 1 == block.len() {
                    let mut row = [0.0; 16];
                    row[0] = 99.0; // never allowed
                    row[5] = 2.0;
                    row[6 + (read.iter().sum::<u32>() as usize + 1) % 10] = 5.0;
                    logits.extend(row);
                }
            }
        }
        Ok(())
    }
}

pub(super) fn plan(words: usize, given: &[bool], prompt: &[u32], sampling: Sampling) -> SamplingPlan {
    let grammar = Grammar::new(&Vocabulary::new(10), WordLength::Fixed(given.len()));
    let (given, prompt) = (given.to_vec(), prompt.to_vec());
    SamplingPlan { given, prompt, guesses: 0, ..SamplingPlan::free(grammar, words, sampling, 7) }
}

/// Words of up to 7 characters.
fn varying(words: usize, beginning: &[u32], sampling: Sampling) -> SamplingPlan {
    let grammar = Grammar::new(&Vocabulary::new(10), WordLength::Varying { most: 7 });
    SamplingPlan { beginnings: vec![beginning.to_vec()], guesses: 0, ..SamplingPlan::free(grammar, words, sampling, 7) }
}

/// A small model of two levels of a tokenizer's words, else as `own` says.
fn two_level(tokenizer: &Tokenizer, own: ModelConfig) -> Gpt {
    let tokens = TokenLayout::of(tokenizer);
    let config = ModelConfig { architecture: Architecture::TwoLevel, layers: 1, heads: 2, width: 16, ..own };
    fixtures::model(&config.resolved(&tokens), &tokens)
}

fn sampled(gpt: &Gpt, plan: &SamplingPlan) -> Vec<u32> {
    let mut reader = Reader::new(gpt, ReaderOptions { streams: plan.streams(), ..ReaderOptions::default() }).unwrap();
    sample_one(&mut reader, plan, &mut unwatched).unwrap()
}

pub(super) fn model(context: usize, streams: usize) -> Summing {
    Summing { context, read: vec![vec![3; 3]; streams], calls: 0 }
}

pub(super) fn run(context: usize, plan: &SamplingPlan) -> Result<(Vec<u32>, usize)> {
    let mut model = model(context, 1);
    let ids = sample_one(&mut model, plan, &mut unwatched)?;
    Ok((ids, model.calls))
}

#[test]
fn dances_of_several_models_are_those_of_one() {
    let (prompt, given) = ([6, 7, 8, 5, 9, 10, 11, 5], [false, true, false]);
    let hot = Sampling::temperature(3.0);
    let beginnings = (6..11).map(|id| vec![id, id, id, 5]).collect();
    let plans = [
        plan(9, &given, &prompt, hot),
        // a first word is chosen, and goes with its own dance
        SamplingPlan { first_frames: 9, ..plan(9, &[false, true, true], &prompt, hot) },
        SamplingPlan { beginnings, lead_in: 1, ..plan(9, &given, &prompt, hot) },
    ];
    for plan in plans {
        let one = sample(&mut model(20, 5), &plan, &mut unwatched).unwrap();
        let mut several: Vec<Box<dyn NextToken>> =
            [2, 1, 2].map(|streams| Box::new(model(20, streams)) as Box<dyn NextToken>).into();
        let mut words = Vec::new();
        let found = sample_side_by_side(&mut several, &plan, &mut |n, last| {
            words.push((n, last.to_vec()));
            ControlFlow::Continue(())
        });
        assert_eq!(found.unwrap(), one);
        assert!(words.iter().enumerate().all(|(i, (n, last))| *n == i + 1 && last.len() == 5));
        let last: Vec<Vec<u32>> = one.ids.iter().map(|ids| ids[ids.len() - 4..].to_vec()).collect();
        assert_eq!(words.last().unwrap().1, last);
        // it is stopped on all, and the error of one is reported
        let stop = sample_side_by_side(&mut several, &plan, &mut |n, _| match n {
            3 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        });
        assert!(stop.unwrap_err().to_string().contains("stopped"));
        several.push(Box::new(model(4, 1)));
        let said = sample_side_by_side(&mut several, &plan, &mut unwatched).unwrap_err().to_string();
        assert!(said.contains("expected at least 2"), "{said}");
    }
}

#[test]
fn given_characters_come_out_as_they_went_in() {
    let prompt = [6, 7, 8, 5, 9, 10, 11, 5];
    let given = [false, true, false];
    let (ids, calls) = run(100, &plan(4, &given, &prompt, Sampling::temperature(1.0))).unwrap();
    assert_eq!(ids.len(), 16);
    assert_eq!((ids[1], ids[5]), (7, 10));
    assert!(ids.chunks(4).all(|w| w[3] == 5 && w[..3].iter().all(|id| (6..16).contains(id))));
    // two free places in the two prompted frames, three in the others: known characters cost no call
    assert_eq!(calls, 2 * 2 + 2 * 3);
}

#[test]
fn a_window_that_moves_never_overflows() {
    for context in 8..40 {
        let p = plan(25, &[false, false, false], &[], Sampling::greedy());
        let (ids, _) = run(context, &p).unwrap();
        assert_eq!(ids.len(), 100);
    }
    assert!(run(7, &plan(3, &[false; 3], &[], Sampling::greedy())).unwrap_err().to_string().contains("holds 1 words"));
}

#[test]
fn the_whole_window_is_read_before_it_moves() {
    // as long as everything fits, the sum of all tokens before decides
    let (ids, _) = run(100, &plan(8, &[false; 3], &[], Sampling::greedy())).unwrap();
    let mut sum = 1;
    for word in ids.chunks(4) {
        for &id in &word[..3] {
            assert_eq!(id, 6 + (sum + 1) % 10);
            sum += id;
        }
        sum += 5;
    }
}

#[test]
fn the_same_seed_gives_the_same_dance() {
    let p = plan(20, &[false; 3], &[], Sampling::temperature(3.0));
    assert_eq!(run(30, &p).unwrap(), run(30, &p).unwrap());
    assert_ne!(run(30, &p).unwrap(), run(30, &SamplingPlan { seed: 8, ..p.clone() }).unwrap());
    assert_ne!(run(30, &p).unwrap(), run(30, &SamplingPlan { inputs_hash: 1, ..p.clone() }).unwrap());
}

#[test]
fn everything_given_needs_no_model() {
    let (ids, calls) = run(30, &plan(2, &[true; 3], &[6, 6, 6, 5, 6, 6, 6, 5], Sampling::greedy())).unwrap();
    assert_eq!((ids, calls), (vec![6, 6, 6, 5, 6, 6, 6, 5], 0));
}

#[test]
fn guessing_ahead_changes_no_id_and_saves_reads() {
    let prompt: Vec<u32> = (0..40).map(|i| if i % 4 == 3 { 5 } else { 6 + i * i % 7 }).collect();
    for given in [[false; 3], [false, true, false], [true, false, false], [false, false, true]] {
        // a temperature that makes characters repeat, one that does not, and the likeliest
        for sampling in [Sampling::temperature(0.3), Sampling::temperature(9.0), Sampling::greedy()] {
            for context in [9, 20, 200] {
                let plain = plan(30, &given, &prompt, sampling);
                let (ids, calls) = run(context, &plain).unwrap();
                for guesses in [1, 2, 5] {
                    let mut model = model(context, 1);
                    let found = sample(&mut model, &SamplingPlan { guesses, ..plain.clone() }, &mut unwatched).unwrap();
                    assert_eq!(found.ids, std::slice::from_ref(&ids));
                    assert_eq!(model.calls + found.right as usize, calls);
                    assert!(found.right <= found.guessed && found.guessed > 0);
                }
            }
        }
    }
}

#[test]
fn the_first_of_several_dances_is_the_one_sampled_alone() {
    for guesses in [0, 2] {
        let plan =
            SamplingPlan { guesses, ..plan(20, &[false, true, false], &[6, 7, 8, 5], Sampling::temperature(3.0)) };
        let mut model = model(30, 3);
        let mut done = Vec::new();
        let found = sample(&mut model, &plan, &mut |words, last| {
            assert_eq!(last.len(), 3);
            done.push(words);
            Continue(())
        })
        .unwrap()
        .ids;
        assert_eq!(found[0], run(30, &plan).unwrap().0);
        assert!(found[0] != found[1] && found[0] != found[2] && found[1] != found[2]);
        assert!(found.iter().all(|ids| ids.len() == 80 && ids[1] == 7));
        assert!(done.is_sorted() && done.last() == Some(&20));
        let stop = |words: usize, _: &[Vec<u32>]| if words < 5 { Continue(()) } else { Break(()) };
        let stopped = sample(&mut model, &plan, &mut { stop }).unwrap_err();
        assert_eq!(stopped.kind(), kinelm_store::Kind::Stopped);
        assert!(
            sample_one(&mut model, &plan, &mut unwatched)
                .unwrap_err()
                .to_string()
                .contains("the number of sequences is 3")
        );
    }
}

/// The token that the model prefers after a window, by the sum of its ids.
fn choice(window: &[u32]) -> u32 {
    6 + (1 + window.iter().sum::<u32>() + 1) % 10
}

#[test]
fn words_of_any_length_keep_to_the_grammar_and_end() {
    for sampling in [Sampling::greedy(), Sampling::temperature(1.0), Sampling::temperature(9.0)] {
        for context in [2, 3, 5, 8, 20, 500] {
            let p = varying(40, &[], sampling);
            let (ids, _) = run(context, &p).unwrap();
            let mut place = Slot::default();
            for &id in &ids {
                assert!(p.grammar.allows(place, id), "{id} at {place:?}");
                place = p.grammar.advance(place, id);
            }
            let spaces = ids.iter().filter(|&&id| id == SPACE).count();
            assert_eq!((spaces, ids.last()), (40, Some(&SPACE)), "context {context}");
            assert_eq!(run(context, &p).unwrap().0, ids, "the same seed gives the same dance");
        }
    }
    let message = run(1, &varying(1, &[], Sampling::greedy())).unwrap_err().to_string();
    assert!(message.contains("holds 1 tokens"), "{message}");
}

#[test]
fn a_dance_goes_on_where_its_beginning_ends() {
    let beginning = [6, 7, 5, 5, 8, 9, 10, 5];
    let (ids, _) = run(100, &varying(6, &beginning, Sampling::greedy())).unwrap();
    assert_eq!(ids[..8], beginning);
    // words of seven, since the model never prefers a space
    assert_eq!(ids.len(), 8 + 3 * 8);
    for (i, &id) in ids.iter().enumerate().skip(8).filter(|(i, _)| (i - 8) % 8 != 7) {
        assert_eq!(id, choice(&ids[..i]), "token {i}");
    }
    let (cut, calls) = run(100, &varying(2, &beginning, Sampling::greedy())).unwrap();
    assert_eq!((&cut[..], calls), (&beginning[..4], 0));
    // one that is longer than the context is read from its end
    let long: Vec<u32> = beginning.repeat(9);
    let (ids, _) = run(13, &varying(36 + 1, &long, Sampling::greedy())).unwrap();
    // 72 tokens: windows begin at 8 (the first word after 6), 16, .. up to 64, where 8 are left
    assert_eq!(ids[72], choice(&ids[64..72]));
}

#[test]
fn a_full_window_moves_to_the_first_word_of_its_later_half() {
    // 7 characters and a space each; of 20 tokens the model reads 1 and 19
    let (ids, _) = run(20, &varying(4, &[], Sampling::greedy())).unwrap();
    for (i, first) in [(19, 0), (20, 16), (22, 16), (24, 16), (30, 16)] {
        assert_eq!(ids[i], choice(&ids[first..i]), "token {i}");
    }
    // a word that alone fills the window is begun inside: 1 + 4 tokens, then from 2 on
    let (ids, _) = run(5, &varying(2, &[], Sampling::greedy())).unwrap();
    for (i, first) in [(4, 0), (5, 2), (6, 2)] {
        assert_eq!(ids[i], choice(&ids[first..i]), "token {i}");
    }
}

#[test]
fn guessing_ahead_changes_no_word_of_any_length() {
    for sampling in [Sampling::temperature(0.3), Sampling::temperature(2.0), Sampling::greedy()] {
        for context in [4, 9, 20, 200] {
            let plain = varying(30, &[6, 7, 8, 9, 5], sampling);
            let (ids, calls) = run(context, &plain).unwrap();
            let mut guessed = 0;
            for guesses in [1, 2, 5] {
                let mut model = model(context, 1);
                let found = sample(&mut model, &SamplingPlan { guesses, ..plain.clone() }, &mut unwatched).unwrap();
                assert_eq!(found.ids, std::slice::from_ref(&ids));
                assert_eq!(model.calls + found.right as usize, calls);
                guessed += found.guessed;
            }
            assert!(guessed > 0, "context {context}");
        }
    }
}

#[test]
fn the_penalty_applies_to_ids_in_the_same_slot() {
    let sampling = Sampling { repetition_penalty: 1e9, repetition_words: 2, ..Sampling::greedy() };
    for plan in [plan(30, &[false; 3], &[], sampling), varying(30, &[], sampling)] {
        let (ids, _) = run(40, &plan).unwrap();
        let words: Vec<&[u32]> = ids.split_inclusive(|&id| id == SPACE).collect();
        assert_eq!(words.len(), 30);
        let of = |word: usize, place: usize| words[word].get(place).filter(|&&id| id != SPACE);
        for (word, place) in (2..30).flat_map(|w| (0..7).map(move |p| (w, p))).filter(|&(w, p)| of(w, p).is_some()) {
            assert!(
                [1, 2].iter().all(|before| of(word - before, place) != of(word, place)),
                "word {word} place {place}"
            );
        }
    }
}

/// The token that the two readings together prefer after a window: fronts 1 and 2.
fn guided_choice(window: &[u32], scale: f64) -> u32 {
    let sum = window.iter().sum::<u32>();
    let (with, without) = (6 + (1 + sum + 1) % 10, 6 + (2 + sum + 1) % 10);
    if scale > 0.5 { with } else { without }
}

#[test]
fn guidance_reads_with_and_without_conditions() {
    for (scale, context) in [(0.0, 200), (0.3, 20), (1.0, 20), (3.0, 200)] {
        for guesses in [0, 3] {
            let guidance = Some(Guidance { scale, unconditioned: vec![2] });
            let plan = SamplingPlan {
                guidance,
                guesses,
                ..plan(12, &[false, true, false], &[6, 7, 8, 5], Sampling::greedy())
            };
            let ids = sample_one(&mut model(context, 2), &plan, &mut unwatched).unwrap();
            assert_eq!((ids[1], ids.len()), (7, 48));
            if context == 200 {
                for (i, &id) in ids.iter().enumerate().filter(|&(i, id)| *id != SPACE && i != 1) {
                    assert_eq!(id, guided_choice(&ids[..i], scale), "token {i}");
                }
            }
            // beside others it is the same, and the others are not
            let sampled = SamplingPlan { sampling: Sampling::temperature(9.0), ..plan.clone() };
            let alone = sample_one(&mut model(context, 2), &sampled, &mut unwatched).unwrap();
            let three = sample(&mut model(context, 6), &sampled, &mut unwatched).unwrap().ids;
            // above 1 the one token that the reading with conditions finds likely is left, whatever the temperature
            assert!(three.len() == 3 && three[0] == alone && (three[1] == alone) == (scale > 1.0));
            if scale == 1.0 {
                let plain = SamplingPlan { guidance: None, ..sampled };
                assert_eq!(sample_one(&mut model(context, 1), &plain, &mut unwatched).unwrap(), alone);
            }
        }
    }
    let said = |plan: SamplingPlan, streams: usize| {
        sample(&mut model(50, streams), &plan, &mut unwatched).unwrap_err().to_string()
    };
    let guided = |unconditioned| SamplingPlan {
        guidance: Some(Guidance { scale: 2.0, unconditioned }),
        ..plan(2, &[false; 3], &[], Sampling::greedy())
    };
    assert!(said(guided(vec![2]), 3).contains("the number of sequences is 3; expected a multiple of the 2"));
    assert!(said(guided(vec![2, 2]), 2).contains("the front without conditions is 2 tokens; expected 1"));
}

#[test]
fn a_front_that_changes_is_that_of_the_window_from_its_word_on() {
    let fronts = vec![(0, vec![1]), (3, vec![2]), (7, vec![1])];
    for (context, guesses) in [(200, 0), (200, 3), (20, 0)] {
        let base =
            SamplingPlan { guesses, ..plan(9, &[false, true, false], &[6, 7, 8, 5], Sampling::temperature(3.0)) };
        let ids = |plan: &SamplingPlan| run(context, plan).unwrap().0;
        let changed = ids(&SamplingPlan { fronts: fronts.clone(), ..base.clone() });
        let before = ids(&base);
        assert!(changed[..12] == before[..12] && changed[12..28] != before[12..28], "{changed:?}");
        // as if one with that front went on from there
        let second =
            ids(&SamplingPlan { fronts: vec![(0, vec![2])], beginnings: vec![changed[..12].to_vec()], ..base.clone() });
        assert_eq!(changed[..28], second[..28]);
        assert_eq!(changed, ids(&SamplingPlan { beginnings: vec![changed[..28].to_vec()], ..base.clone() }));
    }
    let fronts = vec![(0, vec![1]), (3, vec![2, 2])];
    let wrong = SamplingPlan { fronts, ..plan(9, &[false; 3], &[], Sampling::greedy()) };
    assert!(run(200, &wrong).unwrap_err().to_string().contains("the front from word 3 on is 2 tokens; expected 1"));
}

#[test]
fn a_look_ahead_word_is_sampled_taken_back_and_made_of_given_characters() {
    // character 1 is free in word 1 and given after it: what the model would have sampled in word 2 is the look-ahead token
    let prompt: Vec<u32> = (0..4u32).flat_map(|w| [6 + w, 7 + w, 8 + w, 5]).collect();
    let given: Vec<bool> = (0..12).map(|i| i != 4).collect();
    let lookahead: Vec<bool> = (0..12).map(|i| i == 7).collect();
    let one_frame = |context: usize, guesses: usize, lookahead: &[bool]| {
        let plan = SamplingPlan {
            lookahead: lookahead.to_vec(),
            guesses,
            words: 6,
            ..plan(6, &given[..3], &prompt, Sampling::greedy())
        };
        let plan = SamplingPlan { given: given.clone(), ..plan };
        sample(&mut model(context, 1), &plan, &mut unwatched).unwrap()
    };
    for (context, guesses) in [(100, 0), (100, 4), (14, 0), (12, 2)] {
        let [without, with] = [&[][..], &lookahead].map(|lookahead| one_frame(context, guesses, lookahead));
        assert_eq!(with.ids, without.ids, "looking ahead changes nothing");
        assert!(without.lookahead == [vec![]]);
        let ids = &with.ids[0];
        assert_eq!((ids.len(), &ids[8..16]), (24, &prompt[8..16]));
        let [(at, id)] = with.lookahead[0][..] else { panic!("{:?}", with.lookahead) };
        assert_eq!(at, 9);
        if context == 100 {
            assert_eq!(id, 6 + (1 + ids[..9].iter().sum::<u32>() + 1) % 10, "of all that stood before it");
        }
    }
}

#[test]
fn a_look_ahead_word_may_begin_with_a_free_character() {
    // character 2 is free in word 1 and given after it, the first character of word 2 is free
    let prompt: Vec<u32> = (0..4u32).flat_map(|w| [6 + w, 7 + w, 8 + w, 5]).collect();
    let given: Vec<bool> = (0..12).map(|i| !(3..7).contains(&i)).collect();
    let lookahead: Vec<bool> = (0..12).map(|i| i == 7 || i == 8).collect();
    for (context, guesses) in [(100, 0), (100, 4), (14, 0), (12, 2)] {
        let plan = SamplingPlan { guesses, words: 6, ..plan(6, &given[..3], &prompt, Sampling::greedy()) };
        let [without, with] = [&[][..], &lookahead].map(|lookahead| {
            sample(
                &mut model(context, 1),
                &SamplingPlan { given: given.clone(), lookahead: lookahead.to_vec(), ..plan.clone() },
                &mut unwatched,
            )
            .unwrap()
        });
        assert_eq!(with.ids, without.ids, "{context} {guesses}");
        assert_eq!(with.lookahead[0].len(), 2);
    }
}

#[test]
fn the_lead_in_is_free_and_the_prompt_comes_after_it() {
    let prompt = [6, 7, 8, 5, 9, 10, 11, 5];
    let plan = SamplingPlan { lead_in: 2, ..plan(5, &[false, true, false], &prompt, Sampling::temperature(3.0)) };
    let (ids, calls) = run(100, &plan).unwrap();
    assert_eq!((ids.len(), ids[2 * 4 + 1], ids[3 * 4 + 1]), (20, 7, 10));
    assert_eq!(calls, 3 * 3 + 2 * 2);
}
