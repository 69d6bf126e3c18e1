//! The model that [`crate::decode`] reads with, in plain loops and f64.

use crate::decode::{BlockParts, Pair, Parts, Positions};

/// Logits (n, V) behind each of `tokens` (n), which begin the context.
pub fn logits(parts: &Parts, tokens: &[u32]) -> Vec<f64> {
    let width = parts.shape.width;
    let mut x: Vec<Vec<f64>> = tokens
        .iter()
        .enumerate()
        .map(|(i, &id)| {
            let token = &parts.token[id as usize * width..];
            (0..width).map(|j| f64::from(token[j]) + position(parts, &tokens[..i], j)).collect()
        })
        .collect();
    for block in &parts.blocks {
        attention(&mut x, block, parts.shape.heads);
        for x in &mut x {
            let up = linear(&norm(x, block.norm2), block.up);
            let gelu =
                |x: f64| 0.5 * x * (1.0 + ((2.0 / std::f64::consts::PI).sqrt() * (x + 0.044715 * x.powi(3))).tanh());
            let up: Vec<f64> = up.into_iter().map(gelu).collect();
            add(x, &linear(&up, block.down));
        }
    }
    let head = |x: &Vec<f64>| {
        let y = norm(x, parts.norm);
        let row = move |row: &[f32]| row.iter().zip(&y).map(|(&w, y)| f64::from(w) * y).sum::<f64>();
        parts.head.chunks(width).map(row).collect::<Vec<f64>>()
    };
    x.iter().flat_map(head).collect()
}

/// Number `j` of what is added to the token behind those `before`.
fn position(parts: &Parts, before: &[u32], j: usize) -> f64 {
    let width = parts.shape.width;
    match parts.positions {
        Positions::Places(table) => table[before.len() * width + j].into(),
        Positions::Words { front, .. } if before.is_empty() => front[j].into(),
        Positions::Words { word, place, end, .. } => {
            let behind = &before[1..];
            let words = behind.iter().filter(|&&id| id == end).count();
            let places = behind.iter().rev().take_while(|&&id| id != end).count();
            let number = |table: &[f32], row: usize| f64::from(table[row.min(table.len() / width - 1) * width + j]);
            number(word, words) + number(place, places)
        }
    }
}

fn attention(x: &mut [Vec<f64>], block: &BlockParts, heads: usize) {
    let (width, d) = (x[0].len(), x[0].len() / heads);
    let qkv: Vec<Vec<f64>> = x.iter().map(|x| linear(&norm(x, block.norm1), block.qkv)).collect();
    for (i, x) in x.iter_mut().enumerate() {
        let mut y = vec![0.0; width];
        for h in 0..heads {
            let part = |row: &[f64], kind: usize| row[kind * width + h * d..][..d].to_vec();
            let dot = |a: Vec<f64>, b: Vec<f64>| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let score = |row: &Vec<f64>| dot(part(&qkv[i], 0), part(row, 1)) / (d as f64).sqrt();
            let scores: Vec<f64> = qkv[..=i].iter().map(score).collect();
            let most = scores.iter().copied().fold(f64::MIN, f64::max);
            let weights: Vec<f64> = scores.iter().map(|s| (s - most).exp()).collect();
            let total: f64 = weights.iter().sum();
            for (row, weight) in qkv[..=i].iter().zip(weights) {
                part(row, 2).iter().enumerate().for_each(|(j, v)| y[h * d + j] += weight / total * v);
            }
        }
        add(x, &linear(&y, block.out));
    }
}

fn norm(x: &[f64], (weight, bias): Pair) -> Vec<f64> {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let variance = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / x.len() as f64;
    let sd = (variance + 1e-5).sqrt();
    x.iter().zip(weight.iter().zip(bias)).map(|(x, (w, b))| (x - mean) / sd * f64::from(*w) + f64::from(*b)).collect()
}

fn linear(x: &[f64], (weight, bias): Pair) -> Vec<f64> {
    let n = bias.len();
    let column = |j: usize| x.iter().enumerate().map(|(i, x)| x * f64::from(weight[i * n + j])).sum::<f64>();
    (0..n).map(|j| column(j) + f64::from(bias[j])).collect()
}

fn add(x: &mut [f64], y: &[f64]) {
    x.iter_mut().zip(y).for_each(|(x, y)| *x += y);
}
