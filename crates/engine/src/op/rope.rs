//! Rotary embedding: queries and keys rotated by angles that grow with the number of their word, in place. A head of d
//! numbers has d/2 pairs (j, j + d/2); pair j rotates by 10000^(-2j/d) radians a word.
//!
//! Source: Su et al., "RoFormer" (2021).

use super::rows;
use crate::arena::Floats;
use crate::dispatch;
use pulp::{Simd, WithSimd};

/// The angles of pair j grow by this to the power of -2j/d a word.
const BASE: f64 = 10000.0;

/// Cosines and sines of the first words.
pub struct Angles {
    /// `[word]`: d/2 cosines, then d/2 sines.
    numbers: Floats,
    width: usize,
}

impl Angles {
    /// The angles of words `0..words`, for heads of `width` numbers.
    ///
    /// # Panics
    /// If the width is 0 or odd.
    pub fn new(words: usize, width: usize) -> Angles {
        assert!(width > 0 && width.is_multiple_of(2), "heads of {width} numbers have no pairs");
        let mut numbers = Floats::new(words * width);
        for (word, row) in numbers.chunks_exact_mut(width).enumerate() {
            let (cosines, sines) = row.split_at_mut(width / 2);
            for (j, (cosine, sine)) in cosines.iter_mut().zip(sines).enumerate() {
                // in f64: an f32 angle of word 1000 would be off by 6e-5
                let (s, c) = (word as f64 * BASE.powf(-2.0 * j as f64 / width as f64)).sin_cos();
                (*cosine, *sine) = (c as f32, s as f32);
            }
        }
        Angles { numbers, width }
    }

    /// Rotates one head's query or key `x` (d).
    pub(crate) fn rotate(&self, x: &mut [f32], word: u32) {
        let (low, high) = x.split_at_mut(self.width / 2);
        let (cos, sin) = self.numbers[word as usize * self.width..][..self.width].split_at(self.width / 2);
        for ((x, y), (cos, sin)) in low.iter_mut().zip(high).zip(cos.iter().zip(sin)) {
            (*x, *y) = (*x * cos - *y * sin, *x * sin + *y * cos);
        }
    }
}

/// The rotation of each row.
#[derive(Clone, Copy)]
pub struct Rope<'a> {
    /// The angles of a word.
    pub angles: &'a Angles,
    /// The word of row r of the stream is `words[r % words.len()]`: N words, or T where every sequence has the same.
    pub words: &'a [u32],
}

/// Rotates the queries and keys of `qkv` (n, 3D), rows `first_row..first_row + n` of the stream, each row q, k, v of
/// `heads` heads; `back`: by the negative angles, as their gradients are.
///
/// # Panics
/// Shapes that don't fit; a word outside the angles.
pub fn turn(qkv: &mut [f32], heads: usize, first_row: usize, rope: Rope, back: bool) {
    let Rope { angles: Angles { numbers, width }, words } = rope;
    let stride = 3 * heads * width;
    let n = rows("queries, keys and values", qkv.len(), stride);
    assert!(n == 0 || !words.is_empty(), "no words for {n} rows");
    let mut named = (first_row..first_row + n).map(|r| words[r % words.len()]);
    if let Some(word) = named.find(|&word| (word as usize + 1) * width > numbers.len()) {
        panic!("word {word} of {}", numbers.len() / width);
    }
    dispatch::run(Turn { qkv, stride, width: *width, first_row, numbers, words, back });
}

struct Turn<'a> {
    qkv: &'a mut [f32],
    stride: usize,
    width: usize,
    first_row: usize,
    numbers: &'a [f32],
    words: &'a [u32],
    back: bool,
}

impl WithSimd for Turn<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Turn { qkv, stride, width, first_row, numbers, words, back } = self;
        for (r, row) in qkv.chunks_exact_mut(stride).enumerate() {
            let word = words[(first_row + r) % words.len()] as usize;
            let (cosines, sines) = numbers[word * width..][..width].split_at(width / 2);
            for head in row[..stride / 3 * 2].chunks_exact_mut(width) {
                let (a, b) = head.split_at_mut(width / 2);
                // swapping the halves of a pair negates the angle
                if back { turned(simd, b, a, cosines, sines) } else { turned(simd, a, b, cosines, sines) }
            }
        }
    }
}

/// (a, b) become (a cos - b sin, b cos + a sin).
#[inline(always)]
fn turned<S: Simd>(simd: S, a: &mut [f32], b: &mut [f32], cosines: &[f32], sines: &[f32]) {
    let ((a, a_tail), (b, b_tail)) = (S::as_mut_simd_f32s(a), S::as_mut_simd_f32s(b));
    let ((cosines, cosines_tail), (sines, sines_tail)) = (S::as_simd_f32s(cosines), S::as_simd_f32s(sines));
    let both = |a: S::f32s, b: S::f32s, c: S::f32s, s: S::f32s| {
        let left = simd.negate_mul_add_e_f32s(b, s, simd.mul_f32s(a, c));
        (left, simd.mul_add_e_f32s(a, s, simd.mul_f32s(b, c)))
    };
    for ((a, b), (c, s)) in a.iter_mut().zip(b).zip(cosines.iter().zip(sines)) {
        (*a, *b) = both(*a, *b, *c, *s);
    }
    if !a_tail.is_empty() {
        let load = |x: &[f32]| simd.partial_load_f32s(x);
        let (left, right) = both(load(a_tail), load(b_tail), load(cosines_tail), load(sines_tail));
        simd.partial_store_f32s(a_tail, left);
        simd.partial_store_f32s(b_tail, right);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, near, numbers};
    use crate::scalar::rope as scalar;

    /// Two products of numbers below 1 and their sum, with angles rounded to f32.
    const BOUND: f64 = 1e-6;

    #[test]
    fn queries_and_keys_turn_and_values_stay() {
        for (width, lanes) in (1..=34).map(|h| 2 * h).chain([128]).flat_map(|w| Lanes::ALL.map(|l| (w, l))) {
            for (heads, words) in [(1, vec![3, 0, 2, 1]), (3, (0..9).map(|r| r * 5 % 24).collect())] {
                let what = format!("{lanes:?}: {heads} heads of {width}");
                let angles = Angles::new(24, width);
                let before = numbers(1, 9 * 3 * heads * width, 1.0);
                let expected = scalar::turn(&before, heads, width, &words);
                let stride = 3 * heads * width;
                let run = |qkv: &mut [f32], first_row, back| {
                    let (numbers, words) = (&*angles.numbers, words.as_slice());
                    lanes.run(Turn { qkv, stride, width, first_row, numbers, words, back });
                };
                let mut qkv = before.clone();
                run(&mut qkv, 0, false);
                near(&what, &qkv, &expected, BOUND);
                // rows in the middle of a stream
                let mut part = before[4 * stride..].to_vec();
                run(&mut part, 4, false);
                assert_eq!(part, qkv[4 * stride..], "{what}");
                run(&mut qkv, 0, true);
                let before: Vec<f64> = before.iter().map(|&x| x as f64).collect();
                near(&what, &qkv, &before, BOUND);
            }
        }
    }

    #[test]
    fn words_have_angles() {
        let angles = Angles::new(3, 2);
        let rope = Rope { angles: &angles, words: &[2, 3] };
        turn(&mut [1.0; 6], 1, 0, rope, false);
        let found = std::panic::catch_unwind(|| turn(&mut [1.0; 12], 1, 0, rope, false)).unwrap_err();
        assert_eq!(found.downcast_ref::<String>().unwrap(), "word 3 of 3");
        let odd = std::panic::catch_unwind(|| Angles::new(3, 5)).err().unwrap();
        assert_eq!(odd.downcast_ref::<String>().unwrap(), "heads of 5 numbers have no pairs");
    }
}
