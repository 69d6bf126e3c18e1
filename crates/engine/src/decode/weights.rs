//! The weights of a stack of blocks, packed for decoding.

use super::matrix::{Matrix, PIECE, WeightKind};
use crate::op::rope::Angles;

/// Weight and bias; a matrix (in, out) and a bias (out), or both of a layer norm (D).
pub type Pair<'a> = (&'a [f32], &'a [f32]);

/// The weights of a pre-norm transformer block.
#[derive(Debug, Clone, Copy)]
pub struct BlockParts<'a> {
    /// (D), (D).
    pub norm1: Pair<'a>,
    /// (D, 3 D), (3 D): queries, keys, values, each by heads.
    pub qkv: Pair<'a>,
    /// (D, D), (D).
    pub out: Pair<'a>,
    /// (D), (D).
    pub norm2: Pair<'a>,
    /// (D, 4 D), (4 D).
    pub up: Pair<'a>,
    /// (4 D, D), (D).
    pub down: Pair<'a>,
}

/// The size of a stack of blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stack {
    /// L.
    pub layers: usize,
    /// H, divides the width.
    pub heads: usize,
    /// D.
    pub width: usize,
}

impl Stack {
    /// Multiply-adds of a row with the weights, about.
    pub fn multiply_adds(&self) -> usize {
        self.layers * 12 * self.width * self.width
    }
}

/// The blocks of a stack, packed.
pub struct StackWeights {
    stack: Stack,
    pub(super) blocks: Vec<Block>,
    pub(super) angles: Option<Angles>,
}

pub(super) struct Block {
    pub norm1: Norm,
    /// (D, 3 d) per head: query, key, value.
    pub heads: Vec<Matrix>,
    pub out: Matrix,
    pub norm2: Norm,
    pub up: Matrix,
    pub down: Matrix,
}

/// A layer norm.
pub struct Norm {
    pub(super) weight: Vec<f32>,
    pub(super) bias: Vec<f32>,
}

impl StackWeights {
    /// Packs blocks; matrices as `kind`, the rest in f32. With `angles`, queries and keys get rotary positions.
    ///
    /// # Panics
    /// If there aren't as many blocks as the stack has, or they have other shapes; if the heads don't divide the width.
    pub fn new(parts: &[BlockParts], stack: Stack, kind: WeightKind, angles: Option<Angles>) -> StackWeights {
        let Stack { layers, heads, width } = stack;
        assert!(heads > 0 && width.is_multiple_of(heads), "{heads} heads of a width of {width}");
        assert_eq!(parts.len(), layers, "blocks");
        StackWeights { stack, blocks: parts.iter().map(|parts| Block::new(parts, stack, kind)).collect(), angles }
    }

    /// The size of the stack.
    pub fn stack(&self) -> Stack {
        self.stack
    }

    /// Multiply-adds of a row, in the time that those of f32 take, about.
    pub fn work(&self) -> usize {
        self.stack.multiply_adds() / self.blocks.first().map_or(1, |block| block.up.word())
    }

    /// Bytes that are read for a row.
    pub fn bytes(&self) -> usize {
        self.blocks.iter().map(Block::bytes).sum()
    }
}

impl Block {
    fn bytes(&self) -> usize {
        let heads: usize = self.heads.iter().map(Matrix::bytes).sum();
        heads + self.out.bytes() + self.up.bytes() + self.down.bytes() + 16 * self.norm1.weight.len()
    }

    fn new(parts: &BlockParts, stack: Stack, kind: WeightKind) -> Block {
        let (width, d) = (stack.width, stack.width / stack.heads);
        let (weight, bias) = parts.qkv;
        check("qkv", weight, width * 3 * width);
        check("qkv", bias, 3 * width);
        let head = |h: usize| {
            // column j of the head's (D, 3 d) belongs to its query, key or value
            // a head at a time is packed whole, since a thread computes its query, key and value and then attends
            let column = |j: usize| j / d * width + h * d + j % d;
            let at = |i: usize, j: usize| weight[i * 3 * width + column(j)];
            Matrix::packed(kind, width, 3 * d, 3 * d, |j| bias[column(j)], at)
        };
        Block {
            norm1: Norm::new(parts.norm1, width),
            heads: (0..stack.heads).map(head).collect(),
            out: Matrix::linear(parts.out, width, width, kind),
            norm2: Norm::new(parts.norm2, width),
            up: Matrix::linear(parts.up, width, 4 * width, kind),
            down: Matrix::linear(parts.down, 4 * width, width, kind),
        }
    }
}

impl Norm {
    /// A layer norm over `width` numbers.
    ///
    /// # Panics
    /// If weight or bias has another length.
    pub fn new((weight, bias): Pair, width: usize) -> Norm {
        check("norm", weight, width);
        check("norm", bias, width);
        Norm { weight: weight.to_vec(), bias: bias.to_vec() }
    }
}

impl Matrix {
    /// A linear layer: weight (k, n) and bias (n).
    ///
    /// # Panics
    /// If weight or bias has another length.
    pub fn linear((weight, bias): Pair, k: usize, n: usize, kind: WeightKind) -> Matrix {
        check("a linear layer", weight, k * n);
        check("a linear layer's bias", bias, n);
        Matrix::packed(kind, k, n, PIECE, |j| bias[j], |i, j| weight[i * n + j])
    }

    /// The transpose of a `table` (n, k) without bias: a head whose rows are token embeddings.
    ///
    /// # Panics
    /// If the table has another length.
    pub fn transposed(table: &[f32], n: usize, k: usize, kind: WeightKind) -> Matrix {
        check("a table", table, n * k);
        Matrix::packed(kind, k, n, PIECE, |_| 0.0, |i, j| table[j * k + i])
    }
}

fn check(what: &str, numbers: &[f32], expected: usize) {
    assert_eq!(numbers.len(), expected, "numbers of {what}");
}
