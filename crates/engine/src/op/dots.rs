//! Dot products of one vector with many rows of half floats, streamed from memory: what a search reads first.
//!
//! Half floats halve what is read, and reading is all that such a product waits for. Rows are padded with zeros to whole
//! [`PAD`]s. Four rows go through memory side by side and share the vector's numbers in registers; each row's sums run in
//! the same order whatever rows are computed beside it.

use super::rows;
use crate::dispatch;
use crate::element::Element;
use half::f16;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};
use pulp::{Simd, WithSimd};

/// Rows have a multiple of so many numbers: a pair of the widest vectors.
pub const PAD: usize = 32;

/// Rows that are read side by side.
const TILE: usize = 4;

/// `row` becomes the bits of half floats nearest to `numbers`, then zeros.
///
/// # Panics
/// When the row is shorter, or not whole [`PAD`]s.
pub fn round(row: &mut [u16], numbers: &[f32]) {
    assert!(row.len().is_multiple_of(PAD) && row.len() >= numbers.len(), "{} in a row of {}", numbers.len(), row.len());
    let (there, rest) = row.split_at_mut(numbers.len());
    there.reinterpret_cast_mut::<f16>().convert_from_f32_slice(numbers);
    rest.fill(0);
}

/// The numbers that the bits of half floats stand for.
pub fn widen(row: &[u16]) -> impl Iterator<Item = f32> + '_ {
    row.iter().map(|&bits| f16::from_bits(bits).to_f32())
}

/// A vector that rows are multiplied with.
#[derive(Debug, Clone)]
pub struct Query {
    /// Padded, and times what [`Element::pair`] divides by.
    numbers: Vec<f32>,
}

impl Query {
    /// Of numbers below 2^15 in size.
    pub fn new(numbers: &[f32]) -> Query {
        let mut padded = vec![0.0; numbers.len().next_multiple_of(PAD)];
        padded.iter_mut().zip(numbers).for_each(|(to, x)| *to = x * <u16 as Element>::LEFT);
        Query { numbers: padded }
    }

    /// Numbers of a row.
    pub fn padded(&self) -> usize {
        self.numbers.len()
    }

    /// `out` becomes the product of each row with the vector, on one thread.
    ///
    /// Each is within [`Query::error`] times the lengths of both of what it is exactly.
    ///
    /// # Panics
    /// When there are not as many rows as numbers of `out`.
    pub fn dots(&self, out: &mut [f32], halves: &[u16]) {
        let count = rows("dots", halves.len(), self.padded());
        assert_eq!(count, out.len(), "a number a row");
        dispatch::run(Dots { out, rows: halves, query: &self.numbers });
    }

    /// How far a product may be off, as a share of the product of both lengths: a rigorous bound, whatever the numbers.
    ///
    /// Source: Higham, "Accuracy and Stability of Numerical Algorithms" (2002), section 3.1, with the additions that a number
    /// goes through at most.
    pub fn error(&self) -> f64 {
        let pair = super::matmul::panel();
        // an accumulator takes a number of each pair, rounding products and sums; then the accumulators are added up
        let most = 2 * self.padded() / pair + pair + 2;
        let roundings = most as f64 * 0.5f64.powi(24);
        roundings / (1.0 - roundings)
    }
}

struct Dots<'a> {
    out: &'a mut [f32],
    rows: &'a [u16],
    query: &'a [f32],
}

impl WithSimd for Dots<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let k = self.query.len();
        let (tiles, rest) = self.out.as_chunks_mut::<TILE>();
        let (whole, last) = self.rows.split_at(tiles.len() * TILE * k);
        for (out, rows) in tiles.iter_mut().zip(whole.chunks_exact((TILE * k).max(1))) {
            *out = tile::<S, TILE>(simd, rows, self.query);
        }
        for (out, row) in rest.iter_mut().zip(last.chunks_exact(k.max(1))) {
            [*out] = tile::<S, 1>(simd, row, self.query);
        }
    }
}

#[inline(always)]
fn tile<S: Simd, const R: usize>(simd: S, rows: &[u16], query: &[f32]) -> [f32; R] {
    let (k, pair) = (query.len(), 2 * S::F32_LANES);
    let rows: [&[u16]; R] = std::array::from_fn(|r| &rows[r * k..(r + 1) * k]);
    let mut sums = [[simd.splat_f32s(0.0); 2]; R];
    for (at, query) in (0..k).step_by(pair).zip(query.chunks_exact(pair)) {
        let [q0, q1] = f32::pair::<S>(query);
        for (sums, row) in sums.iter_mut().zip(&rows) {
            let [x0, x1] = u16::pair::<S>(&row[at..at + pair]);
            sums[0] = simd.mul_add_e_f32s(x0, q0, sums[0]);
            sums[1] = simd.mul_add_e_f32s(x1, q1, sums[1]);
        }
    }
    sums.map(|[a, b]| simd.reduce_sum_f32s(simd.add_f32s(a, b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, numbers};
    use crate::scalar;

    #[test]
    fn within_the_bound_of_the_oracle_on_every_vector() {
        for (count, k) in [(0, 5usize), (1, 1), (3, 32), (4, 40), (9, 1152), (6, 4321)] {
            let padded = k.next_multiple_of(PAD);
            let query = numbers(k as u64, k, 1.0);
            let mut halves = vec![7; count * padded];
            for (i, row) in halves.chunks_exact_mut(padded).enumerate() {
                round(row, &numbers(i as u64, k, 3.0));
            }
            let mut long = query.clone();
            long.resize(padded, 0.0);
            let expected = scalar::dots::dots(&halves, &long);
            let prepared = Query::new(&query);
            let length = |x: &mut dyn Iterator<Item = f32>| x.map(|x| f64::from(x).powi(2)).sum::<f64>().sqrt();
            let of_query = length(&mut query.iter().copied());
            for lanes in Lanes::ALL {
                let mut out = vec![f32::NAN; count];
                lanes.run(Dots { out: &mut out, rows: &halves, query: &prepared.numbers });
                for (i, (found, expected)) in out.iter().zip(&expected).enumerate() {
                    let of_row = length(&mut widen(&halves[i * padded..(i + 1) * padded]));
                    // with one lane more numbers go through an accumulator than with this CPU's
                    let bound = 16.0 * prepared.error() * of_row * of_query;
                    let off = (f64::from(*found) - expected).abs();
                    assert!(off <= bound, "{lanes:?}, row {i} of {count}, {k}: {off:e} > {bound:e}");
                }
            }
        }
    }

    #[test]
    fn rows_beside_change_no_bit() {
        let (k, count) = (96, 11);
        let halves: Vec<u16> = (0..count)
            .flat_map(|i| {
                let mut row = vec![0; k];
                round(&mut row, &numbers(i, k, 1e-4));
                row
            })
            .collect();
        let query = Query::new(&numbers(99, k, 1.0));
        let mut all = vec![0.0; count as usize];
        query.dots(&mut all, &halves);
        for (i, row) in halves.chunks(k).enumerate() {
            let mut one = [0.0];
            query.dots(&mut one, row);
            assert_eq!(one[0].to_bits(), all[i].to_bits(), "row {i}");
        }
    }
}
