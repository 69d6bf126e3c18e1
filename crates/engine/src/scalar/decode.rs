//! The model that [`crate::decode`] reads with, in plain loops and f64.

use crate::decode::{Before, BlockParts, Pair, Parts, Positions};

/// Logits (n, V) behind each of `tokens` (n), which begin the context; minus infinity where a token can't come.
pub fn logits(parts: &Parts, tokens: &[u32]) -> Vec<f64> {
    let width = parts.sizes.width;
    let mut x: Vec<Vec<f64>> = tokens
        .iter()
        .enumerate()
        .map(|(i, &id)| {
            let token = &parts.token[id as usize * width..];
            let added = |j: usize| position(parts, &tokens[..i], j) + previous(parts, &tokens[..=i], j);
            (0..width).map(|j| f64::from(token[j]) + added(j)).collect()
        })
        .collect();
    let turns: Vec<f64> = (0..tokens.len()).map(|i| turn(parts, &tokens[..i])).collect();
    for block in &parts.blocks {
        through(&mut x, block, parts.sizes.heads, &turns);
    }
    let head = (parts.head, parts.before);
    let behind = |i: usize| behind(head, &tokens[..=i], &norm(&x[i], parts.norm));
    (0..tokens.len()).flat_map(behind).collect()
}

/// Rows `x` through a block, each seeing those before it, queries and keys turned by `turns`.
pub(super) fn through(x: &mut [Vec<f64>], block: &BlockParts, heads: usize, turns: &[f64]) {
    attention(x, block, heads, turns);
    for x in x {
        let up = linear(&norm(x, block.norm2), block.up);
        let gelu = |x: f64| 0.5 * x * (1.0 + ((2.0 / std::f64::consts::PI).sqrt() * (x + 0.044715 * x.powi(3))).tanh());
        let up: Vec<f64> = up.into_iter().map(gelu).collect();
        add(x, &linear(&up, block.down));
    }
}

/// Logits (V) behind `tokens`, the last of which has become `y`, of a head (V, D).
pub(super) fn behind((head, before): (&[f32], Option<Before>), tokens: &[u32], y: &[f64]) -> Vec<f64> {
    let (width, vocabulary) = (y.len(), head.len() / y.len());
    let product = |table: &[f32], row: usize| {
        table[row * width..][..width].iter().zip(y).map(|(&w, y)| f64::from(w) * y).sum::<f64>()
    };
    let all = || (0..vocabulary).map(|id| product(head, id)).collect();
    let Some(before) = before else { return all() };
    let Some((relative, (place, back))) = before.relative.zip(back(&before, tokens, 1)) else { return all() };
    let Some(bins) = before.places.get(place) else { return all() };
    let n = bins.count as usize;
    let Some(p) = (0..n).find(|&p| bins.first as usize + p == back as usize) else { return all() };
    let mut logits = vec![f64::NEG_INFINITY; vocabulary];
    let most = before.places.iter().filter(|bins| !bins.circular).map(|bins| bins.count).max().unwrap_or(0) as usize;
    for j in 0..n {
        logits[bins.first as usize + j] = match bins.circular {
            true => product(relative.circular, (j + n - p) % n),
            false => product(relative.clamped, j + most - 1 - p),
        };
    }
    logits
}

/// The place that follows `tokens`, and the token that stands there so many `words` back.
fn back(before: &Before, tokens: &[u32], words: usize) -> Option<(usize, u32)> {
    let (length, behind) = (before.places.len() + 1, tokens.get(before.front..)?);
    let back = behind.len().checked_sub(words * length)?;
    Some((behind.len() % length, behind[back]))
}

/// Number `j` of what the last of `tokens` is told of the words before.
fn previous(parts: &Parts, tokens: &[u32], j: usize) -> f64 {
    let Some((before, tables)) = parts.before.and_then(|before| Some((before, before.previous?))) else { return 0.0 };
    let width = parts.sizes.width;
    let one = back(&before, tokens, 1);
    let step = || {
        let ((place, a), (_, b)) = (one?, back(&before, tokens, 2)?);
        let bins = before.places.get(place)?;
        let bin = |id: u32| (0..bins.count).find(|bin| bins.first + bin == id);
        Some(i64::from(bin(a)?) - i64::from(bin(b)?)).map(|step| step.rem_euclid(bins.count.into()) as usize)
    };
    let character = one.map_or(tables.missing, |(_, id)| id) as usize;
    let step = step().unwrap_or(tables.step.len() / width - 1);
    f64::from(tables.character[character * width + j]) + f64::from(tables.step[step * width + j])
}

/// The number of the word, by which the token behind those `before` is turned.
fn turn(parts: &Parts, before: &[u32]) -> f64 {
    let Some((rope, behind)) = parts.rope.and_then(|rope| Some((rope, before.get(rope.front..)?))) else { return 0.0 };
    let words = match (rope.word, parts.positions) {
        (Some(word), _) => behind.len() / word,
        (None, Positions::Words { end, .. }) => behind.iter().filter(|&&id| id == end).count(),
        (None, Positions::Places(_)) => 0,
    };
    1.0 + words as f64
}

/// Number `j` of what is added to the token behind those `before`.
fn position(parts: &Parts, before: &[u32], j: usize) -> f64 {
    let width = parts.sizes.width;
    match parts.positions {
        Positions::Places(table) => table[before.len() * width + j].into(),
        Positions::Words { front, .. } if before.len() * width < front.len() => front[before.len() * width + j].into(),
        Positions::Words { front, word, place, end } => {
            let behind = &before[front.len() / width..];
            let words = behind.iter().filter(|&&id| id == end).count();
            let places = behind.iter().rev().take_while(|&&id| id != end).count();
            let number = |table: &[f32], row: usize| f64::from(table[row.min(table.len() / width - 1) * width + j]);
            number(word, words) + number(place, places)
        }
    }
}

fn attention(x: &mut [Vec<f64>], block: &BlockParts, heads: usize, turns: &[f64]) {
    let (width, d) = (x[0].len(), x[0].len() / heads);
    let qkv: Vec<Vec<f64>> = x.iter().map(|x| linear(&norm(x, block.norm1), block.qkv)).collect();
    for (i, x) in x.iter_mut().enumerate() {
        let mut y = vec![0.0; width];
        for h in 0..heads {
            let part = |row: &[f64], kind: usize| row[kind * width + h * d..][..d].to_vec();
            let turned = |i: usize, kind: usize| {
                let row = part(&qkv[i], kind);
                let half = d / 2;
                let angle = |j: usize| turns[i] / 10_000f64.powf(2.0 * (j % half) as f64 / d as f64);
                let number = |j: usize| match turns[i] {
                    0.0 => row[j],
                    _ if j < half => row[j] * angle(j).cos() - row[j + half] * angle(j).sin(),
                    _ => row[j] * angle(j).cos() + row[j - half] * angle(j).sin(),
                };
                (0..d).map(number).collect::<Vec<f64>>()
            };
            let query = turned(i, 0);
            let dot = |a: &[f64], b: Vec<f64>| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let scores: Vec<f64> = (0..=i).map(|at| dot(&query, turned(at, 1)) / (d as f64).sqrt()).collect();
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

pub(super) fn norm(x: &[f64], (weight, bias): Pair) -> Vec<f64> {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let variance = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / x.len() as f64;
    let sd = (variance + 1e-5).sqrt();
    x.iter().zip(weight.iter().zip(bias)).map(|(x, (w, b))| (x - mean) / sd * f64::from(*w) + f64::from(*b)).collect()
}

pub(super) fn linear(x: &[f64], (weight, bias): Pair) -> Vec<f64> {
    let n = bias.len();
    let column = |j: usize| x.iter().enumerate().map(|(i, x)| x * f64::from(weight[i * n + j])).sum::<f64>();
    (0..n).map(|j| column(j) + f64::from(bias[j])).collect()
}

pub(super) fn add(x: &mut [f64], y: &[f64]) {
    x.iter_mut().zip(y).for_each(|(x, y)| *x += y);
}
