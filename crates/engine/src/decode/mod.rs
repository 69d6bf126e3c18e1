//! Incremental decoding: rows of a growing sequence go through a stack of transformer blocks, which stores the keys and
//! values of earlier rows. The caller makes the rows (token embeddings, positions) and turns the rows that come out
//! into logits, by a packed [`Matrix`].
//!
//! A row costs one pass over all weights, so memory bandwidth decides the speed. Weights are packed once in the order in
//! which they are read, in f32 or as bytes with a scale per column ([`WeightKind`]); several sequences and several rows of
//! each share a pass. Keys and values are stored in f32 or as half floats ([`KvKind`]). Decoding row by row allocates
//! nothing. It is for causal models without dropout: a row never sees a later one, and a place that is read again is
//! overwritten from there on.
//!
//! The products of a row are the same bits whatever rows are computed with it, so a block of rows gives the numbers
//! that its rows give one by one. A speculated block can therefore be verified without any change to the sampled
//! tokens.
//!
//! ```
//! use kinelm_engine::decode::{BlockParts, KvKind, Run, Stack, StackDecoder, StackWeights, WeightKind};
//!
//! let stack = Stack { layers: 1, heads: 2, width: 8 };
//! let numbers: Vec<f32> = (0..256).map(|i| (i % 7) as f32 / 50.0 - 0.05).collect();
//! let linear = |k: usize, n: usize| (&numbers[..k * n], &numbers[..n]);
//! let norm = (&[1.0; 8][..], &[0.0; 8][..]);
//! let block = BlockParts {
//!     norm1: norm, qkv: linear(8, 24), out: linear(8, 8),
//!     norm2: norm, up: linear(8, 32), down: linear(32, 8),
//! };
//! let weights = StackWeights::new(&[block], stack, WeightKind::F32, None);
//!
//! // three rows at once, and one after the other
//! let rows: Vec<f32> = (0..24).map(|i| (i as f32).sin()).collect();
//! let pass = |cuts: &[usize]| {
//!     let mut decoder = StackDecoder::new(&weights, KvKind::F32, 1, 16, 4, 0);
//!     let (mut place, mut out) = (0, Vec::new());
//!     for &rows_now in cuts {
//!         decoder.push(Run { stream: 0, place, rows: rows_now });
//!         decoder.rows_mut(0).copy_from_slice(&rows[place * 8..(place + rows_now) * 8]);
//!         decoder.forward(&weights);
//!         out.extend_from_slice(decoder.rows_mut(0));
//!         decoder.clear();
//!         place += rows_now;
//!     }
//!     out
//! };
//! assert_eq!(pass(&[3]), pass(&[1, 1, 1]));
//! ```

mod apart;
mod attention;
mod bytes;
mod cache;
pub(crate) mod kernel;
mod matrix;
mod stack;
#[cfg(test)]
mod tests;
mod weights;

pub use cache::{KvKind, Run};
pub use matrix::{Matrix, Product, WeightKind};
pub use stack::{StackDecoder, in_pool};
pub use weights::{BlockParts, Norm, Pair, Stack, StackWeights};
