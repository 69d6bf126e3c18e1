//! Incremental decoding on the CPU: a model reads tokens and says what may follow, keeping what it needs of those it has
//! read. [`Reader`] reads several sequences side by side; it works with a decoder per architecture.

mod conditioning;
mod head;
mod numbers;
mod reader;
#[cfg(test)]
mod tests;
mod tokens;
mod two_level;

pub use conditioning::FrameConditioning;
pub use kinelm_engine::decode::{KvKind, WeightKind};
pub use reader::{Reader, SavedSequence};

/// How a model is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReaderOptions {
    /// Sequences side by side; they share every read of a weight.
    pub streams: usize,
    /// How the weights are stored.
    pub weights: WeightKind,
    /// How keys and values are stored.
    pub kv: KvKind,
}

impl Default for ReaderOptions {
    fn default() -> ReaderOptions {
        ReaderOptions { streams: 1, weights: WeightKind::F32, kv: KvKind::F32 }
    }
}

/// Which logits a read returns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Logits {
    /// Those after the last token of each block that has any.
    Last,
    /// Those after every token.
    All,
}

/// A row whose logits are returned: input `place` of `stream` is row `row` of the pass.
#[derive(Debug, Clone, Copy)]
struct LogitRow {
    row: usize,
    stream: usize,
    place: usize,
    /// Of the slot that follows, where there is one.
    forecast: i32,
}

/// Adds row `row` of a table to `x`.
fn add_row(x: &mut [f32], table: &[f32], row: usize) {
    let row = &table[row * x.len()..];
    x.iter_mut().zip(row).for_each(|(x, y)| *x += y);
}
