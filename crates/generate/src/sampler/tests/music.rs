//! Sampling to music.

use super::*;
use kinelm_corpus::music::clip_music::ClipMusic;
use kinelm_corpus::samples;
use kinelm_model::fast::{Fast, Windows};
use kinelm_model::goal;
use kinelm_model::music::Music;
use kinelm_tokenizer::TokenizerConfig;

const FRAMES: usize = 12;

/// A tokenizer and a model of its words whose windows hold `window` frames, conditioned on beats.
fn setup(window: usize) -> (Tokenizer, Gpt) {
    let tokenizer = Tokenizer::fit([&samples::walk(9)], TokenizerConfig::uniform(&[0, 4], 20.0, 20)).unwrap();
    let gpt = two_level(&tokenizer, ModelConfig { window: Some(window), music: Music::Beats, ..Default::default() });
    (tokenizer, gpt)
}

fn beats(words: usize) -> Vec<f32> {
    let config = ModelConfig { music: Music::Beats, ..ModelConfig::default() };
    let sound = ClipMusic { beats_s: &[0.05, 0.3, 0.5], ..ClipMusic::default() };
    config.music_conditioning(&sound, (0..words).map(|word| word as f64 / 20.0), 1.0)
}

#[test]
fn a_frame_has_the_music_of_a_whole_window() {
    let (tokenizer, gpt) = setup(FRAMES);
    let music = beats(FRAMES);
    for guesses in [0, 4] {
        let plan = SamplingPlan {
            music: music.clone(),
            guesses,
            ..SamplingPlan::free(tokenizer.grammar(), FRAMES, Sampling::greedy(), 1)
        };
        let ids = sampled(&gpt, &plan);
        assert_ne!(ids, sampled(&gpt, &SamplingPlan { music: Vec::new(), ..plan.clone() }));
        let inputs = [&[1], &ids[..ids.len() - 1]].concat();
        let mut fast = Fast::of(&gpt).unwrap();
        let conditioning = goal::Conditioning { music: music.clone(), ..Default::default() };
        let windows = Windows {
            inputs: &inputs,
            targets: &ids,
            length: ids.len(),
            mask: fast.mask(),
            history: &[],
            conditioning: Some(&conditioning),
        };
        let logits = fast.logits(windows).unwrap();
        for (at, row) in logits.chunks(tokenizer.vocabulary().len() as usize).enumerate() {
            // spaces are the grammar's
            if ids[at] != kinelm_tokenizer::SPACE {
                let best = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                assert!(row[ids[at] as usize] >= best - 1e-4, "token {at}");
            }
        }
    }
}

#[test]
fn windows_that_move_stay_in_the_music_s_time_and_guidance_scales_it() {
    let (tokenizer, gpt) = setup(4);
    let music = beats(FRAMES);
    let free = SamplingPlan::free(tokenizer.grammar(), FRAMES, Sampling::temperature(0.5), 4);
    let with_music = SamplingPlan { music: music.clone(), ..free.clone() };
    // what comes later in the music changes nothing before it
    let mut later = music.clone();
    let (m, word) = (music.len() / FRAMES, tokenizer.tokens_per_word().unwrap());
    later[9 * m..].fill(0.0);
    let (a, b) = (sampled(&gpt, &with_music), sampled(&gpt, &SamplingPlan { music: later, ..free.clone() }));
    assert!(a[..9 * word] == b[..9 * word] && a != b);
    let guided = |scale: f64| {
        let guidance = Some(Guidance { scale, unconditioned: vec![Special::Bos.id()] });
        sampled(&gpt, &SamplingPlan { guidance, ..with_music.clone() })
    };
    assert!(guided(1.0) == a && guided(3.0) != a);
    assert_eq!(guided(0.0), sampled(&gpt, &free));
}

#[test]
fn music_of_other_words_and_numbers_is_refused() {
    let (tokenizer, gpt) = setup(4);
    let free = SamplingPlan::free(tokenizer.grammar(), 5, Sampling::greedy(), 4);
    let said = |music: Vec<f32>| {
        let mut reader = Reader::new(&gpt, ReaderOptions::default()).unwrap();
        sample_one(&mut reader, &SamplingPlan { music, ..free.clone() }, &mut unwatched).unwrap_err().to_string()
    };
    assert!(said(vec![0.0; 7]).contains("music is 7 numbers; expected as many for each of 5 words"));
    assert!(said(vec![0.0; 10]).contains("the music of a frame is 2 numbers; expected"));
}

#[test]
fn dances_to_music_take_steps_that_the_bound_of_guidance_leaves_out() {
    let (tokenizer, _) = setup(4);
    let plan = SamplingPlan::free(tokenizer.grammar(), 1, Sampling::greedy(), 1);
    let slot = kinelm_tokenizer::Slot::default();
    let likeliest = plan.grammar.allowed(slot)[0].start;
    let mut conditioned = vec![-9.0; plan.grammar.vocabulary() as usize];
    let (mut guided, rare) = (conditioned.clone(), likeliest + 1);
    (conditioned[likeliest as usize], conditioned[rare as usize]) = (0.0, -3.0);
    (guided[likeliest as usize], guided[rare as usize]) = (0.0, 1.0);
    let drawn = |music: &[f32]| {
        let plan = SamplingPlan { music: music.to_vec(), ..plan.clone() };
        plan.draw(1, (0, slot), &guided, Some((2.0, &conditioned)), &[]).unwrap()
    };
    assert_eq!((drawn(&[]), drawn(&[0.0])), (likeliest, rare));
}
