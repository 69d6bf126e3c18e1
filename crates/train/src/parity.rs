//! Both forms of the model and their training against PyTorch's, and against a window it must be able to learn by heart.

use super::batches::Batch;
use super::config::{Loss, TrainConfig};
use super::fast::FastLearner;
use super::learner::{Learner, clip_share};
use super::plain::Plain;
use super::schedule;
use candle_core::Tensor;
use kinelm_engine::linear::Products;
use kinelm_engine::op::attention::Mask;
use kinelm_model::fast::{Fast, Windows};
use kinelm_model::weights::{Array, Weights};
use kinelm_model::{DeviceName, Gpt, ModelConfig, Positions, TokenLayout, fixtures};
use serde_json::Value;
use std::collections::BTreeMap;

/// Both sides compute in f32, in another order.
const BOUND: f32 = 1e-4;

fn golden() -> Value {
    // scripts/reference/gpt2_parity.py: transformers' GPT-2 and torch's AdamW
    serde_json::from_str(include_str!("../tests/golden/gpt2_parity.json")).unwrap()
}

fn numbers(packed: &Value) -> Vec<f32> {
    let hex = packed["f32"].as_str().unwrap().as_bytes();
    let byte = |two: &[u8]| u8::from_str_radix(std::str::from_utf8(two).unwrap(), 16).unwrap();
    let bytes: Vec<u8> = hex.chunks(2).map(byte).collect();
    bytes.chunks(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

fn weights(all: &Value) -> Weights {
    let array = |packed: &Value| {
        let shape: Vec<usize> = serde_json::from_value(packed["shape"].clone()).unwrap();
        Array::new(&shape, numbers(packed))
    };
    all.as_object().unwrap().iter().map(|(n, p)| (n.clone(), array(p))).collect()
}

fn model(g: &Value) -> Gpt {
    let size = |key: &str| g["model"][key].as_u64().unwrap() as usize;
    let config = ModelConfig {
        layers: size("layers"),
        heads: size("heads"),
        width: size("width"),
        context: size("context"),
        positions: Positions::Absolute,
        ..Default::default()
    };
    let tokens = TokenLayout {
        vocabulary: size("vocabulary"),
        word: 4,
        varying: false,
        front: 1,
        pad: 0,
        bos: 1,
        space: 5,
        places: Vec::new(),
    };
    Gpt::from_weights(&config, &tokens, &weights(&g["weights"]), DeviceName::Cpu).unwrap()
}

fn batch(g: &Value) -> Batch {
    let ids = |key: &str| serde_json::from_value(g[key].clone()).unwrap();
    Batch {
        inputs: ids("inputs"),
        targets: ids("targets"),
        history: Vec::new(),
        clips: vec!["golden".into(); 3],
        conditioning: None,
    }
}

fn furthest(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Every gradient against PyTorch's: the largest difference over the tensor's largest number, which counts as no less
/// than 1e-3 of the largest of all.
fn check_gradients(form: &str, found: &BTreeMap<String, Vec<f32>>, g: &Value) {
    let largest = |x: &[f32]| x.iter().fold(0.0, |m: f32, x| m.max(x.abs()));
    let expected: BTreeMap<&String, Vec<f32>> = found.keys().map(|n| (n, numbers(&g["gradients"][n]))).collect();
    let floor = 1e-3 * expected.values().map(|e| largest(e)).fold(0.0, f32::max);
    for (name, found) in found {
        let error = furthest(found, &expected[name]) / largest(&expected[name]).max(floor);
        assert!(error < BOUND, "{form}: {name}: {error}");
    }
}

#[test]
fn logits_and_gradients_are_pytorchs_to_1e_4() {
    let g = golden();
    let (gpt, batch) = (model(&g), batch(&g));
    let context = gpt.config().context;
    let ids = gpt.ids(&batch.inputs, context).unwrap();
    let logits = gpt.forward(&ids, None).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let mut fast = Fast::of(&gpt).unwrap();
    let (inputs, targets) = (&batch.inputs, &batch.targets);
    let windows = Windows { inputs, targets, length: context, mask: Mask::Causal, history: &[], conditioning: None };
    for (form, logits) in [("plain", logits), ("fast", fast.logits(windows).unwrap())] {
        let error = furthest(&logits, &numbers(&g["logits"]));
        assert!(error < BOUND, "{form}: logits: {error}");
    }
    let (mut plain, mut fast) =
        (Plain::new(gpt, &TrainConfig::default()).unwrap(), FastLearner::new(fast, &TrainConfig::default()));
    for (form, learner) in [("plain", &mut plain as &mut dyn Learner), ("fast", &mut fast)] {
        let found = learner.gradients(&batch, 0).unwrap();
        assert!((found.loss - g["loss"].as_f64().unwrap()).abs() < BOUND as f64, "{form}: loss {}", found.loss);
    }
    let flat = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    check_gradients("plain", &plain.gradients_by_name().map(|(n, t)| (n.into(), flat(t))).collect(), &g);
    check_gradients("fast", &fast.gradients_by_name().map(|(n, x)| (n.into(), x.to_vec())).collect(), &g);
}

#[test]
fn ten_training_losses_are_pytorchs_to_1e_4() {
    let g = golden();
    let (gpt, batch) = (model(&g), batch(&g));
    let number = |key: &str| g["train"][key].as_f64().unwrap();
    let config = TrainConfig {
        steps: number("steps") as u64,
        learning_rate: number("rate"),
        warmup: number("warmup") as u64,
        final_share: number("final"),
        betas: serde_json::from_value(g["train"]["betas"].clone()).unwrap(),
        weight_decay: number("decay"),
        clip_norm: number("clip"),
        ..Default::default()
    };
    let expected: Vec<f64> = serde_json::from_value(g["losses"].clone()).unwrap();
    let mut fast = FastLearner::new(Fast::of(&gpt).unwrap(), &config);
    let mut plain = Plain::new(gpt, &config).unwrap();
    for (form, learner) in [("plain", &mut plain as &mut dyn Learner), ("fast", &mut fast)] {
        let losses = train(learner, &batch, &config);
        assert_eq!(losses.len(), expected.len());
        for (i, (found, expected)) in losses.iter().zip(&expected).enumerate() {
            assert!((found - expected).abs() < BOUND as f64, "{form}: step {i}: {found}, expected {expected}");
        }
        assert!(losses[9] < losses[0] - 0.5, "{form}: the losses fall: {losses:?}");
    }
}

/// The loss before each update.
fn train(learner: &mut dyn Learner, batch: &Batch, config: &TrainConfig) -> Vec<f64> {
    let update = |i| {
        let found = learner.gradients(batch, i).unwrap();
        learner.update(clip_share(found.norm, config.clip_norm), schedule::rate(config, i)).unwrap();
        found.loss
    };
    (0..config.steps).map(update).collect()
}

#[test]
fn ten_steps_of_every_form_cost_the_same_plain_and_fast() {
    let train_config = TrainConfig { steps: 10, learning_rate: 3e-3, warmup: 2, table_rate: 3.0, ..Default::default() };
    let ordinal = TrainConfig { loss: Loss::Ordinal, ..train_config.clone() };
    for (config, tokens) in fixtures::all(40) {
        let config = ModelConfig { width: 16, dropout: 0.1, ..config };
        let gpt = Gpt::new(&config, &tokens, 1).unwrap();
        let (inputs, targets) = fixtures::batch(&config, &tokens, 3, 40);
        let batch =
            Batch { inputs, targets, history: Vec::new(), clips: vec!["made up".into(); 3], conditioning: None };
        let train_config = if tokens.varying { &train_config } else { &ordinal };
        let mut fast = FastLearner::new(Fast::of(&gpt).unwrap(), train_config);
        let fast = train(&mut fast, &batch, train_config);
        let plain = train(&mut Plain::new(gpt, train_config).unwrap(), &batch, train_config);
        let what = fixtures::name(&config, &tokens);
        assert!(
            fast.iter().zip(&plain).all(|(a, b)| (a - b).abs() < BOUND as f64),
            "{what}: {fast:?}, plain {plain:?}"
        );
        assert!(fast[9] < fast[0], "{what}: {fast:?}");
    }
}

#[test]
fn training_in_bf16_follows_training_in_f32() {
    let (config, tokens) = fixtures::all(40).remove(0);
    let config = ModelConfig { width: 64, heads: 2, dropout: 0.1, ..config };
    let gpt = Gpt::new(&config, &tokens, 1).unwrap();
    let (inputs, targets) = fixtures::batch(&config, &tokens, 3, 40);
    let batch = Batch { inputs, targets, history: Vec::new(), clips: vec!["made up".into(); 3], conditioning: None };
    let train_config = TrainConfig { steps: 10, learning_rate: 3e-3, warmup: 2, ..Default::default() };
    let losses = |products| {
        let mut fast = Fast::of(&gpt).unwrap();
        fast.multiply_by(products);
        train(&mut FastLearner::new(fast, &train_config), &batch, &train_config)
    };
    let [f32s, rounded, here] = [Products::F32, Products::Rounded, Products::bf16()].map(losses);
    for (i, ((f32s, rounded), here)) in f32s.iter().zip(&rounded).zip(&here).enumerate() {
        // eight bits of each factor: a thousandth of the loss; tiles sum in another order than vectors
        assert!(f32s != rounded && (f32s - rounded).abs() < 2e-3 * f32s, "step {i}: {rounded}, in f32 {f32s}");
        assert!((here - rounded).abs() < 2e-4 * f32s, "step {i}: {here}, emulated {rounded}");
    }
}

#[test]
fn one_window_is_learnt_by_heart() {
    let tokens =
        TokenLayout { vocabulary: 30, word: 6, varying: false, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new() };
    for positions in [Positions::FrameJoint, Positions::Absolute] {
        let config = ModelConfig { layers: 2, heads: 2, width: 32, context: 48, positions, ..Default::default() };
        let gpt = Gpt::new(&config, &tokens, 1).unwrap();
        let targets: Vec<u32> = (0..48u32).map(|i| if i % 6 == 5 { 5 } else { 6 + (i * i * 7 + i * 3) % 24 }).collect();
        let inputs = [&[1], &targets[..47]].concat();
        let batch = Batch { inputs, targets, history: Vec::new(), clips: vec!["one".into()], conditioning: None };
        let train_config =
            TrainConfig { steps: 150, learning_rate: 1e-2, warmup: 10, weight_decay: 0.0, ..Default::default() };
        let mut learner = FastLearner::new(Fast::of(&gpt).unwrap(), &train_config);
        let losses = train(&mut learner, &batch, &train_config);
        let last = losses[losses.len() - 1];
        assert!(losses[0] > 3.0 && last < 0.01, "{positions:?}: from {} to {last} nats a token", losses[0]);
    }
}
