//! The weights of a model, packed for decoding.

use super::before::{Before, Inputs};
use super::head::Head;
use super::layers::Stack;
use super::matrix::{Matrix, PIECE, WeightKind};
use super::position::{Positions, Tables};
use super::rope::{Rope, Turns};
use crate::arena::Floats;
use crate::words::Words;

/// The sizes of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sizes {
    /// L.
    pub layers: usize,
    /// H, divides the width.
    pub heads: usize,
    /// D.
    pub width: usize,
    /// V.
    pub vocabulary: usize,
    /// T, the most tokens of a sequence.
    pub context: usize,
}

/// Weight and bias; a matrix (in, out) and a bias (out), or a norm's (D) both.
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

/// The weights of a model.
#[derive(Debug, Clone)]
pub struct Parts<'a> {
    /// How large the model is.
    pub sizes: Sizes,
    /// (V, D), a row a token.
    pub token: &'a [f32],
    /// What is added to a token for where it stands.
    pub positions: Positions<'a>,
    /// How queries and keys are turned for where they stand, if they are.
    pub rope: Option<Rope>,
    /// What the model makes of the word before, where words have one length.
    pub before: Option<Before<'a>>,
    /// L blocks.
    pub blocks: Vec<BlockParts<'a>>,
    /// (D), (D).
    pub norm: Pair<'a>,
    /// (V, D), a row a token.
    pub head: &'a [f32],
}

/// The weights of a model, packed.
pub struct DecoderWeights {
    pub(super) sizes: Sizes,
    pub(super) kind: WeightKind,
    pub(super) token: Floats,
    pub(super) positions: Tables,
    pub(super) turns: Option<Turns>,
    pub(super) words: Option<Words>,
    pub(super) inputs: Option<Inputs>,
    pub(super) blocks: Vec<Block>,
    pub(super) norm: Norm,
    pub(super) head: Head,
}

pub(super) struct Block {
    pub norm1: Norm,
    /// (D, 3 d) a head: query, key, value.
    pub heads: Vec<Matrix>,
    pub out: Matrix,
    pub norm2: Norm,
    pub up: Matrix,
    pub down: Matrix,
}

pub(super) struct Norm {
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
}

impl Sizes {
    /// Those of the blocks.
    pub(super) fn stack(&self) -> Stack {
        Stack { layers: self.layers, heads: self.heads, width: self.width }
    }
}

impl DecoderWeights {
    /// Packs the weights of a model; all matrices as `kind`, the rest in f32.
    ///
    /// # Panics
    /// Slices that don't have the shape they should; heads of an odd width that are to be turned; a [`Rope`] or [`Before`] of
    /// no words.
    pub fn new(parts: &Parts, kind: WeightKind) -> DecoderWeights {
        let Sizes { width, vocabulary, context, heads, .. } = parts.sizes;
        let blocks = Block::all(&parts.blocks, parts.sizes.stack(), kind);
        check("token", parts.token, vocabulary * width);
        let positions = Tables::new(&parts.positions, context, width);
        let words = parts.before.map(|before| before.words(vocabulary));
        let inputs = parts.before.and_then(|b| Some(Inputs::new(&b.previous?, b.places, vocabulary, width)));
        let relative = parts.before.and_then(|before| before.relative);
        let head = Head::new(kind, (vocabulary, width), parts.head, words.clone().zip(relative));
        DecoderWeights {
            sizes: parts.sizes,
            kind,
            token: Floats::of(parts.token),
            turns: parts.rope.map(|rope| Turns::new(rope, &positions, context, width / heads)),
            positions,
            words,
            inputs,
            blocks,
            norm: Norm::new(parts.norm, width),
            head,
        }
    }

    /// How large the model is.
    pub fn sizes(&self) -> Sizes {
        self.sizes
    }

    /// How the matrices are held.
    pub fn kind(&self) -> WeightKind {
        self.kind
    }

    /// Multiply-adds of a token with the weights, about.
    pub fn multiply_adds(&self) -> usize {
        self.sizes.stack().multiply_adds() + self.sizes.vocabulary * self.sizes.width
    }

    /// Bytes of weights that are read for a token, the mean over the places of a word.
    pub fn bytes(&self) -> usize {
        self.blocks.iter().map(Block::bytes).sum::<usize>() + self.head.bytes()
    }
}

impl Block {
    /// # Panics
    /// Not as many blocks as the stack has, or of other shapes.
    pub fn all(parts: &[BlockParts], stack: Stack, kind: WeightKind) -> Vec<Block> {
        let Stack { layers, heads, width } = stack;
        assert!(heads > 0 && width.is_multiple_of(heads), "{heads} heads of a width of {width}");
        assert_eq!(parts.len(), layers, "blocks");
        parts.iter().map(|parts| Block::new(parts, stack, kind)).collect()
    }

    /// Bytes that are read for a row.
    pub fn bytes(&self) -> usize {
        let heads: usize = self.heads.iter().map(Matrix::bytes).sum();
        heads + self.out.bytes() + self.up.bytes() + self.down.bytes() + 16 * self.norm1.weight.len()
    }

    fn new(parts: &BlockParts, stack: Stack, kind: WeightKind) -> Block {
        let (width, d) = (stack.width, stack.width / stack.heads);
        let linear = |name: &str, (weight, bias): Pair, k: usize, n: usize| {
            check(name, weight, k * n);
            check(name, bias, n);
            Matrix::new(kind, (k, n), PIECE, |j| bias[j], |i, j| weight[i * n + j])
        };
        let (weight, bias) = parts.qkv;
        check("qkv", weight, width * 3 * width);
        check("qkv", bias, 3 * width);
        let head = |h: usize| {
            // column j of the head's (D, 3 d): query, key or value, and which of it
            let column = |j: usize| j / d * width + h * d + j % d;
            let at = |i: usize, j: usize| weight[i * 3 * width + column(j)];
            Matrix::new(kind, (width, 3 * d), 3 * d, |j| bias[column(j)], at)
        };
        Block {
            norm1: Norm::new(parts.norm1, width),
            heads: (0..stack.heads).map(head).collect(),
            out: linear("out", parts.out, width, width),
            norm2: Norm::new(parts.norm2, width),
            up: linear("up", parts.up, width, 4 * width),
            down: linear("down", parts.down, 4 * width, width),
        }
    }
}

impl Norm {
    pub fn new((weight, bias): Pair, width: usize) -> Norm {
        check("norm", weight, width);
        check("norm", bias, width);
        Norm { weight: weight.to_vec(), bias: bias.to_vec() }
    }
}

pub(super) fn check(what: &str, numbers: &[f32], expected: usize) {
    assert_eq!(numbers.len(), expected, "numbers of {what}");
}
