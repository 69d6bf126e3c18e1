//! Queries and keys turned by the frame they stand in.

use super::position::Tables;
use crate::arena::Floats;
use crate::words::Stand;

/// Turns queries and keys of every head by the number g of the token's word: 0 in front, 1 for the first word. Numbers j and
/// j + d/2 are turned by g 10000^(-2 j / d).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rope {
    /// K: tokens in front of the first word.
    pub front: usize,
    /// W: tokens of a word, its end among them; `None`: words are counted as [`super::Positions::Words`] counts them.
    pub word: Option<usize>,
}

impl Rope {
    /// g of the token at a place of the sequence, where words have one length; the most it can be where they haven't.
    fn number(self, place: usize) -> usize {
        let word = self.word.unwrap_or(1);
        place.checked_sub(self.front).map_or(0, |behind| 1 + behind / word)
    }
}

/// Cosines and sines of every word, (G, d): d/2 of each.
pub(super) struct Turns {
    rope: Rope,
    numbers: Floats,
    d: usize,
}

impl Turns {
    /// # Panics
    /// An odd d; words without tokens; words that are counted without positions that count them.
    pub fn new(rope: Rope, positions: &Tables, context: usize, d: usize) -> Turns {
        assert!(d.is_multiple_of(2), "pairs of {d} numbers");
        assert!(rope.word != Some(0), "words of no tokens");
        let counted = matches!(positions, Tables::Words { .. });
        assert!(rope.word.is_some() || counted, "words are counted where positions are");
        let (rows, half) = (rope.number(context) + 1, d / 2);
        let mut numbers = Floats::new(rows * d);
        for (g, row) in numbers.chunks_exact_mut(d.max(1)).enumerate() {
            for j in 0..half {
                let (sin, cos) = (g as f64 * 10_000f64.powf(-2.0 * j as f64 / d as f64)).sin_cos();
                (row[j], row[half + j]) = (cos as f32, sin as f32);
            }
        }
        Turns { rope, numbers, d }
    }

    /// Writes g of the tokens from place `first` on of a sequence; `stands` are theirs if words are counted.
    pub fn number(&self, numbers: &mut [u32], first: usize, stands: &[Stand]) {
        for (number, place) in numbers.iter_mut().zip(first..) {
            *number = match stands.get(place) {
                Some(stand) if self.rope.word.is_none() && place >= self.rope.front => 1 + stand.word as u32,
                _ => self.rope.number(place) as u32,
            };
        }
    }

    /// Turns `x` (d) as what stands in word `number`.
    pub fn turn(&self, x: &mut [f32], number: u32) {
        let (low, high) = x.split_at_mut(self.d / 2);
        let (cos, sin) = self.numbers[number as usize * self.d..][..self.d].split_at(self.d / 2);
        for ((x, y), (cos, sin)) in low.iter_mut().zip(high).zip(cos.iter().zip(sin)) {
            (*x, *y) = (*x * cos - *y * sin, *x * sin + *y * cos);
        }
    }
}
