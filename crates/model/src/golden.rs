//! Both forms of every kind of model against PyTorch's in f64.

use super::config::{ModelConfig, TokenLayout};
use super::fast::{Fast, Windows};
use super::goal::Conditioning;
use super::gpt::Gpt;
use super::layout;
use candle_core::{Device, Var};
use serde_json::Value;
use std::collections::BTreeMap;

/// For the plain form in f64: the golden numbers have nine digits.
const BOUND: f64 = 1e-7;
/// For the fast form in f32, whose weights are rounded to it: logits and losses, then gradients; of flat models, and of
/// two-level ones.
const FAST: [f64; 2] = [1e-4; 2];
const TWO_LEVELS: [f64; 2] = [1e-5, 3e-5];

/// As scripts/reference/gpt_forms.py fills tensors, by their number in the order of the names.
fn numbers(parameter: &layout::Parameter, tensor: usize) -> Var {
    let one = if parameter.name.contains("norm") && parameter.name.ends_with("weight") { 1.0 } else { 0.0 };
    let number = |i: usize| f64::from((0.2 * (1.7 * i as f64 + tensor as f64).sin()) as f32) + one;
    let all: Vec<f64> = (0..parameter.len()).map(number).collect();
    Var::from_vec(all, parameter.shape.as_slice(), &Device::Cpu).unwrap()
}

/// A golden case.
struct Case<'a> {
    golden: &'a Value,
    /// In f64.
    gpt: Gpt,
    inputs: Vec<u32>,
    targets: Vec<u32>,
    length: usize,
    conditioning: Option<Conditioning>,
}

impl Case<'_> {
    fn of(golden: &Value) -> Case<'_> {
        let config: ModelConfig = serde_json::from_value(golden["model"].clone()).unwrap();
        // the script knows none
        let forecast = (!config.architecture.is_flat()).then_some(false);
        let config = ModelConfig { forecast, ..config };
        let tokens: TokenLayout = serde_json::from_value(golden["tokens"].clone()).unwrap();
        let parameters = layout::parameters(&config, &tokens);
        let vars = parameters.iter().enumerate().map(|(i, p)| (p.name.clone(), numbers(p, i))).collect();
        let ids = |key: &str| serde_json::from_value::<Vec<Vec<u32>>>(golden[key].clone()).unwrap();
        let (inputs, targets) = (ids("inputs"), ids("targets"));
        let conditioning = golden.get("told").map(|conditioning| Conditioning {
            numbers: serde_json::from_value(conditioning["numbers"].clone()).unwrap(),
            rows: serde_json::from_value(conditioning["rows"].clone()).unwrap(),
            music: Vec::new(),
        });
        Case {
            golden,
            gpt: Gpt::from_vars(&config, &tokens, vars, None).unwrap(),
            length: inputs[0].len(),
            inputs: inputs.concat(),
            targets: targets.concat(),
            conditioning,
        }
    }

    fn counted(&self) -> usize {
        self.targets.iter().filter(|&&t| t != self.gpt.tokens().pad).count()
    }

    /// Logits (B, T, V) of the rows that the case lists.
    fn check_logits(&self, form: &str, logits: &[f64], bound: f64) {
        let (name, vocabulary) = (&self.golden["name"], self.gpt.tokens().vocabulary);
        for row in self.golden["rows"].as_array().unwrap() {
            let at = |i: usize| row[i].as_u64().unwrap() as usize;
            let found = &logits[(at(0) * self.length + at(1)) * vocabulary..][..vocabulary];
            for (id, (found, expected)) in found.iter().zip(row[2].as_array().unwrap()).enumerate() {
                let same = match expected.as_f64() {
                    Some(expected) => (found - expected).abs() <= bound,
                    None => *found == f64::NEG_INFINITY,
                };
                assert!(same, "{form} {name}: input {} of window {}, id {id}: {found}, {expected}", at(1), at(0));
            }
        }
    }

    fn check_loss(&self, form: &str, loss: f64, bound: f64) {
        let expected = self.golden["loss"].as_f64().unwrap();
        assert!((loss - expected).abs() <= bound, "{form} {}: loss {loss}, expected {expected}", self.golden["name"]);
    }

    /// Gradients of the mean loss: relative to a tensor's largest number, which counts as no less than 1e-3 of the model's.
    fn check_gradients(&self, form: &str, found: &BTreeMap<String, Vec<f64>>, expected: &Value, bound: f64) {
        let expected = expected.as_object().unwrap();
        assert!(found.keys().eq(expected.keys()), "{form} {}: other tensors", self.golden["name"]);
        let largest = |name: &str| expected[name]["largest"].as_f64().unwrap();
        let floor = 1e-3 * expected.keys().map(|name| largest(name)).fold(0.0, f64::max);
        for (name, found) in found {
            let what = format!("{form} {}: {name}", self.golden["name"]);
            let bound = bound * largest(name).max(floor);
            assert!(found.iter().all(|g| g.abs() <= largest(name) + bound), "{what} is too large");
            let places: Vec<usize> = serde_json::from_value(expected[name]["places"].clone()).unwrap();
            let numbers: Vec<f64> = serde_json::from_value(expected[name]["numbers"].clone()).unwrap();
            for (place, number) in places.into_iter().zip(numbers) {
                assert!((found[place] - number).abs() <= bound, "{what}[{place}]: {}, expected {number}", found[place]);
            }
        }
    }

    fn check_plain(&self) {
        let mut gpt = self.gpt.to_f64().unwrap();
        let ids = gpt.ids(&self.inputs, self.length).unwrap();
        let logits = match &self.conditioning {
            Some(conditioning) => gpt.forward_beside(&ids, None, &[], Some(conditioning)).unwrap(),
            None => gpt.predict(&ids).unwrap(),
        };
        let logits = logits.flatten_all().unwrap().to_vec1::<f64>().unwrap();
        self.check_logits("plain", &logits, BOUND);
        let mut check = |width: Option<f64>, expected: &Value| {
            gpt.smooth_targets(width);
            let loss = gpt.loss_sum_conditioned(&ids, &self.targets, None, &[], self.conditioning.as_ref()).unwrap();
            let loss = (loss / self.counted() as f64).unwrap();
            self.check_loss("plain", loss.to_scalar().unwrap(), BOUND);
            let store = loss.backward().unwrap();
            let gradient = |(name, var): (&String, &Var)| {
                let numbers = store.get(var.as_tensor()).unwrap().flatten_all().unwrap().to_vec1().unwrap();
                (name.clone(), numbers)
            };
            self.check_gradients("plain", &gpt.vars().iter().map(gradient).collect(), expected, BOUND);
        };
        check(None, &self.golden["gradients"]);
        if let Some(width) = self.golden["ordinal"]["width"].as_f64() {
            check(Some(width), &self.golden["ordinal"]["gradients"]);
        }
    }
}

impl Case<'_> {
    fn check_fast(&self, [bound, of_gradients]: [f64; 2]) {
        let mut fast = Fast::of(&self.gpt).unwrap();
        let (inputs, targets) = (&self.inputs, &self.targets);
        let windows = Windows {
            inputs,
            targets,
            length: self.length,
            mask: fast.mask(),
            history: &[],
            conditioning: self.conditioning.as_ref(),
        };
        let logits: Vec<f64> = fast.logits(windows).unwrap().into_iter().map(f64::from).collect();
        self.check_logits("fast", &logits, bound);
        let mut check = |width: Option<f64>, expected: &Value| {
            fast.smooth_targets(width);
            let mut gradients = fast.like_weights();
            let nats = fast.gradients(windows, None, &mut gradients).unwrap();
            self.check_loss("fast", nats / self.counted() as f64, bound);
            let wide = |g: &[f32]| g.iter().map(|&x| f64::from(x)).collect();
            let named = fast.parameters().iter().zip(&gradients).map(|(p, g)| (p.name.clone(), wide(g)));
            self.check_gradients("fast", &named.collect(), expected, of_gradients);
        };
        check(None, &self.golden["gradients"]);
        if let Some(width) = self.golden["ordinal"]["width"].as_f64() {
            check(Some(width), &self.golden["ordinal"]["gradients"]);
        }
    }
}

#[test]
fn every_form_is_pytorchs() {
    let golden: Value = serde_json::from_str(include_str!("../tests/golden/gpt_forms.json")).unwrap();
    let cases = golden["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 18);
    for case in cases.iter().map(Case::of) {
        assert!(case.counted() > 0);
        case.check_plain();
        case.check_fast(FAST);
    }
}

#[test]
fn two_levels_are_pytorchs() {
    let golden: Value = serde_json::from_str(include_str!("../tests/golden/two_level.json")).unwrap();
    let cases = golden["cases"].as_array().unwrap();
    assert_eq!(cases.iter().map(|case| case.get("told").is_some()).collect::<Vec<_>>(), [false, false, true, true]);
    for case in cases.iter().map(Case::of) {
        assert!(case.counted() > 0 && case.inputs.contains(&case.gpt.tokens().pad));
        case.check_plain();
        case.check_fast(TWO_LEVELS);
    }
}
