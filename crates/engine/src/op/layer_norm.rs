//! Layer norm over rows of D numbers: y = (x - mean)/sd, out = y weight + bias, with the biased variance in two passes.
//!
//! The backward pass needs two sums of each row, which `stats` stores: mean and 1/sd. The gradient of x
//! is (g - mean(g) - y mean(g y))/sd where g = dy weight.

use super::math::{LaneSums, SUM_LANES, sum};
use super::rows;
use crate::dispatch;
use pulp::{Simd, WithSimd};

/// Added to the variance.
pub const EPSILON: f32 = 1e-5;

/// Writes `out` and `stats` (N, 2), mean and 1/sd of each row of `x` (N, D).
///
/// # Panics
/// Shapes that don't fit.
pub fn forward(out: &mut [f32], stats: &mut [f32], x: &[f32], weight: &[f32], bias: &[f32]) {
    check(x, stats, weight.len(), [out.len(), x.len()], [bias.len(), weight.len()]);
    dispatch::run(Forward { out, stats, x, weight, bias });
}

/// Writes `out` once more from the `stats` that [`forward`] left.
///
/// # Panics
/// Shapes that don't fit.
pub fn again(out: &mut [f32], x: &[f32], stats: &[f32], weight: &[f32], bias: &[f32]) {
    check(x, stats, weight.len(), [out.len(), x.len()], [bias.len(), weight.len()]);
    dispatch::run(Again { out, x, stats, weight, bias });
}

/// The inputs of the backward pass from [`forward`].
#[derive(Debug, Clone, Copy)]
pub struct Saved<'a> {
    /// (N, D), the rows that [`forward`] got.
    pub x: &'a [f32],
    /// (N, 2), as [`forward`] left them.
    pub stats: &'a [f32],
    /// (D).
    pub weight: &'a [f32],
}

/// Adds to the gradients `dx` (N, D), `dweight` (D) and `dbias` (D), given `dy` (N, D), that of the output.
///
/// # Panics
/// Shapes that don't fit.
pub fn backward(dx: &mut [f32], dweight: &mut [f32], dbias: &mut [f32], saved: Saved, dy: &[f32]) {
    let width = saved.weight.len();
    check(saved.x, saved.stats, width, [dx.len(), dy.len()], [dweight.len(), dbias.len()]);
    dispatch::run(Backward { dx, dweight, dbias, saved, dy });
}

fn check(x: &[f32], stats: &[f32], width: usize, rows_of: [usize; 2], columns: [usize; 2]) {
    let n = rows("layer norm", x.len(), width);
    assert!(stats.len() == 2 * n, "layer norm: {} means and deviations for {n} rows", stats.len());
    assert!(rows_of == [x.len(); 2], "layer norm: {rows_of:?} numbers beside {} of x", x.len());
    assert!(columns == [width; 2], "layer norm: {columns:?} numbers for {width} columns");
}

struct Forward<'a> {
    out: &'a mut [f32],
    stats: &'a mut [f32],
    x: &'a [f32],
    weight: &'a [f32],
    bias: &'a [f32],
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Forward { out, stats, x, weight, bias } = self;
        let width = weight.len();
        let rows = out.chunks_exact_mut(width).zip(x.chunks_exact(width));
        for ((out, x), stats) in rows.zip(stats.as_chunks_mut::<2>().0) {
            *stats = moments(simd, x);
            scaled_row(simd, out, x, *stats, weight, bias);
        }
    }
}

struct Again<'a> {
    out: &'a mut [f32],
    x: &'a [f32],
    stats: &'a [f32],
    weight: &'a [f32],
    bias: &'a [f32],
}

impl WithSimd for Again<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Again { out, x, stats, weight, bias } = self;
        let width = weight.len();
        let rows = out.chunks_exact_mut(width).zip(x.chunks_exact(width));
        for ((out, x), stats) in rows.zip(stats.as_chunks::<2>().0) {
            scaled_row(simd, out, x, *stats, weight, bias);
        }
    }
}

/// Mean and 1/sd in every lane.
#[derive(Clone, Copy)]
struct Stats<S: Simd> {
    mean: S::f32s,
    rsd: S::f32s,
}

impl<S: Simd> Stats<S> {
    #[inline(always)]
    fn new(simd: S, [mean, rsd]: [f32; 2]) -> Stats<S> {
        Stats { mean: simd.splat_f32s(mean), rsd: simd.splat_f32s(rsd) }
    }

    #[inline(always)]
    fn y(&self, simd: S, x: S::f32s) -> S::f32s {
        simd.mul_f32s(simd.sub_f32s(x, self.mean), self.rsd)
    }
}

/// Mean and 1/sd of a row, in two passes: the second over a row that the first left in the cache.
#[inline(always)]
fn moments<S: Simd>(simd: S, row: &[f32]) -> [f32; 2] {
    let n = row.len() as f32;
    let mean = deviations::<S, false>(simd, row, 0.0) / n;
    // mean(x^2) - mean^2 in one pass would cancel where the mean is large beside the deviation
    let variance = deviations::<S, true>(simd, row, mean) / n;
    [mean, 1.0 / (variance + EPSILON).sqrt()]
}

/// The sum of x - mean, or of its square. Four sums at a time: one would wait for its own result.
#[inline(always)]
fn deviations<S: Simd, const SQUARE: bool>(simd: S, row: &[f32], mean: f32) -> f32 {
    let means = simd.splat_f32s(mean);
    let mut sums = [LaneSums::new(simd); 4];
    let add = |sums: &mut LaneSums<S>, x: &[f32; SUM_LANES]| {
        let (vectors, _) = S::as_simd_f32s(x);
        sums.update(vectors, |sum, x| plus_deviation::<S, SQUARE>(simd, sum, simd.sub_f32s(x, means)));
    };
    let (sixteens, tail) = row.as_chunks();
    let (fours, rest) = sixteens.as_chunks::<4>();
    for four in fours {
        for (sums, x) in sums.iter_mut().zip(four) {
            add(sums, x);
        }
    }
    for x in rest {
        add(&mut sums[0], x);
    }
    if !tail.is_empty() {
        // what fills the lanes deviates by 0
        let mut filled = [mean; SUM_LANES];
        filled[..tail.len()].copy_from_slice(tail);
        add(&mut sums[1], &filled);
    }
    let [a, b, c, d] = sums;
    a.plus(simd, b).plus(simd, c.plus(simd, d)).total(simd)
}

#[inline(always)]
fn plus_deviation<S: Simd, const SQUARE: bool>(simd: S, sum: S::f32s, d: S::f32s) -> S::f32s {
    if SQUARE { simd.mul_add_e_f32s(d, d, sum) } else { simd.add_f32s(sum, d) }
}

#[inline(always)]
fn scaled_row<S: Simd>(simd: S, out: &mut [f32], x: &[f32], stats: [f32; 2], weight: &[f32], bias: &[f32]) {
    let row = Stats::new(simd, stats);
    let ((out, out_tail), (x, x_tail)) = (S::as_mut_simd_f32s(out), S::as_simd_f32s(x));
    let ((w, w_tail), (b, b_tail)) = (S::as_simd_f32s(weight), S::as_simd_f32s(bias));
    for (((o, x), w), b) in out.iter_mut().zip(x).zip(w).zip(b) {
        *o = simd.mul_add_e_f32s(row.y(simd, *x), *w, *b);
    }
    if !x_tail.is_empty() {
        let [x, w, b] = [x_tail, w_tail, b_tail].map(|t| simd.partial_load_f32s(t));
        simd.partial_store_f32s(out_tail, simd.mul_add_e_f32s(row.y(simd, x), w, b));
    }
}

struct Backward<'a> {
    dx: &'a mut [f32],
    dweight: &'a mut [f32],
    dbias: &'a mut [f32],
    saved: Saved<'a>,
    dy: &'a [f32],
}

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Backward { dx, dweight, dbias, saved: Saved { x, stats, weight }, dy } = self;
        let width = weight.len();
        let rows = dx.chunks_exact_mut(width).zip(x.chunks_exact(width)).zip(dy.chunks_exact(width));
        for (((dx, x), dy), stats) in rows.zip(stats.as_chunks::<2>().0) {
            let row = Stats::new(simd, *stats);
            let means = gradient_sums(simd, dweight, dbias, row, x, weight, dy).map(|s| s / width as f32);
            // (dy w - m - y my)/sd, gathered by what a row has in common
            let [m, my] = means.map(|m| m * stats[1]);
            let (m, my) = (simd.splat_f32s(m), simd.splat_f32s(my));
            input_gradient(simd, dx, row, [m, my], x, weight, dy);
        }
    }
}

/// The sums of g and of g y over a row; adds the row's part to the gradients of weight and bias.
#[inline(always)]
fn gradient_sums<S: Simd>(
    simd: S,
    dweight: &mut [f32],
    dbias: &mut [f32],
    row: Stats<S>,
    x: &[f32],
    weight: &[f32],
    dy: &[f32],
) -> [f32; 2] {
    let ((dw, dw_tail), (db, db_tail)) = (S::as_mut_simd_f32s(dweight), S::as_mut_simd_f32s(dbias));
    let ((x, x_tail), (w, w_tail), (dy, dy_tail)) = (S::as_simd_f32s(x), S::as_simd_f32s(weight), S::as_simd_f32s(dy));
    let mut sums = [simd.splat_f32s(0.0); 2];
    for ((((dw, db), x), w), dy) in dw.iter_mut().zip(db).zip(x).zip(w).zip(dy) {
        (*dw, *db, sums) = gradients_of(simd, (*dw, *db, sums), row, [*x, *w, *dy]);
    }
    if !x_tail.is_empty() {
        let [x, w, dy] = [x_tail, w_tail, dy_tail].map(|t| simd.partial_load_f32s(t));
        let (dw, db) = (simd.partial_load_f32s(dw_tail), simd.partial_load_f32s(db_tail));
        let (dw, db, all) = gradients_of(simd, (dw, db, sums), row, [x, w, dy]);
        simd.partial_store_f32s(dw_tail, dw);
        simd.partial_store_f32s(db_tail, db);
        sums = all;
    }
    [sum(simd, sums[0]), sum(simd, sums[1])]
}

/// Gradients of weight and bias, and the sums of g and g y.
type Sums<S> = (<S as Simd>::f32s, <S as Simd>::f32s, [<S as Simd>::f32s; 2]);

#[inline(always)]
fn gradients_of<S: Simd>(simd: S, (dw, db, [s, sy]): Sums<S>, row: Stats<S>, [x, w, dy]: [S::f32s; 3]) -> Sums<S> {
    let (y, g) = (row.y(simd, x), simd.mul_f32s(dy, w));
    let sums = [simd.add_f32s(s, g), simd.mul_add_e_f32s(g, y, sy)];
    (simd.mul_add_e_f32s(dy, y, dw), simd.add_f32s(db, dy), sums)
}

#[inline(always)]
fn input_gradient<S: Simd>(
    simd: S,
    dx: &mut [f32],
    row: Stats<S>,
    means: [S::f32s; 2],
    x: &[f32],
    weight: &[f32],
    dy: &[f32],
) {
    let (dx, dx_tail) = S::as_mut_simd_f32s(dx);
    let ((x, x_tail), (w, w_tail), (dy, dy_tail)) = (S::as_simd_f32s(x), S::as_simd_f32s(weight), S::as_simd_f32s(dy));
    for (((dx, x), w), dy) in dx.iter_mut().zip(x).zip(w).zip(dy) {
        // a second pass over the row: every number needs both means
        *dx = plus_gradient(simd, *dx, row, means, [*x, *w, *dy]);
    }
    if !x_tail.is_empty() {
        let [x, w, dy] = [x_tail, w_tail, dy_tail].map(|t| simd.partial_load_f32s(t));
        let sum = plus_gradient(simd, simd.partial_load_f32s(dx_tail), row, means, [x, w, dy]);
        simd.partial_store_f32s(dx_tail, sum);
    }
}

#[inline(always)]
fn plus_gradient<S: Simd>(
    simd: S,
    dx: S::f32s,
    row: Stats<S>,
    [m, my]: [S::f32s; 2],
    [x, w, dy]: [S::f32s; 3],
) -> S::f32s {
    let g = simd.mul_add_e_f32s(simd.mul_f32s(dy, w), row.rsd, simd.sub_f32s(dx, m));
    simd.negate_mul_add_e_f32s(row.y(simd, x), my, g)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, near, numbers};
    use crate::scalar::layer_norm as scalar;

    /// Sums of up to 1000 numbers of size 1 in four to 64 lanes, and y up to 30: a few units in the last place of f32.
    const BOUND: f64 = 2e-6;

    fn shapes() -> impl Iterator<Item = (usize, usize)> {
        (1..=67).map(|width| (3, width)).chain([(0, 5), (1, 1000), (40, 128), (7, 512)])
    }

    #[test]
    fn forward_has_the_same_bits_on_all_vectors() {
        for width in [1, 5, 16, 40, 64, 71, 130, 256] {
            let (x, weight, bias) = (numbers(1, 3 * width, 2.0), numbers(2, width, 2.0), numbers(3, width, 1.0));
            let all = Lanes::fused().map(|lanes| {
                let (mut out, mut stats) = (vec![0.0; x.len()], vec![0.0; 6]);
                lanes.run(Forward { out: &mut out, stats: &mut stats, x: &x, weight: &weight, bias: &bias });
                (out, stats)
            });
            let all: Vec<_> = all.collect();
            assert!(all.iter().all(|one| one == &all[0]), "width {width}");
        }
    }

    #[test]
    fn forward_is_the_definition() {
        for ((n, width), lanes) in shapes().flat_map(|s| Lanes::ALL.map(|l| (s, l))) {
            let what = format!("{lanes:?} ({n}, {width})");
            // a mean far from 0, as one pass over the squares would not survive
            let x: Vec<f32> = numbers(1, n * width, 2.0).iter().map(|x| x + 100.0).collect();
            let (weight, bias) = (numbers(2, width, 2.0), numbers(3, width, 1.0));
            let [mut out, mut second] = [vec![7.0; n * width], vec![7.0; n * width]];
            let mut stats = vec![7.0; 2 * n];
            lanes.run(Forward { out: &mut out, stats: &mut stats, x: &x, weight: &weight, bias: &bias });
            // the mean of numbers near 100 is rounded to their last place, and a single number has no deviation to it
            let moved = 100.0 * BOUND * if width == 1 { 316.0 } else { 1.0 };
            near(&what, &out, &scalar::forward(&x, &weight, &bias), moved);
            lanes.run(Again { out: &mut second, x: &x, stats: &stats, weight: &weight, bias: &bias });
            assert_eq!(out, second, "{what}");
            let moments: Vec<f64> = x.chunks(width).map(scalar::moments).flat_map(|(m, r)| [m, r]).collect();
            near(&what, &stats, &moments, moved);
        }
    }

    #[test]
    fn backward_adds_the_gradients() {
        for ((n, width), lanes) in shapes().flat_map(|s| Lanes::ALL.map(|l| (s, l))) {
            let what = format!("{lanes:?} ({n}, {width})");
            let (x, dy) = (numbers(1, n * width, 2.0), numbers(4, n * width, 1.0));
            let weight = numbers(2, width, 2.0);
            let mut stats = vec![0.0; 2 * n];
            forward(&mut dy.clone(), &mut stats, &x, &weight, &weight);
            let [mut dx, mut dweight, mut dbias] = [n * width, width, width].map(|len| numbers(5, len, 1.0));
            let before = [dx.clone(), dweight.clone(), dbias.clone()];
            let saved = Saved { x: &x, stats: &stats, weight: &weight };
            lanes.run(Backward { dx: &mut dx, dweight: &mut dweight, dbias: &mut dbias, saved, dy: &dy });
            let expected = scalar::backward(&x, &weight, &dy);
            for ((found, before), mut expected) in [dx, dweight, dbias].iter().zip(&before).zip(expected) {
                expected.iter_mut().zip(before).for_each(|(e, &b)| *e += b as f64);
                // one number a row: 1/sd is 316, and what it multiplies is all rounding
                near(&what, found, &expected, if width == 1 { 316.0 * BOUND } else { BOUND * n.max(5) as f64 });
            }
        }
    }

    #[test]
    fn the_door_checks_shapes() {
        let (x, w) = ([1.0, 3.0, 5.0, 7.0], [1.0, 1.0]);
        let (mut out, mut stats) = ([0.0; 4], [0.0; 4]);
        forward(&mut out, &mut stats, &x, &w, &[0.0, 0.0]);
        assert!((stats[0] - 2.0).abs() < 1e-6 && (stats[1] - 1.0).abs() < 1e-5, "{stats:?}");
        let wrong =
            std::panic::catch_unwind(|| again(&mut [0.0; 3], &[0.0; 3], &[0.0; 2], &[0.0; 2], &[0.0; 2])).unwrap_err();
        let message = wrong.downcast_ref::<String>().unwrap();
        assert_eq!(message, "layer norm: 3 numbers are no rows of 2");
    }
}
