//! Decoding against plain loops, and against itself.

use super::*;
use crate::op::check::numbers;
use crate::scalar;
use std::sync::Arc;

/// The numbers of a model.
struct Model {
    shape: Shape,
    tensors: Vec<Vec<f32>>,
    /// Rows of the tables of words and places, if words are counted.
    words: Option<(usize, usize)>,
}

/// Ends a word.
const END: u32 = 2;

impl Model {
    fn new(shape: Shape, seed: u64) -> Model {
        let Shape { layers, width, vocabulary, context, .. } = shape;
        let mut lengths = vec![vocabulary * width, context * width, width, width, vocabulary * width];
        for _ in 0..layers {
            lengths.extend([width, width, 3 * width * width, 3 * width, width * width, width]);
            lengths.extend([width, width, 4 * width * width, 4 * width, 4 * width * width, width]);
        }
        let spread = 2.0 / (width as f32).sqrt();
        let tensors = lengths.iter().enumerate().map(|(i, &n)| numbers(seed + i as u64, n, spread)).collect();
        Model { shape, tensors, words: None }
    }

    fn parts(&self) -> Parts<'_> {
        let t = &self.tensors;
        let width = self.shape.width;
        let positions = match self.words {
            None => Positions::Places(&t[1]),
            // any numbers will do
            Some((words, places)) => {
                let (front, rest) = t[1].split_at(width);
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
            shape: self.shape,
            token: &t[0],
            positions,
            blocks: (0..self.shape.layers).map(block).collect(),
            norm: pair(2),
            head: &t[4],
        }
    }

    fn tokens(&self, n: usize, seed: u64) -> Vec<u32> {
        let v = self.shape.vocabulary as f32;
        numbers(seed, n, 0.5).iter().map(|x| ((x + 0.5) * v) as u32 % self.shape.vocabulary as u32).collect()
    }

    fn decoder(&self, streams: usize, weights: WeightKind, kv: KvKind) -> Decoder {
        Decoder::new(Arc::new(DecoderWeights::new(&self.parts(), weights)), streams, kv)
    }
}

const SHAPES: [Shape; 4] = [
    Shape { layers: 2, heads: 2, width: 16, vocabulary: 11, context: 40 },
    Shape { layers: 1, heads: 1, width: 5, vocabulary: 3, context: 1 },
    Shape { layers: 2, heads: 3, width: 27, vocabulary: 70, context: 65 },
    Shape { layers: 1, heads: 2, width: 192, vocabulary: 130, context: 33 },
];

/// The largest difference, by the largest number.
fn apart(found: &[f32], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let most = expected.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    found.iter().zip(expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max) / most
}

#[test]
fn logits_are_those_of_plain_loops() {
    for shape in SHAPES {
        let model = Model::new(shape, 1);
        let tokens = model.tokens(shape.context, 9);
        let truth = scalar::decode::logits(&model.parts(), &tokens);
        // half floats have 11 bits; bytes with a scale a column 7 and a half, over sums that average them
        for (weights, kv, bound) in [
            (WeightKind::F32, KvKind::F32, 1e-5),
            (WeightKind::F32, KvKind::F16, 2e-3),
            (WeightKind::Int8, KvKind::F32, 5e-2),
        ] {
            let found = model.decoder(1, weights, kv).read(&[&tokens], Logits::All).to_vec();
            let apart = apart(&found, &truth);
            assert!(apart < bound, "{shape:?} {weights:?} {kv:?}: {apart:e}");
        }
    }
}

#[test]
fn cuts_streams_and_threads_change_no_bit() {
    let model = Model::new(Shape { layers: 2, heads: 3, width: 48, vocabulary: 70, context: 300 }, 2);
    let v = model.shape.vocabulary;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    for (weights, kv) in [(WeightKind::F32, KvKind::F32), (WeightKind::Int8, KvKind::F16)] {
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
                assert!(found == expected, "{weights:?} {kv:?}: block of {n} behind {read}");
                read += n;
            }
            assert_eq!((0..4).map(|s| decoder.len(s)).collect::<Vec<_>>(), [300, 211, 1, 280]);
        }
    }
}

#[test]
fn words_of_any_length_are_counted_however_they_are_cut() {
    let shape = Shape { layers: 1, heads: 2, width: 16, vocabulary: 6, context: 60 };
    // of a vocabulary of 6 every sixth token or so ends a word; words and places go beyond their tables too
    for words in [(20, 30), (3, 4), (1, 1)] {
        let model = Model { words: Some(words), ..Model::new(shape, 4) };
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
    let model = Model::new(SHAPES[0], 3);
    let (tokens, others) = (model.tokens(40, 1), model.tokens(40, 2));
    let mut decoder = model.decoder(2, WeightKind::F32, KvKind::F32);
    let mut fresh = model.decoder(2, WeightKind::F32, KvKind::F32);
    let expected = fresh.read(&[&tokens[..20], &tokens[..5]], Logits::All).to_vec();
    decoder.read(&[&tokens[..9], &others], Logits::Last);
    decoder.truncate(0, 6);
    decoder.truncate(1, 0);
    decoder.read(&[&others[6..], &[]], Logits::Last);
    decoder.truncate(0, 6);
    let v = model.shape.vocabulary;
    assert_eq!(decoder.read(&[&tokens[6..20], &tokens[..5]], Logits::All), &expected[6 * v..]);
    decoder.reset();
    assert!(decoder.is_empty());
    assert_eq!(decoder.read(&[&tokens[..20], &tokens[..5]], Logits::All), expected);
    assert!(decoder.read(&[&[], &[]], Logits::Last).is_empty());
}
