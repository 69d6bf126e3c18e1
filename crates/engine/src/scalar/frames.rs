//! The model of two stacks that [`crate::decode::FrameDecoder`] reads with, in plain loops and f64.

use super::decode::{add, behind, linear, norm, through};
use crate::bins::Bins;
use crate::decode::{Before, FrameConditioning, FrameParts};
use crate::op::embedding::NONE;

/// Logits (n, V) behind each of `tokens` (n), which begin the context; minus infinity where a token can't come, 0 in the
/// front. `told`: what each frame is told, nothing beyond its end.
///
/// # Panics
/// Frames that are told something by a model that can't be.
pub fn logits(parts: &FrameParts, tokens: &[u32], conditioning: &[Option<FrameConditioning>]) -> Vec<f64> {
    let ahead = parts.sizes.front - 1;
    let mut all = vec![0.0; tokens.len().min(ahead) * parts.sizes.vocabulary];
    if tokens.len() <= ahead {
        return all;
    }
    let (labels, tokens) = (&tokens[1..=ahead], &tokens[ahead..]);
    let word = parts.places.len() + 1;
    let frames = tokens.len().div_ceil(word);
    let mut trunk: Vec<Vec<f64>> = (0..frames).map(|frame| before(parts, tokens, frame)).collect();
    for &label in labels {
        let label = wide(parts.labels[0], label as usize, parts.sizes.trunk.width);
        trunk.iter_mut().for_each(|x| add(x, &label));
    }
    for (x, conditioning) in trunk.iter_mut().zip(conditioning) {
        add_told(x, parts.conditioning.map(|parts| parts.trunk), *conditioning);
    }
    for block in &parts.trunk {
        through(&mut trunk, block, parts.sizes.trunk.heads, &vec![0.0; frames]);
    }
    let words = Before { front: 1, places: parts.places, previous: None, relative: Some(parts.relative) };
    for (frame, known) in trunk.iter().enumerate() {
        let mut known = linear(&norm(known, parts.trunk_norm), parts.join);
        for &label in labels {
            let label = wide(parts.labels[1], label as usize, known.len());
            add(&mut known, &label);
        }
        let conditioning = conditioning.get(frame).copied().flatten();
        add_told(&mut known, parts.conditioning.map(|parts| parts.speller), conditioning);
        let end = tokens.len().min((frame + 1) * word);
        let row = |i: usize| row(parts, &tokens[..=i], (frame, i - frame * word), &known);
        let mut rows: Vec<Vec<f64>> = (frame * word..end).map(row).collect();
        if let Some((conditioning, parts)) = conditioning.zip(parts.conditioning) {
            for (place, x) in rows.iter_mut().enumerate() {
                let tables = conditioning.rows.iter().zip(parts.rows).filter(|(rows, _)| rows[place] != NONE);
                tables.for_each(|(rows, table)| add(x, &wide(table, rows[place] as usize, known.len())));
            }
        }
        for block in &parts.speller {
            let none = vec![0.0; rows.len()];
            through(&mut rows, block, parts.sizes.speller.heads, &none);
        }
        for (i, x) in (frame * word..).zip(&rows) {
            all.extend(behind((parts.head, Some(words)), &tokens[..=i], &norm(x, parts.norm)));
        }
    }
    all
}

/// The largest count of bins of the places that go round or don't.
fn most(parts: &FrameParts, circular: bool) -> usize {
    parts.places.iter().filter(|bins| bins.circular == circular).map(|bins| bins.count as usize).max().unwrap_or(0)
}

/// The bin at a place of a frame so many `frames` before another.
fn bin(parts: &FrameParts, tokens: &[u32], (frame, place): (usize, usize), frames: usize) -> Option<usize> {
    let Bins { first, count, .. } = *parts.places.get(place)?;
    let id = tokens[1 + frame.checked_sub(frames)? * (parts.places.len() + 1) + place];
    (0..count as usize).find(|bin| first as usize + bin == id as usize)
}

/// The trunk's input for a frame.
fn before(parts: &FrameParts, tokens: &[u32], frame: usize) -> Vec<f64> {
    let (e, width) = (parts.sizes.character, parts.sizes.trunk.width);
    let missing = most(parts, true).max(most(parts, false));
    let mut conditioning = Vec::new();
    for frames in [1, 2] {
        for place in 0..parts.places.len() {
            let row = place * (missing + 1) + bin(parts, tokens, (frame, place), frames).unwrap_or(missing);
            conditioning.extend(parts.bins[row * e..][..e].iter().map(|&x| f64::from(x)));
        }
    }
    let mut x = linear(&conditioning, parts.frames);
    add(&mut x, &wide(parts.positions, frame, width));
    x
}

/// The speller's input for the last of `tokens`, which is followed by a place of a frame.
fn row(parts: &FrameParts, tokens: &[u32], (frame, place): (usize, usize), known: &[f64]) -> Vec<f64> {
    let (round, clamps) = (most(parts, true), most(parts, false));
    let (missing, none) = (round.max(clamps), round + if clamps > 0 { 2 * clamps - 1 } else { 0 });
    let step = |place: usize, from: usize, to: usize| {
        let n = parts.places[place].count as usize;
        if parts.places[place].circular { (to + n - from) % n } else { round + to + clamps - from - 1 }
    };
    let at = |place, frames| bin(parts, tokens, (frame, place), frames);
    let last = match place.checked_sub(1).map(|place| (place, at(place, 0), at(place, 1))) {
        Some((place, Some(x), Some(p))) => step(place, p, x),
        Some((_, Some(x), None)) => none + 1 + x,
        _ => none,
    };
    let (a, b) = (at(place, 1), at(place, 2));
    let steps = a.zip(b).map_or(none, |(a, b)| step(place, b, a));
    let mut z = known.to_vec();
    let rows = [(parts.last, last), (parts.place, place), (parts.back, a.unwrap_or(missing)), (parts.step, steps)];
    for (table, row) in rows {
        add(&mut z, &wide(table, row, known.len()));
    }
    z
}

/// Adds what the numbers that a frame is told times `matrix` (P, n) give to `x` (n).
fn add_told(x: &mut [f64], matrix: Option<&[f32]>, conditioning: Option<FrameConditioning>) {
    let Some(conditioning) = conditioning else { return };
    let matrix = matrix.expect("a model that can be told");
    for (i, &number) in conditioning.numbers.iter().enumerate() {
        let row: Vec<f64> = wide(matrix, i, x.len()).iter().map(|y| f64::from(number) * y).collect();
        add(x, &row);
    }
}

/// A row of a table.
fn wide(table: &[f32], row: usize, width: usize) -> Vec<f64> {
    table[row * width..][..width].iter().map(|&x| f64::from(x)).collect()
}
