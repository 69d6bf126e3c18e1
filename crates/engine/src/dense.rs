//! A linear layer, `out = x weight + bias`, and a layer norm: the parts between stacks of blocks.
//!
//! Letters: N rows, K numbers of an input, M of an output.

use crate::arena::Floats;
use crate::block::{Linear, Norm};
use crate::linear::{Products, Sums};
use crate::op::matmul::Store;
use crate::op::{bias, layer_norm};
use crate::pieces;
use rayon::prelude::*;

/// Memory for a layer (K, M).
pub struct Workspace {
    rows: usize,
    inputs: usize,
    outputs: usize,
    products: Products,
    piece: usize,
    panels: Floats,
    back: Option<Back>,
}

struct Back {
    d_out: Floats,   // right factor of the weight's gradient, a block of panels a piece
    partial: Floats, // (pieces, M): sums of the bias's gradient
}

impl Workspace {
    /// Memory for N = `rows` rows of K = `inputs` numbers and M = `outputs`; `backward`: for training too.
    pub fn new(rows: usize, inputs: usize, outputs: usize, products: Products, backward: bool) -> Workspace {
        let piece = pieces::rows(rows);
        let pieces = rows.div_ceil(piece);
        let across = products.panels_len(inputs, outputs);
        let down = if backward { products.panels_len(outputs, inputs) } else { 0 };
        Workspace {
            rows,
            inputs,
            outputs,
            products,
            piece,
            panels: Floats::new(across.max(down)),
            back: backward.then(|| Back {
                d_out: Floats::new(pieces * products.panels_len(piece, outputs)),
                partial: Floats::new(pieces * outputs),
            }),
        }
    }

    fn check(&self, x: usize, out: usize, weight: usize, bias: usize) {
        let (k, m) = (self.inputs, self.outputs);
        assert_eq!((x, out), (self.rows * k, self.rows * m), "rows of a layer ({k}, {m})");
        assert_eq!((weight, bias), (k * m, m), "tensors of a layer ({k}, {m})");
    }
}

/// `out` (N, M) becomes `x` (N, K) times the layer's weight, and its bias.
///
/// # Panics
/// If slices have other lengths than the workspace's.
pub fn forward(out: &mut [f32], x: &[f32], layer: Linear<&[f32]>, workspace: &mut Workspace) {
    workspace.check(x.len(), out.len(), layer.weight.len(), layer.bias.len());
    let Workspace { inputs: k, outputs: m, products, piece, ref mut panels, .. } = *workspace;
    products.pack_parallel(panels, layer.weight, k, m);
    let panels = &**panels;
    out.par_chunks_mut(piece * m).zip(x.par_chunks(piece * k)).for_each(|(out, x)| {
        products.times(out, x, k, panels, m);
        bias::add(out, layer.bias);
    });
}

/// From the gradient `d_out` (N, M) of the output: `dx` (N, K) becomes that of the input `x`, if given, and `gradients` those
/// of the layer.
///
/// # Panics
/// If slices have other lengths than the workspace's, or it is for the forward pass only.
pub fn backward(
    dx: Option<&mut [f32]>,
    d_out: &[f32],
    x: &[f32],
    weight: &[f32],
    gradients: Linear<&mut [f32]>,
    workspace: &mut Workspace,
) {
    workspace.check(x.len(), d_out.len(), weight.len(), gradients.bias.len());
    let sizes = (dx.as_ref().map_or(x.len(), |dx| dx.len()), gradients.weight.len());
    assert_eq!(sizes, (x.len(), weight.len()), "gradients of a layer");
    let Workspace { rows, inputs: k, outputs: m, products, piece, ref mut panels, ref mut back } = *workspace;
    let Some(Back { d_out: columns, partial }) = back else { panic!("a workspace for the forward pass only") };
    // the forward panels are overwritten: the next forward pass packs them again, as weights have changed by then
    if let Some(dx) = dx {
        products.pack_transposed_parallel(panels, weight, m, k);
        let down = &**panels;
        let parts = dx.par_chunks_mut(piece * k).zip(d_out.par_chunks(piece * m));
        parts.for_each(|(dx, d_out)| products.times(dx, d_out, m, down, k));
    }
    let parts =
        (d_out.par_chunks(piece * m), columns.par_chunks_mut(products.panels_len(piece, m)), partial.par_chunks_mut(m));
    parts.into_par_iter().for_each(|(d_out, columns, partial)| {
        partial.fill(0.0);
        bias::add_column_sums(partial, d_out);
        products.pack(columns, d_out, m, d_out.len() / m, m);
    });
    Sums { partial, width: m, store: Store::Set }.take(gradients.bias);
    products.weight_gradient(gradients.weight, x, k, (columns, piece), rows, Store::Set);
}

/// `out` (N, K) becomes the layer norm of `x` (N, K); [`norm_backward`] reads `stats` (N, 2).
///
/// # Panics
/// If slices have other lengths.
pub fn norm(out: &mut [f32], stats: &mut [f32], x: &[f32], norm: Norm<&[f32]>) {
    let k = norm.weight.len();
    let piece = pieces::rows(x.len() / k);
    let parts = (out.par_chunks_mut(piece * k), stats.par_chunks_mut(2 * piece), x.par_chunks(piece * k));
    let one = |(out, stats, x): (&mut [f32], &mut [f32], &[f32])| {
        layer_norm::forward(out, stats, x, norm.weight, norm.bias);
    };
    parts.into_par_iter().for_each(one);
}

/// The backward pass of [`norm`]: `dx` (N, K) becomes the gradient of `x`, `gradients` those of the norm, from `d_out` (N, K).
///
/// # Panics
/// If slices have other lengths.
pub fn norm_backward(dx: &mut [f32], d_out: &[f32], saved: layer_norm::Saved, gradients: Norm<&mut [f32]>) {
    for tensor in [&mut *dx, &mut *gradients.weight, &mut *gradients.bias] {
        tensor.fill(0.0);
    }
    // few rows of a trunk: one thread, whose order of sums is its own
    layer_norm::backward(dx, gradients.weight, gradients.bias, saved, d_out);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check;

    /// Sum of `out` times `by`, in f64.
    fn loss(x: &[f32], weight: &[f32], bias: &[f32], by: &[f32], (k, m): (usize, usize)) -> f64 {
        let out = |i: usize| {
            let (r, c) = (i / m, i % m);
            (0..k).map(|j| f64::from(x[r * k + j]) * f64::from(weight[j * m + c])).sum::<f64>() + f64::from(bias[c])
        };
        (0..by.len()).map(|i| out(i) * f64::from(by[i])).sum()
    }

    fn near(found: &[f32], truth: &[f64]) {
        let most = truth.iter().fold(1.0, |m: f64, t| m.max(t.abs()));
        for (i, (f, t)) in found.iter().zip(truth).enumerate() {
            assert!((f64::from(*f) - t).abs() < 1e-5 * most, "number {i}: {f}, expected {t}");
        }
    }

    #[test]
    fn a_layer_and_its_gradients_are_those_of_plain_sums() {
        for (n, k, m) in [(1, 3, 2), (70, 33, 17), (130, 5, 40)] {
            let (x, weight) = (check::numbers(1, n * k, 1.0), check::numbers(2, k * m, 1.0));
            let (bias, by) = (check::numbers(3, m, 1.0), check::numbers(4, n * m, 1.0));
            let mut space = Workspace::new(n, k, m, Products::F32, true);
            let mut out = vec![f32::NAN; n * m];
            forward(&mut out, &x, Linear { weight: &weight, bias: &bias }, &mut space);
            let found: f64 = out.iter().zip(&by).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
            let truth = loss(&x, &weight, &bias, &by, (k, m));
            assert!((found - truth).abs() < 1e-4 * truth.abs().max(10.0), "{found}, expected {truth}");
            let (mut dx, mut dw, mut db) = (vec![f32::NAN; n * k], vec![f32::NAN; k * m], vec![f32::NAN; m]);
            backward(Some(&mut dx), &by, &x, &weight, Linear { weight: &mut dw, bias: &mut db }, &mut space);
            let (mut own, mut sums) = (vec![f32::NAN; k * m], vec![f32::NAN; m]);
            backward(None, &by, &x, &weight, Linear { weight: &mut own, bias: &mut sums }, &mut space);
            assert!((&own, &sums) == (&dw, &db), "nobody wants that of the input");
            let sum = |n: usize, f: &dyn Fn(usize) -> f64| (0..n).map(f).sum::<f64>();
            let f = f64::from;
            let of_x = |i: usize| sum(m, &|c| f(by[i / k * m + c]) * f(weight[i % k * m + c]));
            let of_weight = |i: usize| sum(n, &|r| f(by[r * m + i % m]) * f(x[r * k + i / m]));
            let of_bias = |c: usize| sum(n, &|r| f(by[r * m + c]));
            near(&dx, &(0..n * k).map(of_x).collect::<Vec<_>>());
            near(&dw, &(0..k * m).map(of_weight).collect::<Vec<_>>());
            near(&db, &(0..m).map(of_bias).collect::<Vec<_>>());
        }
    }
}
