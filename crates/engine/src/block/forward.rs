//! The forward pass of a block.

use super::{PanelSet, Rules, Saved, Shape, Weights, Workspace, dropped};
use crate::linear::Products;
use crate::op::{attention, bias, gelu, layer_norm, rope};
use rayon::prelude::*;

/// The block's output (N, D) for its input `x` (N, D).
///
/// # Panics
/// Slices of other lengths than the workspace's shape has, or a [`Saved`] of another shape.
pub fn forward(
    out: &mut [f32],
    x: &[f32],
    weights: &Weights,
    rules: Rules,
    saved: &mut Saved,
    workspace: &mut Workspace,
) {
    let Workspace { shape, products, piece, panels, scratch, attention: space, .. } = workspace;
    let products = *products;
    let (shape, piece) = (*shape, *piece);
    let Shape { width: d, hidden: m, heads: h, .. } = shape;
    let dropout = rules.dropout;
    shape.check([out, x], weights, saved);
    panels.pack(products, weights, d, m);
    let parts =
        (saved.qkv.par_chunks_mut(piece * 3 * d), saved.stats1.par_chunks_mut(piece * 2), x.par_chunks(piece * d));
    parts.into_par_iter().enumerate().for_each(|(i, (qkv, stats, x))| {
        scratch.with(|scratch| {
            let normal = &mut scratch[..x.len()];
            layer_norm::forward(normal, stats, x, weights.norm1.weight, weights.norm1.bias);
            products.times(qkv, normal, d, &panels.qkv, 3 * d);
            bias::add(qkv, weights.qkv.bias);
            if let Some(by) = rules.rope {
                rope::turn(qkv, h, i * piece, by, false);
            }
        });
    });
    attention::forward(shape.attention(), &saved.qkv, rules.attention(), space, &mut saved.heads, &mut saved.lse);
    let heads = &*saved.heads;
    let parts = (
        out.par_chunks_mut(piece * d),
        saved.middle.par_chunks_mut(piece * d),
        saved.stats2.par_chunks_mut(piece * 2),
        saved.up.par_chunks_mut(piece * m),
        x.par_chunks(piece * d),
    );
    parts.into_par_iter().enumerate().for_each(|(i, (out, middle, stats, up, x))| {
        let first = i * piece;
        scratch.with(|scratch| {
            let (normal, rest) = scratch.split_at_mut(x.len());
            let (added, hidden) = rest.split_at_mut(x.len());
            let hidden = &mut hidden[..up.len()];
            attention::gather(shape.attention(), 1, heads, first..first + x.len() / d, normal);
            products.times(added, normal, d, &panels.out, d);
            // `residual` adds to its target; x itself is the caller's, and the backward pass reads it
            middle.copy_from_slice(x);
            dropped(shape, first, x.len() / d, dropout.map(|p| (p.share, p.out)), &mut |rows, mask| {
                bias::residual(&mut middle[rows.clone()], &added[rows], weights.out.bias, mask);
            });
            layer_norm::forward(normal, stats, middle, weights.norm2.weight, weights.norm2.bias);
            products.times(up, normal, d, &panels.up, m);
            // `up` gets its bias in place and is saved before the GELU, whose slope the backward pass needs
            gelu::forward_biased(hidden, up, weights.up.bias);
            products.times(added, hidden, m, &panels.down, d);
            out.copy_from_slice(middle);
            dropped(shape, first, x.len() / d, dropout.map(|p| (p.share, p.mlp)), &mut |rows, mask| {
                bias::residual(&mut out[rows.clone()], &added[rows], weights.down.bias, mask);
            });
        });
    });
}

impl PanelSet {
    fn pack(&mut self, products: Products, weights: &Weights, d: usize, m: usize) {
        let (qkv, out) = (&mut self.qkv, &mut self.out);
        let (up, down) = (&mut self.up, &mut self.down);
        rayon::join(
            || {
                products.pack_parallel(qkv, weights.qkv.weight, d, 3 * d);
                products.pack_parallel(out, weights.out.weight, d, d);
            },
            || {
                products.pack_parallel(up, weights.up.weight, d, m);
                products.pack_parallel(down, weights.down.weight, m, d);
            },
        );
    }
}
