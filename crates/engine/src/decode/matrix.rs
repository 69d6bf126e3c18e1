//! Weights as they are streamed: packed once, in f32 or in bytes.

use super::kernel::{self, Left};
use crate::arena::Floats;
use crate::dispatch;
use crate::element::Element;
use crate::op::matmul::panel;

/// How weights are held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum WeightKind {
    /// As they are.
    #[default]
    F32,
    /// As signed bytes with a scale a column: a quarter of the memory to read for every token.
    Int8,
}

/// Columns of a piece, a whole number of panels: what one thread computes at a time.
pub(super) const PIECE: usize = 64;

/// A (k, n) matrix with its bias, packed for streaming.
pub struct Matrix {
    kind: WeightKind,
    /// Panels, [n / panel][k][panel], of f32 or of bytes.
    numbers: Floats,
    k: usize,
    /// n, whole panels.
    columns: usize,
    /// Columns of a piece.
    piece: usize,
    /// (columns), or nothing.
    scale: Vec<f32>,
    /// (columns), or nothing.
    bias: Vec<f32>,
}

impl Matrix {
    /// Packs the numbers `at(row, column)` in pieces of `piece` columns.
    pub(super) fn packed(
        kind: WeightKind,
        (k, n): (usize, usize),
        piece: usize,
        bias: impl Fn(usize) -> f32,
        at: impl Fn(usize, usize) -> f32,
    ) -> Matrix {
        let panel = panel();
        let columns = n.next_multiple_of(panel);
        let whole = |f: &dyn Fn(usize) -> f32| (0..columns).map(|j| if j < n { f(j) } else { 0.0 }).collect();
        let bytes = columns * k * if kind == WeightKind::Int8 { 1 } else { 4 };
        let mut matrix = Matrix {
            kind,
            numbers: Floats::new(bytes.div_ceil(4)),
            k,
            columns,
            piece: piece.next_multiple_of(panel),
            scale: Vec::new(),
            bias: whole(&bias),
        };
        let place = |i: usize, j: usize| (j / panel * k + i) * panel + j % panel;
        match kind {
            WeightKind::F32 => (0..n).for_each(|j| (0..k).for_each(|i| matrix.numbers[place(i, j)] = at(i, j))),
            WeightKind::Int8 => {
                let scale = |j: usize| (0..k).map(|i| at(i, j).abs()).fold(0.0, f32::max) / 127.0;
                matrix.scale = whole(&scale);
                let bytes: &mut [i8] = bytemuck::cast_slice_mut(&mut matrix.numbers);
                for j in (0..n).filter(|&j| matrix.scale[j] > 0.0) {
                    let scale = matrix.scale[j];
                    (0..k).for_each(|i| bytes[place(i, j)] = (at(i, j) / scale).round() as i8);
                }
            }
        }
        matrix
    }

    /// Pieces of the product.
    pub(super) fn pieces(&self) -> usize {
        self.columns.div_ceil(self.piece)
    }

    /// Columns of the product, whole panels.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Columns of a piece of the product, whole panels.
    pub(super) fn piece(&self) -> usize {
        self.piece
    }

    /// Multiply-adds of a row with one piece.
    pub(super) fn work(&self) -> usize {
        self.k * self.piece
    }

    /// Bytes that are read for a product.
    pub fn bytes(&self) -> usize {
        self.numbers.len() * 4 + (self.scale.len() + self.bias.len()) * 4
    }

    /// Writes a piece of the product of `left` (m, k), bias added, to `c` (m, piece).
    pub(super) fn product(&self, c: &mut [f32], piece: usize, left: Left) {
        match self.kind {
            WeightKind::F32 => self.typed::<f32>(c, piece, left, &self.numbers),
            WeightKind::Int8 => self.typed::<i8>(c, piece, left, bytemuck::cast_slice(&self.numbers)),
        }
    }

    fn typed<E: Element>(&self, c: &mut [f32], piece: usize, left: Left, numbers: &[E]) {
        let (k, first, panel) = (self.k, piece * self.piece, panel());
        let columns = self.piece.min(self.columns - first);
        dispatch::run(kernel::Product {
            c,
            ldc: self.piece,
            left,
            k,
            panels: &numbers[first * k..][..columns * k],
            panel_stride: panel * k,
            count: columns / panel,
            scale: self.scale.get(first..first + columns).unwrap_or_default(),
            bias: &self.bias[first..][..columns],
        });
    }
}

/// Columns of the product of some rows with a [`Matrix`].
pub struct Product<'a> {
    pub(super) pieces: &'a [f32],
    pub(super) rows: usize,
    /// The first piece that was computed.
    pub(super) first: usize,
}

impl Product<'_> {
    /// Copies numbers of a row from `column` on.
    ///
    /// # Panics
    /// If no columns were requested.
    pub fn copy(&self, row: usize, mut column: usize, mut to: &mut [f32]) {
        while !to.is_empty() {
            let within = column % PIECE;
            let n = to.len().min(PIECE - within);
            let piece = &self.pieces[(column / PIECE - self.first) * self.rows * PIECE..];
            to[..n].copy_from_slice(&piece[row * PIECE + within..][..n]);
            (to, column) = (&mut to[n..], column + n);
        }
    }
}
