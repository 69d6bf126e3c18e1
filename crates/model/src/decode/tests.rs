//! Reading against the plain form.

use super::two_level::Progress;
use super::*;
use crate::goal::Conditioning;
use crate::weights;
use crate::{
    Architecture, DeviceName, Gpt, ModelConfig, ModelKind, Positions, Scores, TokenLayout, TokenWindows, fixtures,
};
use candle_core::{Device, Tensor};
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
    let mut weights = weights::initial(&config, tokens, 5);
    crate::fixtures::scale(&mut weights, 3.0);
    Gpt::from_weights(&config, tokens, &weights, DeviceName::Cpu).unwrap()
}

fn ids(n: usize, seed: u64) -> Vec<u32> {
    let mut rng = kinelm_store::random::stream(seed, "ids", 0, 0);
    (0..n).map(|_| rng.next_u32() % 51).collect()
}

/// The largest difference by the largest logit.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let largest = |x: &mut dyn Iterator<Item = f32>| x.fold(0.0, |m: f32, x| m.max(x.abs()));
    // equal infinities: their difference would be NaN
    let apart = largest(&mut a.iter().zip(b).map(|(a, b)| if a == b { 0.0 } else { a - b }));
    apart / largest(&mut b.iter().copied().filter(|x| x.is_finite())).max(f32::MIN_POSITIVE)
}

/// Windows of the plain form's logits for each of `sequences`, after its part of their history.
fn truth(gpt: &Gpt, sequences: &[Vec<u32>], history: &[u32]) -> Vec<Vec<f32>> {
    let before = history.len() / sequences.len();
    let logits = |(i, ids): (usize, &Vec<u32>)| {
        let input = Tensor::new(ids.as_slice(), &Device::Cpu).unwrap().unsqueeze(0).unwrap();
        let logits = gpt.forward_beside(&input, None, &history[i * before..][..before], None).unwrap();
        let mut logits = logits.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        if !gpt.config().architecture.is_flat() {
            // a two-level model predicts no label: those rows are zeros
            logits[..(gpt.tokens().front - 1) * gpt.tokens().vocabulary].fill(0.0);
        }
        logits
    };
    sequences.iter().enumerate().map(logits).collect()
}

/// Reads `sequences` side by side in all ways, now and then more than that, which is taken back.
fn check(gpt: &Gpt, sequences: &[Vec<u32>], name: &str) {
    let (vocabulary, length) = (gpt.tokens().vocabulary, sequences[0].len());
    let streams = sequences.len();
    let history = fixtures::history(gpt.config(), gpt.tokens(), streams);
    let truth = truth(gpt, sequences, &history);
    let before = history.len() / streams;
    let mut reader = Reader::new(gpt, ReaderOptions { streams, ..ReaderOptions::default() }).unwrap();
    let mut first: Vec<Vec<f32>> = Vec::new();
    for cuts in [vec![length], vec![1; length], vec![length / 2, 1, length / 3, length - length / 2 - length / 3 - 1]] {
        for stream in 0..streams {
            let ids = &history[stream * before..][..before];
            reader.begin_after(stream, &ids[ids.iter().take_while(|id| **id == 0).count()..]);
        }
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

/// Sets the conditioning of frames of a stream to that of window `window` of two.
fn condition(
    reader: &mut Reader,
    (stream, window): (usize, usize),
    Conditioning { numbers, rows, music }: &Conditioning,
    frames: std::ops::Range<usize>,
) {
    let (tokens, all) = (reader.tokens().clone(), 2 * reader.config().frames(reader.tokens()));
    for frame in frames {
        let at = window * all / 2 + frame;
        let of_frame = |all_numbers: &[f32]| {
            let n = all_numbers.len() / all;
            all_numbers[at * n..][..n].to_vec()
        };
        let rows = rows.each_ref().map(|rows| rows.get(at * tokens.word..(at + 1) * tokens.word));
        let (numbers, music) = (of_frame(numbers), of_frame(music));
        let goal = Option::zip(rows[0], rows[1]).map(|(a, b)| FrameConditioning { numbers: &numbers, rows: [a, b] });
        reader.condition(stream, frame, goal, &music).unwrap();
    }
}

#[test]
fn conditioned_frames_have_the_logits_of_the_plain_form() {
    for (config, tokens) in fixtures::every(40).into_iter().filter(|(config, _)| config.is_conditioned()) {
        let (gpt, length) = (fixtures::model(&config, &tokens), config.context);
        let (inputs, _) = fixtures::batch(&config, &tokens, 2, length);
        let conditioning = fixtures::conditioning(&config, &tokens, 2).unwrap();
        let truth = gpt.forward_beside(&fixtures::ids(&inputs, length), None, &[], Some(&conditioning)).unwrap();
        let mut truth = truth.to_vec3::<f32>().unwrap();
        truth.iter_mut().for_each(|rows| rows[..tokens.front - 1].iter_mut().for_each(|row| row.fill(0.0)));
        let mut reader = Reader::new(&gpt, ReaderOptions { streams: 2, ..ReaderOptions::default() }).unwrap();
        for stream in 0..2 {
            condition(&mut reader, (stream, stream), &conditioning, 0..config.frames(&tokens));
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
    assert_eq!(message, "decoding: a masked model sees the whole window at once, so it can't be read token by token");
}

#[test]
fn what_cannot_be_read_is_refused() {
    let mut reader = Reader::new(&model(Positions::Absolute, true), ReaderOptions::default()).unwrap();
    const LONG: &str =
        "the sequence takes 71 tokens, the limit is 70 tokens; shorten it, or start anew with its last tokens";
    let mut said = |blocks: &[&[u32]]| reader.read(blocks, Logits::Last).unwrap_err().to_string();
    assert_eq!(said(&[&[1, 51]]), "a token is id 51; expected ids below 51");
    assert_eq!(said(&[&[1; 71]]), LONG);
    assert_eq!(said(&[]), "the number of blocks is 0; expected 1, one per sequence");
    reader.read(&[&[1; 69]], Logits::Last).unwrap();
    let message = reader.read(&[&[1; 2]], Logits::Last).unwrap_err().to_string();
    assert_eq!(message, LONG);
}

#[test]
fn scores_are_those_of_the_plain_form() {
    let mut gpt = model(Positions::FrameJoint, true);
    let mut reader = Reader::new(&gpt, ReaderOptions { streams: 2, ..ReaderOptions::default() }).unwrap();
    let (inputs, mut targets) = (ids(60, 1), ids(60, 2));
    targets[25..].fill(0);
    let (mut found, mut expected) = (vec![9.0; 60], vec![9.0; 60]);
    let windows = TokenWindows { inputs: &inputs, targets: &targets, length: 30, history: &[], conditioning: None };
    reader.nats(windows, &mut found).unwrap();
    gpt.nats(windows, &mut expected).unwrap();
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
            .nats(
                TokenWindows { inputs: &inputs, targets: &targets, length: 70, history: &[], conditioning: None },
                &mut out,
            )
            .unwrap();
        out.iter().sum::<f32>()
    };
    let plain = nats(WeightKind::F32, KvKind::F32);
    for (weights, kv) in
        [(WeightKind::Int8, KvKind::F32), (WeightKind::F32, KvKind::F16), (WeightKind::F32, KvKind::Int8)]
    {
        let other = nats(weights, kv);
        assert!(other != plain && (other / plain - 1.0).abs() < 5e-3, "{weights:?} {kv:?}: {other}, {plain}");
    }
}

/// All causal models, each with weights and keys of one kind.
fn models() -> impl Iterator<Item = (Gpt, ReaderOptions, String)> {
    let causal = fixtures::every(40).into_iter().filter(|(config, _)| config.kind == ModelKind::Causal);
    causal.enumerate().map(|(i, (config, tokens))| {
        let (weights, kv) = if i % 2 == 0 { (WeightKind::F32, KvKind::F32) } else { (WeightKind::Int8, KvKind::F16) };
        let (gpt, name) = (fixtures::model(&config, &tokens), fixtures::name(&config, &tokens));
        (gpt, ReaderOptions { streams: 1, weights, kv }, format!("{name}, {weights:?} {kv:?}"))
    })
}

/// All logits of a sequence, read at once and alone.
fn alone(gpt: &Gpt, options: ReaderOptions, ids: &[u32]) -> Vec<f32> {
    Reader::new(gpt, options).unwrap().read(&[ids], Logits::All).unwrap().to_vec()
}

#[test]
fn cuts_streams_and_threads_change_no_bit() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    for (gpt, options, name) in models() {
        let (v, most) = (gpt.tokens().vocabulary, gpt.config().context);
        let lengths = [most, most * 2 / 3, 1, most - 5];
        let (inputs, _) = fixtures::batch(gpt.config(), gpt.tokens(), 4, most);
        let sequences: Vec<&[u32]> = inputs.chunks(most).zip(lengths).map(|(ids, n)| &ids[..n]).collect();
        let alone: Vec<Vec<f32>> = sequences.iter().map(|ids| alone(&gpt, options, ids)).collect();
        for cuts in [vec![1; most], vec![5; most.div_ceil(5)], vec![20, 1, 8, most - 29], vec![most]] {
            let mut reader = Reader::new(&gpt, ReaderOptions { streams: 4, ..options }).unwrap();
            let mut read = 0;
            for (round, n) in cuts.into_iter().enumerate() {
                let cut = |ids: &[u32]| read.min(ids.len())..(read + n).min(ids.len());
                let blocks: Vec<&[u32]> = sequences.iter().map(|ids| &ids[cut(ids)]).collect();
                let wanted = if (round + n) % 3 == 0 { Logits::All } else { Logits::Last };
                let found = pool.install(|| reader.read(&blocks, wanted).unwrap().to_vec());
                let mut expected = Vec::new();
                for (ids, logits) in sequences.iter().zip(&alone).filter(|(ids, _)| !cut(ids).is_empty()) {
                    let rows = cut(ids);
                    let first = if wanted == Logits::All { rows.start } else { rows.end - 1 };
                    expected.extend_from_slice(&logits[first * v..rows.end * v]);
                }
                assert!(found == expected, "{name}: block of {n} after {read}");
                read += n;
            }
        }
    }
}

#[test]
fn readers_side_by_side_are_one_a_thread_and_change_no_bit() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    for (gpt, options, name) in models() {
        let ids = [gpt.tokens().bos];
        let alone = alone(&gpt, options, &ids);
        for (streams, each, expected) in
            [(1, 1, vec![1]), (4, 1, vec![2, 1, 1]), (8, 2, vec![4, 2, 2]), (4, 4, vec![4]), (2, 1, vec![1, 1])]
        {
            let options = ReaderOptions { streams, ..options };
            let mut readers = pool.install(|| Reader::side_by_side(&gpt, options, each)).unwrap();
            assert_eq!(readers.iter().map(Reader::streams).collect::<Vec<_>>(), expected, "{name}");
            for reader in &mut readers {
                let blocks = vec![&ids[..]; reader.streams()];
                let logits = reader.read(&blocks, Logits::All).unwrap();
                assert!(logits.chunks(alone.len()).all(|logits| logits == alone), "{name}");
            }
        }
        assert!(Reader::side_by_side(&gpt, ReaderOptions { streams: 0, ..options }, 1).is_err());
    }
}

#[test]
fn what_was_forgotten_leaves_no_trace() {
    for (gpt, options, name) in models() {
        let (v, most) = (gpt.tokens().vocabulary, gpt.config().context);
        let (inputs, _) = fixtures::batch(gpt.config(), gpt.tokens(), 4, most);
        let mut reader = Reader::new(&gpt, ReaderOptions { streams: 2, ..options }).unwrap();
        let mut rng = kinelm_store::random::stream(7, "forget", 0, 0);
        let mut any = |count: usize| rng.next_u32() as usize % count;
        // what the streams have read; they go back anywhere and go on otherwise
        let mut read = [Vec::new(), Vec::new()];
        for round in 0..40 {
            for (stream, read) in read.iter_mut().enumerate() {
                if any(3) > 0 {
                    let length = any(read.len() + 2);
                    reader.truncate(stream, length);
                    read.truncate(length);
                }
            }
            let before: Vec<usize> = read.iter().map(Vec::len).collect();
            for read in &mut read {
                let (n, other) = (any(most - read.len() + 1), &inputs[any(4) * most..]);
                read.extend_from_slice(&other[read.len()..][..n]);
            }
            let blocks: Vec<&[u32]> = read.iter().zip(&before).map(|(read, &n)| &read[n..]).collect();
            let wanted = if any(2) == 0 { Logits::All } else { Logits::Last };
            let mut expected = Vec::new();
            for (read, &before) in read.iter().zip(&before).filter(|(read, before)| read.len() > **before) {
                let first = if wanted == Logits::All { before } else { read.len() - 1 };
                expected.extend_from_slice(&alone(&gpt, options, read)[first * v..]);
            }
            assert!(reader.read(&blocks, wanted).unwrap() == expected, "{name}, round {round}");
        }
        assert!(reader.read(&[&[], &[]], Logits::Last).unwrap().is_empty());
    }
}

#[test]
fn conditioning_in_time_or_late_or_of_another_stream_belongs_to_its_frame_alone() {
    for (gpt, options, name) in models().filter(|(gpt, ..)| gpt.config().is_conditioned()) {
        let (config, tokens) = (gpt.config(), gpt.tokens());
        let (v, word, frames, skipped) = (tokens.vocabulary, tokens.word, config.frames(tokens), tokens.front - 1);
        let (inputs, _) = fixtures::batch(config, tokens, 2, config.context);
        let ids = &inputs[..config.context];
        let given = fixtures::conditioning(config, tokens, 2).unwrap();
        let mut reader = Reader::new(&gpt, options).unwrap();
        condition(&mut reader, (0, 0), &given, 0..frames);
        let all = reader.read(&[ids], Logits::All).unwrap().to_vec();
        // conditioning is forgotten with the tokens
        reader.truncate(0, 0);
        let without = alone(&gpt, options, ids);
        assert!(reader.read(&[ids], Logits::All).unwrap() == without && without != all, "{name}");
        // token by token beside another stream, each frame in time
        let mut reader = Reader::new(&gpt, ReaderOptions { streams: 2, ..options }).unwrap();
        for (i, logits) in all.chunks(v).enumerate() {
            if let Some(frame) = i.checked_sub(skipped).filter(|i| i % word == 0).map(|i| i / word) {
                reader.truncate(0, i);
                condition(&mut reader, (0, 0), &given, frame..frame + 1);
            }
            let found = reader.read(&[&ids[i..=i], &ids[i..=i]], Logits::Last).unwrap();
            assert!(found[..v] == *logits && found[v..] == without[i * v..][..v], "{name} token {i}");
        }
        // late: frames are read again
        let mut reader = Reader::new(&gpt, options).unwrap();
        let (read, rest) = ids.split_at(ids.len() - 1);
        reader.read(&[read], Logits::Last).unwrap();
        condition(&mut reader, (0, 0), &given, 0..frames);
        assert!(reader.read(&[rest], Logits::Last).unwrap() == &all[all.len() - v..], "{name}");
    }
}

#[test]
fn rows_that_nobody_needs_are_not_computed() {
    let (config, tokens) = fixtures::every(40)
        .into_iter()
        .find(|(config, tokens)| config.architecture == Architecture::TwoLevel && tokens.front == 1)
        .unwrap();
    let (inputs, _) = fixtures::batch(&config, &tokens, 1, config.context);
    let mut reader = Reader::new(&fixtures::model(&config, &tokens), ReaderOptions::default()).unwrap();
    // words of 6
    reader.read(&[&inputs[..15]], Logits::Last).unwrap();
    let progress = |reader: &Reader| {
        let Progress { frames, frame, rows, .. } = reader.two_level().progress(0);
        (frames, frame, rows)
    };
    assert_eq!(progress(&reader), (3, 2, 3));
    // rows and frames of the tokens that stay aren't computed again
    reader.truncate(0, 14);
    assert_eq!(progress(&reader), (3, 2, 2));
    reader.truncate(0, 12);
    assert_eq!(progress(&reader), (2, 2, 0));
}
