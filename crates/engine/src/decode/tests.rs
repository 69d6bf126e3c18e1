//! A stack decoded against plain loops, and against itself.

use super::*;
use crate::block::{Linear, Norm as BlockNorm, Shape, Tensors};
use crate::op::attention::Mask;
use crate::op::check::numbers;
use crate::op::rope::Angles;
use crate::scalar;

/// The numbers of a stack, its last norm and a head (V, D).
struct Model {
    stack: Stack,
    places: usize,
    rotary: bool,
    tensors: Vec<Vec<f32>>,
    head: Vec<f32>,
}

const VOCABULARY: usize = 130;

impl Model {
    fn new(stack: Stack, places: usize, rotary: bool, seed: u64) -> Model {
        let d = stack.width;
        let block = [d, d, 3 * d * d, 3 * d, d * d, d, d, d, 4 * d * d, 4 * d, 4 * d * d, d];
        let lengths = (0..stack.layers).flat_map(|_| block).chain([d, d]);
        // rows of width d then have sums near 1 in size
        let spread = 2.0 / (d as f32).sqrt();
        let tensors = lengths.enumerate().map(|(i, n)| numbers(seed + i as u64, n, spread)).collect();
        Model { stack, places, rotary, tensors, head: numbers(seed + 99, VOCABULARY * d, spread) }
    }

    fn all(seed: u64) -> Vec<Model> {
        let sizes = [(2, 2, 16, 40), (1, 1, 5, 1), (2, 3, 27, 65), (1, 2, 192, 33), (1, 2, 10, 230), (0, 2, 6, 9)];
        let model = |(layers, heads, width, places): (usize, usize, usize, usize)| {
            let rotary: &[bool] = if (width / heads).is_multiple_of(2) { &[false, true] } else { &[false] };
            rotary.iter().map(move |&is| Model::new(Stack { layers, heads, width }, places, is, seed))
        };
        sizes.into_iter().flat_map(model).collect()
    }

    fn name(&self) -> String {
        format!("{:?}, rotary {}", self.stack, self.rotary)
    }

    fn pair(&self, i: usize) -> Pair<'_> {
        (&self.tensors[i], &self.tensors[i + 1])
    }

    fn norm(&self) -> Pair<'_> {
        self.pair(12 * self.stack.layers)
    }

    /// The rotary position of a place: words of three.
    fn position(place: usize) -> u32 {
        (place / 3) as u32
    }

    fn rows(&self, seed: u64) -> Vec<f32> {
        numbers(seed, self.places * self.stack.width, 1.0)
    }

    /// (places, V): the logits of `rows` in f64.
    fn truth(&self, rows: &[f32]) -> Vec<f64> {
        let Stack { layers, heads, width } = self.stack;
        let wide = |x: &[f32]| -> Vec<f64> { x.iter().map(|&x| x.into()).collect() };
        let norm = |i: usize| BlockNorm { weight: wide(self.pair(i).0), bias: wide(self.pair(i).1) };
        let linear = |i: usize| Linear { weight: wide(self.pair(i).0), bias: wide(self.pair(i).1) };
        let tokens = rows.len() / width;
        let shape = Shape { batch: 1, tokens, width, heads, hidden: 4 * width };
        let positions: Vec<u32> = if self.rotary { (0..tokens).map(Model::position).collect() } else { Vec::new() };
        let mut x = wide(rows);
        for i in (0..layers).map(|layer| 12 * layer) {
            let [norm1, norm2] = [i, i + 6].map(norm);
            let [qkv, out, up, down] = [i + 2, i + 4, i + 8, i + 10].map(linear);
            let tensors = Tensors { norm1, qkv, out, norm2, up, down };
            x = scalar::block::forward(&x, shape, &tensors, Mask::Causal, &positions);
        }
        let normed = scalar::block::layer_norm(&x, &norm(12 * layers));
        let dot = |row: &[f64], id: usize| -> f64 {
            row.iter().zip(&self.head[id * width..]).map(|(x, w)| x * f64::from(*w)).sum()
        };
        normed.chunks(width).flat_map(|row| (0..VOCABULARY).map(|id| dot(row, id)).collect::<Vec<_>>()).collect()
    }

    fn decoder(&self, streams: usize, weights: WeightKind, kv: KvKind) -> Decoder<'_> {
        let block = |layer: usize| {
            let [norm1, qkv, out, norm2, up, down] = [0, 2, 4, 6, 8, 10].map(|i| self.pair(12 * layer + i));
            BlockParts { norm1, qkv, out, norm2, up, down }
        };
        let blocks: Vec<BlockParts> = (0..self.stack.layers).map(block).collect();
        let d = self.stack.width / self.stack.heads;
        let angles = self.rotary.then(|| Angles::new(self.places / 3 + 1, d));
        let weights_of_stack = StackWeights::new(&blocks, self.stack, weights, angles);
        let head = Matrix::transposed(&self.head, VOCABULARY, self.stack.width, weights);
        Decoder {
            model: self,
            norm: Norm::new(self.norm(), self.stack.width),
            decoder: StackDecoder::new(&weights_of_stack, kv, streams, self.places, usize::MAX, head.columns()),
            weights: weights_of_stack,
            head,
        }
    }
}

struct Decoder<'a> {
    model: &'a Model,
    weights: StackWeights,
    norm: Norm,
    head: Matrix,
    decoder: StackDecoder,
}

impl Decoder<'_> {
    /// Logits of blocks of rows, one per stream, from a place of each on.
    fn read(&mut self, blocks: &[(usize, &[f32])]) -> Vec<f32> {
        let width = self.model.stack.width;
        let mut logits = Vec::new();
        for (stream, &(mut place, mut rows)) in blocks.iter().enumerate() {
            while !rows.is_empty() {
                let n = (rows.len() / width).min(self.decoder.free());
                let first = self.decoder.push(Run { stream, place, rows: n });
                self.decoder.rows_mut(first).copy_from_slice(&rows[..n * width]);
                for (i, position) in self.decoder.positions_mut(first).iter_mut().enumerate() {
                    *position = Model::position(place + i);
                }
                (place, rows) = (place + n, &rows[n * width..]);
                if self.decoder.free() == 0 {
                    self.pass(&mut logits);
                }
            }
        }
        self.pass(&mut logits);
        logits
    }

    fn pass(&mut self, logits: &mut Vec<f32>) {
        let rows = self.decoder.rows();
        if rows > 0 {
            self.decoder.forward(&self.weights);
            self.decoder.norm(&self.norm, 0..rows);
            let product = self.decoder.product(&self.head, 0..rows, 0..VOCABULARY);
            for row in 0..rows {
                let first = logits.len();
                logits.resize(first + VOCABULARY, 0.0);
                product.copy(row, 0, &mut logits[first..]);
            }
            self.decoder.clear();
        }
    }
}

#[test]
fn logits_are_those_of_plain_loops() {
    for model in Model::all(1) {
        let rows = model.rows(9);
        let truth = model.truth(&rows);
        let largest = truth.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        // half floats have 11 bits; bytes with a scale per column 7.5, over sums that average them
        for (weights, kv, bound) in [
            (WeightKind::F32, KvKind::F32, 1e-5),
            (WeightKind::F32, KvKind::F16, 2e-3),
            (WeightKind::F32, KvKind::Int8, 2e-2),
            (WeightKind::Int8, KvKind::F32, 5e-2),
        ] {
            let found = model.decoder(1, weights, kv).read(&[(0, &rows)]);
            assert_eq!(found.len(), truth.len());
            let error = found.iter().zip(&truth).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max) / largest;
            assert!(error < bound, "{} {weights:?} {kv:?}: {error:e}", model.name());
        }
    }
}

#[test]
fn cuts_streams_and_threads_change_no_bit() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    for (rotary, weights, kv) in [
        (false, WeightKind::F32, KvKind::F32),
        (true, WeightKind::Int8, KvKind::F16),
        (true, WeightKind::Int8, KvKind::Int8),
    ] {
        let model = Model::new(Stack { layers: 2, heads: 3, width: 48 }, 300, rotary, 2);
        let sequences: Vec<Vec<f32>> =
            [300, 211, 1, 280].iter().map(|&n| model.rows(n as u64)[..n * 48].to_vec()).collect();
        let alone: Vec<Vec<f32>> = sequences.iter().map(|s| model.decoder(1, weights, kv).read(&[(0, s)])).collect();
        for cuts in [vec![1; 300], vec![7; 50], vec![100, 1, 30, 169], vec![300]] {
            let mut decoder = model.decoder(sequences.len(), weights, kv);
            let mut read = 0;
            for n in cuts {
                let cut = |s: &[f32], width: usize| (read * width).min(s.len())..((read + n) * width).min(s.len());
                let blocks: Vec<_> = sequences.iter().map(|s| (read, &s[cut(s, 48)])).collect();
                let found = pool.install(|| decoder.read(&blocks));
                let expected: Vec<f32> = alone.iter().flat_map(|all| &all[cut(all, VOCABULARY)]).copied().collect();
                assert!(found == expected, "{} {weights:?} {kv:?}: {n} rows after {read}", model.name());
                read += n;
            }
        }
    }
}

#[test]
fn overwritten_rows_leave_no_trace() {
    for model in Model::all(3).into_iter().filter(|model| model.places >= 40) {
        let (rows, others, width) = (model.rows(1), model.rows(2), model.stack.width);
        let expected = model.decoder(1, WeightKind::F32, KvKind::F32).read(&[(0, &rows)]);
        let mut decoder = model.decoder(2, WeightKind::F32, KvKind::F32);
        decoder.read(&[(0, &rows[..9 * width]), (0, &others)]);
        decoder.read(&[(6, &others[6 * width..]), (0, &[])]);
        let found = decoder.read(&[(6, &rows[6 * width..]), (0, &rows)]);
        assert!(found == [&expected[6 * VOCABULARY..], &expected].concat(), "{}", model.name());
    }
}
