//! e^x in f64, for probabilities that are summed: one function for all processors, so that a sampled token never depends on
//! whose mathematical library is there.
//!
//! x = n ln 2 + r with |r| <= ln 2 / 2, and e^r by its Taylor series up to r^13, whose rest is below 4e-18.

use crate::dispatch;
use pulp::{Simd, WithSimd};

/// 1.5 * 2^52 + 1023: a number added to it is rounded to a whole one, in the lowest bits with the bias of an exponent.
const ROUND: f64 = 6_755_399_441_056_767.0;
/// Below it powers of 2 end, and the result is 0.
const LOWEST: f64 = -708.0;
/// ln 2 in two parts: multiples of the first, up to 2^11 of them, are exact.
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
/// 1/k!, from 13 down to 2.
const TAYLOR: [f64; 12] = [
    1.0 / 6_227_020_800.0,
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    1.0 / 2.0,
];

/// Each number becomes e^x, for x up to 709: within 2 units in the last place, 0 below -708, NaN for NaN.
///
/// ```
/// let mut x = [0.0, -1.0, f64::NEG_INFINITY];
/// kinelm_engine::op::exp64::exp(&mut x);
/// assert_eq!(x[0], 1.0);
/// assert!((x[1] - 1.0 / std::f64::consts::E).abs() < 1e-15 && x[2] == 0.0);
/// ```
pub fn exp(numbers: &mut [f64]) {
    dispatch::run(Exp(numbers));
}

struct Exp<'a>(&'a mut [f64]);

impl WithSimd for Exp<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        // compiled for the vectors of `S`; products and sums stay apart, which gives the same bits with all of them
        self.0.iter_mut().for_each(|x| *x = one(*x));
    }
}

#[inline(always)]
fn one(x: f64) -> f64 {
    let is_zero = x < LOWEST;
    let x = if is_zero { LOWEST } else { x };
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    // x - n ln 2 in two steps: the first is exact, so what cancels costs no digits
    let r = x - n * LN_2[0] - n * LN_2[1];
    let series = TAYLOR[1..].iter().fold(TAYLOR[0], |sum, c| sum * r + c);
    let power = f64::from_bits(shifted.to_bits() << 52);
    let value = (series * r * r + r + 1.0) * power;
    if is_zero { 0.0 } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::Lanes;

    #[test]
    fn exp_is_exp_to_the_last_bit_but_two_on_all_vectors() {
        let x: Vec<f64> = (0..=1_416_000).map(|i| f64::from(i - 708_000) * 1e-3).collect();
        let mut first: Option<Vec<f64>> = None;
        for lanes in Lanes::ALL {
            let mut y = x.clone();
            lanes.run(Exp(&mut y));
            let error = |(x, y): (&f64, &f64)| (y / x.exp() - 1.0).abs();
            let worst = x.iter().zip(&y).map(error).fold(0.0, f64::max);
            assert!(worst <= 2.0 * f64::EPSILON, "{lanes:?}: error {worst:e}");
            assert!(first.get_or_insert_with(|| y.clone()) == &y, "{lanes:?}");
        }
    }

    #[test]
    fn the_ends_of_exp() {
        let mut ends = [f64::NEG_INFINITY, f64::MIN, -1e6, -708.1, -0.0, 0.0, 1e-300];
        exp(&mut ends);
        assert_eq!(ends, [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        let mut nan = [f64::NAN];
        exp(&mut nan);
        assert!(nan[0].is_nan());
    }
}
