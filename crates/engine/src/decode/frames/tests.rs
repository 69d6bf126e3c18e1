//! Reading with two stacks against plain loops, and against itself.

use super::*;
use crate::bins::Bins;
use crate::decode::{BlockParts, Relative, Stack, WeightKind};
use crate::op::check::numbers;
use crate::op::embedding::NONE;
use crate::scalar;

/// The numbers of a model, in the order of its parts.
struct Model {
    sizes: FrameSizes,
    places: Vec<Bins>,
    tables: Vec<Vec<f32>>,
    trunk: Vec<Vec<f32>>,
    speller: Vec<Vec<f32>>,
}

fn block_of(t: &[Vec<f32>]) -> BlockParts<'_> {
    let [norm1, qkv, out, norm2, up, down] = [0, 2, 4, 6, 8, 10].map(|i| (t[i].as_slice(), t[i + 1].as_slice()));
    BlockParts { norm1, qkv, out, norm2, up, down }
}

/// Ends a frame.
const END: u32 = 2;

/// Numbers that a frame may be told.
const TOLD: usize = 5;

/// What frames are told: numbers and the rows of both tables.
type Telling = Vec<Option<(Vec<f32>, [Vec<u32>; 2])>>;

/// The same as the decoder takes it.
fn conditioning(telling: &Telling) -> Vec<Option<FrameConditioning<'_>>> {
    telling
        .iter()
        .map(|conditioning| conditioning.as_ref().map(|(numbers, [a, b])| FrameConditioning { numbers, rows: [a, b] }))
        .collect()
}

impl Model {
    fn new(sizes: FrameSizes, places: &[Bins], seed: u64) -> Model {
        let FrameSizes { trunk, speller, character, vocabulary, frames, front } = sizes;
        let most = |circular: bool| {
            let counts = places.iter().filter(|bins| bins.circular == circular).map(|bins| bins.count as usize);
            counts.max().unwrap_or(0)
        };
        let (round, clamps) = (most(true), (2 * most(false)).saturating_sub(1));
        let (s, r, c) = (most(true).max(most(false)), round + clamps, places.len());
        let (wide, d) = (trunk.width, speller.width);
        let draw = |seed: u64, lengths: &[usize], spread: f32| -> Vec<Vec<f32>> {
            lengths.iter().enumerate().map(|(i, &n)| numbers(seed * 1000 + i as u64, n, spread)).collect()
        };
        let conditioning = 2 * c * character;
        let mut lengths =
            vec![c * (s + 1) * character, conditioning * wide, wide, frames * wide, wide, wide, wide * d, d];
        lengths.extend([(r + 1 + s) * d, (c + 1) * d, (s + 1) * d, (r + 1) * d, d, d, vocabulary * d]);
        lengths.extend([round * d, clamps * d, if front > 1 { vocabulary * wide } else { 0 }]);
        lengths.extend([TOLD * wide, TOLD * d, r * d, r * d, if front > 1 { vocabulary * d } else { 0 }]);
        let blocks = |seed: u64, Stack { layers, width, .. }: Stack| {
            let mut lengths = vec![];
            for _ in 0..layers {
                lengths.extend([width, width, 3 * width * width, 3 * width, width * width, width]);
                lengths.extend([width, width, 4 * width * width, 4 * width, 4 * width * width, width]);
            }
            draw(seed, &lengths, 2.0 / (width as f32).sqrt())
        };
        Model {
            sizes,
            places: places.to_vec(),
            tables: draw(seed, &lengths, 2.0 / (d as f32).sqrt()),
            trunk: blocks(seed + 1, trunk),
            speller: blocks(seed + 2, speller),
        }
    }

    /// Models of places that go round, that don't, and of both.
    fn all(frames: usize, seed: u64) -> Vec<Model> {
        let bins = |first, count, circular| Bins { first, count, circular };
        let (angle, height) = (bins(5, 7, true), bins(8, 5, false));
        let stack = |layers, heads, width| Stack { layers, heads, width };
        let both = [angle, height, bins(3, 4, true), bins(15, 3, false), angle];
        let models = [
            (both.to_vec(), stack(2, 2, 16), stack(2, 2, 8)),
            (vec![angle; 2], stack(1, 1, 5), stack(1, 3, 27)),
            (vec![height; 3], stack(0, 2, 6), stack(1, 2, 80)),
            (both.to_vec(), stack(1, 2, 64), stack(0, 1, 48)),
        ];
        let new = |(i, (places, trunk, speller)): (usize, (Vec<Bins>, Stack, Stack))| {
            let sizes = FrameSizes { trunk, speller, character: 3, vocabulary: 20, frames, front: [1, 3, 1, 2][i] };
            Model::new(sizes, &places, seed + 10 * i as u64)
        };
        models.into_iter().enumerate().map(new).collect()
    }

    fn name(&self) -> String {
        format!("{:?}, {} places", self.sizes, self.places.len())
    }

    fn parts(&self) -> FrameParts<'_> {
        let t = |i: usize| self.tables[i].as_slice();
        FrameParts {
            sizes: self.sizes,
            places: &self.places,
            bins: t(0),
            frames: (t(1), t(2)),
            positions: t(3),
            trunk: self.trunk.chunks_exact(12).map(block_of).collect(),
            trunk_norm: (t(4), t(5)),
            join: (t(6), t(7)),
            last: t(8),
            place: t(9),
            back: t(10),
            step: t(11),
            speller: self.speller.chunks_exact(12).map(block_of).collect(),
            norm: (t(12), t(13)),
            head: t(14),
            relative: Relative { circular: t(15), clamped: t(16) },
            labels: [t(17), t(22)],
            conditioning: Some(ConditioningParts { trunk: t(18), speller: t(19), rows: [t(20), t(21)] }),
        }
    }

    fn context(&self) -> usize {
        self.sizes.front - 1 + self.sizes.frames * (self.places.len() + 1)
    }

    /// Frames with a token here and there that doesn't belong.
    fn tokens(&self, n: usize, seed: u64) -> Vec<u32> {
        let any = |i: usize, count: u32| {
            let number = numbers(seed * 1009 + i as u64, 1, 0.5)[0] + 0.5;
            (number * count as f32) as u32 % count
        };
        let token = |i: usize| match i.checked_sub(self.sizes.front).map(|k| k % (self.places.len() + 1)) {
            Some(place) if any(i + n, 12) > 0 => {
                self.places.get(place).map_or(END, |bins| bins.first + any(i, bins.count))
            }
            _ => any(i, self.sizes.vocabulary as u32),
        };
        (0..n).map(token).collect()
    }

    /// Something told to two of three frames, rows missing here and there.
    fn telling(&self, seed: u64) -> Telling {
        let word = self.places.len() + 1;
        let steps = self.tables[20].len() / self.sizes.speller.width;
        let of_frame = |frame: u64| {
            let any = numbers(seed * 77 + frame, 2 * word, 0.5);
            let row = |x: &f32| if *x > 0.3 { NONE } else { ((x + 0.5) * steps as f32) as u32 };
            let rows = [0, 1].map(|i| any[i * word..][..word].iter().map(row).collect());
            (frame % 3 != 1).then(|| (numbers(seed * 78 + frame, TOLD, 1.0), rows))
        };
        (0..self.sizes.frames as u64).map(of_frame).collect()
    }

    fn decoder(&self, streams: usize, weights: WeightKind, kv: KvKind) -> FrameDecoder {
        FrameDecoder::new(Arc::new(FrameWeights::new(&self.parts(), weights)), streams, kv)
    }

    /// All logits of a sequence, read at once and alone.
    fn alone(&self, tokens: &[u32], weights: WeightKind, kv: KvKind) -> Vec<f32> {
        self.decoder(1, weights, kv).read(&[tokens], Logits::All).to_vec()
    }
}

/// The largest difference, by the largest number.
fn apart(found: &[f32], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let most = expected.iter().filter(|x| x.is_finite()).fold(0.0, |m: f64, x| m.max(x.abs()));
    // minus infinity is minus infinity
    let apart = |(a, b): (&f32, &f64)| if f64::from(*a) == *b { 0.0 } else { (f64::from(*a) - b).abs() };
    found.iter().zip(expected).map(apart).fold(0.0, f64::max) / most
}

#[test]
fn logits_are_those_of_plain_loops() {
    // frames longer than what goes through the layers at once, too
    let long: Vec<Bins> = (0..209).map(|i| Bins { first: 4, count: 2 + i % 5, circular: i % 3 == 0 }).collect();
    let stack = Stack { layers: 1, heads: 2, width: 10 };
    let sizes = FrameSizes { trunk: stack, speller: stack, character: 1, vocabulary: 10, frames: 3, front: 1 };
    let long = Model::new(sizes, &long, 90);
    // widths of a model that dances
    let wide: Vec<Bins> = (0..42).map(|i| Bins { first: 6, count: 360 - 2 * i, circular: i % 3 > 0 }).collect();
    let (trunk, speller) = (Stack { layers: 1, heads: 8, width: 256 }, Stack { layers: 1, heads: 4, width: 128 });
    let wide =
        Model::new(FrameSizes { trunk, speller, character: 24, vocabulary: 366, frames: 4, front: 3 }, &wide, 95);
    for model in Model::all(4, 1).into_iter().chain(Model::all(1, 2)).chain([long, wide]) {
        let tokens = model.tokens(model.context(), 9);
        let telling = model.telling(5);
        let truths = [&[][..], &conditioning(&telling)]
            .map(|conditioning| scalar::frames::logits(&model.parts(), &tokens, conditioning));
        let truth = &truths[0];
        // of a word's places, those behind a bin one frame back have no other logits
        if model.sizes.frames > 1 {
            assert!(truth.contains(&f64::NEG_INFINITY));
        }
        for (weights, kv, bound) in [
            (WeightKind::F32, KvKind::F32, 1e-5),
            (WeightKind::F32, KvKind::F16, 2e-3),
            (WeightKind::Int8, KvKind::F32, 5e-2),
        ] {
            let off = apart(&model.alone(&tokens, weights, kv), truth);
            assert!(off < bound, "{} {weights:?} {kv:?}: {off:e}", model.name());
            let mut decoder = model.decoder(1, weights, kv);
            conditioning(&telling)
                .into_iter()
                .enumerate()
                .for_each(|(frame, conditioning)| decoder.condition(0, frame, conditioning));
            let off = apart(decoder.read(&[&tokens], Logits::All), &truths[1]);
            assert!(off < bound, "{} {weights:?} {kv:?}, told: {off:e}", model.name());
        }
    }
}

#[test]
fn cuts_streams_and_threads_change_no_bit() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    for (i, model) in Model::all(40, 3).into_iter().enumerate() {
        let (weights, kv) = if i % 2 == 0 { (WeightKind::F32, KvKind::F32) } else { (WeightKind::Int8, KvKind::F16) };
        let (v, most) = (model.sizes.vocabulary, model.context());
        let lengths = [most, most * 2 / 3, 1, most - 5];
        let sequences: Vec<Vec<u32>> = lengths.iter().map(|&n| model.tokens(n, n as u64)).collect();
        let alone: Vec<Vec<f32>> = sequences.iter().map(|s| model.alone(s, weights, kv)).collect();
        for cuts in [vec![1; most], vec![5; most.div_ceil(5)], vec![50, 1, 8, 20, most - 79], vec![most]] {
            let mut decoder = model.decoder(sequences.len(), weights, kv);
            let mut read = 0;
            for (round, n) in cuts.into_iter().enumerate() {
                let cut = |s: &'_ Vec<u32>| read.min(s.len())..(read + n).min(s.len());
                let blocks: Vec<&[u32]> = sequences.iter().map(|s| &s[cut(s)]).collect();
                let wanted = if (round + n) % 3 == 0 { Logits::All } else { Logits::Last };
                let found = pool.install(|| decoder.read(&blocks, wanted).to_vec());
                let mut expected = Vec::new();
                for (s, logits) in sequences.iter().zip(&alone) {
                    let rows = cut(s);
                    match wanted {
                        Logits::All => expected.extend_from_slice(&logits[rows.start * v..rows.end * v]),
                        Logits::Last if rows.is_empty() => {}
                        Logits::Last => expected.extend_from_slice(&logits[(rows.end - 1) * v..rows.end * v]),
                    }
                }
                assert!(found == expected, "{} {weights:?} {kv:?}: block of {n} behind {read}", model.name());
                read += n;
            }
            assert_eq!((0..4).map(|s| decoder.len(s)).collect::<Vec<_>>(), lengths);
        }
    }
}

#[test]
fn what_was_forgotten_leaves_no_trace() {
    for model in Model::all(6, 4) {
        let (v, most) = (model.sizes.vocabulary, model.context());
        let mut decoder = model.decoder(2, WeightKind::F32, KvKind::F32);
        // what the streams have read; they go back anywhere and go on otherwise
        let mut read = [Vec::new(), Vec::new()];
        for round in 0..120u64 {
            let any =
                |i: u64, count: usize| ((numbers(7 * round + i, 1, 0.5)[0] + 0.5) * count as f32) as usize % count;
            for (stream, read) in read.iter_mut().enumerate() {
                if any(stream as u64, 3) > 0 {
                    let length = any(2 + stream as u64, read.len() + 2);
                    decoder.truncate(stream, length);
                    read.truncate(length);
                }
            }
            let before: Vec<usize> = read.iter().map(Vec::len).collect();
            for (stream, read) in read.iter_mut().enumerate() {
                let n = any(4 + stream as u64, most - read.len() + 1);
                let other = model.tokens(most, 2 * round + stream as u64);
                read.extend_from_slice(&other[read.len()..][..n]);
            }
            let blocks: Vec<&[u32]> = read.iter().zip(&before).map(|(read, &n)| &read[n..]).collect();
            let wanted = if any(6, 2) == 0 { Logits::All } else { Logits::Last };
            let mut expected = Vec::new();
            for (read, &before) in read.iter().zip(&before).filter(|(read, before)| read.len() > **before) {
                let alone = model.alone(read, WeightKind::F32, KvKind::F32);
                let first = if wanted == Logits::All { before } else { read.len() - 1 };
                expected.extend_from_slice(&alone[first * v..]);
            }
            assert!(decoder.read(&blocks, wanted) == expected, "{}, round {round}", model.name());
        }
        decoder.reset();
        assert!(decoder.is_empty());
        let expected = model.alone(&read[0], WeightKind::F32, KvKind::F32);
        assert!(decoder.read(&[&read[0], &[]], Logits::All) == expected, "{}", model.name());
        assert!(decoder.read(&[&[], &[]], Logits::Last).is_empty());
    }
}

#[test]
fn what_is_told_in_time_or_late_or_to_another_stream_is_told_to_its_frame_alone() {
    for model in Model::all(6, 6) {
        let (tokens, telling) = (model.tokens(model.context(), 3), model.telling(4));
        let (word, ahead) = (model.places.len() + 1, model.sizes.front - 1);
        let mut decoder = model.decoder(1, WeightKind::F32, KvKind::F32);
        conditioning(&telling)
            .into_iter()
            .enumerate()
            .for_each(|(frame, conditioning)| decoder.condition(0, frame, conditioning));
        let all = decoder.read(&[&tokens], Logits::All).to_vec();
        // what is told is forgotten with the tokens
        decoder.reset();
        let untold = model.alone(&tokens, WeightKind::F32, KvKind::F32);
        assert!(decoder.read(&[&tokens], Logits::All) == untold && untold != all, "{}", model.name());
        // token by token beside another stream, told before each frame begins
        let mut decoder = model.decoder(2, WeightKind::F32, KvKind::F32);
        let v = model.sizes.vocabulary;
        for (i, logits) in all.chunks(v).enumerate() {
            if let Some(frame) = i.checked_sub(ahead).filter(|i| i % word == 0).map(|i| i / word) {
                decoder.truncate(0, i);
                decoder.condition(0, frame, conditioning(&telling)[frame]);
            }
            let found = decoder.read(&[&tokens[i..=i], &tokens[i..=i]], Logits::Last);
            assert!(found[..v] == *logits && found[v..] == untold[i * v..][..v], "{} token {i}", model.name());
        }
        // told late: frames are read again
        let mut decoder = model.decoder(1, WeightKind::F32, KvKind::F32);
        let (read, rest) = tokens.split_at(tokens.len() - 1);
        decoder.read(&[read], Logits::Last);
        conditioning(&telling)
            .into_iter()
            .enumerate()
            .for_each(|(frame, conditioning)| decoder.condition(0, frame, conditioning));
        assert!(decoder.read(&[rest], Logits::Last) == &all[all.len() - v..], "{}", model.name());
    }
}

#[test]
fn what_nobody_asks_for_is_not_spelled() {
    let model = &Model::all(6, 5)[0];
    let tokens = model.tokens(model.context(), 1);
    let mut decoder = model.decoder(1, WeightKind::F32, KvKind::F32);
    decoder.read(&[&tokens[..15]], Logits::Last);
    let Reading { frames, frame, rows, .. } = decoder.readings[0];
    assert_eq!((frames, frame, rows), (3, 2, 3));
    // rows and frames that are still right are kept
    decoder.truncate(0, 14);
    let Reading { frames, frame, rows, .. } = decoder.readings[0];
    assert_eq!((frames, frame, rows), (3, 2, 2));
    decoder.truncate(0, 12);
    let Reading { frames, rows, .. } = decoder.readings[0];
    assert_eq!((frames, rows), (2, 0));
}

#[test]
#[ignore = "prints speeds, judges nothing"]
fn speed_of_tokens() {
    let trunk = Stack { layers: 6, heads: 8, width: 256 };
    let speller = Stack { layers: 3, heads: 4, width: 128 };
    let sizes = FrameSizes { trunk, speller, character: 24, vocabulary: 366, frames: 128, front: 1 };
    let model = Model::new(sizes, &[Bins { first: 6, count: 360, circular: true }; 42], 1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for (weights, kv) in [(WeightKind::F32, KvKind::F32), (WeightKind::Int8, KvKind::F16)] {
        for streams in [1, 8] {
            let tokens = model.tokens(model.context(), 1);
            let (prompt, rest) = tokens.split_at(30 * 43);
            let mut decoder = model.decoder(streams, weights, kv);
            pool.install(|| {
                let begun = std::time::Instant::now();
                decoder.read(&vec![prompt; streams], Logits::Last);
                let prompted = begun.elapsed();
                let begun = std::time::Instant::now();
                for i in 0..20 * 43 {
                    decoder.read(&vec![&rest[i..i + 1]; streams], Logits::Last);
                }
                let rate = (streams * 20 * 43) as f64 / begun.elapsed().as_secs_f64();
                println!("{weights:?} {kv:?}, {streams} streams: prompt {prompted:?}, {rate:.0} tokens/s");
            });
            let begun = std::time::Instant::now();
            decoder.reset();
            let all = pool.install(|| decoder.read(&vec![prompt; streams], Logits::All).len());
            let rate = all as f64 / 366.0 / begun.elapsed().as_secs_f64();
            println!("{weights:?} {kv:?}, {streams} streams: {rate:.0} tokens/s of a known text");
        }
    }
}
