//! Decoding against plain loops, and against itself.

use super::*;
use crate::bins::Bins;
use crate::op::check::numbers;
use crate::scalar;
use std::sync::Arc;

/// The numbers of a model.
struct Model {
    sizes: Sizes,
    tensors: Vec<Vec<f32>>,
    /// Rows of the tables of words and places, if words are counted.
    words: Option<(usize, usize)>,
    rope: Option<Rope>,
    /// What stands at the places of a word, if the model looks one word back: at its inputs, at its logits.
    places: Vec<Bins>,
    looks: (bool, bool),
}

/// Ends a word.
const END: u32 = 2;
/// Tokens in front of the first word.
const FRONT: usize = 2;

impl Model {
    fn new(sizes: Sizes, seed: u64) -> Model {
        let Sizes { layers, width, vocabulary, context, .. } = sizes;
        let mut lengths = vec![vocabulary * width, context * width, width, width, vocabulary * width];
        for _ in 0..layers {
            lengths.extend([width, width, 3 * width * width, 3 * width, width * width, width]);
            lengths.extend([width, width, 4 * width * width, 4 * width, 4 * width * width, width]);
        }
        // the words before, the steps, the differences
        lengths.extend([vocabulary * width, (vocabulary + 1) * width, vocabulary * width, 2 * vocabulary * width]);
        let spread = 2.0 / (width as f32).sqrt();
        let tensors = lengths.iter().enumerate().map(|(i, &n)| numbers(seed + i as u64, n, spread)).collect();
        Model { sizes, tensors, words: None, rope: None, places: Vec::new(), looks: (false, false) }
    }

    /// The model in every form that its sizes has: as it is, turned by words of one length or counted, looking one word back.
    fn forms(sizes: Sizes, seed: u64) -> Vec<Model> {
        let new = || Model::new(sizes, seed);
        let v = sizes.vocabulary as u32;
        let bins = |first, count, circular| Bins { first, count, circular };
        let small = [bins(0, 1, false), bins(1, v - 1, true)];
        let large = [bins(3, v - 4, true), bins(4, v - 5, false), bins(v - 3, 3, false), bins(3, v / 2, true)];
        let places = if v < 10 { small.to_vec() } else { large.to_vec() };
        let word = Some(places.len() + 1);
        let mut all = vec![new()];
        for looks in [(true, false), (false, true), (true, true)] {
            all.push(Model { places: places.clone(), looks, ..new() });
        }
        // without heights, without angles
        for circular in [false, true] {
            let places = places.iter().copied().filter(|bins| bins.circular == circular).collect();
            all.push(Model { places, looks: (true, true), ..new() });
        }
        if (sizes.width / sizes.heads).is_multiple_of(2) {
            let rope = |word| Some(Rope { front: FRONT, word });
            all.push(Model { rope: rope(word), ..new() });
            all.push(Model { rope: rope(None), words: Some((5, 4)), ..new() });
            all.push(Model { rope: rope(word), places, looks: (true, true), ..new() });
        }
        all
    }

    fn name(&self) -> String {
        let Model { sizes, words, rope, places, looks, .. } = self;
        format!("{sizes:?} {words:?} {rope:?} {} places {looks:?}", places.len())
    }

    fn parts(&self) -> Parts<'_> {
        let t = &self.tensors;
        let width = self.sizes.width;
        let positions = match self.words {
            None => Positions::Places(&t[1]),
            // any numbers will do
            Some((words, places)) => {
                let (front, rest) = t[1].split_at(FRONT * width);
                Positions::Words {
                    front,
                    word: &rest[..words * width],
                    place: &rest[width..][..places * width],
                    end: END,
                }
            }
        };
        let pair = |i: usize| (t[i].as_slice(), t[i + 1].as_slice());
        let block = |layer: usize| {
            let i = 5 + 12 * layer;
            BlockParts {
                norm1: pair(i),
                qkv: pair(i + 2),
                out: pair(i + 4),
                norm2: pair(i + 6),
                up: pair(i + 8),
                down: pair(i + 10),
            }
        };
        Parts {
            sizes: self.sizes,
            token: &t[0],
            positions,
            rope: self.rope,
            before: self.before(),
            blocks: (0..self.sizes.layers).map(block).collect(),
            norm: pair(2),
            head: &t[4],
        }
    }

    fn before(&self) -> Option<Before<'_>> {
        let [.., character, step, circular, clamped] = self.tensors.as_slice() else { return None };
        let width = self.sizes.width;
        let most = |circular: bool| {
            let counts = self.places.iter().filter(|bins| bins.circular == circular).map(|bins| bins.count as usize);
            counts.max().unwrap_or(0)
        };
        let (round, clamps) = (most(true), most(false));
        let step = &step[..(round.max(clamps) + 1) * width];
        let previous = Previous { character, missing: 0, step };
        let clamped = &clamped[..(2 * clamps).saturating_sub(1) * width];
        let relative = Relative { circular: &circular[..round * width], clamped };
        let (inputs, logits) = self.looks;
        (inputs || logits).then(|| Before {
            front: FRONT,
            places: &self.places,
            previous: inputs.then_some(previous),
            relative: logits.then_some(relative),
        })
    }

    /// Any tokens, or words of the model's places with a token here and there that doesn't belong.
    fn tokens(&self, n: usize, seed: u64) -> Vec<u32> {
        let any = |i: usize, count: u32| {
            let number = numbers(seed * 1009 + i as u64, 1, 0.5)[0] + 0.5;
            (number * count as f32) as u32 % count
        };
        let token = |i: usize| match i.checked_sub(FRONT).map(|k| k % (self.places.len() + 1)) {
            Some(place) if !self.places.is_empty() && any(i + n, 12) > 0 => {
                self.places.get(place).map_or(END, |bins| bins.first + any(i, bins.count))
            }
            _ => any(i, self.sizes.vocabulary as u32),
        };
        (0..n).map(token).collect()
    }

    fn decoder(&self, streams: usize, weights: WeightKind, kv: KvKind) -> Decoder {
        Decoder::new(Arc::new(DecoderWeights::new(&self.parts(), weights)), streams, kv)
    }
}

const SIZES: [Sizes; 4] = [
    Sizes { layers: 2, heads: 2, width: 16, vocabulary: 11, context: 40 },
    Sizes { layers: 1, heads: 1, width: 5, vocabulary: 3, context: 1 },
    Sizes { layers: 2, heads: 3, width: 27, vocabulary: 70, context: 65 },
    Sizes { layers: 1, heads: 2, width: 192, vocabulary: 130, context: 33 },
];

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
    for model in SIZES.into_iter().flat_map(|sizes| Model::forms(sizes, 1)) {
        let tokens = model.tokens(model.sizes.context, 9);
        let truth = scalar::decode::logits(&model.parts(), &tokens);
        // half floats have 11 bits; bytes with a scale a column 7 and a half, over sums that average them
        for (weights, kv, bound) in [
            (WeightKind::F32, KvKind::F32, 1e-5),
            (WeightKind::F32, KvKind::F16, 2e-3),
            (WeightKind::Int8, KvKind::F32, 5e-2),
        ] {
            let found = model.decoder(1, weights, kv).read(&[&tokens], Logits::All).to_vec();
            let apart = apart(&found, &truth);
            assert!(apart < bound, "{} {weights:?} {kv:?}: {apart:e}", model.name());
        }
    }
}

#[test]
fn cuts_streams_and_threads_change_no_bit() {
    let sizes = Sizes { layers: 2, heads: 3, width: 48, vocabulary: 70, context: 300 };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    for (i, model) in Model::forms(sizes, 2).into_iter().enumerate() {
        let (weights, kv) = if i % 2 == 0 { (WeightKind::F32, KvKind::F32) } else { (WeightKind::Int8, KvKind::F16) };
        let v = model.sizes.vocabulary;
        let sequences: Vec<Vec<u32>> = [300, 211, 1, 280].iter().map(|&n| model.tokens(n, n as u64)).collect();
        let alone: Vec<Vec<f32>> =
            sequences.iter().map(|s| model.decoder(1, weights, kv).read(&[s], Logits::All).to_vec()).collect();
        for cuts in [vec![1; 300], vec![7; 50], vec![100, 1, 30, 169], vec![300]] {
            let mut decoder = model.decoder(sequences.len(), weights, kv);
            let mut read = 0;
            for n in cuts {
                let cut = |s: &'_ Vec<u32>| read.min(s.len())..(read + n).min(s.len());
                let blocks: Vec<&[u32]> = sequences.iter().map(|s| &s[cut(s)]).collect();
                let wanted = if n % 2 == 0 { Logits::Last } else { Logits::All };
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
            assert_eq!((0..4).map(|s| decoder.len(s)).collect::<Vec<_>>(), [300, 211, 1, 280]);
        }
    }
}

#[test]
fn words_of_any_length_are_counted_however_they_are_cut() {
    let turned = Some(Rope { front: FRONT, word: None });
    let sizes = Sizes { layers: 1, heads: 2, width: 16, vocabulary: 6, context: 60 };
    // of a vocabulary of 6 every sixth token or so ends a word; words and places go beyond their tables too
    for (words, rope) in [((20, 30), None), ((3, 4), turned), ((1, 1), None), ((1, 1), turned)] {
        let model = Model { words: Some(words), rope, ..Model::new(sizes, 4) };
        let (tokens, other) = (model.tokens(60, 9), model.tokens(60, 5));
        let truth = scalar::decode::logits(&model.parts(), &tokens);
        let mut decoder = model.decoder(2, WeightKind::F32, KvKind::F32);
        for cuts in [vec![60], vec![1; 60], vec![17, 1, 42]] {
            decoder.truncate(0, 0);
            let mut read = 0;
            for n in cuts {
                // what was read and forgotten leaves no count
                decoder.read(&[&other[..n], &[]], Logits::Last);
                decoder.truncate(0, read);
                decoder.truncate(1, 0);
                let found = decoder.read(&[&tokens[read..read + n], &other], Logits::All)[..6 * n].to_vec();
                let apart = apart(&found, &truth[6 * read..6 * (read + n)]);
                assert!(apart < 1e-5, "{words:?}, block of {n} behind {read}: {apart:e}");
                read += n;
            }
        }
    }
}

#[test]
fn what_was_forgotten_leaves_no_trace() {
    for model in Model::forms(SIZES[0], 3) {
        let (tokens, others) = (model.tokens(40, 1), model.tokens(40, 2));
        let mut decoder = model.decoder(2, WeightKind::F32, KvKind::F32);
        let mut fresh = model.decoder(2, WeightKind::F32, KvKind::F32);
        let expected = fresh.read(&[&tokens[..20], &tokens[..5]], Logits::All).to_vec();
        decoder.read(&[&tokens[..9], &others], Logits::Last);
        decoder.truncate(0, 6);
        decoder.truncate(1, 0);
        decoder.read(&[&others[6..], &[]], Logits::Last);
        decoder.truncate(0, 6);
        let v = model.sizes.vocabulary;
        let name = model.name();
        assert_eq!(decoder.read(&[&tokens[6..20], &tokens[..5]], Logits::All), &expected[6 * v..], "{name}");
        decoder.reset();
        assert!(decoder.is_empty());
        assert_eq!(decoder.read(&[&tokens[..20], &tokens[..5]], Logits::All), expected, "{name}");
        assert!(decoder.read(&[&[], &[]], Logits::Last).is_empty());
    }
}
