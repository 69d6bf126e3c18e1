//! The cell of an LSTM: from the sums at its gates to its state and output, and back.
//!
//! Rows hold P numbers for each of the four gates i, f, g, o, one gate after the other; P is a multiple of a vector, so
//! there are no tails. Source: Hochreiter and Schmidhuber, "Long short-term memory" (1997), with the forget gate of Gers,
//! Schmidhuber and Cummins (2000), as PyTorch's `LSTMCell` computes it.

use super::math::exp_falling;
use super::rows;
use crate::dispatch;
use pulp::{Simd, WithSimd};

/// Turns the sums at the gates (B, 4P), to which `bias` (4P) is added, into the gates, and writes the state `c` (B, P) and
/// the output `h` (B, P) that follow the state `before` (B, P).
///
/// # Panics
/// Shapes that don't fit, and a P that is no multiple of [`super::matmul::panel`].
pub fn forward(gates: &mut [f32], bias: &[f32], before: &[f32], c: &mut [f32], h: &mut [f32]) {
    let width = check("cell", bias.len() / 4, &[gates.len() / 4, before.len(), c.len(), h.len()]);
    dispatch::run(Forward { gates, bias, before, c, h, width });
}

/// The backward pass of [`forward`]: the gates (B, 4P) become the gradients of the sums at them.
///
/// `dh` (B, P) is the gradient of the output; `dc` (B, P) that of the state from the next step, which becomes that of
/// the state `before`.
///
/// # Panics
/// As [`forward`].
pub fn backward(gates: &mut [f32], before: &[f32], c: &[f32], dh: &[f32], dc: &mut [f32], width: usize) {
    let width = check("cell_backward", width, &[gates.len() / 4, before.len(), c.len(), dh.len(), dc.len()]);
    dispatch::run(Backward { gates, before, c, dh, dc, width });
}

#[track_caller]
fn check(what: &str, width: usize, lengths: &[usize]) -> usize {
    assert!(width.is_multiple_of(super::matmul::panel()), "{what}: {width} numbers a gate; expected whole panels");
    assert!(lengths.iter().all(|len| *len == lengths[0]), "{what}: {lengths:?} numbers; expected as many of each");
    rows(what, lengths[0], width);
    width
}

struct Forward<'a> {
    gates: &'a mut [f32],
    bias: &'a [f32],
    before: &'a [f32],
    c: &'a mut [f32],
    h: &'a mut [f32],
    width: usize,
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Forward { gates, bias, before, c, h, width } = self;
        let [bi, bf, bg, bo] = four::<S>(bias, width);
        let states = before.chunks_exact(width).zip(c.chunks_exact_mut(width)).zip(h.chunks_exact_mut(width));
        for (row, ((before, c), h)) in gates.chunks_exact_mut(4 * width).zip(states) {
            let [i, f, g, o] = four_mut::<S>(row, width);
            let before = S::as_simd_f32s(before).0;
            let (c, h) = (S::as_mut_simd_f32s(c).0, S::as_mut_simd_f32s(h).0);
            for n in 0..before.len() {
                i[n] = sigmoid(simd, simd.add_f32s(i[n], bi[n]));
                f[n] = sigmoid(simd, simd.add_f32s(f[n], bf[n]));
                g[n] = tanh(simd, simd.add_f32s(g[n], bg[n]));
                o[n] = sigmoid(simd, simd.add_f32s(o[n], bo[n]));
                c[n] = simd.add_f32s(simd.mul_f32s(f[n], before[n]), simd.mul_f32s(i[n], g[n]));
                h[n] = simd.mul_f32s(o[n], tanh(simd, c[n]));
            }
        }
    }
}

struct Backward<'a> {
    gates: &'a mut [f32],
    before: &'a [f32],
    c: &'a [f32],
    dh: &'a [f32],
    dc: &'a mut [f32],
    width: usize,
}

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Backward { gates, before, c, dh, dc, width } = self;
        let one = simd.splat_f32s(1.0);
        // the slopes of a sigmoid and of a tangent by their values
        let of_sigmoid = |d, y| simd.mul_f32s(d, simd.mul_f32s(y, simd.sub_f32s(one, y)));
        let of_tanh = |d, y| simd.mul_f32s(d, simd.sub_f32s(one, simd.mul_f32s(y, y)));
        let states = before.chunks_exact(width).zip(c.chunks_exact(width));
        let gradients = dh.chunks_exact(width).zip(dc.chunks_exact_mut(width));
        for ((row, (before, c)), (dh, dc)) in gates.chunks_exact_mut(4 * width).zip(states).zip(gradients) {
            let [i, f, g, o] = four_mut::<S>(row, width);
            let (before, c, dh) = (S::as_simd_f32s(before).0, S::as_simd_f32s(c).0, S::as_simd_f32s(dh).0);
            let dc = S::as_mut_simd_f32s(dc).0;
            for n in 0..before.len() {
                // computed again: saving it would cost B P numbers a step
                let t = tanh(simd, c[n]);
                let d = simd.add_f32s(dc[n], of_tanh(simd.mul_f32s(dh[n], o[n]), t));
                dc[n] = simd.mul_f32s(d, f[n]);
                // before i and g are overwritten by their gradients
                let (di, dg) = (simd.mul_f32s(d, g[n]), simd.mul_f32s(d, i[n]));
                f[n] = of_sigmoid(simd.mul_f32s(d, before[n]), f[n]);
                i[n] = of_sigmoid(di, i[n]);
                g[n] = of_tanh(dg, g[n]);
                o[n] = of_sigmoid(simd.mul_f32s(dh[n], t), o[n]);
            }
        }
    }
}

#[inline(always)]
fn four<S: Simd>(row: &[f32], width: usize) -> [&[S::f32s]; 4] {
    let (a, b) = row.split_at(2 * width);
    let ((a, b), (c, d)) = (a.split_at(width), b.split_at(width));
    [S::as_simd_f32s(a).0, S::as_simd_f32s(b).0, S::as_simd_f32s(c).0, S::as_simd_f32s(d).0]
}

#[inline(always)]
fn four_mut<S: Simd>(row: &mut [f32], width: usize) -> [&mut [S::f32s]; 4] {
    let (a, b) = row.split_at_mut(2 * width);
    let ((a, b), (c, d)) = (a.split_at_mut(width), b.split_at_mut(width));
    [S::as_mut_simd_f32s(a).0, S::as_mut_simd_f32s(b).0, S::as_mut_simd_f32s(c).0, S::as_mut_simd_f32s(d).0]
}

/// 1 / (1 + e^-x), by e^-|x| so that nothing overflows; NaN of NaN.
#[inline(always)]
fn sigmoid<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
    // abs and the comparison below lose no NaN: e is NaN, and so is the quotient
    let e = exp_falling(simd, simd.neg_f32s(simd.abs_f32s(x)));
    let above = simd.select_f32s(simd.less_than_f32s(x, zero), e, one);
    simd.div_f32s(above, simd.add_f32s(one, e))
}

/// (1 - e^-2|x|) / (1 + e^-2|x|) with the sign of x; the error is a rounding of 1, not of the result.
#[inline(always)]
fn tanh<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
    let e = exp_falling(simd, simd.mul_f32s(simd.splat_f32s(-2.0), simd.abs_f32s(x)));
    let t = simd.div_f32s(simd.sub_f32s(one, e), simd.add_f32s(one, e));
    simd.select_f32s(simd.less_than_f32s(x, zero), simd.neg_f32s(t), t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, near, numbers};
    use crate::op::matmul::panel;
    use crate::scalar::lstm as scalar;

    /// Some roundings of numbers below 1 and one of e^x.
    const BOUND: f64 = 4e-7; // sums of +-60 are among the cases: tanh's e^120 would overflow, e^-120 doesn't

    #[test]
    fn a_cell_is_what_plain_loops_give() {
        for (batch, panels, range) in [(1, 1, 1.0), (3, 2, 4.0), (5, 1, 60.0)] {
            let p = panels * panel();
            let (sums, bias) = (numbers(1, batch * 4 * p, range), numbers(2, 4 * p, 1.0));
            let before = numbers(3, batch * p, 2.0);
            let mut expected = (Vec::new(), Vec::new());
            for b in 0..batch {
                for u in 0..p {
                    let sum = |gate: usize| (sums[b * 4 * p + gate * p + u] + bias[gate * p + u]) as f64;
                    let (c, h) = scalar::cell([sum(0), sum(1), sum(2), sum(3)], before[b * p + u] as f64);
                    expected.0.push(c);
                    expected.1.push(h);
                }
            }
            for lanes in Lanes::ALL {
                let (mut gates, mut c, mut h) = (sums.clone(), vec![7.0; batch * p], vec![7.0; batch * p]);
                let (before, bias) = (&before, &bias);
                lanes.run(Forward { gates: &mut gates, bias, before, c: &mut c, h: &mut h, width: p });
                near(&format!("{lanes:?} c"), &c, &expected.0, BOUND);
                near(&format!("{lanes:?} h"), &h, &expected.1, BOUND);
            }
        }
    }

    #[test]
    fn numbers_that_are_none_stay_so() {
        let p = panel();
        let (mut gates, bias, before) = (vec![f32::NAN; 4 * p], vec![0.0; 4 * p], vec![0.0; p]);
        let (mut c, mut h) = (vec![0.0; p], vec![0.0; p]);
        forward(&mut gates, &bias, &before, &mut c, &mut h);
        assert!(c.iter().chain(&h).all(|x| x.is_nan()));
    }
}
