//! How near any row of a block may be, by heads alone.
//!
//! The squared distance of a query v from what a row's bytes stand for is at least what is the query's alone less twice a
//! product of two vectors: the row's head and two numbers more, and the query's weights and two more. So the greatest of a
//! block's products, its promise, bounds all its rows, and the promises to many queries are one product of matrices.

use super::distance::{SearchOptions, Side};
use super::quantize::{Query, Size, cosine};

/// Numbers of a row beside its head that a bound by heads takes.
pub const BESIDE: usize = 2;

impl Size {
    /// The length of s b in the rest, and half of the square of its whole length.
    pub fn beside(&self) -> [f32; BESIDE] {
        [self.rest.sqrt(), (self.head + self.rest) / 2.0].map(|x| x as f32)
    }
}

/// What the sizes of some rows are within: of [`Size::norm`] the least and the greatest, else the greatest.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    norms: [f64; 2],
    error: f64,
    length: f64,
    /// The square of the length of all of s b.
    square: f64,
}

impl Extent {
    /// Of at least one row.
    pub fn of(sizes: &[Size]) -> Extent {
        let none = Extent { norms: [f64::INFINITY, 0.0], error: 0.0, length: 0.0, square: 0.0 };
        sizes.iter().fold(none, |all, size| Extent {
            norms: [all.norms[0].min(size.norm), all.norms[1].max(size.norm)],
            error: all.error.max(size.error),
            length: all.length.max(size.length),
            square: all.square.max(size.head + size.rest),
        })
    }
}

impl Query {
    /// The vector whose product with a row's head and [`Size::beside`] is the row's promise. The squared distance is at least
    /// what is the query's alone less twice the promise; where the farthest are searched it is at most that, and twice the
    /// promise more.
    pub fn promising(&self, farthest: bool) -> impl Iterator<Item = f32> + '_ {
        let sign = if farthest { -1.0 } else { 1.0 };
        let beside: [f32; BESIDE] = [self.rest_length as f32, -sign];
        self.weights.iter().map(move |x| sign * x).chain(beside)
    }

    /// The same product, of a head whose own is known.
    #[inline]
    pub fn promise(&self, product: i64, [rest, half]: [f32; BESIDE], farthest: bool) -> f32 {
        let sign = if farthest { -1.0 } else { 1.0 };
        let head = self.head.dots.step() * product as f64 - f64::from(half);
        (sign * head + self.rest_length * f64::from(rest)) as f32
    }

    /// The greatest rank that any of some rows may have, by the greatest of their promises.
    pub fn most(&self, promise: f32, extent: &Extent, wanted: SearchOptions) -> f64 {
        let own = self.head.square + self.rest.square;
        // Higham's gamma for the sum of a head and a few roundings more: the sizes of the terms add up to at most half of the
        // query's square and the row's, and the distance has them twice
        let roundings = (self.weights.len() + 8) as f64 * 0.5f64.powi(24);
        let rounded = (roundings / (1.0 - roundings) + 4.0 * self.slack) * (own + 2.0 * extent.square);
        let off = 2.0 * self.head.dots.error() * extent.length + rounded + f64::from(f32::MIN_POSITIVE);
        let square = match wanted.farthest {
            false => (own - 2.0 * f64::from(promise) - off).max(0.0),
            true => (own + 2.0 * f64::from(promise) + off).max(0.0),
        };
        let cosine = |side| cosine([square; 2], extent.error, side);
        // a rank is greatest at an end of the lengths, or at the foot of the perpendicular on their direction
        let [low, high] = extent.norms;
        let foot = (self.norm * cosine(Side::Greatest)).clamp(low, high);
        let rank = |length| wanted.rank(cosine, Side::Greatest, self.norm, length);
        rank(low).max(rank(high)).max(rank(foot))
    }
}

#[cfg(test)]
mod tests {
    use super::super::distance::Distance;
    use super::super::quantize::{Ranges, widths};
    use super::*;
    use crate::feature::tests::noise;

    /// Features whose bytes have a head and a rest, of very different lengths, one of them zeros.
    fn features(numbers: usize) -> Vec<f32> {
        let size = |i: usize| [1.0, 1e-20, 0.0, 3.0, 1e15][i / numbers % 5] / (1.0 + (i % numbers) as f64);
        noise(5, 60 * numbers).iter().enumerate().map(|(i, x)| ((x + 0.5) * size(i)) as f32).collect()
    }

    #[test]
    fn no_row_is_nearer_than_its_block_promises() {
        let mut near = f64::INFINITY;
        for numbers in [300, 128, 7] {
            let all = features(numbers);
            let mut ranges = Ranges::new(numbers);
            all.chunks_exact(numbers).for_each(|f| ranges.add(f, Size::of(f).norm));
            let scales = ranges.scales();
            let [head, rest] = widths(numbers);
            let mut heads = vec![0; 60 * head];
            let rows = heads.chunks_exact_mut(head).zip(all.chunks_exact(numbers));
            let quantize =
                |(row, f): (&mut [i8], &[f32])| scales.quantize(f, Size::of(f).norm, [row, &mut vec![0; rest]]);
            let sizes: Vec<Size> = rows.map(quantize).collect();
            for v in all.chunks_exact(numbers).take(10) {
                let query = scales.query(v, Size::of(v).norm);
                let mut products = vec![0; 60];
                query.heads(&mut products, &heads);
                for (block, extent) in
                    [0..60, 0..1, 2..3, 20..30].map(|block| (block.clone(), Extent::of(&sizes[block])))
                {
                    for distance in [Distance::Cosine, Distance::Euclid] {
                        for farthest in [false, true] {
                            let wanted = SearchOptions { k: 1, distance, one_per_clip: false, farthest };
                            let rank = |row: usize| {
                                let score = distance.score(v, &all[row * numbers..][..numbers]);
                                let rank = if distance == Distance::Euclid { -score * score } else { score };
                                if farthest { -rank } else { rank }
                            };
                            let promise = |row: usize| query.promise(products[row], sizes[row].beside(), farthest);
                            let vector: Vec<f32> = query.promising(farthest).collect();
                            let by_vector = |row: usize| {
                                let numbers = heads[row * head..][..head].iter().map(|&x| f32::from(x));
                                numbers.chain(sizes[row].beside()).zip(&vector).map(|(x, y)| x * y).sum::<f32>()
                            };
                            let best = block.clone().map(rank).fold(f64::NEG_INFINITY, f64::max);
                            for promise in [&promise as &dyn Fn(usize) -> f32, &by_vector] {
                                let greatest = block.clone().map(promise).fold(f32::NEG_INFINITY, f32::max);
                                let most = query.most(greatest, &extent, wanted);
                                assert!(most >= best, "{numbers} {wanted:?} {block:?}: {most} < {best}");
                                if distance == Distance::Cosine && block.len() == 1 {
                                    near = near.min(most - best);
                                }
                            }
                        }
                    }
                }
            }
        }
        assert!(near < 0.01, "a bound that is never near bounds nothing: {near}");
    }
}
