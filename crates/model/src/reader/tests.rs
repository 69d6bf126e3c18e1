//! Reading against the plain form.

use super::*;
use crate::{Positions, fixtures, layout};
use candle_core::{Device, Tensor};
use kinelm_engine::decode as engine;
use rand_chacha::rand_core::RngCore;

const TOKENS: TokenLayout =
    TokenLayout { vocabulary: 51, word: 7, varying: false, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new() };

/// A model whose numbers are large enough to matter.
fn model(positions: Positions, tied_head: bool) -> Gpt {
    model_of(&TOKENS, positions, tied_head)
}

fn model_of(tokens: &TokenLayout, positions: Positions, tied_head: bool) -> Gpt {
    let config =
        ModelConfig { layers: 3, heads: 4, width: 48, context: 70, positions, tied_head, ..Default::default() };
    let mut tensors = layout::initial(&config, tokens, 5).unwrap();
    tensors.values_mut().for_each(|t| *t = (&*t * 3.0).unwrap());
    Gpt::from_tensors(&config, tokens, tensors).unwrap()
}

fn ids(n: usize, seed: u64) -> Vec<u32> {
    let mut rng = kinelm_store::random::stream(seed, "ids", 0, 0);
    (0..n).map(|_| rng.next_u32() % 51).collect()
}

/// The largest difference by the largest logit.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let largest = |x: &mut dyn Iterator<Item = f32>| x.fold(0.0, |m: f32, x| m.max(x.abs()));
    // minus infinity is minus infinity
    let apart = largest(&mut a.iter().zip(b).map(|(a, b)| if a == b { 0.0 } else { a - b }));
    apart / largest(&mut b.iter().copied().filter(|x| x.is_finite())).max(f32::MIN_POSITIVE)
}

/// Windows of the plain form's logits for each of `sequences`.
fn truth(gpt: &Gpt, sequences: &[Vec<u32>]) -> Vec<Vec<f32>> {
    let logits = |ids: &Vec<u32>| {
        let input = Tensor::new(ids.as_slice(), &Device::Cpu).unwrap().unsqueeze(0).unwrap();
        let mut logits = gpt.predict(&input).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        if !gpt.config().architecture.is_flat() {
            // what follows a token of the front isn't known to a decoder of frames
            logits[..(gpt.tokens().front - 1) * gpt.tokens().vocabulary].fill(0.0);
        }
        logits
    };
    sequences.iter().map(logits).collect()
}

/// Reads `sequences` side by side in all ways, now and then more than that, which is taken back.
fn check(gpt: &Gpt, sequences: &[Vec<u32>], name: &str) {
    let (vocabulary, length) = (gpt.tokens().vocabulary, sequences[0].len());
    let truth = truth(gpt, sequences);
    let streams = sequences.len();
    let mut reader = Reader::new(gpt, ReaderOptions { streams, ..ReaderOptions::default() }).unwrap();
    let mut first: Vec<Vec<f32>> = Vec::new();
    for cuts in [vec![length], vec![1; length], vec![length / 2, 1, length / 3, length - length / 2 - length / 3 - 1]] {
        (0..streams).for_each(|stream| reader.truncate(stream, 0));
        let mut read = 0;
        for n in cuts {
            // another sequence's tokens go in and are forgotten
            let wrong: Vec<&[u32]> = (0..streams).map(|i| &sequences[(i + 1) % streams][read..read + n]).collect();
            reader.read(&wrong, Logits::Last).unwrap();
            (0..streams).for_each(|stream| reader.truncate(stream, read));
            let blocks: Vec<&[u32]> = sequences.iter().map(|ids| &ids[read..read + n]).collect();
            let found = reader.read(&blocks, Logits::All).unwrap();
            for (i, (found, truth)) in found.chunks(n * vocabulary).zip(&truth).enumerate() {
                let rows = read * vocabulary..(read + n) * vocabulary;
                let apart = apart(found, &truth[rows.clone()]);
                assert!(apart < 1e-5, "{name}: block of {n} behind {read}: {apart:e}");
                match first.get(i) {
                    Some(first) => assert!(found == &first[rows], "{name}: block of {n} behind {read} has other bits"),
                    None => first.push(found.to_vec()),
                }
            }
            read += n;
        }
    }
}

#[test]
fn reading_gives_the_logits_of_the_plain_form_to_1e_5() {
    let varying = TokenLayout { varying: true, ..TOKENS };
    for (tokens, positions, tied) in [
        (&TOKENS, Positions::FrameJoint, true),
        (&varying, Positions::FrameJoint, true),
        (&varying, Positions::Rope, true),
        (&TOKENS, Positions::Absolute, false),
    ] {
        let mut sequences = [ids(70, 1), ids(70, 2), ids(70, 3)];
        // words of 9 and of 4
        sequences[0].iter_mut().step_by(9).for_each(|id| *id = 5);
        sequences[1].iter_mut().step_by(4).for_each(|id| *id = 5);
        check(&model_of(tokens, positions, tied), &sequences, &format!("{positions:?}"));
    }
}

#[test]
fn reading_gives_the_logits_of_the_plain_form_in_every_form() {
    const LENGTH: usize = 40;
    let mut count = 0;
    for (config, tokens) in fixtures::every(LENGTH).into_iter().filter(|(config, _)| config.kind == ModelKind::Causal) {
        let length = config.context;
        // with a place of <mask>, and one that ends early
        let (inputs, _) = fixtures::batch(&config, &tokens, 3, length);
        let sequences: Vec<Vec<u32>> = inputs.chunks(length).map(<[u32]>::to_vec).collect();
        check(&fixtures::model(&config, &tokens), &sequences, &fixtures::name(&config, &tokens));
        count += 1;
    }
    assert!(count >= 15, "{count} forms");
}

#[test]
fn what_frames_are_told_makes_the_logits_of_the_plain_form() {
    for (config, tokens) in fixtures::every(40).into_iter().filter(|(config, _)| config.is_conditioned()) {
        let (gpt, length) = (fixtures::model(&config, &tokens), config.context);
        let (inputs, _) = fixtures::batch(&config, &tokens, 2, length);
        let conditioning = fixtures::conditioning(&config, &tokens, 2).unwrap();
        let truth = gpt.forward_conditioned(&fixtures::ids(&inputs, length), &conditioning).unwrap();
        let mut truth = truth.to_vec3::<f32>().unwrap();
        truth.iter_mut().for_each(|rows| rows[..tokens.front - 1].iter_mut().for_each(|row| row.fill(0.0)));
        let mut reader = Reader::new(&gpt, ReaderOptions { streams: 2, ..ReaderOptions::default() }).unwrap();
        let frames = config.frames(&tokens);
        let of_frame = |all: &[f32], at: usize| {
            let n = all.len() / (2 * frames);
            all[at * n..][..n].to_vec()
        };
        for at in 0..2 * frames {
            let rows = conditioning.rows.each_ref().map(|rows| rows.get(at * tokens.word..(at + 1) * tokens.word));
            let (numbers, music) = (of_frame(&conditioning.numbers, at), of_frame(&conditioning.music, at));
            let ahead = Option::zip(rows[0], rows[1])
                .map(|(a, b)| engine::FrameConditioning { numbers: &numbers, rows: [a, b] });
            reader.condition(at / frames, at % frames, ahead, &music).unwrap();
        }
        let blocks: Vec<&[u32]> = inputs.chunks(length).collect();
        let apart = apart(reader.read(&blocks, Logits::All).unwrap(), &truth.concat().concat());
        assert!(apart < 1e-5, "{}: {apart:e}", fixtures::name(&config, &tokens));
    }
}

#[test]
fn a_masked_model_is_not_read() {
    let (config, tokens) = fixtures::all(40).into_iter().find(|(config, _)| config.kind == ModelKind::Masked).unwrap();
    let message = Reader::new(&fixtures::model(&config, &tokens), ReaderOptions::default()).err().unwrap().to_string();
    assert_eq!(message, "a masked model sees the whole window at once: it can't be read token after token");
}

#[test]
fn what_cannot_be_read_is_refused() {
    let mut reader = Reader::new(&model(Positions::Absolute, true), ReaderOptions::default()).unwrap();
    let mut said = |blocks: &[&[u32]]| reader.read(blocks, Logits::Last).unwrap_err().to_string();
    assert_eq!(said(&[&[1, 51]]), "token 51 is outside the vocabulary of 51 ids");
    assert_eq!(said(&[&[1; 71]]), "71 more tokens behind 0 read; expected at most 70");
    assert_eq!(said(&[]), "0 blocks of tokens for 1 sequences");
    reader.read(&[&[1; 69]], Logits::Last).unwrap();
    let message = reader.read(&[&[1; 2]], Logits::Last).unwrap_err().to_string();
    assert_eq!(message, "2 more tokens behind 69 read; expected at most 1");
}

#[test]
fn scores_are_those_of_the_plain_form() {
    let mut gpt = model(Positions::FrameJoint, true);
    let mut reader = Reader::new(&gpt, ReaderOptions { streams: 2, ..ReaderOptions::default() }).unwrap();
    let (inputs, mut targets) = (ids(60, 1), ids(60, 2));
    targets[25..].fill(0);
    let (mut found, mut expected) = (vec![9.0; 60], vec![9.0; 60]);
    reader.nats(&inputs, &targets, 30, &mut found).unwrap();
    gpt.nats(&inputs, &targets, 30, &mut expected).unwrap();
    assert!(apart(&found, &expected) < 1e-5);
}

#[test]
fn bytes_and_half_floats_cost_less_than_half_a_percent() {
    let gpt = model(Positions::FrameJoint, true);
    let (inputs, targets) = (ids(70, 1), ids(70, 2));
    let nats = |weights, kv| {
        let mut out = vec![0.0; 70];
        Reader::new(&gpt, ReaderOptions { streams: 1, weights, kv })
            .unwrap()
            .nats(&inputs, &targets, 70, &mut out)
            .unwrap();
        out.iter().sum::<f32>()
    };
    let plain = nats(WeightKind::F32, KvKind::F32);
    for (weights, kv) in [(WeightKind::Int8, KvKind::F32), (WeightKind::F32, KvKind::F16)] {
        let other = nats(weights, kv);
        assert!(other != plain && (other / plain - 1.0).abs() < 5e-3, "{weights:?} {kv:?}: {other}, {plain}");
    }
}
