//! Decoding: a model reads tokens it is given and says what may follow, keeping what it needs of those it has read.
//!
//! A token costs one pass over all weights, so the time goes into reading memory. Weights are packed once into the order in
//! which they are read, in f32 or as bytes with a scale a column ([`WeightKind`]); several sequences ([`Decoder::streams`])
//! and several tokens of each share a pass. Keys and values lie in one allocation, in f32 or as half floats ([`KvKind`]).
//! Nothing is allocated while tokens are read one after the other.
//!
//! Beside what every such model has, queries and keys may be turned by the word they stand in ([`Rope`]), inputs may tell
//! the token one word back, and logits may be those of differences to it ([`Before`]). Tokens that can't follow have a
//! logit of minus infinity then.
//!
//! A model may also be of two stacks of blocks, one over words of one length and one that spells a word's tokens
//! ([`FrameDecoder`]).
//!
//! Products of a row are the same bits whatever rows stand beside it, so a block of tokens gives the logits that its tokens
//! give one by one. A drafted block can therefore be verified without any change to what is drawn.

mod attention;
mod before;
mod cache;
mod frames;
mod head;
pub(crate) mod kernel;
mod layers;
mod matrix;
mod position;
mod rope;
mod step;
#[cfg(test)]
mod tests;
mod weights;

pub use before::{Before, Previous, Relative};
pub use cache::KvKind;
pub use frames::{ConditioningParts, FrameConditioning, FrameDecoder, FrameParts, FrameSizes, FrameWeights};
pub use layers::Stack;
pub use matrix::WeightKind;
pub use position::Positions;
pub use rope::Rope;
pub use step::{Decoder, Logits};
pub use weights::{BlockParts, DecoderWeights, Pair, Parts, Sizes};
