//! GPT-2's GELU: 0.5 x (1 + tanh u) with u = sqrt(2/pi) (x + 0.044715 x^3), which is x * sigmoid(2 u).
//!
//! The form with exp needs no tanh and is exact at both ends.

use super::math::exp_within;
use super::rows;
use crate::dispatch;
use pulp::{Simd, WithSimd};

const CUBIC: f64 = 0.044715;
/// Beyond it 2 u is clamped: the gate is 0 or 1 to the last place.
const LIMIT: f32 = 87.0;
/// 2 sqrt(2/pi).
const SLOPE: f64 = 2.0 * std::f64::consts::FRAC_2_SQRT_PI * std::f64::consts::FRAC_1_SQRT_2;

/// Writes gelu(x).
///
/// # Panics
/// Slices of different lengths.
pub fn forward(out: &mut [f32], x: &[f32]) {
    assert!(out.len() == x.len(), "gelu: {} numbers for {} of x", out.len(), x.len());
    dispatch::run(Forward { out, x });
}

/// Adds `bias` (D) to the rows of `x` (N, D) and writes gelu of the sums.
///
/// # Panics
/// Shapes that don't fit.
pub(crate) fn forward_biased(out: &mut [f32], x: &mut [f32], bias: &[f32]) {
    rows("gelu", x.len(), bias.len());
    assert!(out.len() == x.len(), "gelu: {} numbers for {} of x", out.len(), x.len());
    dispatch::run(ForwardBiased { out, x, bias });
}

/// Turns `d`, the gradient of gelu(x), into that of `x`, and writes gelu(x) once more, which the gradient of the weights
/// after it needs: x is read once and its sigmoid computed once.
///
/// # Panics
/// Slices of different lengths.
pub fn backward(d: &mut [f32], out: &mut [f32], x: &[f32]) {
    let lengths = [d.len(), out.len()];
    assert!(lengths == [x.len(); 2], "gelu: {lengths:?} numbers for {} of x", x.len());
    dispatch::run(Backward { d, out, x });
}

struct Forward<'a> {
    out: &'a mut [f32],
    x: &'a [f32],
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let ((out, out_tail), (x, x_tail)) = (S::as_mut_simd_f32s(self.out), S::as_simd_f32s(self.x));
        for (o, x) in out.iter_mut().zip(x) {
            *o = value(simd, *x);
        }
        if !x_tail.is_empty() {
            // lanes beyond the tail are 0, whose gate is 1/2: no special case
            let x = simd.partial_load_f32s(x_tail);
            simd.partial_store_f32s(out_tail, value(simd, x));
        }
    }
}

struct ForwardBiased<'a> {
    out: &'a mut [f32],
    x: &'a mut [f32],
    bias: &'a [f32],
}

impl WithSimd for ForwardBiased<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let ForwardBiased { out, x, bias } = self;
        let (b, b_tail) = S::as_simd_f32s(bias);
        for (out, x) in out.chunks_exact_mut(bias.len()).zip(x.chunks_exact_mut(bias.len())) {
            let ((out, out_tail), (x, x_tail)) = (S::as_mut_simd_f32s(out), S::as_mut_simd_f32s(x));
            for ((o, x), b) in out.iter_mut().zip(x).zip(b) {
                *x = simd.add_f32s(*x, *b);
                *o = value(simd, *x);
            }
            if !b_tail.is_empty() {
                let x = simd.add_f32s(simd.partial_load_f32s(x_tail), simd.partial_load_f32s(b_tail));
                simd.partial_store_f32s(x_tail, x);
                simd.partial_store_f32s(out_tail, value(simd, x));
            }
        }
    }
}

struct Backward<'a> {
    d: &'a mut [f32],
    out: &'a mut [f32],
    x: &'a [f32],
}

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (d, d_tail) = S::as_mut_simd_f32s(self.d);
        let ((out, out_tail), (x, x_tail)) = (S::as_mut_simd_f32s(self.out), S::as_simd_f32s(self.x));
        for ((d, o), x) in d.iter_mut().zip(out).zip(x) {
            (*o, *d) = value_and_gradient(simd, *x, *d);
        }
        if !x_tail.is_empty() {
            let (x, d) = (simd.partial_load_f32s(x_tail), simd.partial_load_f32s(d_tail));
            let (o, d) = value_and_gradient(simd, x, d);
            simd.partial_store_f32s(out_tail, o);
            simd.partial_store_f32s(d_tail, d);
        }
    }
}

/// x * sigmoid(2 u(x)).
#[inline(always)]
fn value<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    simd.mul_f32s(x, gate(simd, x, simd.mul_f32s(x, x)).0)
}

/// sigmoid(2 u(x)) and exp(-2 u(x)), given x and its square.
#[inline(always)]
fn gate<S: Simd>(simd: S, x: S::f32s, square: S::f32s) -> (S::f32s, S::f32s) {
    let one = simd.splat_f32s(1.0);
    let cubic = simd.mul_add_e_f32s(square, simd.splat_f32s((-SLOPE * CUBIC) as f32), simd.splat_f32s(-SLOPE as f32));
    // within what exp takes: gates between 1e-38 and 1, and no infinity that a 0 would turn into NaN
    let u2 = simd.min_f32s(simd.mul_f32s(x, cubic), simd.splat_f32s(LIMIT));
    let e = exp_within(simd, simd.max_f32s(u2, simd.splat_f32s(-LIMIT)));
    (simd.div_f32s(one, simd.add_f32s(one, e)), e)
}

/// gelu(x), and its derivative times `d`.
#[inline(always)]
fn value_and_gradient<S: Simd>(simd: S, x: S::f32s, d: S::f32s) -> (S::f32s, S::f32s) {
    let square = simd.mul_f32s(x, x);
    let (s, e) = gate(simd, x, square);
    let value = simd.mul_f32s(x, s);
    let (a, b) = (simd.splat_f32s((3.0 * SLOPE * CUBIC) as f32), simd.splat_f32s(SLOPE as f32));
    let inner = simd.mul_add_e_f32s(square, a, b);
    // s e is 1 - s without its cancellation where s is almost 1
    let rest = simd.mul_f32s(value, simd.mul_f32s(s, e));
    (value, simd.mul_f32s(simd.mul_add_e_f32s(rest, inner, s), d))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, near, numbers};
    use crate::scalar::gelu as scalar;

    /// exp's error, a division and four products; the exponent's own rounding weighs most where the gate is small.
    const BOUND: f64 = 1e-6;

    fn inputs() -> impl Iterator<Item = Vec<f32>> {
        let lengths = (0..=67).chain([1000, 10_007]);
        lengths.flat_map(|len| [0.01, 1.0, 8.0, 100.0].map(|range| numbers(len as u64, len, range)))
    }

    #[test]
    fn forward_is_the_definition() {
        for (x, lanes) in inputs().flat_map(|x| Lanes::ALL.map(|l| (x.clone(), l))) {
            let expected: Vec<f64> = x.iter().map(|&x| scalar::gelu(x as f64)).collect();
            let mut out = vec![7.0; x.len()];
            lanes.run(Forward { out: &mut out, x: &x });
            near(&format!("{lanes:?}"), &out, &expected, BOUND);
        }
    }

    #[test]
    fn backward_is_the_slope_and_the_value() {
        for (x, lanes) in inputs().flat_map(|x| Lanes::ALL.map(|l| (x.clone(), l))) {
            let mut d = numbers(9, x.len(), 1.0);
            let expected: Vec<f64> = x.iter().zip(&d).map(|(&x, &d)| scalar::slope(x as f64) * d as f64).collect();
            let [mut out, mut value] = [vec![7.0; x.len()], vec![7.0; x.len()]];
            lanes.run(Backward { d: &mut d, out: &mut out, x: &x });
            near(&format!("{lanes:?}"), &d, &expected, BOUND);
            lanes.run(Forward { out: &mut value, x: &x });
            assert_eq!(out, value, "{lanes:?}");
        }
    }

    #[test]
    fn the_bias_comes_first() {
        for ((n, width), lanes) in (1..=67).map(|w| (3, w)).flat_map(|s| Lanes::ALL.map(|l| (s, l))) {
            let (mut x, bias) = (numbers(1, n * width, 3.0), numbers(2, width, 1.0));
            let sums: Vec<f32> = x.iter().enumerate().map(|(i, x)| x + bias[i % width]).collect();
            let [mut out, mut expected] = [vec![7.0; n * width], vec![7.0; n * width]];
            lanes.run(ForwardBiased { out: &mut out, x: &mut x, bias: &bias });
            lanes.run(Forward { out: &mut expected, x: &sums });
            assert_eq!(x, sums, "{lanes:?} {width}");
            near(&format!("{lanes:?} {width}"), &out, &expected.iter().map(|&x| x as f64).collect::<Vec<_>>(), BOUND);
        }
    }

    #[test]
    fn the_ends_are_finite_and_what_is_no_number_shows() {
        for lanes in Lanes::ALL {
            let x = [-1e9, -1e4, -90.0, 0.0, 90.0, 1e4, 1e9];
            let (mut d, mut out) = ([1.0; 7], [7.0; 7]);
            lanes.run(Backward { d: &mut d, out: &mut out, x: &x });
            let expected = [0.0, 0.0, 0.0, 0.0, 90.0, 1e4, 1e9];
            assert!(out.iter().zip(expected).all(|(o, e)| (o - e).abs() < 1e-25), "{lanes:?}: {out:?}");
            let slopes = [0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0];
            assert!(d.iter().zip(slopes).all(|(d, e)| (d - e).abs() < 1e-6), "{lanes:?}: {d:?}");
            let x = [f32::NAN; 20];
            let (mut d, mut out) = ([1.0; 20], [7.0; 20]);
            lanes.run(Backward { d: &mut d, out: &mut out, x: &x });
            assert!(d.iter().chain(&out).all(|x| x.is_nan()), "{lanes:?}: {d:?} {out:?}");
        }
    }
}
