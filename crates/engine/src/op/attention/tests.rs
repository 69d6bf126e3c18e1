use super::softmax::{Bias, Drops, Softmax, SoftmaxBack};
use super::*;
use crate::op::check::{Lanes, numbers};
use crate::op::dropout::kept;
use crate::scalar::attention as scalar;
use proptest::prelude::*;

/// Largest difference over largest magnitude.
const APART: f64 = 1e-5;

/// A part's largest magnitude counts as at least this share of the whole's: where each query sees a single key, the
/// gradients of queries and keys are differences of equal numbers.
const SMALL: f64 = 0.1;

#[track_caller]
fn near(what: &str, found: &[f32], expected: &[f64], of_the_whole: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest = greatest(expected).max(SMALL * of_the_whole);
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        let apart = (*f as f64 - e).abs();
        assert!(apart <= APART * largest, "{what}, number {i}: {f}, expected {e}, largest {largest}");
    }
}

fn greatest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs()))
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|x| *x as f64).collect()
}

fn run(shape: Shape, qkv: &[f32], d_out: &[f32], rules: Rules) -> [Vec<f32>; 3] {
    run_in(Products::F32, shape, qkv, d_out, rules)
}

/// Forward and backward from buffers full of what must not shine through.
fn run_in(products: Products, shape: Shape, qkv: &[f32], d_out: &[f32], rules: Rules) -> [Vec<f32>; 3] {
    let (n, space) = (shape.rows() * shape.columns(), Workspace::new(shape, products));
    let [mut out, mut log_sums, mut d_qkv] = [n, shape.rows() * shape.heads, 3 * n].map(|n| vec![f32::NAN; n]);
    for _ in 0..2 {
        forward(shape, qkv, rules, &space, &mut out, &mut log_sums);
        let done = Done { qkv, out: &out, log_sums: &log_sums, d_out };
        backward(shape, done, rules, &space, &mut d_qkv);
    }
    [out, log_sums, d_qkv]
}

fn factors(shape: Shape, dropout: Dropout) -> Vec<f64> {
    let t = shape.tokens;
    let factor = |i: usize| {
        let (sequence, row, column) = (i / t / t / shape.heads, i / t % (shape.heads * t), i % t);
        match kept(dropout.keys[sequence], row as u64, column as u32, threshold(dropout.share)) {
            true => 1.0 / (1.0 - dropout.share),
            false => 0.0,
        }
    };
    (0..shape.pieces() * t * t).map(factor).collect()
}

fn check(shape: Shape, rules: Rules, seed: u64, range: f32) {
    let qkv = numbers(seed, shape.rows() * 3 * shape.columns(), range);
    let d_out = numbers(seed + 1, shape.rows() * shape.columns(), 1.0);
    let [out, _, d_qkv] = run(shape, &qkv, &d_out, rules);
    let factors = rules.dropout.map(|dropout| factors(shape, dropout));
    let wide_qkv = wide(&qkv);
    let expected = scalar::forward(shape, &wide_qkv, rules.mask, factors.as_deref());
    let d_expected = scalar::backward(shape, &wide_qkv, &expected, factors.as_deref(), &wide(&d_out));
    let what = match rules.mask {
        Mask::Additive(mask) => format!("{shape:?}, a mask of {}, {:?}", mask.len(), rules.dropout),
        Mask::CausalAdditive(mask) => format!("{shape:?}, a causal mask of {}, {:?}", mask.len(), rules.dropout),
        _ => format!("{shape:?}, {rules:?}"),
    };
    near(&what, &out, &expected.out, 0.0);
    let size = shape.tokens * shape.width;
    for (part, name) in ["queries", "keys", "values"].into_iter().enumerate() {
        let found: Vec<f32> = d_qkv.chunks(size).skip(part).step_by(3).flatten().copied().collect();
        let expected: Vec<f64> = d_expected.chunks(size).skip(part).step_by(3).flatten().copied().collect();
        near(&format!("{what}, {name}"), &found, &expected, greatest(&d_expected));
    }
}

/// Numbers with every third hidden, the second row and, if there is one, the last wholly.
fn mask(seed: u64, shape: Shape, len: usize) -> Vec<f32> {
    let mut mask = numbers(seed, len, 2.0);
    // of -2..2, a third
    mask.iter_mut().filter(|x| x.abs() < 0.66).for_each(|x| *x = f32::NEG_INFINITY);
    for row in [1, len / shape.tokens - 1] {
        mask.chunks_mut(shape.tokens).skip(row).take(1).for_each(|row| row.fill(f32::NEG_INFINITY));
    }
    mask
}

fn check_all(shape: Shape, seed: u64) {
    let keys: Vec<u64> = (0..shape.batch as u64).map(|b| seed * 77 + b).collect();
    let dropped = Dropout { keys: &keys, share: 0.2 };
    let square = shape.tokens * shape.tokens;
    let (shared, own) = (mask(seed, shape, square), mask(seed, shape, shape.batch * square));
    for dropout in [None, Some(dropped)] {
        let additive = [Mask::Additive(&shared), Mask::Additive(&own)];
        let causal = [Mask::CausalAdditive(&shared), Mask::CausalAdditive(&own)];
        for mask in [Mask::Causal, Mask::Full].into_iter().chain(additive).chain(causal) {
            check(shape, Rules { mask, dropout }, seed, 1.5);
        }
    }
}

#[test]
fn lengths_that_fit_no_tile_are_what_plain_loops_give() {
    for (tokens, width) in [(1, 1), (2, 8), (7, 5), (24, 32), (65, 32), (130, 8), (193, 5), (257, 64), (400, 1)] {
        check_all(Shape { batch: 1, tokens, heads: 1, width }, tokens as u64);
    }
    check_all(Shape { batch: 3, tokens: 50, heads: 2, width: 16 }, 5);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn any_shape_is_what_plain_loops_give(batch in 1..4usize, tokens in 1..200usize, heads in 1..4usize, width in 1..70usize, seed in 0..1000u64) {
        let tokens = tokens.min(250 / batch);
        check_all(Shape { batch, tokens, heads, width }, seed);
    }
}

/// How far numbers rounded to bf16 lead attention away, of the largest number: 8 bits of each factor.
const ROUNDED: f64 = 0.02;

#[test]
fn attention_in_bf16_is_that_of_plain_loops_up_to_the_rounding() {
    let keys = [9, 10];
    let kinds = [Products::Rounded, Products::bf16()];
    for products in kinds {
        for (tokens, heads, width) in [(1, 1, 5), (31, 2, 32), (33, 1, 16), (130, 2, 33), (193, 1, 64), (400, 1, 8)] {
            let shape = Shape { batch: 2, tokens, heads, width };
            let qkv = numbers(tokens as u64, shape.rows() * 3 * shape.columns(), 1.5);
            let d_out = numbers(3, shape.rows() * shape.columns(), 1.0);
            let hidden = mask(5, shape, tokens * tokens);
            let dropout = Some(Dropout { keys: &keys, share: 0.2 });
            let masks = [(Mask::Causal, None), (Mask::Causal, dropout), (Mask::Full, None)];
            for (mask, dropout) in masks.into_iter().chain([(Mask::CausalAdditive(&hidden), None)]) {
                let rules = Rules { mask, dropout };
                let [out, _, d_qkv] = run_in(products, shape, &qkv, &d_out, rules);
                let factors = dropout.map(|dropout| factors(shape, dropout));
                let truth = scalar::forward(shape, &wide(&qkv), mask, factors.as_deref());
                let slopes = scalar::backward(shape, &wide(&qkv), &truth, factors.as_deref(), &wide(&d_out));
                for (what, found, truth) in [("out", &out, &truth.out), ("gradients", &d_qkv, &slopes)] {
                    let most = greatest(truth);
                    let apart = found.iter().zip(truth).map(|(f, t)| (*f as f64 - t).abs()).fold(0.0, f64::max);
                    assert!(apart <= ROUNDED * most, "{products:?} {shape:?}, {what}: {apart:e} of {most}");
                }
            }
        }
    }
}

#[test]
fn large_scores_stay_numbers() {
    let shape = Shape { batch: 1, tokens: 300, heads: 1, width: 4 };
    for scale in [30.0, 1e4] {
        let qkv = numbers(3, shape.rows() * 3 * shape.columns(), scale);
        let [out, _, d_qkv] =
            run(shape, &qkv, &vec![1.0; shape.rows() * 4], Rules { mask: Mask::Causal, dropout: None });
        assert!(out.iter().chain(&d_qkv).all(|x| x.is_finite()), "scale {scale}");
        assert!(out.iter().all(|x| x.abs() <= scale), "means of values above the largest");
    }
}

#[test]
fn a_query_that_sees_nothing_has_no_output_and_no_gradient() {
    let shape = Shape { batch: 2, tokens: 210, heads: 2, width: 4 };
    let qkv = numbers(3, shape.rows() * 3 * shape.columns(), 1.0);
    let d_out = numbers(4, shape.rows() * shape.columns(), 1.0);
    let mask = vec![f32::NEG_INFINITY; 210 * 210];
    let [out, log_sums, d_qkv] = run(shape, &qkv, &d_out, Rules { mask: Mask::Additive(&mask), dropout: None });
    assert!(out.iter().chain(&d_qkv).all(|x| *x == 0.0));
    assert!(log_sums.iter().all(|x| *x == f32::INFINITY));
}

#[test]
fn what_is_no_number_shows() {
    let shape = Shape { batch: 1, tokens: 30, heads: 1, width: 4 };
    let mut qkv = numbers(3, shape.rows() * 12, 1.0);
    qkv[12 * 20] = f32::NAN;
    let [out, ..] = run(shape, &qkv, &[1.0; 120], Rules { mask: Mask::Causal, dropout: None });
    assert!(out[..80].iter().all(|x| x.is_finite()) && out[80..84].iter().all(|x| x.is_nan()));
}

#[test]
fn threads_change_no_bit() {
    let shapes = [(1, 700, 1, 16), (3, 100, 2, 8)];
    let products = [Products::F32, Products::bf16()];
    for ((batch, tokens, heads, width), products) in shapes.into_iter().flat_map(|shape| products.map(|p| (shape, p))) {
        let shape = Shape { batch, tokens, heads, width };
        let qkv = numbers(1, shape.rows() * 3 * shape.columns(), 1.0);
        let d_out = numbers(2, shape.rows() * shape.columns(), 1.0);
        let keys: Vec<u64> = (0..batch as u64).collect();
        let rules = Rules { mask: Mask::Causal, dropout: Some(Dropout { keys: &keys, share: 0.1 }) };
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| run_in(products, shape, &qkv, &d_out, rules))
        };
        let one = on(1);
        assert!(on(2) == one && on(3) == one, "{shape:?}");
    }
}

#[test]
fn gather_brings_heads_back_into_rows() {
    let shape = Shape { batch: 2, tokens: 3, heads: 2, width: 2 };
    // (B, H, P, T, d): each number is its index
    let heads: Vec<f32> = (0..2 * 2 * 3 * 3 * 2).map(|i| i as f32).collect();
    let mut rows = vec![0.0; 2 * 3 * 2 * 2];
    gather(shape, 3, &heads, 2..4, &mut rows);
    let expected = |b: usize, t: usize| {
        let place = move |p: usize, h: usize, i: usize| ((((b * 2 + h) * 3 + p) * 3 + t) * 2 + i) as f32;
        (0..3).flat_map(move |p| (0..2).flat_map(move |h| (0..2).map(move |i| place(p, h, i))))
    };
    assert!(rows.iter().copied().eq(expected(0, 2).chain(expected(1, 0))), "{rows:?}");
    gather(shape, 1, &heads[..24], 6..6, &mut []);
}

/// The passes over a tile on vectors of every width, against those dispatched.
#[test]
fn every_width_of_vector_gives_the_same_softmax() {
    for columns in (1..=67).chain([192]) {
        let tile = Tile { query: 10, rows: 3, key: 0, columns, causal: columns < 40 };
        let (scores, changes) = (numbers(1, 3 * ROW, 9.0), numbers(2, 3 * ROW, 1.0));
        let hidden = mask(3, Shape { batch: 1, tokens: columns, heads: 1, width: 1 }, 3 * columns);
        let bias = (columns % 2 == 0).then_some(Bias { numbers: &hidden, stride: columns });
        let drops = (columns % 3 == 0).then_some(Drops {
            key: 1,
            row: 7,
            column: 5,
            threshold: threshold(0.3),
            growth: growth(0.3),
        });
        let on = |lanes: Lanes| {
            let (mut weights, mut out, mut largest, mut sums) = (scores.clone(), [1.0; 6], [-1e9; 3], [0.0; 3]);
            lanes.run(Softmax {
                tile,
                scores: &mut weights,
                bias,
                drops,
                largest: &mut largest,
                sums: &mut sums,
                out: &mut out,
            });
            let (mut again, mut d_scores) = (scores.clone(), changes.clone());
            let log_sums: Vec<f32> = largest.iter().zip(sums).map(|(m, s)| m + s.ln()).collect();
            let means = [0.1, 0.2, -0.3];
            lanes.run(SoftmaxBack {
                tile,
                scores: &mut again,
                changes: &mut d_scores,
                bias,
                drops,
                log_sums: &log_sums,
                means: &means,
            });
            let seen = |x: Vec<f32>| wide(&x.chunks(ROW).flat_map(|row| row[..columns].to_vec()).collect::<Vec<f32>>());
            [seen(weights), wide(&largest), wide(&sums), seen(again), seen(d_scores)]
        };
        let expected = on(Lanes::Dispatched);
        for lanes in Lanes::ALL {
            for (found, expected) in on(lanes).iter().zip(&expected) {
                let apart = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(apart <= 1e-5, "{lanes:?}, {columns} columns: {found:?}, dispatched {expected:?}");
            }
        }
    }
}
