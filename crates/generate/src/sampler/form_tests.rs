//! The fast form samples the dances of the plain one.

use super::{NextToken, SamplingPlan, sample, unwatched};
use crate::sampling::Sampling;
use kinelm_model::{HeadKind, ModelConfig, Positions, Reader, ReaderOptions, TokenLayout, fixtures};
use kinelm_tokenizer::{Tokenizer, TokenizerConfig};

#[test]
fn dances_of_the_default_form_are_those_of_the_plain_one_guessed_or_not() {
    let walk = kinelm_corpus::samples::walk(5);
    let tokenizer = Tokenizer::fit([&walk], TokenizerConfig::uniform(&[0], 20.0, 10)).unwrap();
    let tokens = TokenLayout::of(&tokenizer);
    for positions in [Positions::FrameJoint, Positions::Rope] {
        let (previous_frame, head) = (Some(true), Some(HeadKind::Relative));
        // 40 tokens hold 5 words of 7: the window moves again and again
        let config = ModelConfig {
            layers: 2,
            heads: 2,
            width: 16,
            context: 40,
            positions,
            previous_frame,
            head,
            ..Default::default()
        };
        let gpt = fixtures::model(&config, &tokens);
        let plain = || -> Box<dyn NextToken> { Box::new(vec![gpt.cache().unwrap(), gpt.cache().unwrap()]) };
        let fast = || Reader::new(&gpt, ReaderOptions { streams: 2, ..ReaderOptions::default() }).unwrap();
        for greedy in [true, false] {
            let sampling = Sampling { greedy, ..Sampling::default() };
            let dance = |model: &mut dyn NextToken, guesses| {
                let plan = SamplingPlan { guesses, ..SamplingPlan::free(tokenizer.grammar(), 30, sampling, 3) };
                sample(model, &plan, &mut unwatched).unwrap()
            };
            let alone = dance(&mut fast(), 0);
            let guessed = dance(&mut fast(), 8);
            assert_eq!(guessed.ids, alone.ids, "{positions:?} {sampling:?}");
            assert!(guessed.guessed > 0);
            assert_eq!(dance(&mut *plain(), 0).ids, alone.ids, "{positions:?} {sampling:?}");
            assert!(alone.ids.iter().all(|ids| ids.len() == 30 * tokens.word));
        }
    }
}
