//! Rows (N, D) and a bias (D): adding it, its gradient, and the addition to a residual stream.

use super::dropout::{self, Mask};
use super::rows;
use crate::dispatch;
use pulp::{Simd, WithSimd};

/// Adds `bias` to each row of `x`.
///
/// # Panics
/// Shapes that don't fit.
pub fn add(x: &mut [f32], bias: &[f32]) {
    rows("bias", x.len(), bias.len());
    dispatch::run(Add { x, bias });
}

/// Adds to `dbias` (D) the sum of each column of `dy` (N, D): the gradient of a bias.
///
/// # Panics
/// Shapes that don't fit.
pub fn add_column_sums(dbias: &mut [f32], dy: &[f32]) {
    rows("column sums", dy.len(), dbias.len());
    dispatch::run(AddColumnSums { dbias, dy });
}

/// x += dropout(y + bias), the end of a branch beside the stream `x` (N, D).
///
/// # Panics
/// Shapes that don't fit; a share outside `0.0..1.0`.
pub fn residual(x: &mut [f32], y: &[f32], bias: &[f32], mask: Mask) {
    rows("residual", x.len(), bias.len());
    assert!(x.len() == y.len(), "residual: {} numbers to {} of x", y.len(), x.len());
    let threshold = dropout::threshold(mask.share);
    match threshold {
        0 => dispatch::run(Residual { x, y, bias }),
        _ => dispatch::run(ResidualDropped { x, y, bias, mask, threshold }),
    }
}

/// The backward pass of [`residual`]: writes `dy` = dropout(dx), rows of `width` numbers, with the same mask. Without
/// dropout it is a copy, and `dx` itself will do.
///
/// # Panics
/// Shapes that don't fit; a share outside `0.0..1.0`.
pub(crate) fn residual_backward(dy: &mut [f32], dx: &[f32], width: usize, mask: Mask) {
    rows("residual", dx.len(), width);
    assert!(dx.len() == dy.len(), "residual: {} numbers for {} of dx", dy.len(), dx.len());
    let threshold = dropout::threshold(mask.share);
    match threshold {
        0 => dy.copy_from_slice(dx),
        _ => dispatch::run(Dropped { dy, dx, width, mask, threshold }),
    }
}

struct Add<'a> {
    x: &'a mut [f32],
    bias: &'a [f32],
}

impl WithSimd for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Add { x, bias } = self;
        let (b, b_tail) = S::as_simd_f32s(bias);
        for row in x.chunks_exact_mut(bias.len()) {
            let (x, x_tail) = S::as_mut_simd_f32s(row);
            for (x, b) in x.iter_mut().zip(b) {
                *x = simd.add_f32s(*x, *b);
            }
            if !b_tail.is_empty() {
                let sum = simd.add_f32s(simd.partial_load_f32s(x_tail), simd.partial_load_f32s(b_tail));
                simd.partial_store_f32s(x_tail, sum);
            }
        }
    }
}

struct AddColumnSums<'a> {
    dbias: &'a mut [f32],
    dy: &'a [f32],
}

impl WithSimd for AddColumnSums<'_> {
    type Output = ();

    /// Four rows at a time: the sums so far are read and written a quarter as often.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let AddColumnSums { dbias, dy } = self;
        let width = dbias.len();
        let (sums, sums_tail) = S::as_mut_simd_f32s(dbias);
        let fours = dy.chunks_exact(4 * width);
        // the order depends on the number of rows alone, as that of a piece does: threads change no bit
        for row in fours.remainder().chunks_exact(width) {
            let (y, y_tail) = S::as_simd_f32s(row);
            for (s, y) in sums.iter_mut().zip(y) {
                *s = simd.add_f32s(*s, *y);
            }
            if !y_tail.is_empty() {
                let sum = simd.add_f32s(simd.partial_load_f32s(sums_tail), simd.partial_load_f32s(y_tail));
                simd.partial_store_f32s(sums_tail, sum);
            }
        }
        for four in fours {
            let row = |i: usize| S::as_simd_f32s(&four[i * width..][..width]);
            let [(a, a_tail), (b, b_tail), (c, c_tail), (d, d_tail)] = [row(0), row(1), row(2), row(3)];
            for ((((s, a), b), c), d) in sums.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *s = simd.add_f32s(*s, sum_of_four(simd, [*a, *b, *c, *d]));
            }
            if !a_tail.is_empty() {
                let four = [a_tail, b_tail, c_tail, d_tail].map(|t| simd.partial_load_f32s(t));
                let sum = simd.add_f32s(simd.partial_load_f32s(sums_tail), sum_of_four(simd, four));
                simd.partial_store_f32s(sums_tail, sum);
            }
        }
    }
}

#[inline(always)]
fn sum_of_four<S: Simd>(simd: S, [a, b, c, d]: [S::f32s; 4]) -> S::f32s {
    simd.add_f32s(simd.add_f32s(a, b), simd.add_f32s(c, d))
}

struct Residual<'a> {
    x: &'a mut [f32],
    y: &'a [f32],
    bias: &'a [f32],
}

impl WithSimd for Residual<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Residual { x, y, bias } = self;
        let (b, b_tail) = S::as_simd_f32s(bias);
        for (x, y) in x.chunks_exact_mut(bias.len()).zip(y.chunks_exact(bias.len())) {
            let ((x, x_tail), (y, y_tail)) = (S::as_mut_simd_f32s(x), S::as_simd_f32s(y));
            for ((x, y), b) in x.iter_mut().zip(y).zip(b) {
                *x = simd.add_f32s(*x, simd.add_f32s(*y, *b));
            }
            if !b_tail.is_empty() {
                let y = simd.add_f32s(simd.partial_load_f32s(y_tail), simd.partial_load_f32s(b_tail));
                let sum = simd.add_f32s(simd.partial_load_f32s(x_tail), y);
                simd.partial_store_f32s(x_tail, sum);
            }
        }
    }
}

struct ResidualDropped<'a> {
    x: &'a mut [f32],
    y: &'a [f32],
    bias: &'a [f32],
    mask: Mask,
    threshold: u32,
}

impl WithSimd for ResidualDropped<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let ResidualDropped { x, y, bias, mask, threshold } = self;
        let growth = dropout::growth(mask.share);
        let (b, b_tail) = S::as_simd_f32s(bias);
        let rows = x.chunks_exact_mut(bias.len()).zip(y.chunks_exact(bias.len()));
        for (r, (x, y)) in rows.enumerate() {
            let row_key = dropout::row_key(mask.key, mask.first_row.wrapping_add(r as u64));
            let ((x, x_tail), (y, y_tail)) = (S::as_mut_simd_f32s(x), S::as_simd_f32s(y));
            let mut column = 0;
            for ((x, y), b) in x.iter_mut().zip(y).zip(b) {
                let factors = dropout::factors(simd, row_key, column, threshold, growth);
                *x = simd.mul_add_e_f32s(simd.add_f32s(*y, *b), factors, *x);
                column += S::F32_LANES as u32;
            }
            if !b_tail.is_empty() {
                let factors = dropout::factors(simd, row_key, column, threshold, growth);
                let y = simd.add_f32s(simd.partial_load_f32s(y_tail), simd.partial_load_f32s(b_tail));
                let sum = simd.mul_add_e_f32s(y, factors, simd.partial_load_f32s(x_tail));
                simd.partial_store_f32s(x_tail, sum);
            }
        }
    }
}

struct Dropped<'a> {
    dy: &'a mut [f32],
    dx: &'a [f32],
    width: usize,
    mask: Mask,
    threshold: u32,
}

impl WithSimd for Dropped<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Dropped { dy, dx, width, mask, threshold } = self;
        let growth = dropout::growth(mask.share);
        for (r, (dy, dx)) in dy.chunks_exact_mut(width).zip(dx.chunks_exact(width)).enumerate() {
            let row_key = dropout::row_key(mask.key, mask.first_row.wrapping_add(r as u64));
            let ((dy, dy_tail), (dx, dx_tail)) = (S::as_mut_simd_f32s(dy), S::as_simd_f32s(dx));
            let mut column = 0;
            for (dy, dx) in dy.iter_mut().zip(dx) {
                *dy = simd.mul_f32s(*dx, dropout::factors(simd, row_key, column, threshold, growth));
                column += S::F32_LANES as u32;
            }
            if !dx_tail.is_empty() {
                let factors = dropout::factors(simd, row_key, column, threshold, growth);
                simd.partial_store_f32s(dy_tail, simd.mul_f32s(simd.partial_load_f32s(dx_tail), factors));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, near, numbers};
    use crate::scalar::bias as scalar;

    /// Sums of two or three numbers below 4.
    const SUM: f64 = 5e-7;

    fn cases() -> impl Iterator<Item = (usize, usize, Lanes)> {
        let shapes = (1..=67).map(|width| (5, width)).chain([(0, 3), (1, 40), (4, 9), (33, 130)]);
        shapes.flat_map(|(n, width)| Lanes::ALL.map(|lanes| (n, width, lanes)))
    }

    #[test]
    fn rows_get_the_bias() {
        for (n, width, lanes) in cases() {
            let (x, bias) = (numbers(1, n * width, 2.0), numbers(2, width, 2.0));
            let mut sum = x.clone();
            lanes.run(Add { x: &mut sum, bias: &bias });
            let expected: Vec<f32> = x.iter().enumerate().map(|(i, x)| x + bias[i % width]).collect();
            assert_eq!(sum, expected, "{lanes:?} ({n}, {width})");
        }
    }

    #[test]
    fn columns_are_summed_onto_what_is_there() {
        for (n, width, lanes) in cases().chain(Lanes::ALL.map(|lanes| (1001, 24, lanes))) {
            let (dy, before) = (numbers(1, n * width, 2.0), numbers(2, width, 2.0));
            let mut dbias = before.clone();
            lanes.run(AddColumnSums { dbias: &mut dbias, dy: &dy });
            let mut expected = scalar::column_sums(&dy, width);
            expected.iter_mut().zip(&before).for_each(|(e, &b)| *e += b as f64);
            near(&format!("{lanes:?} ({n}, {width})"), &dbias, &expected, SUM * (n as f64).sqrt().max(2.0));
        }
    }

    #[test]
    fn the_branch_is_dropped_and_added() {
        for ((n, width, lanes), share) in cases().flat_map(|c| [0.0, 0.25].map(|share| (c, share))) {
            let what = format!("{lanes:?} ({n}, {width}), {share} dropped");
            let mask = Mask { key: 77 + n as u64, first_row: 1 << 33, share };
            let [x, y, dx] = [1, 2, 3].map(|seed| numbers(seed, n * width, 2.0));
            let bias = numbers(4, width, 2.0);
            let [mut sum, mut dy] = [x.clone(), vec![7.0; n * width]];
            match dropout::threshold(share) {
                0 => {
                    lanes.run(Residual { x: &mut sum, y: &y, bias: &bias });
                    residual_backward(&mut dy, &dx, width, mask);
                }
                threshold => {
                    lanes.run(ResidualDropped { x: &mut sum, y: &y, bias: &bias, mask, threshold });
                    lanes.run(Dropped { dy: &mut dy, dx: &dx, width, mask, threshold });
                }
            }
            near(&what, &sum, &scalar::residual(&x, &y, &bias, mask), SUM);
            let dx: Vec<f64> = dx.iter().map(|&x| x as f64).collect();
            near(&what, &dy, &scalar::masked(&dx, width, mask), SUM);
        }
    }

    #[test]
    fn the_doors_lead_to_the_kernels() {
        let mask = Mask { key: 5, first_row: 2, share: 0.5 };
        let (x, y, bias) = (numbers(1, 40, 1.0), numbers(2, 40, 1.0), numbers(3, 10, 1.0));
        for mask in [mask, Mask::NONE] {
            let mut sum = x.clone();
            residual(&mut sum, &y, &bias, mask);
            near("residual", &sum, &scalar::residual(&x, &y, &bias, mask), SUM);
        }
        let (mut whole, mut parts) = (vec![0.0; 40], vec![0.0; 40]);
        residual_backward(&mut whole, &y, 10, mask);
        let second = Mask { first_row: 4, ..mask };
        residual_backward(&mut parts[..20], &y[..20], 10, mask);
        residual_backward(&mut parts[20..], &y[20..], 10, second);
        assert_eq!(whole, parts);
    }
}
