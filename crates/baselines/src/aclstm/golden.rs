//! The network and its updates against PyTorch and plain tensor operations.

use super::network::Learner;
use super::plain;
use crate::PartWeights;
use crate::form::Form;
use candle_core::{Device, Tensor};
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::{Lstm, Shape, Wiring};
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    width: usize,
    layers: usize,
    batch: usize,
    rate: f64,
    given: Vec<bool>,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    form: Form,
    compat: bool,
    channels: usize,
    outputs: Vec<f64>,
    gradients: Vec<Vec<f64>>,
    losses: Vec<f64>,
}

/// f32 over some steps.
const BOUND: f64 = 3e-6;

#[track_caller]
fn near(what: &str, found: &[f32], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let most = expected.iter().fold(1e-3, |most: f64, x| most.max(x.abs()));
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!((*f as f64 - e).abs() <= BOUND * most.max(1.0), "{what}, number {i}: {f}, expected {e}");
    }
}

/// As scripts/reference/aclstm.py makes them.
fn numbers(salt: usize, len: usize) -> Vec<f32> {
    (0..len).map(|k| (0.4 * (1.7 * k as f64 + 0.9 * salt as f64).sin()) as f32).collect()
}

fn wiring(compat: bool) -> Wiring {
    if compat { Wiring::Compat } else { Wiring::Fixed }
}

#[test]
fn outputs_gradients_and_ten_losses_are_pytorchs() {
    let golden: Golden = serde_json::from_str(include_str!("../../tests/golden/aclstm.json")).unwrap();
    assert_eq!(golden.cases.len(), 6);
    let Golden { width, layers, batch, rate, given, cases } = golden;
    for case in cases {
        let Case { form, compat, channels, outputs, gradients, losses } = case;
        let what = format!("{form:?}, {:?}", wiring(compat));
        let shape = Shape { channels, width, layers, wiring: wiring(compat) };
        let sizes = shape.tensors().into_iter().enumerate();
        let weights: Vec<Floats> = sizes.map(|(salt, [r, c])| Floats::of(&numbers(salt, r * c))).collect();
        let row = batch * channels;
        let sequence = |step: usize| numbers(100 + step, (given.len() + 1) * row);
        let mut lstm = Lstm::new(shape, batch, given.len(), false);
        lstm.pack(&weights);
        near(&what, lstm.forward(&sequence(0)[..given.len() * row], &given), &outputs);
        let mut learner = Learner::new(form, PartWeights::EVEN, shape, batch, given.len(), weights);
        for (step, expected) in losses.iter().enumerate() {
            let sequence = sequence(step);
            let found = learner.gradients(&sequence[..given.len() * row], &sequence[row..], &given).loss;
            assert!((found - expected).abs() < 2e-5, "{what}, step {step}: {found}, expected {expected}");
            if step == 0 {
                for (i, (found, expected)) in learner.parameters.optimizer.gradients.iter().zip(&gradients).enumerate()
                {
                    near(&format!("{what}, tensor {i}"), found, expected);
                }
            }
            learner.parameters.update(rate, None);
        }
    }
}

#[test]
fn the_engine_is_the_plain_form() {
    let mut rng = kinelm_store::random::stream(3, "plain", 0, 0);
    let mut random =
        |len: usize| (0..len).map(|_| 0.3 * kinelm_store::random::normal(&mut rng) as f32).collect::<Vec<f32>>();
    for (channels, width, layers, batch, mask) in
        [(9, 40, 3, 4, "gggffggff"), (5, 130, 2, 1, "gffffff"), (3, 7, 1, 3, "gggg")]
    {
        for compat in [false, true] {
            let shape = Shape { channels, width, layers, wiring: wiring(compat) };
            let given: Vec<bool> = mask.chars().map(|c| c == 'g').collect();
            let weights: Vec<Floats> = shape.tensors().iter().map(|[r, c]| Floats::of(&random(r * c))).collect();
            let size = (given.len(), batch, channels);
            let len = given.len() * batch * channels;
            let (inputs, d_out) = (random(len), random(len));
            let wide = |x: &[f32]| x.iter().map(|x| *x as f64).collect::<Vec<f64>>();
            let tensor = |x: &[f32]| Tensor::from_vec(wide(x), size, &Device::Cpu).unwrap();
            let plain: Vec<Vec<f64>> = weights.iter().map(|w| wide(w)).collect();
            let (outputs, gradients) =
                plain::outputs_and_gradients(&shape, &plain, &tensor(&inputs), &given, &tensor(&d_out)).unwrap();
            let mut lstm = Lstm::new(shape, batch, given.len(), true);
            lstm.pack(&weights);
            near(&format!("{shape:?}"), lstm.forward(&inputs, &given), &outputs);
            let mut found: Vec<Floats> = weights.iter().map(|w| Floats::new(w.len())).collect();
            lstm.backward(&d_out, &mut found);
            for (i, (found, expected)) in found.iter().zip(&gradients).enumerate() {
                near(&format!("{shape:?}, tensor {i}"), found, expected);
            }
        }
    }
}
