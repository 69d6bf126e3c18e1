//! The weights of a model of two stacks, packed for decoding.

use super::rows::Rows;
use crate::arena::Floats;
use crate::bins::Bins;
use crate::decode::head::Head;
use crate::decode::matrix::{Matrix, PIECE, WeightKind};
use crate::decode::weights::{Block, Norm, check};
use crate::decode::{Before, BlockParts, Pair, Relative, Stack};

/// The sizes of a model of two stacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameSizes {
    /// Over frames; its width is D.
    pub trunk: Stack,
    /// Over the tokens of a frame; its width is d.
    pub speller: Stack,
    /// e: numbers by which the trunk is told a character.
    pub character: usize,
    /// V.
    pub vocabulary: usize,
    /// F: the most frames of a sequence.
    pub frames: usize,
    /// K: tokens in front of the first frame, 1 or more.
    pub front: usize,
}

/// The weights of a model of two stacks. C characters and an end make a frame, W = C + 1; S is the largest count of
/// bins of a place, Sc that of the circular places and Sl that of the others, 0 if there are none.
///
/// A step between two bins of a place is a row of a table: that from b to a is (a - b) mod count where the place is
/// circular and Sc + a - b + Sl - 1 where it isn't. R = Sc + max(2 Sl - 1, 0) is the row where there is none.
#[derive(Debug, Clone)]
pub struct FrameParts<'a> {
    /// How large the model is.
    pub sizes: FrameSizes,
    /// (C) what stands at the places of a frame up to its end.
    pub places: &'a [Bins],
    /// (C (S + 1), e): S + 1 rows a place, a row a bin; the last where what stands there is no bin, or nothing does.
    pub bins: &'a [f32],
    /// (2 C e, D), (D): from the C characters one frame back, then those two frames back.
    pub frames: Pair<'a>,
    /// (F, D): a row a frame.
    pub positions: &'a [f32],
    /// (V, D) and (V, d), where K > 1: the rows of the tokens of the front but its first are added to every frame, and to every
    /// row of the speller.
    pub labels: [&'a [f32]; 2],
    /// Blocks of the trunk.
    pub trunk: Vec<BlockParts<'a>>,
    /// (D), (D): the trunk's last norm.
    pub trunk_norm: Pair<'a>,
    /// (D, d), (d): from the trunk to the speller.
    pub join: Pair<'a>,
    /// (R + 1 + S, d): row R where a frame begins and behind a token that is no bin; behind a bin, the step to it from
    /// the token one frame back, or R + 1 + bin where that is missing or no bin.
    pub last: &'a [f32],
    /// (W, d): a row a place.
    pub place: &'a [f32],
    /// (S + 1, d): the bin one frame back at the place that follows; row S if there is none, and for ends of frames.
    pub back: &'a [f32],
    /// (R + 1, d): its step from the bin two frames back; row R if there is none, and for ends of frames.
    pub step: &'a [f32],
    /// Blocks of the speller.
    pub speller: Vec<BlockParts<'a>>,
    /// (d), (d).
    pub norm: Pair<'a>,
    /// (V, d), a row a token.
    pub head: &'a [f32],
    /// (Sc, d) and (2 Sl - 1, d): logits over differences to the token one frame back.
    pub relative: Relative<'a>,
    /// What frames may be told beside what was read, if they may.
    pub conditioning: Option<ConditioningParts<'a>>,
}

/// What becomes of the P numbers and the rows of [`super::Told`].
#[derive(Debug, Clone, Copy)]
pub struct ConditioningParts<'a> {
    /// (P, D): from a frame's numbers to its row of the trunk.
    pub trunk: &'a [f32],
    /// (P, d): from its numbers to each of its rows of the speller.
    pub speller: &'a [f32],
    /// (R, d) each: rows of steps that are added to rows of the speller; empty where no row is.
    pub rows: [&'a [f32]; 2],
}

/// The same, kept.
pub(super) struct ConditioningWeights {
    /// P.
    pub numbers: usize,
    pub trunk: Floats,
    pub speller: Floats,
    pub rows: [Floats; 2],
}

impl ConditioningWeights {
    /// # Panics
    /// Slices that don't have the shape they should.
    fn new(parts: &ConditioningParts, sizes: FrameSizes, steps: usize) -> ConditioningWeights {
        let (wide, d) = (sizes.trunk.width, sizes.speller.width);
        let numbers = parts.trunk.len() / wide;
        check("told to the trunk", parts.trunk, numbers * wide);
        check("told to the speller", parts.speller, numbers * d);
        let of_steps = |rows: &&[f32]| if rows.is_empty() { 0 } else { steps * d };
        parts.rows.iter().for_each(|rows| check("told rows", rows, of_steps(rows)));
        ConditioningWeights {
            numbers,
            trunk: Floats::of(parts.trunk),
            speller: Floats::of(parts.speller),
            rows: parts.rows.map(Floats::of),
        }
    }
}

/// The weights of a model of two stacks, packed.
pub struct FrameWeights {
    pub(super) sizes: FrameSizes,
    kind: WeightKind,
    pub(super) rows: Rows,
    pub(super) frames: Matrix,
    pub(super) positions: Floats,
    pub(super) labels: [Floats; 2],
    pub(super) trunk: Vec<Block>,
    pub(super) trunk_norm: Norm,
    pub(super) join: Matrix,
    pub(super) speller: Vec<Block>,
    pub(super) norm: Norm,
    pub(super) head: Head,
    pub(super) conditioning: Option<ConditioningWeights>,
}

impl FrameParts<'_> {
    /// The words that the frames are, for the parts that a model of one stack has too.
    fn before(&self) -> Before<'_> {
        Before { front: 1, places: self.places, previous: None, relative: Some(self.relative) }
    }
}

impl FrameWeights {
    /// Packs the weights of a model; all matrices as `kind`, the rest in f32.
    ///
    /// # Panics
    /// Slices that don't have the shape they should; no places, or a place of no bins or of ids outside the vocabulary.
    pub fn new(parts: &FrameParts, kind: WeightKind) -> FrameWeights {
        let FrameSizes { trunk, speller, frames, vocabulary, front, .. } = parts.sizes;
        let words = parts.before().words(vocabulary);
        let rows = Rows::new(parts, words.clone());
        let linear = |name: &str, (weight, bias): Pair, (k, n): (usize, usize)| {
            check(name, weight, k * n);
            check(name, bias, n);
            Matrix::new(kind, (k, n), PIECE, |j| bias[j], |i, j| weight[i * n + j])
        };
        assert!(front > 0, "no token in front of the first frame");
        check("positions", parts.positions, frames * trunk.width);
        for (labels, width) in parts.labels.iter().zip([trunk.width, speller.width]) {
            check("labels", labels, if front > 1 { vocabulary * width } else { 0 });
        }
        FrameWeights {
            sizes: parts.sizes,
            kind,
            frames: linear("frames", parts.frames, (rows.frame_width(), trunk.width)),
            conditioning: parts
                .conditioning
                .map(|conditioning| ConditioningWeights::new(&conditioning, parts.sizes, rows.steps())),
            rows,
            positions: Floats::of(parts.positions),
            labels: parts.labels.map(Floats::of),
            trunk: Block::all(&parts.trunk, trunk, kind),
            trunk_norm: Norm::new(parts.trunk_norm, trunk.width),
            join: linear("join", parts.join, (trunk.width, speller.width)),
            speller: Block::all(&parts.speller, speller, kind),
            norm: Norm::new(parts.norm, speller.width),
            head: Head::new(kind, (vocabulary, speller.width), parts.head, Some((words, parts.relative))),
        }
    }

    /// How large the model is.
    pub fn sizes(&self) -> FrameSizes {
        self.sizes
    }

    /// How the matrices are held.
    pub fn kind(&self) -> WeightKind {
        self.kind
    }

    /// T = K - 1 + F W: the most tokens of a sequence.
    pub fn context(&self) -> usize {
        self.ahead() + self.sizes.frames * self.rows.word()
    }

    /// K - 1: tokens before the one that the first frame begins behind.
    pub(super) fn ahead(&self) -> usize {
        self.sizes.front - 1
    }

    /// Adds the rows of a table of labels (V, n) to `x` (n).
    pub(super) fn add_labels(x: &mut [f32], table: &[f32], labels: &[u32]) {
        let n = x.len();
        for &label in labels {
            x.iter_mut().zip(&table[label as usize * n..]).for_each(|(x, y)| *x += y);
        }
    }

    /// P: how many numbers a frame may be told beside what was read; 0 where it may be told none.
    pub fn told_numbers(&self) -> usize {
        self.conditioning.as_ref().map_or(0, |conditioning| conditioning.numbers)
    }

    /// Multiply-adds of a token with the weights, about, the mean over the places of a frame.
    pub fn multiply_adds(&self) -> usize {
        self.work(0, 1) + self.work(1, 0) / self.rows.word()
    }

    /// Multiply-adds of so many rows of the trunk and of the speller, about.
    pub(super) fn work(&self, frames: usize, tokens: usize) -> usize {
        let FrameSizes { trunk, speller, vocabulary, .. } = self.sizes;
        let frame = trunk.multiply_adds() + (self.rows.frame_width() + speller.width) * trunk.width;
        frames * frame + tokens * (speller.multiply_adds() + vocabulary * speller.width)
    }

    /// Bytes of weights that are read for a token, the mean over the places of a frame.
    pub fn bytes(&self) -> usize {
        let blocks = |blocks: &[Block]| blocks.iter().map(Block::bytes).sum::<usize>();
        let frame = blocks(&self.trunk) + self.frames.bytes() + self.join.bytes();
        blocks(&self.speller) + self.head.bytes() + frame / self.rows.word()
    }
}
