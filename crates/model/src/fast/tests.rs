//! The fast form against the plain one in f64.

use super::*;
use crate::music::Music;
use crate::{HeadKind, Positions, fixtures, layout, ops};
use candle_core::{DType, Device, Tensor, Var};
use kinelm_engine::bins::Bins;
use kinelm_engine::op::cross_entropy::RowTarget;
use rand_chacha::rand_core::RngCore;

/// Largest difference of a gradient tensor over its largest number, which counts as no less than 1e-3 of the model's.
const BOUND: f64 = 1e-5;

#[derive(Clone, Copy)]
struct Case {
    positions: Positions,
    varying: bool,
    tied_head: bool,
    layers: usize,
    heads: usize,
    width: usize,
    batch: usize,
    length: usize,
    vocabulary: usize,
    dropout: f64,
    mask: Hides,
}

/// Which tokens a token sees.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Hides {
    Later,
    Nothing,
    /// Some by chance, some scores only lowered; the third token sees nothing at all. One for every sequence if true.
    Some(bool),
}

fn model(case: &Case) -> Gpt {
    let &Case { positions, varying, tied_head, layers, heads, width, length, vocabulary, .. } = case;
    let tokens = TokenLayout { vocabulary, word: 3, varying, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new() };
    let context = length.max(6);
    let config = ModelConfig {
        layers,
        heads,
        width,
        context,
        positions,
        tied_head,
        dropout: case.dropout,
        ..Default::default()
    };
    let gpt = Gpt::new(&config, &tokens, 1).unwrap();
    // away from zeros and ones, where gradients could be right by accident
    for (name, var) in gpt.vars() {
        let shift = random(name, var.dims());
        var.set(&(var.as_tensor() + shift).unwrap()).unwrap();
    }
    gpt
}

fn random(purpose: &str, shape: &[usize]) -> Tensor {
    let mut rng = kinelm_store::random::stream(7, purpose, 0, 0);
    let n = shape.iter().product();
    let data: Vec<f32> = (0..n).map(|_| (rng.next_u32() as f32 / u32::MAX as f32 - 0.5) * 0.4).collect();
    Tensor::from_vec(data, shape, &Device::Cpu).unwrap()
}

/// Ids with `<bos>` in front of each window, and targets with some `<pad>`.
fn batch(case: &Case) -> (Vec<u32>, Vec<u32>) {
    let mut rng = kinelm_store::random::stream(3, "ids", 0, 0);
    let n = case.batch * case.length;
    let mut draw = || (0..n).map(|_| 1 + rng.next_u32() % (case.vocabulary as u32 - 1)).collect::<Vec<u32>>();
    let (mut inputs, mut targets) = (draw(), draw());
    inputs.iter_mut().step_by(case.length).for_each(|id| *id = 1);
    targets.iter_mut().skip(2).step_by(5).for_each(|id| *id = 0);
    (inputs, targets)
}

/// A mask of numbers: (T, T), or one for each sequence.
fn hidden(case: &Case) -> Vec<f32> {
    let Hides::Some(each) = case.mask else { return Vec::new() };
    let (sequences, t) = (if each { case.batch } else { 1 }, case.length);
    let mut rng = kinelm_store::random::stream(5, "mask", 0, 0);
    let mut number = |i: usize| match rng.next_u32() % 4 {
        _ if i / t % t == 2 => f32::NEG_INFINITY,
        0 => f32::NEG_INFINITY,
        1 => -0.7,
        _ => 0.0,
    };
    (0..sequences * t * t).map(&mut number).collect()
}

fn check(case: &Case) {
    let what = format!(
        "{:?} varying {} tied {} L {} H {} D {} B {} T {} V {} dropout {} {:?}",
        case.positions,
        case.varying,
        case.tied_head,
        case.layers,
        case.heads,
        case.width,
        case.batch,
        case.length,
        case.vocabulary,
        case.dropout,
        case.mask
    );
    let gpt = model(case);
    let (inputs, targets) = batch(case);
    let dropout = (case.dropout > 0.0).then_some(Dropout { share: case.dropout, seed: 1, step: 4, first: 0 });
    let truth = gpt.to_f64().unwrap();
    let ids = Tensor::new(inputs.as_slice(), &Device::Cpu).unwrap().reshape((case.batch, case.length)).unwrap();
    let hidden = hidden(case);
    let plain_mask = match case.mask {
        Hides::Later => ops::Mask::Causal,
        Hides::Nothing => ops::Mask::Full,
        Hides::Some(_) => {
            let sequences = hidden.len() / (case.length * case.length);
            let mask = Tensor::from_slice(&hidden, (sequences, 1, case.length, case.length), &Device::Cpu).unwrap();
            ops::Mask::Additive(mask.to_dtype(DType::F64).unwrap())
        }
    };
    let mask = match case.mask {
        Hides::Later => Mask::Causal,
        Hides::Nothing => Mask::Full,
        Hides::Some(_) => Mask::Additive(&hidden),
    };
    let logits = truth.forward_masked(&ids, &plain_mask, dropout.as_ref()).unwrap();
    let loss = loss_sum(&logits.flatten_to(1).unwrap(), &targets, 0).unwrap();
    let windows =
        Windows { inputs: &inputs, targets: &targets, length: case.length, mask, history: &[], conditioning: None };
    let fast = compare(&what, &truth, Fast::of(&gpt).unwrap(), (windows, dropout.as_ref()), &loss, &logits);
    if case.mask == Hides::Later {
        check_nats(&what, fast, windows, dropout.as_ref());
    }
}

/// Gradients and logits of `fast` against `truth`'s, whose `loss` is a sum over the targets that count.
fn compare(
    what: &str,
    truth: &Gpt,
    mut fast: Fast,
    (windows, dropout): (Windows, Option<&Dropout>),
    loss: &Tensor,
    logits: &Tensor,
) -> (Fast, f64) {
    let counted = windows.targets.iter().filter(|&&t| t != 0).count().max(1) as f64;
    let store = (loss / counted).unwrap().backward().unwrap();
    // a window of the front token alone takes no row of the other position tables
    let of = |v: &Var| match store.get(v.as_tensor()) {
        Some(gradient) => gradient.flatten_all().unwrap().to_vec1().unwrap(),
        None => vec![0.0; v.elem_count()],
    };
    let expected: Vec<Vec<f64>> = truth.vars().values().map(of).collect();

    let mut gradients = fast.like_weights();
    gradients.iter_mut().for_each(|g| g.fill(f32::NAN));
    let nats = fast.gradients(windows, dropout, &mut gradients).unwrap();
    let (loss, found) = (loss.to_scalar::<f64>().unwrap() / counted, nats / counted);
    assert!((found - loss).abs() <= BOUND * loss.abs().max(1.0), "{what}: loss {found}, expected {loss}");
    let largest = |x: &[f64]| x.iter().filter(|x| x.is_finite()).fold(0.0, |m: f64, x| m.max(x.abs()));
    let floor = 1e-3 * expected.iter().map(|e| largest(e)).fold(0.0, f64::max);
    for ((name, found), expected) in truth.vars().keys().zip(&gradients).zip(&expected) {
        let apart = found.iter().zip(expected).fold(0.0, |m: f64, (f, e)| m.max((*f as f64 - e).abs()));
        let apart = if found.iter().any(|f| f.is_nan()) { f64::NAN } else { apart };
        let bound = BOUND * largest(expected).max(floor);
        assert!(apart <= bound, "{what}: {name} is {apart:e} off, at most {bound:e} allowed");
    }
    if dropout.is_none() {
        let found = fast.logits(windows).unwrap();
        let expected = logits.flatten_all().unwrap().to_vec1::<f64>().unwrap();
        let bound = BOUND * largest(&expected).max(1.0);
        // minus infinity has to be just that
        let near = |(f, e): (&f32, &f64)| f64::from(*f) == *e || (f64::from(*f) - e).abs() <= bound;
        assert!(found.len() == expected.len() && found.iter().zip(&expected).all(near), "{what}: logits off");
    }
    (fast, nats)
}

/// The nats one by one against those at once.
fn check_nats(what: &str, (mut fast, nats): (Fast, f64), windows: Windows, dropout: Option<&Dropout>) {
    if dropout.is_none() && windows.conditioning.is_none() {
        let mut each = vec![f32::NAN; windows.inputs.len()];
        let Windows { inputs, targets, length, history, conditioning, .. } = windows;
        fast.nats(TokenWindows { inputs, targets, length, history, conditioning }, &mut each).unwrap();
        let sum: f64 = each.iter().map(|x| *x as f64).sum();
        assert!((sum - nats).abs() <= BOUND * nats.max(1.0), "{what}: {sum} nats one by one, {nats} at once");
        assert!(each.iter().zip(windows.targets).all(|(x, &t)| (*x == 0.0) == (t == 0)), "{what}");
    }
}

/// A form with its own mask, the targets smoothed by `width`.
fn check_form(config: &ModelConfig, tokens: &TokenLayout, windows: usize, width: Option<f64>) {
    let what =
        format!("{}, {windows} windows of {}, smoothing {width:?}", fixtures::name(config, tokens), config.context);
    let length = config.context;
    let gpt = fixtures::model(config, tokens);
    let (inputs, targets) = fixtures::batch(config, tokens, windows, length);
    let dropout = (config.dropout > 0.0).then_some(Dropout { share: config.dropout, seed: 1, step: 4, first: 0 });
    let (mut truth, mut fast) = (gpt.to_f64().unwrap(), Fast::of(&gpt).unwrap());
    truth.smooth_targets(width);
    fast.smooth_targets(width);
    let ids = fixtures::ids(&inputs, length);
    let conditioning = fixtures::conditioning(config, tokens, windows);
    let history = fixtures::history(config, tokens, windows);
    let logits = truth.forward_beside(&ids, dropout.as_ref(), &history, conditioning.as_ref()).unwrap();
    let loss = truth.loss_sum_conditioned(&ids, &targets, dropout.as_ref(), &history, conditioning.as_ref()).unwrap();
    let windows = Windows {
        inputs: &inputs,
        targets: &targets,
        length,
        mask: fast.mask(),
        history: &history,
        conditioning: conditioning.as_ref(),
    };
    let found = compare(&what, &truth, fast, (windows, dropout.as_ref()), &loss, &logits);
    check_nats(&what, found, windows, dropout.as_ref());
}

#[test]
fn every_form_is_the_oracle_s() {
    for (config, tokens) in fixtures::every(23) {
        let widths: &[Option<f64>] = if tokens.varying { &[None] } else { &[None, Some(0.75)] };
        for &width in widths {
            check_form(&config, &tokens, 2, width);
        }
        if config.architecture == Architecture::TwoLevel {
            let window = |frames| ModelConfig { window: Some(frames), ..config.clone() }.resolved(&tokens);
            check_form(&ModelConfig { width: 40, heads: 4, ..window(13) }, &tokens, 3, None);
            check_form(&ModelConfig { layers: 1, ..window(70) }, &tokens, 1, Some(0.75));
            check_form(&ModelConfig { dropout: 0.2, ..window(9) }, &tokens, 3, None);
            continue;
        }
        check_form(&ModelConfig { dropout: 0.2, ..config.clone() }, &tokens, 3, None);
        // wider than a vector, longer than a piece; shorter than a word
        check_form(
            &ModelConfig { width: 40, heads: 4, context: 75, ..config.clone() },
            &tokens,
            3,
            widths[widths.len() - 1],
        );
    }
}

#[test]
fn what_nobody_tells_changes_no_bit_and_learns_nothing() {
    for (config, tokens) in fixtures::every(23).into_iter().filter(|(config, _)| config.is_conditioned()) {
        let length = config.context;
        let (inputs, targets) = fixtures::batch(&config, &tokens, 2, length);
        let gpt = fixtures::model(&config, &tokens);
        let without = ModelConfig { goal: false, music: Music::None, ..config.clone() };
        let is_told = |name: &str| layout::GOAL.contains(&name) || layout::MUSIC.contains(&name);
        let mut weights = gpt.weights().unwrap();
        let run = |fast: &mut Fast, conditioning: Option<&Conditioning>| {
            let windows =
                Windows { inputs: &inputs, targets: &targets, length, mask: fast.mask(), history: &[], conditioning };
            let mut gradients = fast.like_weights();
            fast.gradients(windows, None, &mut gradients).unwrap();
            let learns: Vec<bool> = gradients.iter().map(|g| g.iter().any(|x| *x != 0.0)).collect();
            (fast.logits(windows).unwrap(), learns)
        };
        let mut fast = Fast::from_weights(&config, &tokens, &weights).unwrap();
        let nothing = fixtures::conditioning(&config, &tokens, 2).unwrap().none_like();
        let (plain, learns) = run(&mut fast, None);
        for (parameter, learns) in fast.parameters().iter().zip(learns) {
            assert!(!(learns && is_told(&parameter.name)), "{}", parameter.name);
        }
        assert!(run(&mut fast, Some(&nothing)).0 == plain);
        assert!(run(&mut fast, fixtures::conditioning(&config, &tokens, 2).as_ref()).0 != plain);
        weights.retain(|name, _| !is_told(name));
        assert!(run(&mut Fast::from_weights(&without, &tokens, &weights).unwrap(), None).0 == plain);
        // of other frames, or of a model without conditioning
        let of_music = Conditioning { music: vec![0.5; 7], ..Default::default() };
        let mut other = Fast::of(&fixtures::model(&without, &tokens)).unwrap();
        for (conditioning, can, what, why) in [
            (Conditioning::none(3, 5), config.goal, "the goals of ", "model.goal = false"),
            (of_music, !config.music.is_none(), " frames is 7 numbers; expected", "model.music = \"none\""),
        ] {
            let windows = Windows {
                inputs: &inputs,
                targets: &targets,
                length,
                mask: fast.mask(),
                history: &[],
                conditioning: Some(&conditioning),
            };
            assert!(fast.logits(windows).unwrap_err().to_string().contains(if can { what } else { why }));
            assert!(other.logits(windows).unwrap_err().to_string().contains(why));
        }
    }
}

#[test]
fn forms_begin_with_a_front_alone() {
    for (config, tokens) in fixtures::all(23) {
        let gpt = fixtures::model(&config, &tokens);
        let mut fast = Fast::of(&gpt).unwrap();
        for length in tokens.front..12 {
            let (inputs, targets) = fixtures::batch(&config, &tokens, 2, length);
            let windows = Windows {
                inputs: &inputs,
                targets: &targets,
                length,
                mask: fast.mask(),
                history: &[],
                conditioning: None,
            };
            let found = fast.logits(windows).unwrap();
            let expected =
                gpt.predict(&fixtures::ids(&inputs, length)).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
            let near = |(a, b): (&f32, &f32)| a == b || (a - b).abs() < 1e-4;
            assert!(found.iter().zip(&expected).all(near), "{}: {length} tokens", fixtures::name(&config, &tokens));
            let mut gradients = fast.like_weights();
            fast.gradients(windows, None, &mut gradients).unwrap();
            assert!(gradients.iter().all(|g| g.iter().all(|x| x.is_finite())));
        }
    }
}

#[test]
fn what_counts_behind_no_bin_is_refused_and_the_next_batch_is_taken() {
    let (config, tokens) = fixtures::all(29).into_iter().find(|(c, _)| c.head == Some(HeadKind::Relative)).unwrap();
    let mut fast = Fast::of(&fixtures::model(&config, &tokens)).unwrap();
    let (inputs, good) = fixtures::batch(&config, &tokens, 2, 29);
    let dropped = (29..58).find(|&row| inputs[row] == 3 && row + tokens.word < 58).unwrap();
    let mut bad = good.clone();
    bad[dropped - 1 + tokens.word] = 6;
    let mut gradients = fast.like_weights();
    let mut run = |targets: &[u32]| {
        let windows =
            Windows { inputs: &inputs, targets, length: 29, mask: Mask::Causal, history: &[], conditioning: None };
        fast.gradients(windows, None, &mut gradients).map_err(|e| e.to_string())
    };
    assert!(run(&bad).unwrap_err().contains("is id 3; expected a bin of its slot"));
    let nats = run(&good).unwrap();
    assert!(nats.is_finite() && nats > 0.0);
    // nothing counts: nothing is learned
    assert_eq!(run(&[0; 58]).unwrap(), 0.0);
    assert!(gradients.iter().all(|g| g.iter().all(|x| *x == 0.0)));
}

const CASE: Case = Case {
    positions: Positions::FrameJoint,
    varying: false,
    tied_head: true,
    layers: 2,
    heads: 2,
    width: 16,
    batch: 2,
    length: 9,
    vocabulary: 11,
    dropout: 0.0,
    mask: Hides::Later,
};

#[test]
fn every_gradient_is_the_oracle_s_over_many_shapes() {
    check(&CASE);
    check(&Case { positions: Positions::Absolute, tied_head: false, ..CASE });
    // T = 1, B = 1, one head, a width that no vector divides, lengths around the tiles
    check(&Case { length: 1, batch: 1, ..CASE });
    check(&Case { length: 1, batch: 5, positions: Positions::Absolute, ..CASE });
    check(&Case { heads: 1, width: 5, batch: 3, length: 7, ..CASE });
    check(&Case { heads: 3, width: 21, batch: 1, length: 67, vocabulary: 37, ..CASE });
    check(&Case { heads: 4, width: 64, batch: 2, length: 130, vocabulary: 70, layers: 1, ..CASE });
    check(&Case { heads: 2, width: 48, batch: 1, length: 257, vocabulary: 33, layers: 1, tied_head: false, ..CASE });
}

#[test]
fn words_of_any_length_have_the_oracle_s_positions() {
    let case = Case { varying: true, ..CASE };
    check(&case);
    check(&Case { length: 1, batch: 1, ..case });
    check(&Case { batch: 3, length: 67, vocabulary: 8, tied_head: false, ..case });
    check(&Case { heads: 4, width: 32, batch: 2, length: 130, vocabulary: 70, dropout: 0.2, ..case });
    check(&Case { positions: Positions::Absolute, ..case });
    // the same room for other tokens
    let gpt = model(&case);
    let mut fast = Fast::of(&gpt).unwrap();
    for ids in [[1, 7, 5, 8, 9, 6, 5, 5, 7], [1, 5, 8, 8, 8, 5, 8, 8, 8]] {
        let windows =
            Windows { inputs: &ids, targets: &ids, length: 9, mask: Mask::Causal, history: &[], conditioning: None };
        let found = fast.logits(windows).unwrap();
        let expected =
            gpt.predict(&gpt.ids(&ids, 9).unwrap()).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-4), "{ids:?}");
    }
}

#[test]
fn every_mask_hides_what_it_hides_from_the_oracle() {
    for mask in [Hides::Nothing, Hides::Some(false), Hides::Some(true)] {
        check(&Case { mask, ..CASE });
        check(&Case { mask, heads: 2, width: 32, batch: 3, length: 75, dropout: 0.2, ..CASE });
    }
}

#[test]
fn dropout_drops_what_the_oracle_drops() {
    check(&Case { dropout: 0.3, ..CASE });
    check(&Case { dropout: 0.1, heads: 4, width: 32, batch: 3, length: 70, positions: Positions::Absolute, ..CASE });
}

#[test]
fn random_shapes_agree_too() {
    let mut rng = kinelm_store::random::stream(11, "shapes", 0, 0);
    let mut draw = |most: u32| 1 + (rng.next_u32() % most) as usize;
    for _ in 0..12 {
        // of a width of 1 or 2 a layer norm leaves nothing but rounding
        let (heads, d) = (draw(4), 2 + draw(12));
        check(&Case {
            positions: if draw(2) == 1 { Positions::Absolute } else { Positions::FrameJoint },
            varying: draw(2) == 1,
            tied_head: draw(2) == 1,
            layers: draw(2),
            heads,
            width: heads * d,
            batch: draw(4),
            length: draw(90),
            vocabulary: 6 + draw(60),
            dropout: if draw(3) == 1 { 0.2 } else { 0.0 },
            mask: [Hides::Later, Hides::Nothing, Hides::Some(false), Hides::Some(true)][draw(4) - 1],
        });
    }
}

#[test]
fn threads_change_no_bit_and_a_second_shape_finds_its_room() {
    for (config, tokens) in fixtures::every(100) {
        let config = ModelConfig { heads: 4, width: 64, ..config };
        let length = config.context;
        let gpt = fixtures::model(&config, &tokens);
        let (inputs, targets) = fixtures::batch(&config, &tokens, 3, length);
        let (history, before) = (fixtures::history(&config, &tokens, 3), config.history() * tokens.word);
        let dropout = config.architecture.is_flat().then_some(Dropout { share: 0.1, seed: 1, step: 0, first: 0 });
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut fast = Fast::of(&gpt).unwrap();
                let mask = fast.mask();
                let windows = |n: usize| Windows {
                    inputs: &inputs[..n],
                    targets: &targets[..n],
                    length,
                    mask,
                    history: &history[..n / length * before],
                    conditioning: None,
                };
                let mut gradients = fast.like_weights();
                fast.gradients(windows(2 * length), None, &mut gradients).unwrap();
                let nats = fast.gradients(windows(3 * length), dropout.as_ref(), &mut gradients).unwrap();
                let bits: Vec<u32> = gradients.iter().flat_map(|g| g.iter().map(|x| x.to_bits())).collect();
                (nats.to_bits(), bits)
            })
        };
        let one = run(1);
        assert!([2, 3, 5].iter().all(|&threads| run(threads) == one), "{}", fixtures::name(&config, &tokens));
    }
}

#[test]
fn wrong_windows_are_refused() {
    let mut fast = Fast::of(&model(&CASE)).unwrap();
    let mut said = |inputs: &[u32], length| {
        let windows = Windows { inputs, targets: inputs, length, mask: Mask::Causal, history: &[], conditioning: None };
        fast.logits(windows).unwrap_err().to_string()
    };
    assert_eq!(
        said(&[1; 10], 10),
        "a window takes 10 tokens, the limit is 9 tokens; the model's context holds no more"
    );
    assert_eq!(said(&[1, 2, 11], 3), "a token is id 11; expected ids below 11");
    assert!(said(&[1; 7], 3).contains("expected as many of both, in windows of 3"));
    assert!(said(&[], 0).contains("expected as many of both, in windows of 0"));
}

/// Sum of -ln p(target) over the rows of `logits` (N, V) whose target isn't `ignored`.
fn loss_sum(logits: &Tensor, targets: &[u32], ignored: u32) -> candle_core::Result<Tensor> {
    let count = logits.dim(1)? as u32;
    let counted = (0..).zip(targets).filter(|(_, t)| **t != ignored);
    let target_of = |(row, &target): (u32, &u32)| (row, RowTarget { target, first: 0, count, bins: Bins::NONE });
    let (rows, targets): (Vec<u32>, Vec<RowTarget>) = counted.map(target_of).unzip();
    let rows = Tensor::new(rows, logits.device())?;
    ops::nats(&logits.index_select(&rows, 0)?, &targets, None)?.sum_all()
}
