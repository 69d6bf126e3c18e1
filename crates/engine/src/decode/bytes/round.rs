//! Numbers rounded to bytes.

use super::{Way, pairs, quads};
use crate::decode::kernel::Left;
use crate::dispatch;
use pulp::{Simd, WithSimd};

/// The largest byte on either side of 0.
pub(super) const MOST: f32 = 127.0;
/// 1.5 * 2^23: added to it, a number is rounded to a whole one, which is in the last bits; the half keeps negative ones in
/// the same binade.
const WHOLE: f32 = 12_582_912.0;

/// Rows rounded to bytes.
#[derive(Debug, Default)]
pub(in crate::decode) struct Rows {
    /// (m, words).
    pub(super) numbers: Vec<u32>,
    /// (m): the factor of a row's bytes.
    pub(super) scales: Vec<f32>,
    /// Numbers of a word.
    word: usize,
    /// The bytes of a row.
    line: Vec<i8>,
}

impl Rows {
    /// Rounds the rows of `left`, k numbers each, for products of this way.
    pub fn round(&mut self, left: Left, k: usize, way: Way) {
        dispatch::run(Round { left, k, way, to: self });
    }

    /// # Panics
    /// If there aren't as many rows of as many words of this way.
    pub(super) fn check(&self, m: usize, words: usize, way: Way) {
        assert!(m == 0 || self.word == way.word(), "words of {} numbers", self.word);
        assert!(self.numbers.len() >= m * words && self.scales.len() >= m, "{m} rows of {words} words");
    }
}

struct Round<'a> {
    left: Left<'a>,
    k: usize,
    way: Way,
    to: &'a mut Rows,
}

impl WithSimd for Round<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Round { left: Left { data, rows, width, stride }, k, way, to: Rows { numbers, scales, word, line } } = self;
        let words = way.words(k);
        *word = way.word();
        numbers.resize(numbers.len().max(rows * words), 0);
        scales.resize(scales.len().max(rows), 0.0);
        line.resize(line.len().max(words * way.word()), 0);
        // padding of the last word: the panels have zeros there, so any byte would do
        line[k..].fill(0);
        for (row, scale) in scales.iter_mut().take(rows).enumerate() {
            // loops: the closures of iterators aren't compiled for the vectors of `S`
            let mut size = Size::new(simd);
            for at in (0..k).step_by(width) {
                size.add(simd, &data[(at / width * rows + row) * stride..][..width.min(k - at)]);
            }
            let size = size.get(simd);
            for at in (0..k).step_by(width) {
                let part = &data[(at / width * rows + row) * stride..][..width.min(k - at)];
                *scale = round(simd, &mut line[at..], part, size);
            }
            let to = &mut numbers[row * words..][..words];
            match way {
                Way::Quads => {
                    for (to, four) in to.iter_mut().zip(line.as_chunks().0) {
                        *to = quads::packed(*four);
                    }
                }
                _ => {
                    for (to, two) in to.iter_mut().zip(line.as_chunks().0) {
                        *to = pairs::packed(*two);
                    }
                }
            }
        }
    }
}

/// The size of the largest of some numbers.
#[derive(Clone, Copy)]
struct Size<S: Simd> {
    most: S::f32s,
    all: S::f32s,
    rest_most: f32,
    rest_all: f32,
}

impl<S: Simd> Size<S> {
    #[inline(always)]
    fn new(simd: S) -> Size<S> {
        let none = simd.splat_f32s(0.0);
        Size { most: none, all: none, rest_most: 0.0, rest_all: 0.0 }
    }

    #[inline(always)]
    fn add(&mut self, simd: S, numbers: &[f32]) {
        let (vectors, rest) = S::as_simd_f32s(numbers);
        for x in vectors {
            let size = simd.abs_f32s(*x);
            self.most = simd.max_f32s(self.most, size);
            self.all = simd.add_f32s(self.all, size);
        }
        for x in rest {
            self.rest_most = self.rest_most.max(x.abs());
            self.rest_all += x.abs();
        }
    }

    /// NaN where a number isn't finite.
    #[inline(always)]
    fn get(self, simd: S) -> f32 {
        // a maximum may pass over NaN, a sum never does
        let all = simd.reduce_sum_f32s(self.all) + self.rest_all;
        if all.is_finite() { simd.reduce_max_f32s(self.most).max(self.rest_most) } else { f32::NAN }
    }
}

/// The size of the largest number, NaN where one isn't finite.
#[inline(always)]
pub(in crate::decode) fn size_of<S: Simd>(simd: S, numbers: &[f32]) -> f32 {
    let mut size = Size::new(simd);
    size.add(simd, numbers);
    size.get(simd)
}

/// Rounds numbers, the largest of which has this [`size_of`]; returns their scale.
#[inline(always)]
pub(in crate::decode) fn round<S: Simd>(_: S, to: &mut [i8], numbers: &[f32], size: f32) -> f32 {
    let scale = size / MOST;
    // infinite for the smallest sizes, and then the bytes are arbitrary: a scale below 3e-39 makes them nothing
    let inverse = if scale > 0.0 { MOST / size } else { 0.0 };
    for (to, x) in to.iter_mut().zip(numbers) {
        *to = (x * inverse + WHOLE).to_bits() as i8;
    }
    scale
}
