//! Unit vectors as signed bytes: each coefficient on a scale of its own, and how far the bytes are off.
//!
//! The bytes b of a feature over its length, u, mean c + s b, with a centre c and a step s a coefficient. A query v is
//! compared in the same frame, |v - u| = |(v - c) - (u - c)|, so that neither the mean pose nor the greatest coefficients
//! cost precision.

use super::distance::{Side, dot};
use kinelm_engine::op::dots;

/// The largest byte.
const MOST: f64 = 127.0;

/// The quantities stored beside a feature's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Size {
    /// Length of the feature.
    pub norm: f64,
    /// A bound of the distance between what the bytes stand for and the feature over its length.
    pub error: f64,
    /// The square of the length of s b.
    pub square: f64,
    /// Length of b.
    pub length: f64,
}

impl Size {
    /// Of a feature without bytes.
    pub fn of(feature: &[f32]) -> Size {
        Size { norm: dot(feature, feature).sqrt(), ..Size::default() }
    }
}

/// The least and greatest that each coefficient is among unit vectors.
#[derive(Debug, Clone)]
pub struct Ranges {
    /// (D).
    limits: Vec<[f64; 2]>,
}

impl Ranges {
    /// Of no vectors of D = `numbers`.
    pub fn new(numbers: usize) -> Ranges {
        Ranges { limits: vec![[f64::INFINITY, f64::NEG_INFINITY]; numbers] }
    }

    /// Counts a feature of length `norm` in, if it has one.
    pub fn add(&mut self, feature: &[f32], norm: f64) {
        if norm > 0.0 {
            for ([low, high], x) in self.limits.iter_mut().zip(unit(feature, norm)) {
                (*low, *high) = (low.min(x), high.max(x));
            }
        }
    }

    /// Of the vectors of both.
    pub fn merge(mut self, other: Ranges) -> Ranges {
        for ([low, high], [other_low, other_high]) in self.limits.iter_mut().zip(other.limits) {
            (*low, *high) = (low.min(other_low), high.max(other_high));
        }
        self
    }

    /// Scales on which all of them have bytes.
    pub fn scales(&self) -> Scales {
        let scale = |&[low, high]: &[f64; 2]| match low <= high {
            true => {
                let centre = ((low + high) / 2.0) as f32;
                // from the rounded centre: half of high - low may be a little short on one side
                let reach = (high - f64::from(centre)).max(f64::from(centre) - low);
                [centre, (reach / MOST) as f32]
            }
            false => [0.0; 2],
        };
        Scales(self.limits.iter().map(scale).collect())
    }
}

/// (D, 2) the centre and the step of each coefficient of the unit vectors.
#[derive(Debug, Clone)]
pub struct Scales(pub Vec<[f32; 2]>);

impl Scales {
    /// `row` becomes the bytes of a feature of length `norm`, then zeros; those of a zero vector are zeros.
    ///
    /// # Panics
    /// When the row is shorter than the feature.
    pub fn quantize(&self, feature: &[f32], norm: f64, row: &mut [i8]) -> Size {
        row.fill(0);
        let mut size = Size { norm, ..Size::default() };
        if norm == 0.0 {
            return size;
        }
        let row = &mut row[..feature.len()];
        for ((byte, x), scale) in row.iter_mut().zip(unit(feature, norm)).zip(&self.0) {
            let [centre, step] = scale.map(f64::from);
            let from_centre = x - centre;
            if step > 0.0 {
                *byte = (from_centre / step).round().clamp(-MOST, MOST) as i8;
            }
            let (whole, stands_for) = (f64::from(*byte), f64::from(*byte) * step);
            size.error += (from_centre - stands_for).powi(2);
            size.square += stands_for * stands_for;
            size.length += whole * whole;
        }
        // rounded up beyond what the sum in f64 may be off, as it is a bound
        size.error = size.error.sqrt() * (1.0 + 1e-9) + 1e-15;
        size.length = size.length.sqrt() * (1.0 + 1e-9);
        size
    }

    /// A query of length `norm`, to be compared with rows of these scales.
    pub fn query(&self, feature: &[f32], norm: f64) -> Query {
        let from_centre = || unit(feature, norm).zip(&self.0).map(|(x, &[centre, step])| (x - f64::from(centre), step));
        let weights: Vec<f64> = from_centre().map(|(x, step)| x * f64::from(step)).collect();
        Query {
            square: from_centre().map(|(x, _)| x * x).sum(),
            dots: dots::Query::new(&weights),
            // a rounding per term of the sums, and some for what surrounds them
            slack: (feature.len() + 16) as f64 * f64::EPSILON,
        }
    }
}

/// A feature over its length; zeros for a zero vector.
fn unit(feature: &[f32], norm: f64) -> impl Iterator<Item = f64> + '_ {
    let over = if norm > 0.0 { 1.0 / norm } else { 0.0 };
    feature.iter().map(move |&x| f64::from(x) * over)
}

/// A unit vector v that bytes are compared with.
#[derive(Debug, Clone)]
pub struct Query {
    /// The square of the length of v - c.
    square: f64,
    /// Of s (v - c).
    dots: dots::Query,
    /// A bound of the relative error of sums in f64.
    slack: f64,
}

impl Query {
    /// `out` becomes the products with rows of bytes, for [`Query::cosine`].
    ///
    /// # Panics
    /// When there are not as many rows as numbers of `out`.
    pub fn dots(&self, out: &mut [i64], bytes: &[i8]) {
        self.dots.dots(out, bytes);
    }

    /// Numbers of a row of bytes.
    pub fn padded(&self) -> usize {
        self.dots.padded()
    }

    /// Least and greatest squared distance of v from what a row's bytes stand for, by the row's product.
    fn squares(&self, product: i64, size: &Size) -> [f64; 2] {
        let squares = self.square + size.square;
        let middle = squares - 2.0 * self.dots.step() * product as f64;
        let off = 2.0 * self.dots.error() * size.length + 4.0 * self.slack * squares;
        [(middle - off).max(0.0), (middle + off).max(0.0)]
    }

    /// The least or the greatest that the cosine of v and a row's feature may be.
    pub(super) fn cosine(&self, product: i64, size: &Size, side: Side) -> f64 {
        let [near, far] = self.squares(product, size);
        // the triangle inequality: the feature is at most `error` from what its bytes stand for
        let distance = match side {
            Side::Least => far.sqrt() + size.error,
            Side::Greatest => (near.sqrt() - size.error).max(0.0),
        };
        // of unit vectors |v - u|^2 = 2 - 2 cos
        1.0 - distance * distance / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::tests::noise;

    fn features(count: usize, numbers: usize, size: f64) -> Vec<f32> {
        let spread = |i: usize| size / (1.0 + (i % numbers) as f64) + 3.0 * size * f64::from(i % numbers == 2);
        noise(3, count * numbers).iter().enumerate().map(|(i, &x)| (x * spread(i) + spread(i)) as f32).collect()
    }

    #[test]
    fn cosines_are_within_their_bounds_and_the_bounds_are_near() {
        for (numbers, size) in [(1152, 1.0), (45, 1e-38), (45, 1e30), (3, 1.0), (1, 1.0)] {
            let all = features(40, numbers, size);
            let mut ranges = Ranges::new(numbers);
            all.chunks_exact(numbers).for_each(|f| ranges.add(f, Size::of(f).norm));
            let scales = ranges.scales();
            let mut row = vec![7; numbers.next_multiple_of(dots::PAD)];
            for v in all.chunks_exact(numbers).take(8) {
                let query = scales.query(v, Size::of(v).norm);
                for u in all.chunks_exact(numbers) {
                    let size = scales.quantize(u, Size::of(u).norm, &mut row);
                    let mut product = [0];
                    query.dots(&mut product, &row);
                    let cosine = dot(u, v) / (size.norm * Size::of(v).norm);
                    let [least, greatest] =
                        [Side::Least, Side::Greatest].map(|side| query.cosine(product[0], &size, side));
                    assert!(least - 1e-12 <= cosine && cosine <= greatest + 1e-12, "{least} {cosine} {greatest}");
                    assert!(greatest - least < 0.05, "{least} {cosine} {greatest}");
                }
            }
        }
    }

    #[test]
    fn bytes_are_as_near_as_is_said() {
        let (numbers, count) = (77, 30);
        let all = features(count, numbers, 1.0);
        let mut ranges = Ranges::new(numbers);
        all.chunks_exact(numbers).for_each(|f| ranges.add(f, Size::of(f).norm));
        let scales = ranges.scales();
        for feature in all.chunks_exact(numbers) {
            let mut row = vec![7; 128];
            let norm = Size::of(feature).norm;
            let size = scales.quantize(feature, norm, &mut row);
            let off = |(i, &x): (usize, &f32)| {
                let [centre, step] = scales.0[i].map(f64::from);
                (f64::from(x) / norm - centre - step * f64::from(row[i])).powi(2)
            };
            let error = feature.iter().enumerate().map(off).sum::<f64>().sqrt();
            assert!(error <= size.error && size.error < error + 1e-9, "{error} {size:?}");
            // no byte is cut off: at most half a step a coefficient
            let half = scales.0.iter().map(|&[_, step]| (f64::from(step) * 0.5001).powi(2)).sum::<f64>().sqrt();
            assert!(size.error <= half && row[numbers..].iter().all(|&b| b == 0), "{size:?}");
        }
    }

    #[test]
    fn zeros_and_single_vectors_have_bytes() {
        let mut ranges = Ranges::new(3);
        ranges.add(&[0.0; 3], 0.0);
        let mut row = [7; 64];
        assert_eq!(ranges.scales().quantize(&[0.0; 3], 0.0, &mut row), Size::default());
        assert_eq!(row, [0; 64]);
        ranges.add(&[3.0, 0.0, 4.0], 5.0);
        let scales = ranges.scales();
        let size = scales.quantize(&[3.0, 0.0, 4.0], 5.0, &mut row);
        assert!(size.error < 1e-9 && size.square < 1e-12 && row[3..] == [0; 61], "{size:?}");
    }
}
