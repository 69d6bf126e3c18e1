//! Dot products of one vector with many rows of signed bytes, streamed from memory: the first stage of a search.
//!
//! A byte a number is a quarter of a float, and memory bandwidth alone decides the speed of such a product. The vector
//! is rounded to 16 bits, so that a product is whole numbers alone and exact: it is the same with all instructions, in
//! every order. The vector's rounding error is known ([`Query::error`]). Rows are padded with zeros to whole [`PAD`]s.
//!
//! Rows are read one after the other, front to back: four side by side share the vector's numbers in registers, but memory
//! then delivers 23 GB/s to two cores of an AMD EPYC (Zen 4) instead of 35. From the cache, a core multiplies 60 GB/s.

use super::rows;
use crate::dispatch;
use pulp::{Arch, NullaryFnOnce};

/// Rows have a multiple of 64 numbers: a cache line.
pub const PAD: usize = 64;

/// Added to a length, since the square of a number below 1e-154 is 0.
const VANISHING: f64 = 1e-150;

/// A vector that rows are multiplied with.
#[derive(Debug, Clone)]
pub struct Query {
    /// Padded.
    numbers: Vec<i16>,
    step: f64,
    error: f64,
}

impl Query {
    /// The query of finite numbers, which are rounded to multiples of [`Query::step`].
    ///
    /// # Panics
    /// For more than 2^23 numbers.
    pub fn new(numbers: &[f64]) -> Query {
        let padded = numbers.len().next_multiple_of(PAD);
        assert!(padded <= 1 << 23, "{padded} numbers");
        // no sum of a lane, which takes two products of sixteen at most, leaves 32 bits, whatever the bytes
        let most = (i32::MAX as usize / (128 * padded.max(1) / 8)).min(i16::MAX as usize) as f64;
        let largest = numbers.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        // a subnormal step has too few digits to divide by; all is error then, and that is stated
        let step = if largest / most >= f64::MIN_POSITIVE { largest / most } else { 0.0 };
        let mut whole = vec![0; padded];
        let mut left_out = 0.0;
        for (whole, &x) in whole.iter_mut().zip(numbers) {
            *whole = if step > 0.0 { (x / step).round().clamp(-most, most) as i16 } else { 0 };
            left_out += (x - f64::from(*whole) * step).powi(2);
        }
        // squares of the very least numbers vanish
        Query { numbers: whole, step, error: left_out.sqrt() + VANISHING }
    }

    /// Numbers of a row.
    pub fn padded(&self) -> usize {
        self.numbers.len()
    }

    /// Factor of a product.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// The length of the vector's rounding error: a product times the step is off by at most this times the
    /// row's length.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// `out` becomes the product of each row with the rounded vector, on one thread, exactly.
    ///
    /// # Panics
    /// When there are not as many rows as numbers of `out`.
    pub fn dots(&self, out: &mut [i64], bytes: &[i8]) {
        let count = rows("dots", bytes.len(), self.padded());
        assert_eq!(count, out.len(), "a number a row");
        // pulp has no products of integers: a trait of our own, over the same choice of instructions
        match dispatch::arch() {
            #[cfg(target_arch = "x86_64")]
            Arch::V4(simd) => pulp::Simd::vectorize(simd, Dots { out, rows: bytes, query: &self.numbers, lanes: simd }),
            #[cfg(target_arch = "x86_64")]
            Arch::V3(simd) => pulp::Simd::vectorize(simd, Dots { out, rows: bytes, query: &self.numbers, lanes: simd }),
            _ => Dots { out, rows: bytes, query: &self.numbers, lanes: Plain }.call(),
        }
    }
}

/// Instructions that multiply bytes with 16-bit numbers.
trait Lanes: Copy {
    /// Numbers that are multiplied at a time.
    const WIDTH: usize;
    /// [`Lanes::WIDTH`] numbers of the vector.
    type Numbers: Copy;
    /// Sums of 32 bits.
    type Sums: Copy;

    fn zero(self) -> Self::Sums;
    fn numbers(self, query: &[i16]) -> Self::Numbers;
    /// The sums, and [`Lanes::WIDTH`] products.
    fn add(self, sums: Self::Sums, row: &[i8], query: Self::Numbers) -> Self::Sums;
    fn total(self, sums: Self::Sums) -> i64;
}

struct Dots<'a, L> {
    out: &'a mut [i64],
    rows: &'a [i8],
    query: &'a [i16],
    lanes: L,
}

impl<L: Lanes> NullaryFnOnce for Dots<'_, L> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let k = self.query.len().max(1);
        for (out, row) in self.out.iter_mut().zip(self.rows.chunks_exact(k)) {
            let mut sums = self.lanes.zero();
            for (row, query) in row.chunks_exact(L::WIDTH).zip(self.query.chunks_exact(L::WIDTH)) {
                sums = self.lanes.add(sums, row, self.lanes.numbers(query));
            }
            *out = self.lanes.total(sums);
        }
    }
}

/// Plain loops.
#[derive(Clone, Copy)]
struct Plain;

impl Lanes for Plain {
    const WIDTH: usize = 16;
    type Numbers = [i16; 16];
    type Sums = [i32; 16];

    #[inline(always)]
    fn zero(self) -> [i32; 16] {
        [0; 16]
    }

    #[inline(always)]
    fn numbers(self, query: &[i16]) -> [i16; 16] {
        std::array::from_fn(|i| query[i])
    }

    #[inline(always)]
    fn add(self, sums: [i32; 16], row: &[i8], query: [i16; 16]) -> [i32; 16] {
        std::array::from_fn(|i| sums[i] + i32::from(row[i]) * i32::from(query[i]))
    }

    #[inline(always)]
    fn total(self, sums: [i32; 16]) -> i64 {
        sums.iter().map(|&x| i64::from(x)).sum()
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::Lanes;
    use pulp::x86::{V3, V4};
    use std::arch::x86_64::{__m128i, __m256i, __m512i};

    /// The first numbers of a slice as a vector's bits.
    #[inline(always)]
    fn first<const N: usize, T: bytemuck::Pod, V>(numbers: &[T]) -> V
    where
        [T; N]: bytemuck::Pod,
        V: bytemuck::Pod,
    {
        bytemuck::cast(*numbers.first_chunk::<N>().expect("a vector's numbers"))
    }

    impl Lanes for V3 {
        const WIDTH: usize = 16;
        type Numbers = __m256i;
        type Sums = __m256i;

        #[inline(always)]
        fn zero(self) -> __m256i {
            self.avx._mm256_setzero_si256()
        }

        #[inline(always)]
        fn numbers(self, query: &[i16]) -> __m256i {
            first::<16, i16, __m256i>(query)
        }

        #[inline(always)]
        fn add(self, sums: __m256i, row: &[i8], query: __m256i) -> __m256i {
            // madd adds two products of 16 bits in 32: at most 2 * 128 * 32767, far from overflow
            let wide = self.avx2._mm256_cvtepi8_epi16(first::<16, i8, __m128i>(row));
            self.avx2._mm256_add_epi32(sums, self.avx2._mm256_madd_epi16(wide, query))
        }

        #[inline(always)]
        fn total(self, sums: __m256i) -> i64 {
            bytemuck::cast::<__m256i, [i32; 8]>(sums).iter().map(|&x| i64::from(x)).sum()
        }
    }

    impl Lanes for V4 {
        const WIDTH: usize = 32;
        type Numbers = __m512i;
        type Sums = __m512i;

        #[inline(always)]
        fn zero(self) -> __m512i {
            self.avx512f._mm512_setzero_si512()
        }

        #[inline(always)]
        fn numbers(self, query: &[i16]) -> __m512i {
            first::<32, i16, __m512i>(query)
        }

        #[inline(always)]
        fn add(self, sums: __m512i, row: &[i8], query: __m512i) -> __m512i {
            let wide = self.avx512bw._mm512_cvtepi8_epi16(first::<32, i8, __m256i>(row));
            self.avx512f._mm512_add_epi32(sums, self.avx512bw._mm512_madd_epi16(wide, query))
        }

        #[inline(always)]
        fn total(self, sums: __m512i) -> i64 {
            bytemuck::cast::<__m512i, [i32; 16]>(sums).iter().map(|&x| i64::from(x)).sum()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::numbers;
    use crate::scalar;

    fn rounded(seed: u64, k: usize, most: f32) -> Vec<i8> {
        numbers(seed, k, most).iter().map(|&x| x.round() as i8).collect()
    }

    /// Calls `check` with the answers of all instructions that this CPU has.
    fn on_all(bytes: &[i8], query: &Query, check: impl Fn(&str, &[i64])) {
        let count = bytes.len() / query.padded();
        let mut out = vec![7; count];
        query.dots(&mut out, bytes);
        check("dispatched", &out);
        out.fill(7);
        Dots { out: &mut out, rows: bytes, query: &query.numbers, lanes: Plain }.call();
        check("plain", &out);
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(lanes) = pulp::x86::V3::try_new() {
                out.fill(7);
                pulp::Simd::vectorize(lanes, Dots { out: &mut out, rows: bytes, query: &query.numbers, lanes });
                check("avx2", &out);
            }
            if let Some(lanes) = pulp::x86::V4::try_new() {
                out.fill(7);
                pulp::Simd::vectorize(lanes, Dots { out: &mut out, rows: bytes, query: &query.numbers, lanes });
                check("avx512", &out);
            }
        }
    }

    #[test]
    fn the_oracle_s_numbers_with_all_instructions() {
        for (count, k) in [(1, 1), (3, 32), (4, 64), (5, 65), (9, 1152), (6, 4321)] {
            let query = Query::new(&numbers(k as u64, k, 3.0).iter().map(|&x| x.into()).collect::<Vec<f64>>());
            let bytes: Vec<i8> = (0..count).flat_map(|i| rounded(i, query.padded(), 127.0)).collect();
            let expected = scalar::dots::dots(&bytes, &query.numbers);
            on_all(&bytes, &query, |what, found| {
                assert!(found == expected, "{what}, {count} of {k}");
            });
        }
        Query::new(&[1.0]).dots(&mut [], &[]);
    }

    #[test]
    fn the_largest_sums_fit() {
        for k in [64, 1152, 9728, 1 << 17] {
            for (sign, byte) in [(1.0, -128), (-1.0, 127), (1.0, 127)] {
                let query = Query::new(&vec![sign * 1e-3; k]);
                let bytes = vec![byte; k];
                let expected = scalar::dots::dots(&bytes, &query.numbers)[0];
                on_all(&bytes, &query, |what, found| assert_eq!(found[0], expected, "{what}, {k}"));
                let value = expected as f64 * query.step();
                assert!((value / (sign * 1e-3 * k as f64 * f64::from(byte)) - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn what_rounding_leaves_out_is_said() {
        for (k, size) in [(5, 1.0), (1152, 1e-30), (1152, 1e30), (3000, 1.0), (64, 0.0), (64, 1e-310)] {
            let exact: Vec<f64> = numbers(9, k, 1.0).iter().map(|&x| f64::from(x) * size).collect();
            let query = Query::new(&exact);
            let bytes = rounded(4, query.padded(), 127.0);
            let mut out = [0];
            query.dots(&mut out, &bytes);
            let product: f64 = exact.iter().zip(&bytes).map(|(x, &y)| x * f64::from(y)).sum();
            let length = bytes[..k].iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
            let off = (out[0] as f64 * query.step() - product).abs();
            assert!(off <= query.error() * length * (1.0 + 1e-9), "{k} {size:e}: {off:e} > {:e}", query.error());
            let whole = exact.iter().map(|x| x * x).sum::<f64>().sqrt();
            assert!(query.error() <= 1e-3 * whole + VANISHING, "{k} {size:e}: {:e}", query.error());
        }
    }
}
