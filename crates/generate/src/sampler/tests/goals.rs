//! Sampling with goals.

use super::*;
use crate::sampler::guidance::MIN_P;
use kinelm_corpus::samples;
use kinelm_model::DeviceName;
use kinelm_model::fast::{Fast, Windows};
use kinelm_model::goal::{GoalEncoder, GoalTrack, numbers};
use kinelm_model::weights::Array;
use kinelm_tokenizer::{RootRotation, TokenizerConfig};

const FRAMES: usize = 16;
const C: usize = 9;

/// A tokenizer, a model of its words whose windows hold `window` frames, and the ids of a clip.
fn setup(window: usize) -> (Tokenizer, Gpt, Vec<u32>) {
    let walk = samples::walk(FRAMES);
    let config = TokenizerConfig::uniform(&[0, 4], 20.0, 20);
    let config = TokenizerConfig { root_rotation: RootRotation::HeadingDelta, ..config };
    let tokenizer = Tokenizer::fit([&walk], config).unwrap();
    let gpt = two_level(&tokenizer, ModelConfig { window: Some(window), goal: true, ..Default::default() });
    let ids = tokenizer.ids_of_words(&tokenizer.encode(&walk).unwrap().words).unwrap();
    (tokenizer, gpt, ids)
}

fn track(tokenizer: &Tokenizer, ids: &[u32], given: &[bool], lead_in: usize) -> Arc<GoalTrack> {
    let encoder = GoalEncoder::of(tokenizer).unwrap();
    let codes = [vec![0; lead_in * C], encoder.codes(ids)].concat();
    Arc::new(GoalTrack::new(encoder, codes, [&vec![false; lead_in * C], given].concat(), lead_in))
}

/// The knee free in frames 4 to 8 and 12.
fn knee_free() -> Vec<bool> {
    let is_free = |frame: usize, place: usize| place >= 6 && (4..9).contains(&frame) || (frame, place) == (12, 7);
    (0..FRAMES).flat_map(|frame| (0..C).map(move |place| !is_free(frame, place))).collect()
}

#[test]
fn a_frame_has_the_goals_of_a_whole_window() {
    let (tokenizer, gpt, prompt) = setup(FRAMES);
    let given = knee_free();
    let track = track(&tokenizer, &prompt, &given, 0);
    for guesses in [0, 4] {
        let free = SamplingPlan::free(tokenizer.grammar(), FRAMES, Sampling::greedy(), 1);
        let plan =
            SamplingPlan { given: given.clone(), prompt: prompt.clone(), goals: Some(track.clone()), guesses, ..free };
        assert_eq!(plan.streams(), 1);
        let ids = sampled(&gpt, &plan);
        assert_ne!(ids, sampled(&gpt, &SamplingPlan { goal_guidance: 0.0, ..plan.clone() }));
        // the most likely characters by the plain logits of the whole dance, conditioned on the goals of its own characters
        let own = super::goals::track(&tokenizer, &ids, &given, 0);
        let inputs = [&[1], &ids[..ids.len() - 1]].concat();
        let mut fast = Fast::of(&gpt).unwrap();
        let conditioning = own.conditioning(FRAMES);
        assert!(
            conditioning
                .numbers
                .chunks(numbers(C))
                .enumerate()
                .all(|(frame, x)| { x.iter().any(|x| *x != 0.0) == ((4..9).contains(&frame) || frame == 12) })
        );
        let mask = fast.mask();
        let windows = Windows {
            inputs: &inputs,
            targets: &ids,
            length: ids.len(),
            mask,
            history: &[],
            conditioning: Some(&conditioning),
        };
        let logits = fast.logits(windows).unwrap();
        for (at, row) in logits.chunks(tokenizer.vocabulary().len() as usize).enumerate() {
            let (frame, place) = (at / (C + 1), at % (C + 1));
            if place < C && !given[frame * C + place] {
                let best = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                assert!(row[ids[at] as usize] >= best - 1e-4, "frame {frame}, place {place}");
            }
        }
    }
}

#[test]
fn goals_with_weights_of_zero_change_nothing_and_others_more_with_the_scale() {
    // windows that move, a lead-in, a look-ahead frame
    let (tokenizer, gpt, prompt) = setup(5);
    let is_free = |frame: usize| frame < 3 || (7..12).contains(&frame);
    let given: Vec<bool> = (0..FRAMES).flat_map(|frame| [!is_free(frame); C]).collect();
    let lookahead: Vec<bool> = (0..FRAMES).flat_map(|frame| [frame == 12; C]).collect();
    let track = track(&tokenizer, &prompt, &given, 2);
    let free = SamplingPlan::free(tokenizer.grammar(), FRAMES + 2, Sampling::temperature(0.5), 4);
    let plan = SamplingPlan { given, lookahead, prompt: prompt.clone(), lead_in: 2, ..free };
    let with = |goal_guidance: f64| SamplingPlan { goals: Some(track.clone()), goal_guidance, ..plan.clone() };
    assert_eq!([0.0, 1.0, 2.0].map(|scale| with(scale).streams()), [1, 1, 2]);
    let dances = [0.0, 1.0, 2.0].map(|scale| sampled(&gpt, &with(scale)));
    assert_eq!(dances[0], sampled(&gpt, &plan));
    assert!(dances[0] != dances[1] && dances[1] != dances[2]);
    for dance in &dances {
        let (lead_in, is_given) = (2 * (C + 1), |frame: &usize| !is_free(*frame));
        for frame in (0..FRAMES).filter(is_given) {
            let of = |ids: &[u32], at: usize| ids[at..at + C + 1].to_vec();
            assert_eq!(of(dance, lead_in + frame * (C + 1)), of(&prompt, frame * (C + 1)), "frame {frame}");
        }
    }
    let mut weights = gpt.weights().unwrap();
    for name in kinelm_model::layout::GOAL {
        let array = weights.get_mut(name).unwrap();
        *array = Array::full(array.shape(), 0.0);
    }
    let zeros = Gpt::from_weights(gpt.config(), gpt.tokens(), &weights, DeviceName::Cpu).unwrap();
    for scale in [0.0, 1.0] {
        assert_eq!(sampled(&zeros, &with(scale)), dances[0], "{scale}");
    }
    // two readings that agree leave what both find likely; a temperature of 0.5 squares probabilities
    let likely = Sampling { min_p: Some(MIN_P * MIN_P), ..plan.sampling };
    assert_eq!(sampled(&zeros, &with(2.0)), sampled(&gpt, &SamplingPlan { sampling: likely, ..plan }));
}

#[test]
fn goals_of_other_words_are_refused() {
    let (tokenizer, gpt, prompt) = setup(5);
    let track = track(&tokenizer, &prompt, &[true; FRAMES * C], 0);
    let mut reader = Reader::new(&gpt, ReaderOptions::default()).unwrap();
    let plan = SamplingPlan { goals: Some(track), ..plan(5, &[true], &[6, 5], Sampling::greedy()) };
    let message = sample_one(&mut reader, &plan, &mut unwatched).unwrap_err().to_string();
    assert!(message.contains("the goals' length is 9 characters per frame"), "{message}");
}
