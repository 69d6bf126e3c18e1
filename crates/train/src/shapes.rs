//! The fast form against PyTorch in f32, over many shapes and masks.

use kinelm_engine::op::attention::Mask;
use kinelm_model::fast::{Fast, Windows};
use kinelm_model::weights::Array;
use kinelm_model::{ModelConfig, Positions, TokenLayout, layout};
use serde_json::Value;

/// Largest difference of a gradient tensor over its largest number, which counts as no less than 1e-3 of the model's.
const BOUND: f64 = 1e-4;

/// As scripts/reference/gpt_shapes.py fills tensors, by their number in the order of the names.
fn numbers(parameter: &layout::Parameter, tensor: usize) -> Array {
    let one = if parameter.name.contains("norm") && parameter.name.ends_with("weight") { 1.0 } else { 0.0 };
    let number = |i: usize| (0.2 * (1.7 * i as f64 + tensor as f64).sin()) as f32 + one;
    let all: Vec<f32> = (0..parameter.len()).map(number).collect();
    Array::new(&parameter.shape, all)
}

fn ids(count: usize, step: usize, vocabulary: usize) -> Vec<u32> {
    (0..count).map(|i| (1 + (i * step + 3) % (vocabulary - 1)) as u32).collect()
}

fn hidden(t: usize) -> Vec<f32> {
    let number = |q: usize, k: usize| match () {
        _ if q % 7 == 2 || (q * 5 + k * 3).is_multiple_of(4) => f32::NEG_INFINITY,
        _ if (q + k).is_multiple_of(3) => -0.7,
        _ => 0.0,
    };
    (0..t * t).map(|i| number(i / t, i % t)).collect()
}

fn check(case: &Value) {
    let what = case["model"].to_string();
    let size = |key: &str| case["model"][key].as_u64().unwrap() as usize;
    let (batch, length, vocabulary) = (size("batch"), size("tokens"), size("vocabulary"));
    let config = ModelConfig {
        layers: size("layers"),
        heads: size("heads"),
        width: size("width"),
        context: length.max(6),
        positions: Positions::Absolute,
        tied_head: case["model"]["tied_head"].as_bool().unwrap(),
        ..Default::default()
    };
    let tokens =
        TokenLayout { vocabulary, word: 3, varying: false, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new() };
    let parameters = layout::parameters(&config, &tokens);
    let weights = parameters.iter().enumerate().map(|(i, p)| (p.name.clone(), numbers(p, i))).collect();
    let (inputs, mut targets) = (ids(batch * length, 7, vocabulary), ids(batch * length, 5, vocabulary));
    targets.iter_mut().skip(2).step_by(5).for_each(|id| *id = 0);
    let hidden = hidden(length);
    let mask = match case["model"]["mask"].as_str().unwrap() {
        "causal" => Mask::Causal,
        "full" => Mask::Full,
        _ => Mask::Additive(&hidden),
    };
    let mut fast = Fast::from_weights(&config, &tokens, &weights).unwrap();
    let mut gradients = fast.like_weights();
    let windows = Windows { inputs: &inputs, targets: &targets, length, mask, history: &[], conditioning: None };
    let loss =
        fast.gradients(windows, None, &mut gradients).unwrap() / targets.iter().filter(|&&t| t != 0).count() as f64;
    let expected = case["loss"].as_f64().unwrap();
    assert!((loss - expected).abs() < BOUND, "{what}: loss {loss}, expected {expected}");
    let expected = |name: &str| &case["gradients"][name];
    let largest = |name: &str| expected(name)["largest"].as_f64().unwrap();
    let floor = 1e-3 * parameters.iter().map(|p| largest(&p.name)).fold(0.0, f64::max);
    for (p, found) in parameters.iter().zip(&gradients) {
        let places: Vec<usize> = serde_json::from_value(expected(&p.name)["places"].clone()).unwrap();
        let numbers: Vec<f64> = serde_json::from_value(expected(&p.name)["numbers"].clone()).unwrap();
        let bound = BOUND * largest(&p.name).max(floor);
        assert!(found.iter().all(|g| g.abs() as f64 <= largest(&p.name) + bound), "{what}: {} is too large", p.name);
        for (place, number) in places.into_iter().zip(numbers) {
            let error = (found[place] as f64 - number).abs();
            assert!(error <= bound, "{what}: {}[{place}]: {}, expected {number}", p.name, found[place]);
        }
    }
}

#[test]
fn gradients_of_many_shapes_and_masks_are_pytorchs_to_1e_4() {
    let golden: Value = serde_json::from_str(include_str!("../tests/golden/gpt_shapes.json")).unwrap();
    let cases = golden["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 9);
    cases.iter().for_each(check);
}
