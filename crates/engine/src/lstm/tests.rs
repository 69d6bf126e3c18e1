//! The fast form held to plain loops in f64, and its gradients to differences of these.

use super::*;
use crate::op::check::{near, numbers};
use crate::scalar::lstm as scalar;

/// Sums of some dozen numbers below 1, over some steps.
const BOUND: f64 = 3e-6;

fn shapes() -> impl Iterator<Item = Shape> {
    let sizes = [(3, 5, 3), (4, 70, 2), (1, 1, 1), (7, 33, 3)];
    let of = |(channels, width, layers)| {
        [Wiring::Fixed, Wiring::Compat].map(|wiring| Shape { channels, width, layers, wiring })
    };
    sizes.into_iter().flat_map(of)
}

fn weights(shape: &Shape) -> Vec<Floats> {
    let of = |(i, [rows, columns]): (usize, [usize; 2])| Floats::of(&numbers(i as u64, rows * columns, 0.4));
    shape.tensors().into_iter().enumerate().map(of).collect()
}

fn wide(weights: &[Floats]) -> Vec<Vec<f64>> {
    weights.iter().map(|w| w.iter().map(|x| *x as f64).collect()).collect()
}

const MASKS: [&str; 5] = ["g", "ggggggg", "gfffgfg", "ggffggff", "ffff"];

fn mask(text: &str) -> Vec<bool> {
    text.chars().map(|c| c == 'g').collect()
}

#[test]
fn a_sequence_falls_into_stretches_of_known_inputs() {
    let of = |text: &str| stretches(&mask(text)).collect::<Vec<_>>();
    assert_eq!(of("ggffgg"), [0..2, 2..3, 3..6]);
    assert_eq!(of("fggfg"), [0..3, 3..5]);
    assert_eq!(of("ff"), [0..1, 1..2]);
}

#[test]
fn outputs_are_what_plain_loops_give() {
    for (shape, text) in shapes().flat_map(|shape| MASKS.map(|text| (shape, text))) {
        let (given, batch) = (mask(text), 3);
        let weights = weights(&shape);
        let inputs = numbers(99, given.len() * batch * shape.channels, 1.0);
        let mut lstm = Lstm::new(shape, batch, 9, false);
        lstm.pack(&weights);
        let narrow: Vec<f64> = inputs.iter().map(|x| *x as f64).collect();
        let expected = scalar::forward(&shape, &wide(&weights), &narrow, &given);
        near(&format!("{shape:?} {text}"), lstm.forward(&inputs, &given), &expected, BOUND);
        // at rest again, the same
        lstm.rest();
        near(&format!("{shape:?} {text} again"), lstm.forward(&inputs, &given), &expected, BOUND);
    }
}

#[test]
fn a_sequence_in_pieces_is_the_whole_to_the_last_bit() {
    for shape in shapes() {
        let (given, row) = (mask("gggfgff"), 2 * shape.channels);
        let inputs = numbers(5, given.len() * row, 1.0);
        let weights = weights(&shape);
        let mut lstm = Lstm::new(shape, 2, given.len(), false);
        lstm.pack(&weights);
        let whole = lstm.forward(&inputs, &given).to_vec();
        lstm.rest();
        let mut parts = Vec::new();
        for range in [0..2, 2..3, 3..7] {
            parts.extend_from_slice(lstm.forward(&inputs[range.start * row..range.end * row], &given[range]));
            lstm.carry();
        }
        assert_eq!(whole, parts, "{shape:?}");
        assert_eq!(lstm.last_output(), &whole[6 * row..]);
    }
}

#[test]
fn gradients_are_the_slopes_of_plain_loops() {
    for (shape, text) in shapes().filter(|s| s.width < 40).flat_map(|shape| MASKS.map(|text| (shape, text))) {
        let (given, batch) = (mask(text), 2);
        let weights = weights(&shape);
        let inputs = numbers(9, given.len() * batch * shape.channels, 1.0);
        let pull = numbers(10, inputs.len(), 1.0);
        let mut lstm = Lstm::new(shape, batch, 8, true);
        lstm.pack(&weights);
        lstm.forward(&inputs, &given);
        let mut found: Vec<Floats> = weights.iter().map(|w| Floats::new(w.len())).collect();
        lstm.backward(&pull, &mut found);
        let inputs: Vec<f64> = inputs.iter().map(|x| *x as f64).collect();
        let all = wide(&weights);
        let total = |weights: &[Vec<f64>]| -> f64 {
            let outputs = scalar::forward(&shape, weights, &inputs, &given);
            outputs.iter().zip(&pull).map(|(y, p)| y * *p as f64).sum()
        };
        for (tensor, gradient) in found.iter().enumerate() {
            // some of each are enough: the loops are slow
            let some = gradient.len().div_ceil(7);
            for at in (0..gradient.len()).step_by(some) {
                let slope = |by: f64| {
                    let mut moved = all.clone();
                    moved[tensor][at] += by;
                    total(&moved)
                };
                let expected = (slope(1e-5) - slope(-1e-5)) / 2e-5;
                near(&format!("{shape:?} {text} tensor {tensor}"), &gradient[at..=at], &[expected], 2e-5);
            }
        }
    }
}

#[test]
fn threads_change_no_bit() {
    let shape = Shape { channels: 20, width: 150, layers: 3, wiring: Wiring::Fixed };
    let given = mask("ggffggffgg");
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let weights = weights(&shape);
            let inputs = numbers(1, given.len() * 13 * shape.channels, 1.0);
            let mut lstm = Lstm::new(shape, 13, given.len(), true);
            lstm.pack(&weights);
            let outputs = lstm.forward(&inputs, &given).to_vec();
            let mut gradients: Vec<Floats> = weights.iter().map(|w| Floats::new(w.len())).collect();
            lstm.backward(&outputs, &mut gradients);
            (outputs, gradients.iter().map(|g| g.to_vec()).collect::<Vec<_>>())
        })
    };
    assert!(run(1) == run(3));
}

#[test]
fn sizes_are_those_of_the_published_networks() {
    let of = |channels| Shape { channels, width: 1024, layers: 3, wiring: Wiring::Compat }.parameters();
    // 4 D (C + D + 2) for the first of 3 layers, 4 D (2 D + 2) for each other, (D + 1) C for the output, at D = 1024
    assert_eq!([171, 132, 175].map(of), [21_871_787, 21_672_068, 21_892_271]);
}
