//! Decoding: a model reads tokens it is given and says what may follow, keeping what it needs of those it has read.
//!
//! A token costs one pass over all weights, so the time goes into reading memory. Weights are packed once into the order in
//! which they are read, in f32 or as bytes with a scale a column ([`WeightKind`]); several sequences ([`Decoder::streams`])
//! and several tokens of each share a pass. Keys and values lie in one allocation, in f32 or as half floats ([`KvKind`]).
//! Nothing is allocated while tokens are read one after the other.
//!
//! Products of a row are the same bits whatever rows stand beside it, so a block of tokens gives the logits that its tokens
//! give one by one. A drafted block can therefore be verified without any change to what is drawn.

mod attention;
mod cache;
mod kernel;
mod matrix;
mod position;
mod step;
#[cfg(test)]
mod tests;
mod weights;

pub use cache::KvKind;
pub use matrix::WeightKind;
pub use position::Positions;
pub use step::{Decoder, Logits};
pub use weights::{BlockParts, DecoderWeights, Pair, Parts, Shape};
