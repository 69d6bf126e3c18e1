//! A pre-norm transformer block: `middle = x + attention(norm1(x))`, `out = middle + mlp(norm2(middle))`.
//!
//! Forward and backward are explicit and share a [`Workspace`]; the backward pass reads [`Saved`]: ten numbers of width D per
//! token, and the log-sums of the softmax. Normalised rows, GELU and attention weights are computed a second time, which
//! costs less than reading them back.
//!
//! Dropout and masks are the caller's keys and numbers: a pass has no random state. All sequences of a batch have T
//! tokens.
//!
//! Letters: B batch, T tokens, N = B T rows, D width, H heads, M width of the hidden layer, R rows of a piece.
//!
//! ```
//! use kinelm_engine::arena::Floats;
//! use kinelm_engine::block::{self, Linear, Norm, Rules, Saved, Shape, Tensors, Workspace};
//! use kinelm_engine::linear::Products;
//! use kinelm_engine::op::attention::Mask;
//! use kinelm_engine::op::matmul::Store;
//!
//! let shape = Shape { batch: 1, tokens: 3, width: 4, heads: 2, hidden: 16 };
//! let norm = |weight| Norm { weight: Floats::of(&[weight; 4]), bias: Floats::new(4) };
//! let linear = |k: usize, n: usize, weight| Linear { weight: Floats::of(&vec![weight; k * n]), bias: Floats::new(n) };
//! let tensors = |norm_weight, weight| Tensors {
//!     norm1: norm(norm_weight), qkv: linear(4, 12, weight), out: linear(4, 4, weight),
//!     norm2: norm(norm_weight), up: linear(4, 16, weight), down: linear(16, 4, weight),
//! };
//! let (weights, mut gradients) = (tensors(1.0, 0.0), tensors(0.0, 0.0));
//! let rules = Rules { mask: Mask::Causal, dropout: None, rope: None };
//! let (mut saved, mut workspace) = (Saved::new(shape), Workspace::new(shape, Products::F32, true));
//!
//! // without weights a block adds nothing, and its gradient passes through
//! let x: Vec<f32> = (0..12).map(|i| i as f32).collect();
//! let mut out = vec![0.0; 12];
//! block::forward(&mut out, &x, &weights.each_ref(), rules, &mut saved, &mut workspace);
//! assert_eq!(out, x);
//!
//! let mut dx = vec![1.0; 12];
//! let mut to = gradients.each_mut();
//! block::backward(&mut dx, &x, &weights.each_ref(), &mut to, Store::Set, rules, &saved, &mut workspace);
//! assert_eq!(dx, [1.0; 12]);
//! assert_eq!(*gradients.down.bias, [3.0; 4]);
//! ```

mod backward;
mod forward;
#[cfg(test)]
mod tests;

pub use backward::backward;
pub use forward::forward;

use crate::arena::Floats;
use crate::linear::Products;
use crate::op::attention;
use crate::op::dropout::Mask;
use crate::op::rope::Rope;
use crate::per_thread::PerThread;
use crate::pieces;
use std::ops::{Deref, Range};

/// The shape of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// B: sequences.
    pub batch: usize,
    /// T: tokens of each.
    pub tokens: usize,
    /// D: numbers of a token.
    pub width: usize,
    /// H: heads; divides the width.
    pub heads: usize,
    /// M: numbers of the hidden layer.
    pub hidden: usize,
}

impl Shape {
    /// N: tokens of all sequences.
    pub fn rows(&self) -> usize {
        self.batch * self.tokens
    }

    fn attention(self) -> attention::Shape {
        let Shape { batch, tokens, width, heads, .. } = self;
        attention::Shape { batch, tokens, heads, width: width / heads }
    }

    /// Checks a pass against the shape of its workspace, by which work is shared out.
    fn check<T: Deref<Target = [f32]>>(self, streams: [&[f32]; 2], tensors: &Tensors<T>, saved: &Saved) {
        let Shape { width: d, hidden: m, .. } = self;
        assert_eq!(saved.shape, self, "what another shape has saved");
        assert_eq!(streams.map(<[f32]>::len), [self.rows() * d; 2], "rows of {self:?}");
        let Tensors { norm1, qkv, out, norm2, up, down } = tensors;
        let norms = [norm1, norm2].map(|n| (n.weight.len(), n.bias.len()));
        let linears = [qkv, out, up, down].map(|l| (l.weight.len(), l.bias.len()));
        assert_eq!(norms, [(d, d); 2], "norms of {self:?}");
        assert_eq!(linears, [(3 * d * d, 3 * d), (d * d, d), (d * m, m), (m * d, d)], "linear layers of {self:?}");
    }
}

/// A layer norm's weight and bias (D).
#[derive(Clone, Copy)]
pub struct Norm<T> {
    /// Factors.
    pub weight: T,
    /// Summands.
    pub bias: T,
}

/// A linear layer's weight (in, out) and bias (out).
#[derive(Clone, Copy)]
pub struct Linear<T> {
    /// Factors.
    pub weight: T,
    /// Summands.
    pub bias: T,
}

/// The tensors of a block: `&[f32]` for its weights, `&mut [f32]` for their gradients.
#[derive(Clone, Copy)]
pub struct Tensors<T> {
    /// Before the attention.
    pub norm1: Norm<T>,
    /// (D, 3D): queries, keys, values.
    pub qkv: Linear<T>,
    /// (D, D), after the attention.
    pub out: Linear<T>,
    /// Before the hidden layer.
    pub norm2: Norm<T>,
    /// (D, M).
    pub up: Linear<T>,
    /// (M, D).
    pub down: Linear<T>,
}

impl Tensors<Floats> {
    /// Its numbers, to read.
    pub fn each_ref(&self) -> Weights<'_> {
        fn norm(n: &Norm<Floats>) -> Norm<&[f32]> {
            Norm { weight: &n.weight, bias: &n.bias }
        }
        fn linear(l: &Linear<Floats>) -> Linear<&[f32]> {
            Linear { weight: &l.weight, bias: &l.bias }
        }
        let Tensors { norm1, qkv, out, norm2, up, down } = self;
        let (norm1, norm2) = (norm(norm1), norm(norm2));
        Tensors { norm1, qkv: linear(qkv), out: linear(out), norm2, up: linear(up), down: linear(down) }
    }

    /// Its numbers, to write.
    pub fn each_mut(&mut self) -> Gradients<'_> {
        fn norm(n: &mut Norm<Floats>) -> Norm<&mut [f32]> {
            Norm { weight: &mut n.weight, bias: &mut n.bias }
        }
        fn linear(l: &mut Linear<Floats>) -> Linear<&mut [f32]> {
            Linear { weight: &mut l.weight, bias: &mut l.bias }
        }
        let Tensors { norm1, qkv, out, norm2, up, down } = self;
        let (norm1, norm2) = (norm(norm1), norm(norm2));
        Tensors { norm1, qkv: linear(qkv), out: linear(out), norm2, up: linear(up), down: linear(down) }
    }
}

/// Weights of a block.
pub type Weights<'a> = Tensors<&'a [f32]>;
/// Gradients of a block.
pub type Gradients<'a> = Tensors<&'a mut [f32]>;

/// The dropout of a block in training: [`crate::op::dropout`].
#[derive(Debug, Clone, Copy)]
pub struct Dropout<'a> {
    /// Share of the numbers that is dropped, in `0.0..1.0`.
    pub share: f64,
    /// (B): a key per sequence for the attention weights; row = head * T + query, column = key.
    pub attention: &'a [u64],
    /// (B): a key per sequence for the attention's output; row = token, column = feature.
    pub out: &'a [u64],
    /// (B): a key per sequence for the hidden layer's output.
    pub mlp: &'a [u64],
}

/// Mask, dropout and rotary positions of a pass.
#[derive(Clone, Copy)]
pub struct Rules<'a> {
    /// The tokens that a token attends to.
    pub mask: attention::Mask<'a>,
    /// Dropout, in training.
    pub dropout: Option<Dropout<'a>>,
    /// Rotary positions of queries and keys.
    pub rope: Option<Rope<'a>>,
}

impl<'a> Rules<'a> {
    fn attention(&self) -> attention::Rules<'a> {
        let dropout = self.dropout.map(|p| attention::Dropout { share: p.share, keys: p.attention });
        attention::Rules { mask: self.mask, dropout }
    }
}

/// Calls `work` with the range of numbers (of rows of width D) and the dropout mask of each sequence that rows
/// `first..first + rows` touch; once, with an empty mask, without dropout.
pub fn dropped(
    shape: Shape,
    first: usize,
    rows: usize,
    dropout: Option<(f64, &[u64])>,
    work: &mut dyn FnMut(Range<usize>, Mask),
) {
    let Some((share, keys)) = dropout else { return work(0..rows * shape.width, Mask::NONE) };
    let mut row = first;
    while row < first + rows {
        // pieces know nothing of sequences, but each sequence has its own key and counts its rows from 0
        let (sequence, token) = (row / shape.tokens, row % shape.tokens);
        let end = (row + shape.tokens - token).min(first + rows);
        let numbers = (row - first) * shape.width..(end - first) * shape.width;
        work(numbers, Mask { key: keys[sequence], first_row: token as u64, share });
        row = end;
    }
}

/// Activations that the backward pass needs.
pub struct Saved {
    shape: Shape,
    stats1: Floats, // (N, 2)
    qkv: Floats,    // (N, 3D)
    heads: Floats,  // (B, H, T, D/H)
    lse: Floats,    // (B, H, T)
    middle: Floats, // (N, D)
    stats2: Floats, // (N, 2)
    up: Floats,     // (N, M), before the GELU
}

impl Saved {
    /// Room for a batch of `shape`.
    pub fn new(shape: Shape) -> Saved {
        let (n, d) = (shape.rows(), shape.width);
        Saved {
            shape,
            stats1: Floats::new(2 * n),
            qkv: Floats::new(3 * n * d),
            heads: Floats::new(n * d),
            lse: Floats::new(n * shape.heads),
            middle: Floats::new(n * d),
            stats2: Floats::new(2 * n),
            up: Floats::new(n * shape.hidden),
        }
    }
}

/// Memory that blocks of one shape share.
pub struct Workspace {
    shape: Shape,
    products: Products,
    piece: usize,
    panels: PanelSet,
    scratch: PerThread<Floats>,
    attention: attention::Workspace,
    back: Option<Back>,
}

/// The four weights of a block in panels.
struct PanelSet {
    qkv: Floats,
    out: Floats,
    up: Floats,
    down: Floats,
}

/// Memory for the backward pass.
struct Back {
    // right factors of the weights' gradients, a block of panels a piece
    d_down: Floats,
    d_up: Floats,
    d_out: Floats,
    d_qkv: Floats,
    // left factors of the weights' gradients
    gelu: Floats,       // (N, M)
    normal: Floats,     // (N, D)
    gathered: Floats,   // (N, D)
    d_heads: Floats,    // (N, D): gradient of the gathered heads
    dqkv_heads: Floats, // (B, H, 3, T, D/H)
    partial: Floats,    // a row a piece: sums over its rows of biases and norms
}

impl Workspace {
    /// Memory for batches of `shape`; `backward`: for training too.
    pub fn new(shape: Shape, products: Products, backward: bool) -> Workspace {
        let Shape { width: d, hidden: m, .. } = shape;
        let piece = pieces::rows(shape.rows());
        let len = |k, n| products.panels_len(k, n);
        // the backward pass packs the transposed weights into the same memory, where padding may take more
        let both = |k, n| Floats::new(len(k, n).max(if backward { len(n, k) } else { 0 }));
        let panels = PanelSet { qkv: both(d, 3 * d), out: both(d, d), up: both(d, m), down: both(m, d) };
        Workspace {
            shape,
            products,
            piece,
            panels,
            scratch: PerThread::new(|| Floats::new(piece * (2 * d + m.max(3 * d)))),
            attention: attention::Workspace::new(shape.attention(), products),
            back: backward.then(|| Back::new(shape, products, piece)),
        }
    }
}

impl Back {
    fn new(shape: Shape, products: Products, piece: usize) -> Back {
        let (n, d, m) = (shape.rows(), shape.width, shape.hidden);
        let pieces = n.div_ceil(piece);
        let blocks = |width: usize| Floats::new(pieces * products.panels_len(piece, width));
        Back {
            d_down: blocks(d),
            d_up: blocks(m),
            d_out: blocks(d),
            d_qkv: blocks(3 * d),
            gelu: Floats::new(n * m),
            normal: Floats::new(n * d),
            gathered: Floats::new(n * d),
            d_heads: Floats::new(n * d),
            dqkv_heads: Floats::new(3 * n * d),
            // the sums after the attention (M + 4 D) and those before it (5 D) are never needed at once
            partial: Floats::new(pieces * (m + 4 * d).max(5 * d)),
        }
    }
}
