//! Weights as they are streamed: packed once, in f32 or in bytes.

use super::bytes::{self, Rows, Way};
use super::kernel::{self, Left};
use crate::arena::Floats;
use crate::dispatch;
use crate::op::matmul::panel;

/// The format of weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum WeightKind {
    /// As they are.
    #[default]
    F32,
    /// As signed bytes with a scale a column: a quarter of the memory to read for every token. Rows are rounded to bytes
    /// too, with a scale a row.
    Int8,
}

/// Columns of a piece, a whole number of panels; one thread computes a piece at a time.
pub(super) const PIECE: usize = 64;

/// A (k, n) matrix with its bias, packed for streaming.
pub struct Matrix {
    /// How its bytes are multiplied; `None`: it is in f32.
    way: Option<Way>,
    /// Panels, [n / panel][k][panel], of f32 or of bytes, which have the numbers of a word of k side by side.
    numbers: Floats,
    k: usize,
    /// n, whole panels.
    columns: usize,
    /// Columns of a piece.
    piece: usize,
    /// (columns), or nothing.
    scale: Vec<f32>,
    /// (columns), or nothing: [`Way::excess`].
    excess: Vec<i32>,
    /// (columns), or nothing.
    bias: Vec<f32>,
}

impl Matrix {
    /// Packs the numbers `at(row, column)` in pieces of `piece` columns.
    pub(super) fn packed(
        kind: WeightKind,
        k: usize,
        n: usize,
        piece: usize,
        bias: impl Fn(usize) -> f32,
        at: impl Fn(usize, usize) -> f32,
    ) -> Matrix {
        let panel = panel();
        let columns = n.next_multiple_of(panel);
        let whole = |f: &dyn Fn(usize) -> f32| (0..columns).map(|j| if j < n { f(j) } else { 0.0 }).collect();
        let way = (kind == WeightKind::Int8).then(Way::here);
        let word = way.map_or(1, Way::word);
        // k in whole words; the zeros of Floats fill the last one
        let high = k.next_multiple_of(word);
        let bytes = columns * high * if way.is_some() { 1 } else { size_of::<f32>() };
        let mut matrix = Matrix {
            way,
            numbers: Floats::new(bytes.div_ceil(size_of::<f32>())),
            k,
            columns,
            piece: piece.next_multiple_of(panel),
            scale: Vec::new(),
            excess: vec![0; if way.is_some() { columns } else { 0 }],
            bias: whole(&bias),
        };
        let place = |i: usize, j: usize| ((j / panel * (high / word) + i / word) * panel + j % panel) * word + i % word;
        let Some(way) = way else {
            (0..n).for_each(|j| (0..k).for_each(|i| matrix.numbers[place(i, j)] = at(i, j)));
            return matrix;
        };
        let scale = |j: usize| (0..k).map(|i| at(i, j).abs()).fold(0.0, f32::max) / 127.0;
        matrix.scale = whole(&scale);
        let bytes: &mut [i8] = bytemuck::cast_slice_mut(&mut matrix.numbers);
        // a column of zeros has scale 0 and stays zeros; 0 / 0 would be NaN
        for j in (0..n).filter(|&j| matrix.scale[j] > 0.0) {
            let scale = matrix.scale[j];
            (0..k).for_each(|i| bytes[place(i, j)] = (at(i, j) / scale).round() as i8);
            matrix.excess[j] = way.excess((0..k).map(|i| bytes[place(i, j)]));
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

    /// Multiply-adds of a row with one piece, in the time that those of f32 take.
    pub(super) fn work(&self) -> usize {
        self.k * self.piece / self.word()
    }

    /// How its left operands must be rounded to bytes, if they must.
    pub(super) fn way(&self) -> Option<Way> {
        self.way
    }

    /// Multiply-adds in the time of one of f32, about: numbers that are multiplied at a time.
    pub(super) fn word(&self) -> usize {
        self.way.map_or(1, Way::word)
    }

    /// k.
    pub(super) fn rows(&self) -> usize {
        self.k
    }

    /// Bytes that are read for a product.
    pub fn bytes(&self) -> usize {
        self.numbers.len() * 4 + (self.scale.len() + self.bias.len()) * 4
    }

    /// Writes a piece of the product of `left` (m, k), bias added, to `c` (m, piece). `rounded`: the rows of `left` as bytes,
    /// where the matrix meets bytes.
    pub(super) fn product(&self, c: &mut [f32], piece: usize, left: Left, rounded: &Rows) {
        let (panel, first) = (panel(), piece * self.piece);
        let columns = first..self.columns.min(first + self.piece);
        if let Some(way) = self.way {
            let panels: &[i8] = bytemuck::cast_slice(&self.numbers);
            let product = bytes::Product {
                c,
                ldc: self.piece,
                rows: rounded,
                m: left.rows,
                k: self.k,
                panels: &panels[first * way.words(self.k) * way.word()..],
                panel,
                scale: &self.scale[columns.clone()],
                excess: &self.excess[columns.clone()],
                bias: &self.bias[columns],
            };
            return product.run(way);
        }
        dispatch::run(kernel::Product {
            c,
            ldc: self.piece,
            left,
            k: self.k,
            panels: &self.numbers[first * self.k..][..columns.len() * self.k],
            panel_stride: panel * self.k,
            count: columns.len() / panel,
            scale: &[],
            bias: &self.bias[columns],
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
