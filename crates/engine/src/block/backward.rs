//! The backward pass of a block.

use super::{Back, Gradients, PanelSet, Rules, Saved, Shape, Weights, Workspace, dropped};
use crate::arena::Floats;
use crate::linear::{Products, Sums};
use crate::op::matmul::Store;
use crate::op::{attention, bias, gelu, layer_norm, rope};
use crate::per_thread::PerThread;
use rayon::prelude::*;

/// Turns `dx` (N, D), the gradient of the block's output, into that of its input `x`, and adds to (or sets) the
/// gradients of its weights.
///
/// `saved` comes from the forward pass with the same `x`, weights and rules.
///
/// # Panics
/// Slices of other lengths than the workspace's shape has, a [`Saved`] of another shape, or a workspace without its
/// backward part.
#[allow(clippy::too_many_arguments)]
pub fn backward(
    dx: &mut [f32],
    x: &[f32],
    weights: &Weights,
    gradients: &mut Gradients,
    store: Store,
    rules: Rules,
    saved: &Saved,
    workspace: &mut Workspace,
) {
    let Workspace { shape, products, piece, panels, scratch, attention, back } = workspace;
    let (shape, products, piece) = (*shape, *products, *piece);
    let Some(back) = back else { panic!("a workspace for the forward pass only") };
    shape.check([dx, x], weights, saved);
    shape.check([dx, x], gradients, saved);
    panels.pack_transposed(products, weights, shape.width, shape.hidden);
    let pass = Pass { shape, products, piece, weights, store, rules, saved, panels, scratch };
    pass.after_attention(dx, back);
    pass.sums_after_attention(gradients, back);
    pass.attention(gradients, attention, back);
    pass.before_attention(dx, x, back);
    pass.gradients_before_attention(gradients, back);
}

/// The inputs of all parts of the pass. Rows fall into pieces that threads work on; sums over rows are taken piece by
/// piece and then over the pieces, so that the number of threads changes no bit.
struct Pass<'a> {
    shape: Shape,
    products: Products,
    /// R, rows of a piece.
    piece: usize,
    weights: &'a Weights<'a>,
    store: Store,
    rules: Rules<'a>,
    saved: &'a Saved,
    panels: &'a PanelSet,
    scratch: &'a PerThread<Floats>,
}

impl Pass<'_> {
    /// Numbers of a piece's partial sums after the attention: for `down`'s bias, `up`'s, the second norm, `out`'s bias.
    fn width_after(&self) -> usize {
        self.shape.hidden + 4 * self.shape.width
    }

    /// The same before the attention: for `qkv`'s bias and the first norm.
    fn width_before(&self) -> usize {
        5 * self.shape.width
    }

    /// Back through the hidden layer, the second norm and the attention's projection: `dx` becomes the gradient of
    /// `middle`, `d_heads` that of the gathered heads. Both factors of the weights' gradients are left in `back`.
    fn after_attention(&self, dx: &mut [f32], back: &mut Back) {
        let Pass { shape, products, piece, weights, rules, saved, panels, scratch, .. } = *self;
        let (d, m, dropout) = (shape.width, shape.hidden, rules.dropout);
        let slot = |width: usize| products.panels_len(piece, width);
        let parts = (
            (dx.par_chunks_mut(piece * d), saved.middle.par_chunks(piece * d), saved.stats2.par_chunks(piece * 2)),
            (saved.up.par_chunks(piece * m), back.gelu.par_chunks_mut(piece * m)),
            (back.normal.par_chunks_mut(piece * d), back.gathered.par_chunks_mut(piece * d)),
            back.d_heads.par_chunks_mut(piece * d),
            (
                back.d_down.par_chunks_mut(slot(d)),
                back.d_up.par_chunks_mut(slot(m)),
                back.d_out.par_chunks_mut(slot(d)),
            ),
            back.partial.par_chunks_mut(self.width_after()),
        );
        parts.into_par_iter().enumerate().for_each(
            |(i, ((dx, middle, stats), (up, gelu), (normal, gathered), d_heads, (d_down, d_up, d_out), partial))| {
                let (first, rows) = (i * piece, dx.len() / d);
                // the sums below add, and the memory holds the last block's
                partial.fill(0.0);
                let (db_down, partial) = partial.split_at_mut(d);
                let (db_up, partial) = partial.split_at_mut(m);
                let (d_norm, db_out) = partial.split_at_mut(2 * d);
                let (dw_norm, db_norm) = d_norm.split_at_mut(d);
                scratch.with(|scratch| {
                    let (dy, rest) = scratch.split_at_mut(dx.len());
                    let (d_normal, rest) = rest.split_at_mut(dx.len());
                    let d_hidden = &mut rest[..up.len()];
                    dropped(shape, first, rows, dropout.map(|p| (p.share, p.mlp)), &mut |rows, mask| {
                        bias::residual_backward(&mut dy[rows.clone()], &dx[rows], d, mask);
                    });
                    bias::add_column_sums(db_down, dy);
                    // now, while dy is in the cache: it is overwritten below, and `attention` needs it
                    products.pack(d_down, dy, d, rows, d);
                    products.times(d_hidden, dy, d, &panels.down, m);
                    gelu::backward(d_hidden, gelu, up);
                    bias::add_column_sums(db_up, d_hidden);
                    products.pack(d_up, d_hidden, m, rows, m);
                    products.times(d_normal, d_hidden, m, &panels.up, d);
                    // computed again rather than saved: the rows are in the cache, N D more numbers are not
                    layer_norm::again(normal, middle, stats, weights.norm2.weight, weights.norm2.bias);
                    // adds to dx, which is the gradient of the path around the hidden layer already
                    let normed = layer_norm::Saved { x: middle, stats, weight: weights.norm2.weight };
                    layer_norm::backward(dx, dw_norm, db_norm, normed, d_normal);
                    dropped(shape, first, rows, dropout.map(|p| (p.share, p.out)), &mut |rows, mask| {
                        bias::residual_backward(&mut dy[rows.clone()], &dx[rows], d, mask);
                    });
                    bias::add_column_sums(db_out, dy);
                    products.pack(d_out, dy, d, rows, d);
                    products.times(d_heads, dy, d, &panels.out, d);
                    attention::gather(shape.attention(), 1, &saved.heads, first..first + rows, gathered);
                });
            },
        );
    }

    /// Adds up the pieces' sums, in the order in which [`Pass::after_attention`] writes them.
    fn sums_after_attention(&self, gradients: &mut Gradients, back: &Back) {
        let mut sums = self.sums(back, self.width_after());
        sums.take(gradients.down.bias);
        sums.take(gradients.up.bias);
        sums.take(gradients.norm2.weight);
        sums.take(gradients.norm2.bias);
        sums.take(gradients.out.bias);
    }

    /// Back through the attention, from `d_heads` to `dqkv_heads`. Beside it run the products for the gradients of the
    /// weights after it, which wait for nothing: they fill the threads that the attention's uneven pieces leave idle.
    fn attention(&self, gradients: &mut Gradients, space: &mut attention::Workspace, back: &mut Back) {
        let Pass { shape, products, piece, store, saved, .. } = *self;
        let (n, d, m) = (shape.rows(), shape.width, shape.hidden);
        let Back { d_down, d_up, d_out, gelu, normal, gathered, d_heads, dqkv_heads, .. } = back;
        let done = attention::Done { qkv: &saved.qkv, out: &saved.heads, log_sums: &saved.lse, d_out: d_heads };
        let (dw_down, dw_up) = (&mut *gradients.down.weight, &mut *gradients.up.weight);
        let dw_out = &mut *gradients.out.weight;
        rayon::join(
            || attention::backward(shape.attention(), done, self.rules.attention(), space, dqkv_heads),
            || {
                rayon::join(
                    || products.weight_gradient(dw_down, gelu, m, (d_down, piece), n, store),
                    || {
                        rayon::join(
                            || products.weight_gradient(dw_up, normal, d, (d_up, piece), n, store),
                            || products.weight_gradient(dw_out, gathered, d, (d_out, piece), n, store),
                        )
                    },
                )
            },
        );
    }

    /// Back through the queries, keys and values and the first norm: `dx`, the gradient of `middle`, becomes that of the input.
    fn before_attention(&self, dx: &mut [f32], x: &[f32], back: &mut Back) {
        let Pass { shape, products, piece, weights, rules, saved, panels, scratch, .. } = *self;
        let d = shape.width;
        let dqkv_heads = &*back.dqkv_heads;
        let parts = (
            dx.par_chunks_mut(piece * d),
            (x.par_chunks(piece * d), saved.stats1.par_chunks(piece * 2)),
            back.normal.par_chunks_mut(piece * d),
            back.d_qkv.par_chunks_mut(products.panels_len(piece, 3 * d)),
            back.partial.par_chunks_mut(self.width_before()),
        );
        parts.into_par_iter().enumerate().for_each(|(i, (dx, (x, stats), normal, d_qkv, partial))| {
            let (first, rows) = (i * piece, dx.len() / d);
            partial.fill(0.0);
            let (db_qkv, d_norm) = partial.split_at_mut(3 * d);
            let (dw_norm, db_norm) = d_norm.split_at_mut(d);
            scratch.with(|scratch| {
                let (d_normal, rest) = scratch.split_at_mut(dx.len());
                // scratch holds the hidden layer's M numbers a row or these 3 D, never both
                let dqkv = &mut rest[..3 * dx.len()];
                attention::gather(shape.attention(), 3, dqkv_heads, first..first + rows, dqkv);
                if let Some(by) = rules.rope {
                    // the gradient of a rotation is its inverse; values are not rotated
                    rope::turn(dqkv, shape.heads, first, by, true);
                }
                bias::add_column_sums(db_qkv, dqkv);
                products.pack(d_qkv, dqkv, 3 * d, rows, 3 * d);
                products.times(d_normal, dqkv, 3 * d, &panels.qkv, d);
                layer_norm::again(normal, x, stats, weights.norm1.weight, weights.norm1.bias);
                let normed = layer_norm::Saved { x, stats, weight: weights.norm1.weight };
                layer_norm::backward(dx, dw_norm, db_norm, normed, d_normal);
            });
        });
    }

    /// Gradients from the factors and sums of [`Pass::before_attention`], in its order.
    fn gradients_before_attention(&self, gradients: &mut Gradients, back: &Back) {
        let Pass { shape, products, piece, store, .. } = *self;
        let mut sums = self.sums(back, self.width_before());
        sums.take(gradients.qkv.bias);
        sums.take(gradients.norm1.weight);
        sums.take(gradients.norm1.bias);
        let d_qkv = (&*back.d_qkv, piece);
        products.weight_gradient(gradients.qkv.weight, &back.normal, shape.width, d_qkv, shape.rows(), store);
    }

    /// A row of `width` partial sums a piece.
    fn sums<'b>(&self, back: &'b Back, width: usize) -> Sums<'b> {
        let pieces = self.shape.rows().div_ceil(self.piece);
        Sums { partial: &back.partial[..pieces * width], width, store: self.store }
    }
}

impl PanelSet {
    fn pack_transposed(&mut self, products: Products, weights: &Weights, d: usize, m: usize) {
        let (qkv, out) = (&mut self.qkv, &mut self.out);
        let (up, down) = (&mut self.up, &mut self.down);
        rayon::join(
            || {
                products.pack_transposed_parallel(down, weights.down.weight, d, m);
                products.pack_transposed_parallel(out, weights.out.weight, d, d);
            },
            || {
                products.pack_transposed_parallel(up, weights.up.weight, m, d);
                products.pack_transposed_parallel(qkv, weights.qkv.weight, 3 * d, d);
            },
        );
    }
}
