//! The network, its losses and its updates against PyTorch.

use super::SPECTRUM;
use super::config::{Effort, Pose, Shape};
use super::loss::{Terms, loss};
use super::network::{Dropout, Network, list};
use crate::PartWeights;
use crate::train::Parameters;
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::TeacherForcing;
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    rate: f64,
    clip: f64,
    stride: usize,
    #[serde(rename = "told")]
    forced: Vec<bool>,
    weights: Vec<f64>,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    pose: Pose,
    effort: Effort,
    outputs: Vec<f64>,
    gradients: Vec<Vec<f64>>,
    losses: Vec<f64>,
}

const BATCH: usize = 2;
/// Of a tensor's largest number: f32 over some steps, and an angle's slope by numbers that are rounded to it.
const BOUND: f64 = 2e-5;

#[track_caller]
fn near(what: &str, found: &[f32], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let most = expected.iter().fold(1e-6, |most: f64, x| most.max(x.abs()));
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!((f64::from(*f) - e).abs() <= BOUND * most, "{what}, number {i}: {f}, expected {e}");
    }
}

/// As scripts/reference/music_lstm.py makes them.
fn numbers(salt: usize, amplitude: f64, len: usize) -> Vec<f32> {
    (0..len).map(|k| (amplitude * (1.7 * k as f64 + 0.9 * salt as f64).sin()) as f32).collect()
}

fn unit(numbers: &[f32]) -> Vec<f32> {
    let of = |q: &[f32]| {
        let length = q.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
        q.iter().map(|x| (f64::from(*x) / length) as f32).collect::<Vec<_>>()
    };
    numbers.chunks_exact(4).flat_map(of).collect()
}

#[test]
fn outputs_gradients_and_ten_losses_are_pytorchs() {
    let golden: Golden = serde_json::from_str(include_str!("../../tests/golden/music_lstm.json")).unwrap();
    assert_eq!(golden.cases.len(), 4);
    let steps = golden.forced.len();
    let shape = Shape { encoder: vec![5], width: 4, layers: 2, joints: golden.weights.len() };
    let (row, no_dropout) = (BATCH * shape.channels(), Dropout { share: 0.0, keys: &[] });
    for case in golden.cases {
        let what = format!("{:?} {:?}", case.pose, case.effort);
        let learned = list(&shape).into_iter().skip(2).enumerate();
        let learned = learned.map(|(salt, p)| Floats::of(&numbers(salt, 0.4, p.len())));
        let weights = [Floats::new(SPECTRUM), Floats::of(&[1.0; SPECTRUM])].into_iter().chain(learned).collect();
        let mut network = Network::new(&shape, BATCH, steps, true);
        let mut parameters = Parameters::new(list(&shape), weights);
        let mut d_out = vec![0.0; steps * row];
        for (step, expected) in case.losses.iter().enumerate() {
            let spectra = numbers(50 + step, 0.02, BATCH * steps * SPECTRUM);
            let poses = unit(&numbers(100 + step, 0.4, (steps + 1) * row));
            let forced = TeacherForcing { steps: &golden.forced, rows: &poses[..steps * row] };
            network.pack(&parameters.weights);
            network.rest();
            let outputs = network.forward(&parameters.weights, &spectra, forced, no_dropout);
            let terms =
                Terms { pose: case.pose, effort: case.effort, parts: PartWeights::EVEN, weights: &golden.weights };
            let found = loss(terms, BATCH, outputs, &poses[row..], &mut d_out).loss;
            assert!((found - expected).abs() < 2e-5 * expected.max(1.0), "{what}, step {step}: {found}, {expected}");
            if step == 0 {
                near(&what, outputs, &case.outputs);
            }
            network.backward(&parameters.weights, &d_out, &spectra, no_dropout, &mut parameters.optimizer.gradients);
            if step == 0 {
                for (i, (found, expected)) in
                    parameters.optimizer.gradients[2..].iter().zip(&case.gradients).enumerate()
                {
                    let some = if found.len() > 2000 { golden.stride } else { 1 };
                    let found: Vec<f32> = found.iter().copied().step_by(some).collect();
                    near(&format!("{what}, tensor {i}"), &found, expected);
                }
            }
            parameters.update(golden.rate, Some(golden.clip));
        }
        // the scale of the spectra doesn't learn
        assert!(parameters.weights[0].iter().all(|x| *x == 0.0) && parameters.weights[1].iter().all(|x| *x == 1.0));
    }
}

#[test]
fn dropout_applies_to_gradients_too() {
    let shape = Shape { encoder: vec![3], width: 16, layers: 2, joints: 2 };
    let (steps, keys) = (4, [5, 9]);
    let sized = list(&shape).into_iter().enumerate();
    let mut weights: Vec<Floats> = sized.map(|(i, p)| Floats::of(&numbers(i, 0.4, p.len()))).collect();
    let spectra = numbers(70, 0.02, steps * BATCH * SPECTRUM);
    let d_out = numbers(71, 1.0, steps * BATCH * shape.channels());
    let mut network = Network::new(&shape, BATCH, steps, true);
    let mut gradients: Vec<Floats> = weights.iter().map(|w| Floats::new(w.len())).collect();
    for share in [0.0, 0.5] {
        let dropout = Dropout { share, keys: &keys };
        let mut total = |weights: &[Floats]| -> f64 {
            network.pack(weights);
            network.rest();
            let outputs = network.forward(weights, &spectra, TeacherForcing::NONE, dropout);
            outputs.iter().zip(&d_out).map(|(y, p)| f64::from(y * p)).sum()
        };
        // the bias of the last linear layer, and a weight of the second LSTM layer
        let mut expected = Vec::new();
        for (tensor, at) in [(5, 1), (10, 7)] {
            let before = weights[tensor][at];
            let mut moved = |by: f32| {
                weights[tensor][at] = before + by;
                total(&weights)
            };
            expected.push((tensor, at, (moved(1e-2) - moved(-1e-2)) / 2e-2));
            weights[tensor][at] = before;
        }
        total(&weights);
        network.backward(&weights, &d_out, &spectra, dropout, &mut gradients);
        for (tensor, at, slope) in expected {
            let found = f64::from(gradients[tensor][at]);
            assert!((found - slope).abs() < 2e-3 * slope.abs().max(0.1), "{share} tensor {tensor}: {found} {slope}");
        }
    }
}
