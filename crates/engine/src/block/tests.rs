//! A block and a head against f64 loops, their gradients against differences of those.

use super::*;
use crate::bins::Bins;
use crate::head;
use crate::linear::Products;
use crate::op::attention::Mask;
use crate::op::check::numbers;
use crate::op::cross_entropy::RowTarget;
use crate::op::matmul::Store;
use crate::op::rope::{Angles, Rope};
use crate::scalar::block as plain;

/// Of a tensor's largest gradient; f32 sums of some hundred terms, and what differences in f64 leave.
const BOUND: f64 = 1e-5;
const VOCABULARY: usize = 37;
const CAUSAL: Rules = Rules { mask: Mask::Causal, dropout: None, rope: None };

/// One tensor after the other, in a fixed order.
fn each<T>(t: &Tensors<T>) -> [&T; 12] {
    let Tensors { norm1, qkv, out, norm2, up, down } = t;
    [
        &norm1.weight,
        &norm1.bias,
        &qkv.weight,
        &qkv.bias,
        &out.weight,
        &out.bias,
        &norm2.weight,
        &norm2.bias,
        &up.weight,
        &up.bias,
        &down.weight,
        &down.bias,
    ]
}

fn tensors(shape: Shape) -> Tensors<Vec<f32>> {
    let (d, m) = (shape.width, shape.hidden);
    let norm = |seed| Norm { weight: numbers(seed, d, 1.0), bias: numbers(seed + 1, d, 0.5) };
    let linear = |seed, k, n| Linear { weight: numbers(seed, k * n, 0.4), bias: numbers(seed + 1, n, 0.4) };
    Tensors {
        norm1: norm(1),
        qkv: linear(3, d, 3 * d),
        out: linear(5, d, d),
        norm2: norm(7),
        up: linear(9, d, m),
        down: linear(11, m, d),
    }
}

fn map<T, U>(t: &Tensors<T>, f: impl Fn(&T) -> U) -> Tensors<U> {
    let norm = |n: &Norm<T>| Norm { weight: f(&n.weight), bias: f(&n.bias) };
    let linear = |l: &Linear<T>| Linear { weight: f(&l.weight), bias: f(&l.bias) };
    Tensors {
        norm1: norm(&t.norm1),
        qkv: linear(&t.qkv),
        out: linear(&t.out),
        norm2: norm(&t.norm2),
        up: linear(&t.up),
        down: linear(&t.down),
    }
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|x| *x as f64).collect()
}

/// What a loss of everything is made of, in f64.
struct Model {
    shape: Shape,
    x: Vec<f64>,
    weights: Tensors<Vec<f64>>,
    norm: Norm<Vec<f64>>,
    head: Vec<f64>,
    targets: Vec<u32>,
    words: Vec<u32>,
}

impl Model {
    fn loss(&self, mask: Mask) -> f64 {
        let out = plain::forward(&self.x, self.shape, &self.weights, mask, &self.words);
        plain::loss(&out, &self.norm, &self.head, &self.targets)
    }

    fn tensor(&mut self, which: usize) -> &mut Vec<f64> {
        let Tensors { norm1, qkv, out, norm2, up, down } = &mut self.weights;
        let all = [
            &mut norm1.weight,
            &mut norm1.bias,
            &mut qkv.weight,
            &mut qkv.bias,
            &mut out.weight,
            &mut out.bias,
            &mut norm2.weight,
            &mut norm2.bias,
            &mut up.weight,
            &mut up.bias,
            &mut down.weight,
            &mut down.bias,
            &mut self.x,
            &mut self.norm.weight,
            &mut self.norm.bias,
            &mut self.head,
        ];
        all.into_iter().nth(which).unwrap()
    }
}

fn check(shape: Shape, mask: Mask, words: &[u32]) {
    let n = shape.rows();
    let x = numbers(20, n * shape.width, 1.0);
    let weights = map(&tensors(shape), |t| Floats::of(t));
    let norm = [numbers(21, shape.width, 1.0), numbers(22, shape.width, 0.5)];
    let head = numbers(23, VOCABULARY * shape.width, 0.5);
    let targets: Vec<u32> = (0..n as u32).map(|i| (i * 7) % VOCABULARY as u32).collect();
    let mut model = Model {
        shape,
        x: wide(&x),
        weights: map(&tensors(shape), |t| wide(t)),
        norm: Norm { weight: wide(&norm[0]), bias: wide(&norm[1]) },
        head: wide(&head),
        targets: targets.clone(),
        words: words.to_vec(),
    };
    let angles = (!words.is_empty()).then(|| Angles::new(9, shape.width / shape.heads));
    let rules = Rules { mask, dropout: None, rope: angles.as_ref().map(|angles| Rope { angles, words }) };
    let target_of = |&target: &u32| RowTarget { target, first: 0, count: VOCABULARY as u32, bins: Bins::NONE };
    let targets: Vec<RowTarget> = targets.iter().map(target_of).collect();

    let (mut saved, mut space) = (Saved::new(shape), Workspace::new(shape, Products::F32, true));
    let mut head_space = head::Workspace::new(n, shape.width, VOCABULARY, Products::F32, true);
    let mut out = vec![f32::NAN; x.len()];
    forward(&mut out, &x, &weights.each_ref(), rules, &mut saved, &mut space);
    let mut gradients = map(&weights, |t| Floats::of(&vec![f32::NAN; t.len()]));
    let (mut dx, mut d_head) = (vec![f32::NAN; x.len()], vec![f32::NAN; head.len()]);
    let [mut dw, mut db] = [vec![f32::NAN; shape.width], vec![f32::NAN; shape.width]];
    let of_norm = Norm { weight: norm[0].as_slice(), bias: norm[1].as_slice() };
    let mut of_head = head::Gradients { dx: &mut dx, norm: Norm { weight: &mut dw, bias: &mut db }, head: &mut d_head };
    let targets = head::Targets { targets: &targets, smoothing: None, scale: 1.0 };
    let nats = head::loss(&out, of_norm, &head, targets, &mut of_head, Store::Set, &mut head_space);
    let mut each_gradient = gradients.each_mut();
    backward(&mut dx, &x, &weights.each_ref(), &mut each_gradient, Store::Set, rules, &saved, &mut space);

    let expected = model.loss(mask);
    assert!((nats - expected).abs() <= BOUND * expected, "{shape:?}: {nats} nats, expected {expected}");
    let found: Vec<&[f32]> = each(&gradients).map(|t| &**t).into_iter().chain([&dx[..], &dw, &db, &d_head]).collect();
    for (which, found) in found.into_iter().enumerate() {
        // tensors whose gradients are differences of equal numbers get a floor, or any rounding would fail
        let largest = found.iter().fold(1e-2, |m: f32, g| m.max(g.abs())) as f64;
        for i in (0..6).map(|k| k * (found.len() - 1) / 5) {
            let mut moved = |by: f64| {
                model.tensor(which)[i] += by;
                let loss = model.loss(mask);
                model.tensor(which)[i] -= by;
                loss
            };
            // h^4 is 1e-16, as small as f64's roundings; of the divisions by h, 1e-12 remains
            let h = 1e-4;
            // of fourth order: the error is some h^4
            let near = (moved(h) - moved(-h)) / (2.0 * h);
            let far = (moved(2.0 * h) - moved(-2.0 * h)) / (4.0 * h);
            let expected = (4.0 * near - far) / 3.0;
            let apart = (found[i] as f64 - expected).abs();
            assert!(
                apart <= BOUND * largest,
                "{shape:?}: tensor {which}, number {i}: {}, differences say {expected}",
                found[i]
            );
        }
    }
}

#[test]
fn every_gradient_is_what_differences_say() {
    check(Shape { batch: 2, tokens: 9, width: 8, heads: 2, hidden: 20 }, Mask::Causal, &[]);
    check(Shape { batch: 1, tokens: 1, width: 6, heads: 1, hidden: 24 }, Mask::Causal, &[]);
    check(Shape { batch: 2, tokens: 7, width: 12, heads: 2, hidden: 20 }, Mask::Causal, &[0, 1, 1, 2, 2, 8, 3]);
    check(Shape { batch: 2, tokens: 3, width: 8, heads: 1, hidden: 20 }, Mask::Full, &[0, 1, 1, 4, 0, 7]);
    check(Shape { batch: 1, tokens: 70, width: 10, heads: 5, hidden: 7 }, Mask::Full, &[]);
    let hidden: Vec<f32> =
        numbers(30, 11 * 11, 1.0).iter().map(|x| if *x < 0.0 { f32::NEG_INFINITY } else { *x }).collect();
    check(Shape { batch: 3, tokens: 11, width: 9, heads: 3, hidden: 36 }, Mask::Additive(&hidden), &[]);
}

#[test]
fn gradients_of_two_batches_add_up() {
    let shape = Shape { batch: 1, tokens: 5, width: 8, heads: 2, hidden: 16 };
    let weights = map(&tensors(shape), |t| Floats::of(t));
    let (mut saved, mut space) = (Saved::new(shape), Workspace::new(shape, Products::F32, true));
    let x = numbers(20, 40, 1.0);
    let mut out = vec![0.0; 40];
    forward(&mut out, &x, &weights.each_ref(), CAUSAL, &mut saved, &mut space);
    let mut run = |times: usize| {
        let mut gradients = map(&weights, |t| Floats::new(t.len()));
        for i in 0..times {
            let store = if i == 0 { Store::Set } else { Store::Add };
            let (mut dx, mut to) = (numbers(21, 40, 1.0), gradients.each_mut());
            backward(&mut dx, &x, &weights.each_ref(), &mut to, store, CAUSAL, &saved, &mut space);
        }
        each(&gradients).map(|t| t.to_vec()).concat()
    };
    let (once, twice) = (run(1), run(2));
    assert!(once.iter().zip(&twice).all(|(a, b)| (2.0 * a - b).abs() <= 1e-5 * b.abs().max(1.0)));
}

#[test]
fn rows_that_are_not_there_are_told_and_not_skipped() {
    let shape = Shape { batch: 1, tokens: 130, width: 4, heads: 2, hidden: 8 };
    let weights = map(&tensors(shape), |t| Floats::of(t));
    let forward = |rows: usize, saved: Shape| {
        let (mut saved, mut space) = (Saved::new(saved), Workspace::new(shape, Products::F32, false));
        let (mut out, x) = (vec![0.0; shape.rows() * shape.width], vec![0.0; rows * shape.width]);
        let pass = || forward(&mut out, &x, &weights.each_ref(), CAUSAL, &mut saved, &mut space);
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(pass)).is_ok()
    };
    assert!(forward(130, shape));
    assert!(!forward(65, shape));
    assert!(!forward(130, Shape { tokens: 120, ..shape }));
}
