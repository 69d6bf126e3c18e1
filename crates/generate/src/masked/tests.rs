//! Filling by models whose choices are easy to predict, and by small real ones.

use super::*;
use crate::sampler::{Guidance, unwatched};
use crate::sampling::Sampling;
use kinelm_model::fast::Fast;
use kinelm_model::{ModelConfig, ModelKind, Positions, TokenLayout, fixtures};
use kinelm_tokenizer::{Grammar, SPACE, Vocabulary, WordLength};
use std::ops::ControlFlow;

const MASK: u32 = 3;

/// Prefers in every slot the character of the slot before it, plus one, modulo ten characters, where that is known, by
/// as much as it is sure; records what it has read.
struct Following {
    context: usize,
    read: Vec<Vec<u32>>,
}

impl Following {
    fn new(context: usize) -> Following {
        Following { context, read: Vec::new() }
    }
}

impl MaskedModel for Following {
    fn context(&self) -> usize {
        self.context
    }

    fn logits(&mut self, window: &[u32]) -> Result<Vec<f32>> {
        assert!(window.len() <= self.context && [1, 2].contains(&window[0]), "{window:?}");
        self.read.push(window.to_vec());
        let before = |at: usize| window[..at].iter().rposition(|&id| id != SPACE);
        let row = |at: usize| {
            let mut row = vec![0.0; 16];
            row[0] = 99.0; // never allowed
            if let Some(id) = before(at).map(|at| window[at]).filter(|id| (6..16).contains(id)) {
                row[6 + (id as usize - 5) % 10] = if window[0] == 1 { 30.0 } else { 0.0 };
            }
            row
        };
        Ok((0..window.len()).flat_map(row).collect())
    }
}

fn plan(words: usize, given: &[bool], prompt: &[u32], passes: usize) -> SamplingPlan {
    let grammar = Grammar::new(&Vocabulary::new(10), WordLength::Fixed(3));
    let (given, prompt) = (given.to_vec(), prompt.to_vec());
    SamplingPlan { given, prompt, passes, ..SamplingPlan::free(grammar, words, Sampling::default(), 7) }
}

fn run(model: &mut dyn MaskedModel, plan: &SamplingPlan) -> Result<Vec<u32>> {
    Ok(fill(model, plan, 1, &mut unwatched)?.ids.remove(0))
}

#[test]
fn the_most_certain_characters_stay_and_given_ones_come_out() {
    let (f, t) = (false, true);
    let prompt = [6, 7, 8, 5, 9, 10, 11, 5, 12, 13, 14, 5];
    let given = [t, t, t, f, f, f, t, t, t];
    // only the first free character has a known one before it, then the second: in three passes one after the other
    let mut model = Following::new(30);
    assert_eq!(run(&mut model, &plan(3, &given, &prompt, 3)).unwrap(), [6, 7, 8, 5, 9, 10, 11, 5, 12, 13, 14, 5]);
    let masked: Vec<Vec<u32>> = model.read.iter().map(|window| window[5..8].to_vec()).collect();
    assert_eq!(masked, [[MASK; 3], [9, MASK, MASK], [9, 10, MASK]]);
    // in one pass all but the first are sampled blindly
    let mut others = 0;
    for seed in 0..20 {
        let mut model = Following::new(30);
        let found = run(&mut model, &SamplingPlan { seed, ..plan(3, &given, &prompt, 1) }).unwrap();
        assert!(model.read.len() == 1 && found[..5] == [6, 7, 8, 5, 9] && found[7..] == [5, 12, 13, 14, 5]);
        assert!(found[5..7].iter().all(|id| (6..16).contains(id)));
        others += usize::from(found[5..7] != [10, 11]);
    }
    assert!(others > 15, "{others} of 20");
    // no more passes than there are free characters
    let mut model = Following::new(30);
    run(&mut model, &plan(3, &given, &prompt, 200)).unwrap();
    assert_eq!(model.read.len(), 3);
}

#[test]
fn a_dance_longer_than_a_window_is_filled_by_windows_of_whole_words() {
    let (f, t) = (false, true);
    let prompt: Vec<u32> = (0..40).flat_map(|word| [6 + word % 10, 7, 8, SPACE]).collect();
    // the first slot is given while the prompt lasts, and all of its first and last words
    let given: Vec<bool> =
        (0..40).flat_map(|word| if [0, 39].contains(&word) { [t, t, t] } else { [t, f, f] }).collect();
    for context in [9, 14, 33, 300] {
        let mut model = Following::new(context);
        let mut seen = Vec::new();
        // one character in every pass, so that each follows what it must
        let plan = plan(50, &given, &prompt, MOST_PASSES);
        let found = fill(&mut model, &plan, 1, &mut |words, last| {
            seen.push((words, last.to_vec()));
            ControlFlow::Continue(())
        });
        let ids = found.unwrap().ids.remove(0);
        assert_eq!(ids.len(), 200);
        for (word, ids) in ids.chunks(4).enumerate() {
            assert!(ids[..3].iter().all(|id| (6..16).contains(id)) && ids[3] == SPACE, "{ids:?}");
            for slot in 0..3 {
                if word < 40 && given[word * 3 + slot] {
                    assert_eq!(ids[slot], prompt[word * 4 + slot]);
                } else if word < 40 {
                    assert_eq!(ids[slot], 6 + (ids[slot - 1] - 5) % 10, "word {word} follows what is given in it");
                }
            }
            assert_eq!(seen[word], (word + 1, vec![ids.to_vec()]));
        }
        assert!(model.read.iter().all(|window| window.len() % 4 == 1 && window[0] == 1));
    }
}

#[test]
fn several_dances_are_those_of_one_each() {
    let beginnings: Vec<Vec<u32>> = (6..9).map(|id| vec![id, id, id, SPACE]).collect();
    let plan = SamplingPlan { beginnings, lead_in: 1, inputs_hash: 5, ..plan(20, &[], &[], 2) };
    let found = fill(&mut Following::new(30), &plan, 3, &mut unwatched).unwrap();
    assert_eq!((found.ids.len(), found.lookahead.len()), (3, 3));
    for (dance, ids) in found.ids.iter().enumerate() {
        let seed = crate::sampler::variation_seed(plan.seed, dance);
        let beginnings = vec![plan.beginnings[dance].clone()];
        let alone = SamplingPlan { seed, beginnings, ..plan.clone() };
        assert_eq!(&run(&mut Following::new(30), &alone).unwrap(), ids);
        assert_eq!(ids[..4], plan.beginnings[dance]);
    }
    assert!(found.ids[0] != found.ids[1] && found.ids[1] != found.ids[2]);
    let stopped = fill(&mut Following::new(30), &plan, 3, &mut |words, _| match words {
        3 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    });
    assert!(stopped.unwrap_err().to_string().contains("stopped"));
}

#[test]
fn fronts_change_with_the_words_and_guidance_reads_twice() {
    let fronts = vec![(0, vec![1, 4]), (12, vec![1, 9])];
    let changing = SamplingPlan { fronts: fronts.clone(), ..plan(20, &[], &[], 2) };
    let mut model = Following::new(34);
    run(&mut model, &changing).unwrap();
    let with = |front: u32| model.read.iter().filter(|window| window[1] == front).count();
    // 8 words a window: 0 to 5, 6 to 9, 10 and 11 under the first, 12 to 15, 16 to 19 under the second
    assert_eq!((with(4), with(9)), (6, 4));
    // an unconditioned reading that knows nothing raises what is preferred
    let guidance = Guidance { scale: 2.0, unconditioned: vec![2] };
    let guided = SamplingPlan { guidance: Some(guidance), ..plan(4, &[], &[], 1) };
    let mut model = Following::new(40);
    run(&mut model, &guided).unwrap();
    assert_eq!(model.read.iter().map(|window| window[0]).collect::<Vec<_>>(), [1, 2]);
}

#[test]
fn what_a_masked_model_cannot_fill_is_refused() {
    let varying = Grammar::new(&Vocabulary::new(10), WordLength::Varying { most: 7 });
    let varying = SamplingPlan::free(varying, 9, Sampling::default(), 7);
    let said = |context, plan: &SamplingPlan| run(&mut Following::new(context), plan).unwrap_err().to_string();
    assert!(said(40, &varying).contains("the words of this tokenizer differ in length"));
    assert!(said(8, &plan(9, &[], &[], 1)).contains("the window holds 1 words of 4; expected at least 2"));
    let grammar = Grammar::new(&Vocabulary::new(11), WordLength::Fixed(3));
    let other = SamplingPlan { grammar, ..plan(9, &[], &[], 1) };
    assert!(said(40, &other).contains("the model's vocabulary is 16; expected 17 tokens"));
}

#[test]
fn both_forms_fill_alike_on_any_number_of_threads() {
    let walk = kinelm_corpus::samples::walk(30);
    let config = kinelm_tokenizer::TokenizerConfig::uniform(&[0, 18], 20.0, 10);
    let tokenizer = kinelm_tokenizer::Tokenizer::fit([&walk], config).unwrap();
    let tokens = TokenLayout::of(&tokenizer);
    let prompt = tokenizer.ids_of_words(&tokenizer.encode(&walk).unwrap().words).unwrap();
    let characters = tokens.word - 1;
    let given: Vec<bool> = (0..30 * characters).map(|at| !(8..25).contains(&(at / characters))).collect();
    for positions in [Positions::FrameJoint, Positions::Rope] {
        let kind = ModelKind::Masked;
        let context = 8 * tokens.word + 1;
        let config = ModelConfig { kind, layers: 2, heads: 2, width: 16, context, positions, ..Default::default() };
        let mut gpt = fixtures::model(&config.resolved(&tokens), &tokens);
        let plan = SamplingPlan {
            given: given.clone(),
            prompt: prompt.clone(),
            passes: 3,
            ..SamplingPlan::free(tokenizer.grammar(), 30, Sampling::default(), 3)
        };
        let filled = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(&mut Fast::of(&gpt).unwrap(), &plan).unwrap())
        };
        let one = filled(1);
        assert_eq!(filled(2), one);
        assert_eq!(run(&mut gpt, &plan).unwrap(), one, "{positions:?}");
        for (at, &id) in one.iter().enumerate() {
            let (word, slot) = (at / tokens.word, at % tokens.word);
            assert!(tokenizer.grammar().allows(super::slot(slot), id));
            assert!((8..25).contains(&word) || id == prompt[at]);
        }
        assert_ne!(one, prompt);
    }
}
