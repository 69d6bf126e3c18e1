//! The end of a model: layer norm, the head's logits, cross-entropy. Logits exist for a stretch of rows at a time.
//!
//! Letters: N rows, D width, V columns of the logits: the vocabulary, or the steps from an id to the next. The head is (V, D),
//! as the token embedding it may be tied to. Rows of different heads go through one group after the other.

use crate::arena::Floats;
use crate::block::Norm;
use crate::linear::{Products, Sums};
use crate::op::cross_entropy::{self, RowTarget};
use crate::op::layer_norm;
use crate::op::matmul::Store;
use crate::op::smoothing::Smoothing;
use crate::per_thread::PerThread;
use crate::pieces;
use rayon::prelude::*;

/// Logits that exist at a time, unless one piece has more.
const LOGITS: usize = 1 << 22;

/// Memory for the head of batches of one shape.
pub struct Workspace {
    /// The most rows.
    rows: usize,
    width: usize,
    vocabulary: usize,
    products: Products,
    piece: usize,
    /// Rows whose logits exist at a time.
    stretch: usize,
    across: Floats, // the head, transposed, in panels: (D, V)
    stats: Floats,  // (N, 2)
    logits: Floats, // (stretch, V)
    normal: PerThread<Floats>,
    nats: Vec<f64>, // a piece
    back: Option<Back>,
}

struct Back {
    down: Floats,   // the head in panels: (V, D)
    normal: Floats, // a stretch of normalised rows, a block of panels a piece
    partial: Floats,
}

/// The destinations of the head's gradients.
pub struct Gradients<'a> {
    /// (N, D), that of the head's input; overwritten.
    pub dx: &'a mut [f32],
    /// (D) each.
    pub norm: Norm<&'a mut [f32]>,
    /// (V, D).
    pub head: &'a mut [f32],
}

impl Workspace {
    /// Memory for up to `rows` rows of `width` numbers and a head of `vocabulary` rows; `backward`: for training too.
    pub fn new(rows: usize, width: usize, vocabulary: usize, products: Products, backward: bool) -> Workspace {
        let piece = pieces::rows(rows);
        // whole pieces, so that `back.partial` and `nats` have a place for each, wherever a stretch begins
        let stretch = (LOGITS / vocabulary.max(1) / piece * piece).clamp(piece, rows.next_multiple_of(piece));
        Workspace {
            rows,
            width,
            vocabulary,
            products,
            piece,
            stretch,
            across: Floats::new(products.panels_len(width, vocabulary)),
            stats: Floats::new(2 * rows),
            logits: Floats::new(stretch * vocabulary),
            normal: PerThread::new(|| Floats::new(2 * piece * width)),
            nats: vec![0.0; rows.div_ceil(piece)],
            back: backward.then(|| Back {
                down: Floats::new(products.panels_len(vocabulary, width)),
                normal: Floats::new(stretch / piece * products.panels_len(piece, width)),
                partial: Floats::new(rows.div_ceil(piece) * 2 * width),
            }),
        }
    }

    /// Packs the head (V, D) for the passes that follow.
    fn pack(&mut self, head: &[f32]) {
        assert_eq!(head.len(), self.vocabulary * self.width, "a head of other numbers");
        self.products.pack_transposed_parallel(&mut self.across, head, self.width, self.vocabulary);
        if let Some(back) = &mut self.back {
            self.products.pack_parallel(&mut back.down, head, self.vocabulary, self.width);
        }
    }
}

/// The targets of rows in training.
#[derive(Debug, Clone, Copy)]
pub struct Targets<'a> {
    /// (N).
    pub targets: &'a [RowTarget],
    /// The smoothing of targets, in the gradients alone.
    pub smoothing: Option<&'a Smoothing>,
    /// Factor of the gradients.
    pub scale: f32,
}

/// Sum of -ln p of the targets of the rows `x` (N, D), in nats, and its gradients times the scale.
///
/// # Panics
/// If slices have other lengths, for more rows than the workspace has room for, targets outside the head, or a workspace
/// for the forward pass only.
#[allow(clippy::too_many_arguments)]
pub fn loss(
    x: &[f32],
    norm: Norm<&[f32]>,
    head: &[f32],
    Targets { targets, smoothing, scale }: Targets,
    gradients: &mut Gradients,
    store: Store,
    workspace: &mut Workspace,
) -> f64 {
    workspace.pack(head);
    let products = workspace.products;
    let Workspace {
        rows,
        width: d,
        vocabulary: v,
        piece,
        stretch,
        across,
        stats,
        logits,
        normal: scratch,
        nats,
        back,
        ..
    } = workspace;
    let (n, d, v, piece) = (targets.len(), *d, *v, *piece);
    let Some(back) = back else { panic!("a workspace for the forward pass only") };
    assert!(
        n <= *rows && x.len() == n * d && gradients.dx.len() == n * d,
        "a head of {n} rows of {d}, room for {rows}"
    );
    let lens = [gradients.norm.weight.len(), gradients.norm.bias.len(), gradients.head.len()];
    assert_eq!(lens, [d, d, v * d], "gradients of a head of {v} rows of {d}");
    let mut store_head = store;
    for first in (0..n).step_by(*stretch) {
        let rows = (*stretch).min(n - first);
        let pieces = rows.div_ceil(piece);
        let part = first * d..(first + rows) * d;
        let parts = (
            (x[part.clone()].par_chunks(piece * d), gradients.dx[part].par_chunks_mut(piece * d)),
            stats[2 * first..][..2 * rows].par_chunks_mut(2 * piece),
            targets[first..][..rows].par_chunks(piece),
            logits[..rows * v].par_chunks_mut(piece * v),
            back.normal.par_chunks_mut(products.panels_len(piece, d)).take(pieces),
            back.partial[first / piece * 2 * d..][..pieces * 2 * d].par_chunks_mut(2 * d),
            nats[first / piece..][..pieces].par_iter_mut(),
        );
        let (across, down) = (&*across, &*back.down);
        parts.into_par_iter().for_each(|((x, dx), stats, targets, logits, panels, partial, nats)| {
            scratch.with(|scratch| {
                let (normal, rest) = scratch.split_at_mut(x.len());
                let d_normal = &mut rest[..x.len()];
                layer_norm::forward(normal, stats, x, norm.weight, norm.bias);
                // right factor of the head's gradient, packed now: the next piece of this thread overwrites `normal`
                products.pack(panels, normal, d, targets.len(), d);
                products.times(logits, normal, d, across, v);
                *nats = cross_entropy::forward_backward(logits, targets, smoothing, scale);
                products.times(d_normal, logits, v, down, d);
                // `backward` adds, and nothing has come to dx yet
                dx.fill(0.0);
                partial.fill(0.0);
                let (dw, db) = partial.split_at_mut(d);
                let saved = layer_norm::Saved { x, stats, weight: norm.weight };
                layer_norm::backward(dx, dw, db, saved, d_normal);
            });
        });
        products.weight_gradient(gradients.head, logits, v, (&back.normal, piece), rows, store_head);
        // the first stretch may overwrite, later ones add: the head's gradient is a sum over stretches
        store_head = Store::Add;
    }
    let mut sums = Sums { partial: &back.partial[..n.div_ceil(piece) * 2 * d], width: 2 * d, store };
    sums.take(gradients.norm.weight);
    sums.take(gradients.norm.bias);
    nats[..n.div_ceil(piece)].iter().sum()
}

/// Passes the logits (N, V) of `x` (N, D) to `take`, some rows at a time: the number of the first row, and their logits.
///
/// # Panics
/// If slices have other lengths, or for more rows than the workspace has room for.
pub fn logits(
    x: &[f32],
    norm: Norm<&[f32]>,
    head: &[f32],
    workspace: &mut Workspace,
    take: &mut dyn FnMut(usize, &mut [f32]),
) {
    workspace.pack(head);
    let products = workspace.products;
    let Workspace { rows, width: d, vocabulary: v, piece, stretch, across, stats, logits, normal: scratch, .. } =
        workspace;
    let (n, d, v, piece) = (x.len() / *d, *d, *v, *piece);
    assert!(n <= *rows && x.len() == n * d, "a head of {n} rows of {d}, room for {rows}");
    for first in (0..n).step_by(*stretch) {
        let rows = (*stretch).min(n - first);
        let parts = (
            x[first * d..][..rows * d].par_chunks(piece * d),
            stats[2 * first..][..2 * rows].par_chunks_mut(2 * piece),
            logits[..rows * v].par_chunks_mut(piece * v),
        );
        parts.into_par_iter().for_each(|(x, stats, logits)| {
            scratch.with(|scratch| {
                let normal = &mut scratch[..x.len()];
                layer_norm::forward(normal, stats, x, norm.weight, norm.bias);
                products.times(logits, normal, d, across, v);
            });
        });
        take(first, &mut logits[..rows * v]);
    }
}
