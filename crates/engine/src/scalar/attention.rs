//! Attention with every score written down, in f64.

use crate::op::attention::{Mask, Shape};

/// The numbers that [`backward`] needs from [`forward`]: `out` (B, H, T, d) and `weights` (B, H, T, T), before dropout.
pub struct Attended {
    /// The output of each head.
    pub out: Vec<f64>,
    /// Rows sum to 1, or to 0 where a query sees nothing.
    pub weights: Vec<f64>,
}

/// The index of a number of qkv (N, 3 D).
fn at(shape: Shape, sequence: usize, token: usize, part: usize, head: usize, i: usize) -> usize {
    (sequence * shape.tokens + token) * 3 * shape.columns() + part * shape.columns() + head * shape.width + i
}

fn added(shape: Shape, mask: Mask, sequence: usize, query: usize, key: usize) -> f64 {
    let t = shape.tokens;
    match mask {
        Mask::Causal | Mask::CausalAdditive(_) if key > query => f64::NEG_INFINITY,
        Mask::Causal | Mask::Full => 0.0,
        Mask::Additive(mask) | Mask::CausalAdditive(mask) if mask.len() == t * t => mask[query * t + key] as f64,
        Mask::Additive(mask) | Mask::CausalAdditive(mask) => mask[(sequence * t + query) * t + key] as f64,
    }
}

/// The output and the weights; `factors` (B, H, T, T) multiplies the weights, as dropout does.
pub fn forward(shape: Shape, qkv: &[f64], mask: Mask, factors: Option<&[f64]>) -> Attended {
    let Shape { batch, tokens: t, heads, width: d } = shape;
    let mut attended = Attended { out: vec![0.0; batch * heads * t * d], weights: vec![0.0; batch * heads * t * t] };
    for (b, h, query) in indices(shape) {
        let row = ((b * heads + h) * t + query) * t;
        let score = |key: usize| {
            let dot: f64 = (0..d).map(|i| qkv[at(shape, b, query, 0, h, i)] * qkv[at(shape, b, key, 1, h, i)]).sum();
            dot / (d as f64).sqrt() + added(shape, mask, b, query, key)
        };
        let scores: Vec<f64> = (0..t).map(score).collect();
        let largest = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if largest == f64::NEG_INFINITY {
            continue;
        }
        let sum: f64 = scores.iter().map(|s| (s - largest).exp()).sum();
        for (key, score) in scores.iter().enumerate() {
            let weight = (score - largest).exp() / sum;
            attended.weights[row + key] = weight;
            for i in 0..d {
                let value = qkv[at(shape, b, key, 2, h, i)];
                attended.out[((b * heads + h) * t + query) * d + i] +=
                    weight * factors.map_or(1.0, |f| f[row + key]) * value;
            }
        }
    }
    attended
}

/// Gradients of queries, keys and values (B, H, 3, T, d) from that of the output, `d_out` (N, D).
pub fn backward(shape: Shape, qkv: &[f64], attended: &Attended, factors: Option<&[f64]>, d_out: &[f64]) -> Vec<f64> {
    let Shape { batch, tokens: t, heads, width: d } = shape;
    let mut gradient = vec![0.0; batch * heads * 3 * t * d];
    for (b, h, query) in indices(shape) {
        let row = ((b * heads + h) * t + query) * t;
        let to = |part: usize, token: usize, i: usize| (((b * heads + h) * 3 + part) * t + token) * d + i;
        let slope = |i: usize| d_out[(b * t + query) * shape.columns() + h * d + i];
        let factor = |key: usize| factors.map_or(1.0, |f| f[row + key]);
        let d_weight = |key: usize| -> f64 {
            factor(key) * (0..d).map(|i| slope(i) * qkv[at(shape, b, key, 2, h, i)]).sum::<f64>()
        };
        let d_weights: Vec<f64> = (0..t).map(d_weight).collect();
        let weights = &attended.weights[row..row + t];
        let mean: f64 = weights.iter().zip(&d_weights).map(|(w, g)| w * g).sum();
        for key in 0..t {
            let d_score = weights[key] * (d_weights[key] - mean) / (d as f64).sqrt();
            for i in 0..d {
                gradient[to(0, query, i)] += d_score * qkv[at(shape, b, key, 1, h, i)];
                gradient[to(1, key, i)] += d_score * qkv[at(shape, b, query, 0, h, i)];
                gradient[to(2, key, i)] += weights[key] * factor(key) * slope(i);
            }
        }
    }
    gradient
}

fn indices(shape: Shape) -> impl Iterator<Item = (usize, usize, usize)> {
    let Shape { batch, tokens, heads, .. } = shape;
    (0..batch * heads * tokens).map(move |i| (i / tokens / heads, i / tokens % heads, i % tokens))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(n: usize, seed: u64) -> Vec<f64> {
        let mut x = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut next = || {
            x ^= x << 13;
            x ^= x >> 7;
            x ^= x << 17;
            (x >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
        };
        (0..n).map(|_| next()).collect()
    }

    /// The loss is the output weighted by fixed numbers; its slope along each number of qkv is the gradient.
    fn check(shape: Shape, mask: Mask, factors: Option<&[f64]>) {
        const STEP: f64 = 1e-5;
        let Shape { batch, tokens: t, heads, width: d } = shape;
        let mut qkv = numbers(shape.rows() * 3 * shape.columns(), 1);
        let d_out = numbers(shape.rows() * shape.columns(), 2);
        let loss = |qkv: &[f64]| -> f64 {
            let out = forward(shape, qkv, mask, factors).out;
            let row_major = |i: usize| {
                let (b, h, token, i) = (i / d / t / heads, i / d / t % heads, i / d % t, i % d);
                d_out[(b * t + token) * heads * d + h * d + i]
            };
            out.iter().enumerate().map(|(i, x)| x * row_major(i)).sum()
        };
        let gradient = backward(shape, &qkv, &forward(shape, &qkv, mask, factors), factors, &d_out);
        for (b, h, token) in indices(shape) {
            for (part, i) in (0..3).flat_map(|part| (0..d).map(move |i| (part, i))) {
                let place = at(shape, b, token, part, h, i);
                let x = qkv[place];
                qkv[place] = x + STEP;
                let above = loss(&qkv);
                qkv[place] = x - STEP;
                let below = loss(&qkv);
                qkv[place] = x;
                let slope = (above - below) / (2.0 * STEP);
                let found = gradient[(((b * heads + h) * 3 + part) * t + token) * d + i];
                assert!((slope - found).abs() < 1e-8, "part {part} of {batch} {h} {token} {i}: {found}, slope {slope}");
            }
        }
    }

    #[test]
    fn gradients_are_the_slopes_of_the_output() {
        let shape = Shape { batch: 2, tokens: 4, heads: 2, width: 3 };
        let factors: Vec<f64> = numbers(2 * 2 * 16, 5).iter().map(|x| if *x > -0.4 { 1.25 } else { 0.0 }).collect();
        let mut mask: Vec<f32> = numbers(32, 7).iter().map(|x| *x as f32).collect();
        mask[4..8].fill(f32::NEG_INFINITY);
        mask[9] = f32::NEG_INFINITY;
        for factors in [None, Some(&factors[..])] {
            check(shape, Mask::Causal, factors);
            check(shape, Mask::Full, factors);
            check(shape, Mask::Additive(&mask[..16]), factors);
            check(shape, Mask::Additive(&mask), factors);
            check(shape, Mask::CausalAdditive(&mask), factors);
            check(Shape { batch: 1, tokens: 1, heads: 1, width: 1 }, Mask::Causal, factors.map(|f| &f[..1]));
        }
    }

    #[test]
    fn two_keys_of_which_the_second_weighs_three_times_the_first() {
        let shape = Shape { batch: 1, tokens: 2, heads: 1, width: 1 };
        // scores of the second query: 0 and ln 3; values 1 and 5
        let qkv = [0.0, 0.0, 1.0, 1.0, 3f64.ln(), 5.0];
        let attended = forward(shape, &qkv, Mask::Causal, None);
        let expected = [1.0, 4.0];
        assert!(attended.out.iter().zip(expected).all(|(x, e)| (x - e).abs() < 1e-12), "{:?}", attended.out);
        assert!((attended.weights[3] - 0.75).abs() < 1e-12);
    }
}
