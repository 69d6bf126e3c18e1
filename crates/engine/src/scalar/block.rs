//! A block and a head, forward only, in f64: their gradients are checked by differences.

use super::gelu::gelu;
use super::{attention, rope};
use crate::block::{Linear, Norm, Shape, Tensors};
use crate::op::attention::Mask;

/// `x` (N, k) times the weight (k, n) plus the bias (n).
pub fn linear(x: &[f64], layer: &Linear<Vec<f64>>) -> Vec<f64> {
    let n = layer.bias.len();
    let k = layer.weight.len() / n;
    let at = |row: &[f64], j: usize| layer.bias[j] + (0..k).map(|i| row[i] * layer.weight[i * n + j]).sum::<f64>();
    x.chunks(k).flat_map(|row| (0..n).map(move |j| at(row, j))).collect()
}

/// Rows of `x` (N, D) brought to mean 0 and variance 1, times the weight plus the bias.
pub fn layer_norm(x: &[f64], norm: &Norm<Vec<f64>>) -> Vec<f64> {
    let d = norm.weight.len();
    let row = |row: &[f64]| -> Vec<f64> {
        let mean = row.iter().sum::<f64>() / d as f64;
        let variance = row.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / d as f64;
        let rsd = 1.0 / (variance + crate::op::layer_norm::EPSILON as f64).sqrt();
        (0..d).map(|i| (row[i] - mean) * rsd * norm.weight[i] + norm.bias[i]).collect()
    };
    x.chunks(d).flat_map(row).collect()
}

/// The block's output (N, D) for its input `x` (N, D); queries and keys are turned by `words[row % words.len()]`, if there are
/// any.
pub fn forward(x: &[f64], shape: Shape, w: &Tensors<Vec<f64>>, mask: Mask, words: &[u32]) -> Vec<f64> {
    let mut qkv = linear(&layer_norm(x, &w.norm1), &w.qkv);
    if !words.is_empty() {
        qkv = rope::turn(&qkv, shape.heads, shape.width / shape.heads, words);
    }
    let (t, heads, d) = (shape.tokens, shape.heads, shape.width / shape.heads);
    let of = crate::op::attention::Shape { batch: shape.batch, tokens: t, heads, width: d };
    let out = attention::forward(of, &qkv, mask, None).out;
    let gathered = (0..shape.rows() * shape.width).map(|i| {
        let (row, column) = (i / shape.width, i % shape.width);
        let (sequence, token, head, j) = (row / t, row % t, column / d, column % d);
        out[((sequence * heads + head) * t + token) * d + j]
    });
    let middle = add(x, &linear(&gathered.collect::<Vec<f64>>(), &w.out));
    let hidden: Vec<f64> = linear(&layer_norm(&middle, &w.norm2), &w.up).into_iter().map(gelu).collect();
    add(&middle, &linear(&hidden, &w.down))
}

/// Sum of -ln p over the rows of `x`; the head is (V, D).
pub fn loss(x: &[f64], norm: &Norm<Vec<f64>>, head: &[f64], targets: &[u32]) -> f64 {
    let d = norm.weight.len();
    let normal = layer_norm(x, norm);
    let nats = |(row, target): (&[f64], &u32)| {
        let dot = |token: &[f64]| row.iter().zip(token).map(|(a, b)| a * b).sum::<f64>();
        let powers: f64 = head.chunks(d).map(|token| dot(token).exp()).sum();
        powers.ln() - dot(&head[*target as usize * d..][..d])
    };
    normal.chunks(d).zip(targets).map(nats).sum()
}

fn add(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}
