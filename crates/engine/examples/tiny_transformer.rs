//! A tiny transformer learns a verse by heart, character by character, and recites it: all parts of a training step,
//! then incremental decoding.
//!
//!     cargo run --release -p kinelm-engine --example tiny_transformer

use kinelm_engine::arena::Floats;
use kinelm_engine::bins::Bins;
use kinelm_engine::block::{self, Linear, Norm, Rules, Saved, Shape, Tensors};
use kinelm_engine::decode::{self, BlockParts, KvKind, Matrix, Run, Stack, StackDecoder, StackWeights, WeightKind};
use kinelm_engine::head::{self, Targets};
use kinelm_engine::linear::Products;
use kinelm_engine::op::adamw::{self, Step};
use kinelm_engine::op::attention::Mask;
use kinelm_engine::op::cross_entropy::RowTarget;
use kinelm_engine::op::embedding::{self, Lookup};
use kinelm_engine::op::matmul::Store;

/// The Lobster Quadrille, Lewis Carroll, 1865.
const TEXT: &str = "will you walk a little faster? said a whiting to a snail. there's a porpoise close behind us, \
and he's treading on my tail. see how eagerly the lobsters and the turtles all advance! they are waiting on the shingle, \
will you come and join the dance? will you, won't you, will you, won't you, will you join the dance? will you, won't you, \
will you, won't you, won't you join the dance? ";

/// B, T, D, H, L.
const BATCH: usize = 8;
const TOKENS: usize = 64;
const WIDTH: usize = 64;
const HEADS: usize = 4;
const LAYERS: usize = 2;
const STEPS: u64 = 150;
const SHAPE: Shape = Shape { batch: BATCH, tokens: TOKENS, width: WIDTH, heads: HEADS, hidden: 4 * WIDTH };

/// The tensors of a model, cut one after the other out of one slice of all its numbers. The head is the token table.
struct Model<T> {
    token: T,
    place: T,
    blocks: Vec<Tensors<T>>,
    norm: Norm<T>,
}

/// `take` gives the next so many numbers.
fn model<T>(vocabulary: usize, mut take: impl FnMut(usize) -> T) -> Model<T> {
    const D: usize = WIDTH;
    fn norm<T>(take: &mut impl FnMut(usize) -> T) -> Norm<T> {
        Norm { weight: take(D), bias: take(D) }
    }
    fn linear<T>(take: &mut impl FnMut(usize) -> T, k: usize, n: usize) -> Linear<T> {
        Linear { weight: take(k * n), bias: take(n) }
    }
    let (token, place) = (take(vocabulary * D), take(TOKENS * D));
    let block = |_| Tensors {
        norm1: norm(&mut take),
        qkv: linear(&mut take, D, 3 * D),
        out: linear(&mut take, D, D),
        norm2: norm(&mut take),
        up: linear(&mut take, D, 4 * D),
        down: linear(&mut take, 4 * D, D),
    };
    let blocks = (0..LAYERS).map(block).collect();
    Model { token, place, blocks, norm: norm(&mut take) }
}

/// How many numbers a model has.
fn size(vocabulary: usize) -> usize {
    let mut all = 0;
    model(vocabulary, |n| all += n);
    all
}

fn read(vocabulary: usize, mut all: &[f32]) -> Model<&[f32]> {
    model(vocabulary, |n| {
        let (taken, rest) = all.split_at(n);
        all = rest;
        taken
    })
}

fn write(vocabulary: usize, mut all: &mut [f32]) -> Model<&mut [f32]> {
    model(vocabulary, |n| {
        let (taken, rest) = std::mem::take(&mut all).split_at_mut(n);
        all = rest;
        taken
    })
}

/// Numbers in 0..1 that don't change from run to run; xorshift, Marsaglia (2003).
struct Rng(u64);

impl Rng {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn initial(vocabulary: usize, rng: &mut Rng) -> Floats {
    let mut all = Floats::new(size(vocabulary));
    all.fill_with(|| (0.2 * rng.next() - 0.1) as f32);
    let Model { blocks, norm, .. } = write(vocabulary, &mut all);
    for Norm { weight, bias } in blocks.into_iter().flat_map(|b| [b.norm1, b.norm2]).chain([norm]) {
        weight.fill(1.0);
        bias.fill(0.0);
    }
    all
}

/// The memory of a training step, taken once.
struct Trainer {
    ids: Vec<u32>,
    vocabulary: usize,
    weights: Floats,
    gradients: Floats,
    moments: [Floats; 2],
    /// (N, D) what goes into each block, and what comes out of the last.
    stream: Vec<Floats>,
    saved: Vec<Saved>,
    block: block::Workspace,
    head: head::Workspace,
    dx: Floats,
}

impl Trainer {
    fn new(ids: Vec<u32>, vocabulary: usize, weights: Floats) -> Trainer {
        let (n, all) = (SHAPE.rows(), weights.len());
        Trainer {
            ids,
            vocabulary,
            weights,
            gradients: Floats::new(all),
            moments: [Floats::new(all), Floats::new(all)],
            stream: (0..=LAYERS).map(|_| Floats::new(n * WIDTH)).collect(),
            saved: (0..LAYERS).map(|_| Saved::new(SHAPE)).collect(),
            block: block::Workspace::new(SHAPE, Products::F32, true),
            head: head::Workspace::new(n, WIDTH, vocabulary, Products::F32, true),
            dx: Floats::new(n * WIDTH),
        }
    }

    /// One step on windows that begin anywhere; the loss in nats a character.
    fn step(&mut self, number: u64, rng: &mut Rng) -> f64 {
        let n = SHAPE.rows();
        let count = self.vocabulary as u32;
        let starts = (0..BATCH).map(|_| (rng.next() * (self.ids.len() - TOKENS) as f64) as usize);
        let (inputs, targets): (Vec<u32>, Vec<RowTarget>) = starts
            .flat_map(|start| start..start + TOKENS)
            .map(|i| (self.ids[i], RowTarget { target: self.ids[i + 1], first: 0, count, bins: Bins::NONE }))
            .unzip();
        let places: Vec<u32> = (0..TOKENS as u32).collect();
        let rules = Rules { mask: Mask::Causal, dropout: None, rope: None };
        let weights = read(self.vocabulary, &self.weights);

        let lookups = [Lookup { table: weights.token, ids: &inputs }, Lookup { table: weights.place, ids: &places }];
        embedding::forward(&mut self.stream[0], WIDTH, 0, &lookups);
        for (layer, block) in weights.blocks.iter().enumerate() {
            let (from, to) = self.stream.split_at_mut(layer + 1);
            block::forward(&mut to[0], &from[layer], block, rules, &mut self.saved[layer], &mut self.block);
        }

        let mut to = write(self.vocabulary, &mut self.gradients);
        let targets = Targets { targets: &targets, smoothing: None, scale: 1.0 / n as f32 };
        let mut gradients = head::Gradients { dx: &mut self.dx, norm: to.norm, head: to.token };
        let last = &self.stream[LAYERS];
        let nats = head::loss(last, weights.norm, weights.token, targets, &mut gradients, Store::Set, &mut self.head);
        for (layer, gradients) in to.blocks.iter_mut().enumerate().rev() {
            let (x, block, saved) = (&self.stream[layer], &weights.blocks[layer], &self.saved[layer]);
            block::backward(&mut self.dx, x, block, gradients, Store::Set, rules, saved, &mut self.block);
        }
        // the table is the head too: its gradients add up
        embedding::backward(to.token, WIDTH, &inputs, &self.dx);
        to.place.fill(0.0);
        let places: Vec<u32> = (0..n as u32).map(|row| row % TOKENS as u32).collect();
        embedding::backward(to.place, WIDTH, &places, &self.dx);

        let [first, second] = &mut self.moments;
        let step = Step::new(number, 3e-3, [0.9, 0.99], 1e-8, 0.01, 1.0);
        adamw::update(&mut self.weights, first, second, &self.gradients, &step);
        nats / n as f64
    }
}

/// The model for decoding a token at a time.
struct Decoder<'a> {
    model: Model<&'a [f32]>,
    weights: StackWeights,
    norm: decode::Norm,
    head: Matrix,
    stack: StackDecoder,
    logits: Vec<f32>,
}

impl Decoder<'_> {
    fn new(vocabulary: usize, weights: &[f32]) -> Decoder<'_> {
        let model = read(vocabulary, weights);
        let blocks = model.blocks.iter().map(|b| BlockParts {
            norm1: (b.norm1.weight, b.norm1.bias),
            qkv: (b.qkv.weight, b.qkv.bias),
            out: (b.out.weight, b.out.bias),
            norm2: (b.norm2.weight, b.norm2.bias),
            up: (b.up.weight, b.up.bias),
            down: (b.down.weight, b.down.bias),
        });
        let blocks: Vec<_> = blocks.collect();
        let stack = Stack { layers: LAYERS, heads: HEADS, width: WIDTH };
        let weights = StackWeights::new(&blocks, stack, WeightKind::F32, None);
        let head = Matrix::transposed(model.token, vocabulary, WIDTH, WeightKind::F32);
        Decoder {
            norm: decode::Norm::new((model.norm.weight, model.norm.bias), WIDTH),
            stack: StackDecoder::new(&weights, KvKind::F32, 1, TOKENS, 1, vocabulary),
            logits: vec![0.0; vocabulary],
            model,
            weights,
            head,
        }
    }

    /// Logits of what follows `id` at `place`.
    fn read(&mut self, id: u32, place: usize) -> &[f32] {
        self.stack.push(Run { stream: 0, place, rows: 1 });
        let (token, position) = (&self.model.token[id as usize * WIDTH..], &self.model.place[place * WIDTH..]);
        let row = self.stack.rows_mut(0).iter_mut();
        row.zip(token.iter().zip(position)).for_each(|(x, (token, position))| *x = token + position);
        self.stack.forward(&self.weights);
        self.stack.norm(&self.norm, 0..1);
        self.stack.product(&self.head, 0..1, 0..self.logits.len()).copy(0, 0, &mut self.logits);
        self.stack.clear();
        &self.logits
    }
}

/// An id by its probability, the logits divided by a temperature.
fn sample(logits: &[f32], temperature: f64, rng: &mut Rng) -> u32 {
    let top = logits.iter().fold(f32::MIN, |a, b| a.max(*b));
    let weights: Vec<f64> = logits.iter().map(|x| (f64::from(x - top) / temperature).exp()).collect();
    let mut left = rng.next() * weights.iter().sum::<f64>();
    let passed = |weight: &f64| {
        left -= weight;
        left < 0.0
    };
    weights.iter().position(passed).unwrap_or(0) as u32
}

fn main() {
    let mut letters: Vec<char> = TEXT.chars().collect();
    letters.sort_unstable();
    letters.dedup();
    let ids: Vec<u32> = TEXT.chars().filter_map(|c| letters.binary_search(&c).ok()).map(|i| i as u32).collect();
    let mut rng = Rng(1);
    let weights = initial(letters.len(), &mut rng);
    println!("{} characters of {} kinds, {} parameters", ids.len(), letters.len(), weights.len());

    let mut trainer = Trainer::new(ids, letters.len(), weights);
    for number in 1..=STEPS {
        let nats = trainer.step(number, &mut rng);
        if number == 1 || number % 25 == 0 {
            println!("step {number:>3}: {nats:.3} nats a character");
        }
    }

    let mut decoder = Decoder::new(letters.len(), &trainer.weights);
    let mut next = trainer.ids[0];
    let mut text = String::new();
    for place in 0..TOKENS {
        text.push(letters[next as usize]);
        next = sample(decoder.read(next, place), 0.5, &mut rng);
    }
    println!("sampled: {text}");
}
