//! Layers of LSTM as plain loops in f64: the results of [`crate::lstm`], one number at a time.

use crate::lstm::{Shape, Wiring};

/// The state and output of one unit by the sums at its gates i, f, g, o and the state before.
pub fn cell([i, f, g, o]: [f64; 4], before: f64) -> (f64, f64) {
    let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
    let c = sigmoid(f) * before + sigmoid(i) * g.tanh();
    (c, sigmoid(o) * c.tanh())
}

/// Outputs (T, B, C) of a sequence that begins at rest: step t sees `inputs` (T, B, C) where `given[t]`, else the output of
/// the step before. `weights` as [`Shape::tensors`] lists them.
pub fn forward(shape: &Shape, weights: &[Vec<f64>], inputs: &[f64], given: &[bool]) -> Vec<f64> {
    let (c, d) = (shape.channels, shape.width);
    let batch = inputs.len() / given.len().max(1) / c;
    let mut outputs: Vec<f64> = Vec::with_capacity(inputs.len());
    let mut h = vec![vec![0.0; batch * d]; shape.layers];
    let mut states = h.clone();
    for (t, given) in given.iter().enumerate() {
        let x = match given {
            true => inputs[t * batch * c..][..batch * c].to_vec(),
            false if t > 0 => outputs[(t - 1) * batch * c..].to_vec(),
            false => vec![0.0; batch * c],
        };
        let before = h.clone();
        for layer in 0..shape.layers {
            let input = match (layer, shape.wiring) {
                (0, _) => &x,
                (_, Wiring::Fixed) => &h[layer - 1].clone(),
                (_, Wiring::Compat) => &before[layer - 1],
            };
            let width = input.len() / batch;
            let [wx, wh, bx, bh] = &weights[4 * layer..4 * layer + 4] else { unreachable!("four a layer") };
            for b in 0..batch {
                for u in 0..d {
                    let sum = |gate: usize| {
                        let column = gate * d + u;
                        let of = |w: &[f64], x: &[f64]| -> f64 {
                            x.iter().enumerate().map(|(i, x)| x * w[i * 4 * d + column]).sum()
                        };
                        let (x, h) = (&input[b * width..][..width], &before[layer][b * d..][..d]);
                        of(wx, x) + of(wh, h) + bx[column] + bh[column]
                    };
                    let (state, out) = cell([sum(0), sum(1), sum(2), sum(3)], states[layer][b * d + u]);
                    (states[layer][b * d + u], h[layer][b * d + u]) = (state, out);
                }
            }
        }
        let (w, bias) = (&weights[4 * shape.layers], &weights[4 * shape.layers + 1]);
        let top = &h[shape.layers - 1];
        for b in 0..batch {
            for n in 0..c {
                let sum: f64 = (0..d).map(|u| top[b * d + u] * w[u * c + n]).sum();
                outputs.push(sum + bias[n]);
            }
        }
    }
    outputs
}
