//! Products in f32 or bf16: a right factor in panels, and left factors for it.

use super::bf16::{self, Instructions};
use super::matmul::{self, Left, Panels, Store};
use std::cell::RefCell;

/// The number format of the products of layers and of attention. All else, and the sums of the products, are f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Products {
    /// The factors as they are.
    #[default]
    F32,
    /// Factors rounded to bf16, by the instructions that this processor has for it (`Instructions::here`).
    Bf16,
    /// Factors rounded to bf16 and multiplied as f32: the results of [`Products::Bf16`], up to the order of its sums,
    /// on any machine, and slower than [`Products::F32`].
    Rounded,
}

thread_local! {
    /// A left factor, rounded.
    static ROUNDED: RefCell<Vec<f32>> = const { RefCell::new(Vec::new()) };
}

/// Rows `first..` of a right factor that was packed in blocks of `block` rows; from elsewhere than 0, of one block.
#[derive(Debug, Clone, Copy)]
pub struct Right<'a> {
    /// From [`Products::pack`].
    pub panels: &'a [f32],
    /// Rows of a block.
    pub block: usize,
    /// In bf16 a multiple of 32.
    pub first: usize,
}

impl Products {
    /// bf16 as this machine does it best.
    pub fn bf16() -> Products {
        if Instructions::here().is_some() { Products::Bf16 } else { Products::Rounded }
    }

    /// Its name: `f32`, `amx`, `avx512bf16` or `emulated`.
    pub fn name(self) -> &'static str {
        match self {
            Products::F32 => "f32",
            Products::Bf16 if Instructions::here() == Some(Instructions::Tiles) => "amx",
            Products::Bf16 => "avx512bf16",
            Products::Rounded => "emulated",
        }
    }

    /// Numbers that a (k, n) right factor takes in panels.
    pub fn panels_len(self, k: usize, n: usize) -> usize {
        match self {
            Products::F32 | Products::Rounded => matmul::panels_len(k, n),
            Products::Bf16 => bf16::panels_len(k, n),
        }
    }

    /// Packs `b` (k, n), a row every `ldb` numbers, in panels.
    ///
    /// # Panics
    /// Slices that are too short, here and below.
    pub fn pack(self, panels: &mut [f32], b: &[f32], ldb: usize, k: usize, n: usize) {
        match self {
            Products::F32 => matmul::pack(panels, b, ldb, k, n),
            Products::Bf16 => bf16::pack(panels, b, ldb, k, n),
            Products::Rounded => {
                matmul::pack(panels, b, ldb, k, n);
                bf16::round_all(&mut panels[..matmul::panels_len(k, n)]);
            }
        }
    }

    /// As [`Products::pack`], from `bt`, the transposed (n, k), a row every `ldb` numbers.
    pub fn pack_transposed(self, panels: &mut [f32], bt: &[f32], ldb: usize, k: usize, n: usize) {
        match self {
            Products::F32 => matmul::pack_transposed(panels, bt, ldb, k, n),
            Products::Bf16 => bf16::pack_transposed(panels, bt, ldb, k, n),
            Products::Rounded => {
                matmul::pack_transposed(panels, bt, ldb, k, n);
                bf16::round_all(&mut panels[..matmul::panels_len(k, n)]);
            }
        }
    }

    /// `c` (m, n), a row every `ldc` numbers, becomes (or grows by) `a` (m, k) times k rows of `b`.
    pub fn product(self, c: &mut [f32], ldc: usize, (m, k, n): (usize, usize, usize), a: Left, b: Right, store: Store) {
        let Right { panels, block, first } = b;
        if self == Products::Bf16 {
            return bf16::product(c, ldc, (m, k, n), a, (&panels[bf16::row(first)..], block), store);
        }
        // right for every panel of a block: their steps keep the distance `block`
        let panels = Panels { numbers: &panels[first * matmul::panel()..], block };
        match self {
            Products::Rounded => ROUNDED.with_borrow_mut(|rounded| {
                let a = round_left(rounded, a, m, k);
                matmul::product(c, ldc, (m, k, n), a, panels, store);
            }),
            _ => matmul::product(c, ldc, (m, k, n), a, panels, store),
        }
    }
}

/// `a` (m, k) in rounded numbers, those in `rounded`.
fn round_left<'a>(rounded: &'a mut Vec<f32>, a: Left, m: usize, k: usize) -> Left<'a> {
    // grows only: after the first step nothing is allocated
    rounded.resize(rounded.len().max(m * k), 0.0);
    let rounded = &mut rounded[..m * k];
    let (from, lda, width) = match a {
        Left::Rows { a, lda } => (a, lda, k),
        Left::Columns { a, lda } => (a, lda, m),
    };
    for (to, from) in rounded.chunks_mut(width.max(1)).zip(from.chunks(lda)) {
        to.copy_from_slice(&from[..width]);
    }
    bf16::round_all(rounded);
    match a {
        Left::Rows { .. } => Left::Rows { a: rounded, lda: k },
        Left::Columns { .. } => Left::Columns { a: rounded, lda: m },
    }
}
