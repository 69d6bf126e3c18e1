//! Every form of the plain model against its definition.

use super::*;
use crate::head_groups::HeadGroups;
use crate::previous::Basis;
use crate::sequence::Sequences;
use crate::{HeadKind, ModelKind, Positions, fixtures};
use rand_chacha::rand_core::RngCore;

const TOKENS: TokenLayout =
    TokenLayout { vocabulary: 11, word: 4, varying: false, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new() };

fn small(positions: Positions, tied_head: bool) -> Gpt {
    let config = ModelConfig { layers: 2, heads: 2, width: 8, context: 10, positions, tied_head, ..Default::default() };
    fixtures::model(&config, &TOKENS)
}

fn ids(n: usize) -> Vec<u32> {
    let mut rng = kinelm_store::random::stream(3, "ids", 0, 0);
    (0..n).map(|_| 5 + rng.next_u32() % 6).collect()
}

/// The mean over the targets that count of the cross-entropy with targets smoothed `width` bins wide, from the logits.
fn smoothed_loss(gpt: &Gpt, inputs: &Tensor, targets: &[u32], dropout: Option<&Dropout>, width: f64) -> f64 {
    let tokens = gpt.tokens();
    let kinds: Vec<_> = tokens.slot_ids().collect();
    let (length, shift) = (inputs.dim(1).unwrap(), usize::from(gpt.config().kind == ModelKind::Causal));
    let logits = gpt.forward(inputs, dropout).unwrap().flatten_to(1).unwrap().to_vec2::<f64>().unwrap();
    let (mut sum, mut counted) = (0.0, 0.0);
    for (row, (logits, &target)) in logits.iter().zip(targets).enumerate().filter(|(_, (_, t))| **t != tokens.pad) {
        let total: f64 = logits.iter().map(|x| x.exp()).sum();
        let place = (row % length + shift - tokens.front) % tokens.word;
        let weight = |id: u32| match kinds.get(place) {
            None => f64::from(id == target),
            Some(kind) => kind.bin(id).map_or(0.0, |bin| {
                let apart = bin.abs_diff(kind.bin(target).unwrap());
                let d = f64::from(if kind.circular { apart.min(kind.count - apart) } else { apart });
                if d <= 3.0 * width { (-d * d / (2.0 * width * width)).exp() } else { 0.0 }
            }),
        };
        let all: f64 = (0..logits.len() as u32).map(weight).sum();
        for (id, x) in (0..).zip(logits) {
            let share = weight(id) / all;
            // what can't come has no share
            sum += if share > 0.0 { share * (total.ln() - x) } else { 0.0 };
        }
        counted += 1.0;
    }
    sum / counted
}

#[test]
fn every_variable_has_the_gradient_that_finite_differences_find() {
    let mut cases: Vec<_> = fixtures::every(23).into_iter().map(|(config, tokens)| (config, tokens, None)).collect();
    let placed = cases.iter().filter(|(config, tokens, _)| !tokens.varying && !config.is_conditioned()).cloned();
    let placed: Vec<_> = placed.map(|(config, tokens, _)| (config, tokens, Some(0.75))).collect();
    cases.extend(placed);
    for (i, (config, tokens, width)) in cases.into_iter().enumerate() {
        let what = format!("{}, smoothing {width:?}", fixtures::name(&config, &tokens));
        let mut gpt = fixtures::model(&config, &tokens).to_f64().unwrap();
        gpt.smooth_targets(width);
        let (inputs, targets) = fixtures::batch(&config, &tokens, 2, config.context);
        let inputs = fixtures::ids(&inputs, config.context);
        let dropout = Dropout { share: 0.2, seed: 1, step: 0, first: 0 };
        let dropout = (i % 2 == 0 && config.architecture.is_flat()).then_some(&dropout);
        let conditioning = fixtures::conditioning(&config, &tokens, 2);
        let counted = targets.iter().filter(|&&t| t != tokens.pad).count() as f64;
        let loss = || {
            (gpt.loss_sum_conditioned(&inputs, &targets, dropout, &[], conditioning.as_ref()).unwrap() / counted)
                .unwrap()
        };
        let grads = loss().backward().unwrap();
        let at = |v: &Var, numbers: &[f64]| {
            v.set(&Tensor::new(numbers, &Device::Cpu).unwrap().reshape(v.dims()).unwrap()).unwrap();
            match width {
                Some(width) => smoothed_loss(&gpt, &inputs, &targets, dropout, width),
                None => loss().to_scalar::<f64>().unwrap(),
            }
        };
        for (name, var) in gpt.vars() {
            let grad = grads.get(var.as_tensor()).unwrap_or_else(|| panic!("{what}: {name} got no gradient"));
            let grad = grad.flatten_all().unwrap().to_vec1::<f64>().unwrap();
            let numbers = var.flatten_all().unwrap().to_vec1::<f64>().unwrap();
            // five numbers of every tensor, spread over it
            for i in (0..5).map(|k| k * (numbers.len() - 1) / 4) {
                let moved = |by: f64| {
                    let mut x = numbers.clone();
                    x[i] += by;
                    at(var, &x)
                };
                let h = 1e-5;
                let expected = (moved(h) - moved(-h)) / (2.0 * h);
                let apart = (grad[i] - expected).abs();
                assert!(apart < 1e-7, "{what}: {name}[{i}]: gradient {}, differences {expected}", grad[i]);
            }
            at(var, &numbers);
            assert!(grad.iter().any(|g| *g != 0.0), "{what}: {name}: the gradient is 0 everywhere");
        }
    }
}

#[test]
fn losses_are_those_of_the_logits_and_relative_rows_know_their_place_alone() {
    for (config, tokens) in fixtures::every(29) {
        let (what, length) = (fixtures::name(&config, &tokens), config.context);
        let mut gpt = fixtures::model(&config, &tokens).to_f64().unwrap();
        let (inputs, targets) = fixtures::batch(&config, &tokens, 3, length);
        let ids = fixtures::ids(&inputs, length);
        let logits = gpt.predict(&ids).unwrap().flatten_to(1).unwrap();
        let nats = |(logits, &target): (&Vec<f64>, &u32)| match target {
            0 => 0.0,
            target => logits.iter().map(|x| x.exp()).sum::<f64>().ln() - logits[target as usize],
        };
        let logits = logits.to_vec2::<f64>().unwrap();
        let truth: Vec<f64> = logits.iter().zip(&targets).map(nats).collect();
        for width in [None, Some(1.1)] {
            gpt.smooth_targets(width.filter(|_| !tokens.varying));
            let found = gpt
                .net
                .nats(&ids, &targets, Beside::default(), gpt.smoothing.as_ref())
                .unwrap()
                .to_vec1::<f64>()
                .unwrap();
            assert!(found.iter().zip(&truth).all(|(a, b)| (a - b).abs() < 1e-12), "{what}");
        }
        let head_groups = HeadGroups::of(&config, &tokens);
        let mut sequences = Sequences::new(&config, &tokens, 3, length);
        sequences.fill(&inputs, &[], None);
        let mut relative = 0;
        for (row, logits) in logits.iter().enumerate() {
            let can: Vec<u32> = (0..).zip(logits).filter(|(_, x)| x.is_finite()).map(|(id, _)| id).collect();
            match head_groups.basis(&sequences.get(row / length), row % length) {
                Basis::Ids => assert_eq!(can.len(), tokens.vocabulary, "{what}"),
                Basis::Steps { bins, .. } => {
                    relative += 1;
                    assert_eq!(can, bins.ids().collect::<Vec<_>>(), "{what}");
                }
            }
        }
        assert_eq!(relative > 20, config.head == Some(HeadKind::Relative), "{what}: {relative} relative rows");
    }
}

#[test]
fn a_batch_that_counts_behind_no_bin_is_refused() {
    let (config, tokens) =
        (ModelConfig { head: Some(HeadKind::Relative), ..fixtures::all(29)[0].0.clone() }, fixtures::placed());
    let gpt = fixtures::model(&config, &tokens);
    let (inputs, mut targets) = fixtures::batch(&config, &tokens, 2, 29);
    let dropped = (29..58).find(|&row| inputs[row] == 3 && row + tokens.word < 58).unwrap();
    targets[dropped - 1 + tokens.word] = 6;
    let message = gpt.loss(&fixtures::ids(&inputs, 29), &targets, None).unwrap_err().to_string();
    assert!(message.contains("is id 3; expected a bin of its slot"), "{message}");
    let message = gpt.loss(&fixtures::ids(&inputs, 29), &[1; 58].map(|_| 26), None).unwrap_err().to_string();
    assert_eq!(message, "a target is id 26; expected ids below 26");
    assert!(gpt.loss(&fixtures::ids(&inputs, 29), &[1], None).is_err());
}

#[test]
fn reading_in_blocks_is_reading_at_once_to_1e_5() {
    for (config, layout) in fixtures::all(20).into_iter().filter(|(config, _)| config.kind == ModelKind::Causal) {
        let what = fixtures::name(&config, &layout);
        let gpt = fixtures::model(&config, &layout);
        let (tokens, _) = fixtures::batch(&config, &layout, 3, 20);
        let tokens = &tokens[..20];
        let truth =
            gpt.forward(&fixtures::ids(tokens, 20), None).unwrap().squeeze(0).unwrap().to_vec2::<f32>().unwrap();
        let mut cache = gpt.cache().unwrap();
        for cuts in [vec![20], vec![1; 20], vec![4, 1, 15], vec![1, 19]] {
            cache.reset();
            let mut read = 0;
            for n in cuts {
                let logits = cache.read_all(&tokens[read..read + n]).unwrap().to_vec2::<f32>().unwrap();
                for (row, truth) in logits.iter().zip(&truth[read..]) {
                    assert!(row.iter().zip(truth).all(|(a, b)| a == b || (a - b).abs() < 1e-5), "{what}: place {read}");
                }
                read += n;
            }
            assert!(cache.read(&[6]).unwrap_err().to_string().contains("the number of tokens after 20 is 1"));
        }
        cache.truncate(3);
        assert_eq!(cache.len(), 3);
        let (one, other) = (cache.read(&tokens[3..]).unwrap(), &truth[19]);
        assert!(one.iter().zip(other).all(|(a, b)| a == b || (a - b).abs() < 1e-5), "{what}: cut");
    }
}

#[test]
fn a_later_token_changes_no_earlier_logit_but_in_masked_models() {
    for (config, tokens) in fixtures::every(30) {
        let gpt = fixtures::model(&config, &tokens);
        let (mut inputs, _) = fixtures::batch(&config, &tokens, 3, 30);
        let logits = |inputs: &[u32]| {
            let logits = gpt.predict(&fixtures::ids(&inputs[..30], 30)).unwrap();
            logits.squeeze(0).unwrap().to_vec2::<f32>().unwrap()
        };
        let before = logits(&inputs);
        inputs[21] = if inputs[21] == 14 { 15 } else { 14 };
        let after = logits(&inputs);
        let same = before[..21] == after[..21];
        assert_eq!(same, config.kind == ModelKind::Causal, "{}", fixtures::name(&config, &tokens));
        assert_ne!(before[21..], after[21..]);
    }
}

#[test]
fn attention_sees_what_the_mask_lets_it() {
    let gpt = small(Positions::Absolute, true);
    let ids = gpt.ids(&ids(20), 10).unwrap();
    let logits =
        |mask: &Mask| gpt.forward_masked(&ids, mask, None).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let hide = |hidden: &dyn Fn(usize, usize) -> bool| {
        let add = (0..100).map(|i| if hidden(i / 10, i % 10) { f32::NEG_INFINITY } else { 0.0 });
        Mask::Additive(Tensor::from_vec(add.collect(), (10, 10), &Device::Cpu).unwrap())
    };
    assert_eq!(logits(&hide(&|q, k| k > q)), logits(&Mask::Causal));
    assert_eq!(logits(&hide(&|_, _| false)), logits(&Mask::Full));
    assert_ne!(logits(&Mask::Full), logits(&Mask::Causal));
    // a mask of each sequence; a query that sees nothing is no NaN, in values or gradients
    let per_sequence = Tensor::new(&[0f32, f32::NEG_INFINITY], &Device::Cpu).unwrap();
    let mask = Mask::Additive(per_sequence.reshape((2, 1, 1, 1)).unwrap());
    let all = logits(&mask);
    assert_eq!(all[..110], logits(&Mask::Full)[..110]);
    assert_ne!(all[110..], logits(&Mask::Full)[110..]);
    let grads = gpt.forward_masked(&ids, &mask, None).unwrap().sum_all().unwrap().backward().unwrap();
    for (name, var) in gpt.vars() {
        let grad = grads.get(var.as_tensor()).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert!(grad.iter().all(|g| g.is_finite()), "{name}");
    }
}

#[test]
fn wrong_windows_and_weights_are_refused_by_name() {
    let gpt = small(Positions::FrameJoint, true);
    let long = Tensor::zeros((1, 11), candle_core::DType::U32, &Device::Cpu).unwrap();
    let message = gpt.forward(&long, None).unwrap_err().to_string();
    assert_eq!(message, "a window takes 11 tokens, the limit is 10 tokens; the model's context holds no more");
    let message = gpt.ids(&[3, 11], 2).unwrap_err().to_string();
    assert_eq!(message, "a token is id 11; expected ids below 11");
    let mut weights = gpt.weights().unwrap();
    let load = |all: &Weights| {
        let gpt = Gpt::from_weights(gpt.config(), gpt.tokens(), all, DeviceName::Cpu);
        gpt.err().map(|e| e.to_string()).unwrap_or_default()
    };
    assert_eq!(load(&weights), "");
    let long = Array::full(&[1, 11], 0.0);
    weights.insert("head.weight".into(), long.clone());
    assert!(load(&weights).contains("head.weight that this model has no place for"));
    weights.remove("head.weight");
    weights.insert("norm.bias".into(), long);
    assert!(load(&weights).contains("norm.bias has shape [1, 11]; this model expects [8]"));
    weights.remove("norm.bias");
    assert!(load(&weights).contains("no tensor norm.bias"));
}
