//! Unit vectors as signed bytes: each coefficient on a scale of its own, and how far the bytes are off.
//!
//! The bytes b of a feature over its length, u, mean c + s b, with a centre c and a step s a coefficient. A query v is
//! compared in the same frame, |v - u| = |(v - c) - (u - c)|, so that neither the mean pose nor the greatest coefficients
//! cost precision.
//!
//! The coefficients that vary most come first. The first of them, the head, bound the whole distance: what the rest adds lies
//! between the squares of the difference and of the sum of both rests' lengths.

use super::distance::{Side, dot};
use kinelm_engine::op::dots;

/// The largest byte.
const MOST: f64 = 127.0;
/// Numbers of a head, at most.
const HEAD: usize = 128;
/// Coefficients as whole numbers, whose sums are the same in every order.
const WHOLE: f64 = (1u64 << 31) as f64;

/// Bytes of a row's head and of its rest, for features of `numbers`.
pub fn widths(numbers: usize) -> [usize; 2] {
    [numbers.min(HEAD), numbers.saturating_sub(HEAD)].map(|n| n.next_multiple_of(dots::PAD).max(dots::PAD))
}

/// The quantities stored beside a feature's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Size {
    /// Length of the feature.
    pub norm: f64,
    /// A bound of the distance between what the bytes stand for and the feature over its length.
    pub error: f64,
    /// The square of the length of s b in the head.
    pub head: f64,
    /// The same in the rest.
    pub rest: f64,
    /// Length of b.
    pub length: f64,
}

impl Size {
    /// Of a feature without bytes.
    pub fn of(feature: &[f32]) -> Size {
        Size { norm: dot(feature, feature).sqrt(), ..Size::default() }
    }
}

/// The least and greatest that each coefficient is among unit vectors, and how much it varies.
#[derive(Debug, Clone)]
pub struct Ranges {
    /// (D).
    limits: Vec<[f64; 2]>,
    /// (D) the sum of the coefficients in units of 1 / [`WHOLE`], and that of their squares.
    sums: Vec<[i128; 2]>,
    count: i128,
}

impl Ranges {
    /// Of no vectors of D = `numbers`.
    pub fn new(numbers: usize) -> Ranges {
        let (limits, sums) = (vec![[f64::INFINITY, f64::NEG_INFINITY]; numbers], vec![[0; 2]; numbers]);
        Ranges { limits, sums, count: 0 }
    }

    /// Counts a feature of length `norm` in, if it has one.
    pub fn add(&mut self, feature: &[f32], norm: f64) {
        if norm > 0.0 {
            self.count += 1;
            for (([low, high], [sum, squares]), x) in
                self.limits.iter_mut().zip(&mut self.sums).zip(unit(feature, norm))
            {
                (*low, *high) = (low.min(x), high.max(x));
                let whole = (x * WHOLE) as i64;
                (*sum, *squares) = (*sum + i128::from(whole), *squares + i128::from(whole) * i128::from(whole));
            }
        }
    }

    /// Of the vectors of both.
    pub fn merge(mut self, other: Ranges) -> Ranges {
        for ([low, high], [other_low, other_high]) in self.limits.iter_mut().zip(other.limits) {
            (*low, *high) = (low.min(other_low), high.max(other_high));
        }
        for ([sum, squares], [other_sum, other_squares]) in self.sums.iter_mut().zip(other.sums) {
            (*sum, *squares) = (*sum + other_sum, *squares + other_squares);
        }
        self.count += other.count;
        self
    }

    /// Scales on which all of them have bytes.
    pub fn scales(&self) -> Scales {
        let energy = |&i: &u32| {
            let [sum, squares] = self.sums[i as usize];
            squares.saturating_mul(self.count).saturating_sub(sum.saturating_mul(sum))
        };
        let mut order: Vec<u32> = (0..self.limits.len() as u32).collect();
        // stable: of equal ones the first stays first
        order.sort_by_key(|i| std::cmp::Reverse(energy(i)));
        let scale = |&i: &u32| match self.limits[i as usize] {
            [low, high] if low <= high => {
                let centre = ((low + high) / 2.0) as f32;
                // from the rounded centre: half of high - low may be a little short on one side
                let reach = (high - f64::from(centre)).max(f64::from(centre) - low);
                [centre, (reach / MOST) as f32]
            }
            _ => [0.0; 2],
        };
        Scales { scales: order.iter().map(scale).collect(), order }
    }
}

/// How the coefficients of unit vectors are rounded to bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct Scales {
    /// (D, 2) the centre and the step of each coefficient, in the order of a row.
    pub scales: Vec<[f32; 2]>,
    /// (D) the coefficient at each place of a row.
    pub order: Vec<u32>,
}

impl Scales {
    /// `head` and `rest` become the bytes of a feature of length `norm`, then zeros; those of a zero vector are zeros.
    ///
    /// # Panics
    /// When they have other lengths than [`widths`].
    pub fn quantize(&self, feature: &[f32], norm: f64, [head, rest]: [&mut [i8]; 2]) -> Size {
        assert_eq!([head.len(), rest.len()], widths(feature.len()), "a row of another width");
        head.fill(0);
        rest.fill(0);
        let mut size = Size { norm, ..Size::default() };
        if norm == 0.0 {
            return size;
        }
        let in_head = feature.len().min(HEAD);
        for (place, (from_centre, step)) in self.centred(feature, norm).enumerate() {
            let (byte, square) = match place.checked_sub(in_head) {
                None => (&mut head[place], &mut size.head),
                Some(place) => (&mut rest[place], &mut size.rest),
            };
            if step > 0.0 {
                *byte = (from_centre / step).round().clamp(-MOST, MOST) as i8;
            }
            let (whole, stands_for) = (f64::from(*byte), f64::from(*byte) * step);
            size.error += (from_centre - stands_for).powi(2);
            *square += stands_for * stands_for;
            size.length += whole * whole;
        }
        // rounded up beyond what the sum in f64 may be off, as it is a bound
        size.error = size.error.sqrt() * (1.0 + 1e-9) + 1e-15;
        size.length = size.length.sqrt() * (1.0 + 1e-9);
        size
    }

    /// A query of length `norm`, to be compared with rows of these scales.
    pub fn query(&self, feature: &[f32], norm: f64) -> Query {
        let in_head = feature.len().min(HEAD);
        let half = |from: usize, count: usize| {
            let all = || self.centred(feature, norm).skip(from).take(count);
            // of no numbers a row is zeros, and so is its product
            let weights: Vec<f64> = all().map(|(x, step)| x * step).chain((count == 0).then_some(0.0)).collect();
            (Half { square: all().map(|(x, _)| x * x).sum(), dots: dots::Query::new(&weights) }, weights)
        };
        let [(head, weights), (rest, _)] = [half(0, in_head), half(in_head, feature.len() - in_head)];
        let mut weights: Vec<f32> = weights.into_iter().map(|x| x as f32).collect();
        weights.resize(widths(feature.len())[0], 0.0);
        // a rounding per term of the sums, and some for what surrounds them
        let slack = (feature.len() + 16) as f64 * f64::EPSILON;
        Query { rest_length: rest.square.sqrt(), head, rest, slack, weights, norm }
    }

    /// How far the coefficients of a feature over its length are from their centres, with their steps, in the order of a row.
    fn centred(&self, feature: &[f32], norm: f64) -> impl Iterator<Item = (f64, f64)> {
        let over = over(norm);
        self.order.iter().zip(&self.scales).map(move |(&i, scale)| {
            let [centre, step] = scale.map(f64::from);
            (f64::from(feature[i as usize]) * over - centre, step)
        })
    }
}

/// A feature over its length; zeros for a zero vector.
fn unit(feature: &[f32], norm: f64) -> impl Iterator<Item = f64> + '_ {
    let over = over(norm);
    feature.iter().map(move |&x| f64::from(x) * over)
}

fn over(norm: f64) -> f64 {
    if norm > 0.0 { 1.0 / norm } else { 0.0 }
}

/// A unit vector v that bytes are compared with.
#[derive(Debug, Clone)]
pub struct Query {
    pub(super) head: Half,
    pub(super) rest: Half,
    /// The length of v - c in the rest.
    pub(super) rest_length: f64,
    /// A bound of the relative error of sums in f64.
    pub(super) slack: f64,
    /// s (v - c) in the head, and zeros to a row's width.
    pub(super) weights: Vec<f32>,
    /// The length of the feature.
    pub(super) norm: f64,
}

/// The head or the rest of one.
#[derive(Debug, Clone)]
pub(super) struct Half {
    /// The square of the length of v - c.
    pub square: f64,
    /// Of s (v - c).
    pub dots: dots::Query,
}

impl Query {
    /// `out` becomes the products with heads of rows, for [`Query::by_head`].
    ///
    /// # Panics
    /// When there are not as many rows as numbers of `out`.
    pub fn heads(&self, out: &mut [i64], bytes: &[i8]) {
        self.head.dots.dots(out, bytes);
    }

    /// The product with the rest of a row, for [`Query::by_all`].
    ///
    /// # Panics
    /// When it isn't one row.
    pub fn rest(&self, bytes: &[i8]) -> i64 {
        let mut product = [0];
        self.rest.dots.dots(&mut product, bytes);
        product[0]
    }

    /// Least and greatest squared distance of v from what a row's bytes stand for, by the product with its head.
    #[inline]
    pub fn by_head(&self, product: i64, size: &Size) -> [f64; 2] {
        let squares = self.head.square + size.head;
        let middle = squares - 2.0 * self.head.dots.step() * product as f64;
        let rest = size.rest.sqrt();
        let all = squares + self.rest.square + size.rest;
        let off = 2.0 * self.head.dots.error() * size.length + 4.0 * self.slack * all;
        let [near, far] = [self.rest_length - rest, self.rest_length + rest].map(|x| x * x);
        [(middle - off + near).max(0.0), (middle + off + far).max(0.0)]
    }

    /// The same by the products with both.
    pub fn by_all(&self, [head, rest]: [i64; 2], size: &Size) -> [f64; 2] {
        let squares = self.head.square + self.rest.square + size.head + size.rest;
        let product = self.head.dots.step() * head as f64 + self.rest.dots.step() * rest as f64;
        let middle = squares - 2.0 * product;
        let error = self.head.dots.error().hypot(self.rest.dots.error());
        let off = 2.0 * error * size.length + 4.0 * self.slack * squares;
        [(middle - off).max(0.0), (middle + off).max(0.0)]
    }
}

/// The least or the greatest that the cosine of v and a row's feature may be, by the least and greatest squared distance of v
/// from what its bytes stand for, and how far the feature is from that at most.
#[inline]
pub(super) fn cosine([near, far]: [f64; 2], error: f64, side: Side) -> f64 {
    // the triangle inequality
    let distance = match side {
        Side::Least => far.sqrt() + error,
        Side::Greatest => (near.sqrt() - error).max(0.0),
    };
    // of unit vectors |v - u|^2 = 2 - 2 cos
    1.0 - distance * distance / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::tests::noise;

    fn features(count: usize, numbers: usize, size: f64) -> Vec<f32> {
        let spread = |i: usize| size / (1.0 + (i % numbers) as f64) + 3.0 * size * f64::from(i % numbers == 2);
        noise(3, count * numbers).iter().enumerate().map(|(i, &x)| (x * spread(i) + spread(i)) as f32).collect()
    }

    fn scales_of(all: &[f32], numbers: usize) -> Scales {
        let mut ranges = Ranges::new(numbers);
        all.chunks_exact(numbers).for_each(|f| ranges.add(f, Size::of(f).norm));
        ranges.scales()
    }

    /// A row, which was something else before.
    fn row(numbers: usize) -> [Vec<i8>; 2] {
        widths(numbers).map(|width| vec![7; width])
    }

    fn quantized(scales: &Scales, feature: &[f32], [head, rest]: &mut [Vec<i8>; 2]) -> Size {
        scales.quantize(feature, Size::of(feature).norm, [head, rest])
    }

    #[test]
    fn cosines_are_within_their_bounds_and_the_bounds_are_near() {
        for (numbers, size) in [(1152, 1.0), (200, 1.0), (45, 1e-38), (45, 1e30), (3, 1.0), (1, 1.0)] {
            let all = features(40, numbers, size);
            let scales = scales_of(&all, numbers);
            let mut row = row(numbers);
            let mut near = 0.0f64;
            for v in all.chunks_exact(numbers).take(8) {
                let query = scales.query(v, Size::of(v).norm);
                for u in all.chunks_exact(numbers) {
                    let size = quantized(&scales, u, &mut row);
                    let mut head = [0];
                    query.heads(&mut head, &row[0]);
                    let exact = dot(u, v) / (size.norm * Size::of(v).norm);
                    let all = query.by_all([head[0], query.rest(&row[1])], &size);
                    let [by_all, by_head] = [all, query.by_head(head[0], &size)]
                        .map(|squares| [Side::Least, Side::Greatest].map(|side| cosine(squares, size.error, side)));
                    for [least, greatest] in [by_all, by_head] {
                        assert!(least - 1e-12 <= exact && exact <= greatest + 1e-12, "{least} {exact} {greatest}");
                    }
                    assert!(by_all[1] - by_all[0] < 0.05, "{by_all:?}");
                    near = near.max(by_head[1] - by_head[0]);
                }
            }
            // the coefficients that vary most are in the head
            assert!(near < if numbers > HEAD { 1.5 } else { 0.05 }, "{numbers}: {near}");
        }
    }

    #[test]
    fn what_varies_most_comes_first() {
        // the second number is large and still, the third varies most
        let all = [[0.1f32, 3.0, 1.0], [0.2, 3.0, -1.0], [0.1, 3.0, 2.0]].concat();
        assert_eq!(scales_of(&all, 3).order, [2, 1, 0]);
        let still = [[1.0f32, 1.0], [1.0, 1.0]].concat();
        assert_eq!(scales_of(&still, 2).order, [0, 1], "of equal ones the first");
    }

    #[test]
    fn bytes_are_as_near_as_is_said() {
        let (numbers, count) = (177, 30);
        let all = features(count, numbers, 1.0);
        let scales = scales_of(&all, numbers);
        for feature in all.chunks_exact(numbers) {
            let mut row = row(numbers);
            let size = quantized(&scales, feature, &mut row);
            let bytes: Vec<i8> = row[0].iter().chain(&row[1]).copied().collect();
            let off = |(place, &i): (usize, &u32)| {
                let [centre, step] = scales.scales[place].map(f64::from);
                (f64::from(feature[i as usize]) / size.norm - centre - step * f64::from(bytes[place])).powi(2)
            };
            let error = scales.order.iter().enumerate().map(off).sum::<f64>().sqrt();
            assert!(error <= size.error && size.error < error + 1e-9, "{error} {size:?}");
            // no byte is cut off: at most half a step a coefficient
            let half = scales.scales.iter().map(|&[_, step]| (f64::from(step) * 0.5001).powi(2)).sum::<f64>().sqrt();
            assert!(size.error <= half && bytes[numbers..].iter().all(|&b| b == 0), "{size:?}");
        }
    }

    #[test]
    fn zeros_and_single_vectors_have_bytes() {
        let mut ranges = Ranges::new(3);
        ranges.add(&[0.0; 3], 0.0);
        let mut row = row(3);
        assert_eq!(quantized(&ranges.scales(), &[0.0; 3], &mut row), Size::default());
        assert_eq!(row, [vec![0; 64], vec![0; 64]]);
        ranges.add(&[3.0, 0.0, 4.0], 5.0);
        let size = quantized(&ranges.scales(), &[3.0, 0.0, 4.0], &mut row);
        assert!(size.error < 1e-9 && size.head < 1e-12 && size.rest == 0.0 && row[0][3..] == [0; 61], "{size:?}");
    }
}
