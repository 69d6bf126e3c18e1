//! Dances that go on with the best of several continuations.

use super::*;
use crate::sampler::look_ahead::block_seed;
use kinelm_corpus::samples;
use kinelm_tokenizer::TokenizerConfig;
use std::sync::Mutex;

fn tokenizer() -> Tokenizer {
    Tokenizer::fit([&samples::walk(9)], TokenizerConfig::uniform(&[0, 4], 20.0, 20)).unwrap()
}

/// Prefers the dance whose last words have the largest sum of ids, and remembers what it was asked.
#[derive(Debug, Default)]
struct Largest(Mutex<Vec<Range<usize>>>);

impl Chooser for Largest {
    fn best(&self, dances: &[&[u32]], _: usize, block: Range<usize>) -> Result<usize> {
        self.0.lock().unwrap().push(block.clone());
        let sum = |ids: &&[u32]| ids.split_inclusive(|id| *id == SPACE).skip(block.start).flatten().sum::<u32>();
        assert!(dances.iter().all(|ids| ids.iter().filter(|id| **id == SPACE).count() == block.end));
        Ok((0..dances.len()).rev().max_by_key(|i| sum(&dances[*i])).unwrap_or(0))
    }
}

/// Takes the first, which leaves a dance as it is.
#[derive(Debug)]
struct First;

impl Chooser for First {
    fn best(&self, _: &[&[u32]], _: usize, _: Range<usize>) -> Result<usize> {
        Ok(0)
    }
}

fn ahead(candidates: usize, chooser: Arc<dyn Chooser>) -> Option<LookAhead> {
    Some(LookAhead { candidates, first: 2, block: 3, before: usize::MAX, chooser })
}

#[test]
fn every_block_is_the_best_and_the_next_goes_on_from_it() {
    let hot = plan(10, &[false; 4], &[], Sampling::temperature(4.0));
    let largest = Arc::new(Largest::default());
    let chosen = SamplingPlan { look_ahead: ahead(6, largest.clone()), ..hot.clone() };
    let found = sample(&mut model(24, 12), &chosen, &mut unwatched).unwrap();
    let (two, third, last) = ([0..2, 0..2], [2..5, 2..5], [8..10, 8..10]);
    let asked = largest.0.lock().unwrap().clone();
    assert_eq!(asked, [two, third, [5..8, 5..8], last].concat());
    assert_eq!(found.ids.iter().map(Vec::len).collect::<Vec<_>>(), [50, 50]);
    let plain = sample(&mut model(24, 2), &hot, &mut unwatched).unwrap();
    let sum = |ids: &Vec<u32>| ids.iter().sum::<u32>();
    assert!(found.ids.iter().zip(&plain.ids).all(|(best, plain)| sum(best) > sum(plain)));
    // a candidate of the first block, sampled for itself, begins the dance
    let seed = hot.seed_of(0);
    let first = |candidate: usize| {
        let plan = SamplingPlan { seed: block_seed(seed, 0, candidate), words: 2, ..hot.clone() };
        run(24, &plan).unwrap().0
    };
    let best = (0..6).map(first).max_by_key(sum).unwrap();
    assert_eq!(found.ids[0][..10], best);
}

#[test]
fn where_the_first_candidate_is_always_chosen_nothing_changes() {
    let hot = plan(10, &[false, true, false], &[6, 7, 8, 5, 9, 10, 11, 5], Sampling::temperature(3.0));
    let varied = varying(9, &[6, 7, 5, 8, 9, 10, 5], Sampling::temperature(3.0));
    let begun =
        SamplingPlan { first_frames: 9, ..plan(9, &[false, true, true], &[6, 7, 8, 5], Sampling::temperature(3.0)) };
    for plan in [hot, varied, begun] {
        let plain = sample(&mut model(20, 2), &plan, &mut unwatched).unwrap();
        let ahead = SamplingPlan { look_ahead: ahead(3, Arc::new(First)), ..plan };
        assert_eq!(sample(&mut model(20, 6), &ahead, &mut unwatched).unwrap().ids, plain.ids);
    }
}

#[test]
fn candidates_of_a_dance_in_several_models_are_those_of_one() {
    let tokenizer = tokenizer();
    let gpt = two_level(&tokenizer, ModelConfig { window: Some(6), ..ModelConfig::default() });
    let flat = fixtures::model(
        &ModelConfig { layers: 1, heads: 1, width: 8, context: 40, ..Default::default() },
        &TokenLayout::of(&tokenizer),
    );
    let grammar = tokenizer.grammar();
    let free = SamplingPlan::free(grammar, 20, Sampling::temperature(1.5), 7);
    for gpt in [gpt, flat] {
        let of = |splits: &[usize], look_ahead: Option<LookAhead>| {
            let reader =
                |streams: &usize| Reader::new(&gpt, ReaderOptions { streams: *streams, ..Default::default() }).unwrap();
            let mut readers: Vec<Box<dyn NextToken>> = splits.iter().map(|n| Box::new(reader(n)) as _).collect();
            sample_side_by_side(&mut readers, &SamplingPlan { look_ahead, ..free.clone() }, &mut unwatched).unwrap().ids
        };
        let largest = || ahead(4, Arc::new(Largest::default()));
        let one = of(&[8], largest());
        assert_eq!(of(&[3, 5], largest()), one);
        assert_eq!(of(&[1, 1, 6], largest()), one);
        // what was copied is what would have been read: the dance under its own seeds, read from the beginning
        assert_ne!(one, of(&[2], None));
        assert_eq!(of(&[6], ahead(3, Arc::new(First))), of(&[2], None));
    }
}

#[test]
fn a_saved_sequence_goes_on_as_the_one_it_was_saved_of() {
    let tokenizer = tokenizer();
    let gpt = two_level(&tokenizer, ModelConfig { window: Some(6), ..ModelConfig::default() });
    let mut reader = Reader::new(&gpt, ReaderOptions { streams: 3, ..Default::default() }).unwrap();
    let words = SamplingPlan::free(tokenizer.grammar(), 4, Sampling::temperature(2.0), 3);
    let mut own = Reader::new(&gpt, ReaderOptions::default()).unwrap();
    let ids = [vec![Special::Bos.id()], sample_one(&mut own, &words, &mut unwatched).unwrap()].concat();
    for cut in 1..ids.len() {
        (0..3).for_each(|stream| reader.truncate(stream, 0));
        reader.read(&[&ids[..cut], &[1], &[]], Logits::Last).unwrap();
        let saved = reader.save(0);
        reader.restore(2, &saved);
        let rest = &ids[cut..];
        let both = reader.read(&[rest, &[], rest], Logits::All).unwrap();
        let (one, other) = both.split_at(both.len() / 2);
        assert!(one == other, "after {cut} tokens");
    }
}

#[test]
fn sequences_must_be_whole_dances() {
    let plan = SamplingPlan { look_ahead: ahead(4, Arc::new(First)), ..plan(3, &[false; 3], &[], Sampling::default()) };
    let error = sample(&mut model(20, 6), &plan, &mut unwatched).unwrap_err().to_string();
    assert!(error.contains('6') && error.contains("4 candidates"), "{error}");
}

#[test]
fn neither_guesses_nor_the_other_candidates_change_a_dance() {
    let hot = Sampling::temperature(1.5);
    let free = plan(12, &[false; 5], &[], hot);
    for plan in [free, varying(15, &[6, 7, 5, 8, 5], hot)] {
        let of = |splits: &[usize], guesses: usize| {
            let look_ahead = ahead(4, Arc::new(Largest::default()));
            let plan = SamplingPlan { look_ahead, guesses, ..plan.clone() };
            let mut models: Vec<Box<dyn NextToken>> = splits.iter().map(|n| Box::new(model(30, *n)) as _).collect();
            sample_side_by_side(&mut models, &plan, &mut unwatched).unwrap().ids
        };
        let one = of(&[8], 0);
        for (splits, guesses) in [(&[8][..], 6), (&[3, 5], 0), (&[3, 5], 6), (&[1, 1, 6], 2)] {
            assert_eq!(of(splits, guesses), one, "{splits:?}, {guesses} guesses");
        }
        // the first dance is the same without the second
        assert_eq!(of(&[4], 6), one[..1]);
    }
}
