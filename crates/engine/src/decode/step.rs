//! Reading tokens: a block through all layers, the keys and values kept.

use super::cache::KvKind;
use super::layers::{Asked, Layers, Run, in_pool};
use super::weights::DecoderWeights;
use crate::words::Stand;
use std::sync::Arc;

/// Which logits a read is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Logits {
    /// Those behind the last token of each block that has any.
    Last,
    /// Those behind every token.
    All,
}

/// Sequences that are read side by side, sharing every read of a weight.
pub struct Decoder {
    weights: Arc<DecoderWeights>,
    layers: Layers,
    /// Tokens read, a number a stream.
    lengths: Vec<usize>,
    /// Those tokens, T a stream.
    tokens: Vec<u32>,
    /// Where those tokens and the next stand in their words, if words are counted: so many a stream.
    stands: Vec<Stand>,
    /// The rows whose logits are asked for.
    asked: Vec<Asked>,
    logits: Vec<f32>,
}

impl Decoder {
    /// A reader of `streams` sequences.
    ///
    /// # Panics
    /// No streams.
    pub fn new(weights: Arc<DecoderWeights>, streams: usize, kv: KvKind) -> Decoder {
        assert!(streams > 0, "a decoder of no streams");
        let sizes = weights.sizes;
        let (turned, widest) = (weights.turns.is_some(), weights.head.widest());
        let layers = Layers::new(kv, sizes.stack(), (streams, sizes.context), streams * sizes.context, turned, widest);
        Decoder {
            lengths: vec![0; streams],
            tokens: vec![0; streams * sizes.context],
            stands: vec![Stand::default(); streams * weights.positions.stands(sizes.context)],
            asked: Vec::with_capacity(layers.free()),
            logits: Vec::with_capacity(streams * sizes.vocabulary),
            layers,
            weights,
        }
    }

    /// The weights it reads with.
    pub fn weights(&self) -> &Arc<DecoderWeights> {
        &self.weights
    }

    /// How keys and values are held.
    pub fn kv(&self) -> KvKind {
        self.layers.kv()
    }

    /// Sequences.
    pub fn streams(&self) -> usize {
        self.lengths.len()
    }

    /// Tokens that a stream has read.
    ///
    /// # Panics
    /// A stream that is not there.
    pub fn len(&self, stream: usize) -> usize {
        self.lengths[stream]
    }

    /// Whether no stream has read anything.
    pub fn is_empty(&self) -> bool {
        self.lengths.iter().all(|&n| n == 0)
    }

    /// Every stream forgets all it has read.
    pub fn reset(&mut self) {
        self.lengths.fill(0);
    }

    /// A stream forgets all but its first `length` tokens.
    ///
    /// # Panics
    /// A stream that is not there.
    pub fn truncate(&mut self, stream: usize, length: usize) {
        self.lengths[stream] = self.lengths[stream].min(length);
    }

    /// Reads a block of tokens a stream, which may be empty; logits (rows, V) of what follows, the rows in the order of the
    /// streams and of their tokens.
    ///
    /// Work is shared out over the threads of the pool that this is called in where it is worth it. A token's logits
    /// depend on the tokens before it alone: not on how blocks are cut, on other streams or on threads.
    ///
    /// # Panics
    /// Not a block a stream, more tokens than the context has room for, tokens outside the vocabulary.
    pub fn read(&mut self, blocks: &[&[u32]], wanted: Logits) -> &[f32] {
        assert_eq!(blocks.len(), self.streams(), "blocks of tokens");
        let context = self.weights.sizes.context;
        for (block, read) in blocks.iter().zip(&self.lengths) {
            assert!(block.len() + read <= context, "{} tokens behind {read}, of {context}", block.len());
        }
        self.logits.clear();
        // a read that found a token it doesn't know may have left some
        self.asked.clear();
        self.layers.clear();
        let work = self.weights.multiply_adds() * blocks.iter().map(|b| b.len()).sum::<usize>();
        in_pool(work, || self.read_all(blocks, wanted));
        &self.logits
    }

    fn read_all(&mut self, blocks: &[&[u32]], wanted: Logits) {
        for (stream, block) in blocks.iter().enumerate() {
            let mut rest = *block;
            while !rest.is_empty() {
                let (tokens, behind) = rest.split_at(rest.len().min(self.layers.free()));
                let (n, place) = (tokens.len(), self.lengths[stream]);
                let row = self.layers.push(Run { stream, place, rows: n });
                self.embed(row, tokens, stream);
                self.lengths[stream] += n;
                let first = match wanted {
                    Logits::All => 0,
                    Logits::Last => n - usize::from(behind.is_empty()),
                };
                self.asked.extend((first..n).map(|i| Asked { row: row + i, stream, place: place + i }));
                if self.layers.free() == 0 {
                    self.pass();
                }
                rest = behind;
            }
        }
        if self.layers.rows() > 0 {
            self.pass();
        }
    }

    /// The vectors of the next `tokens` of a stream into the rows from `row` on.
    fn embed(&mut self, row: usize, tokens: &[u32], stream: usize) {
        let DecoderWeights { token, positions, turns, words, inputs, sizes, .. } = &*self.weights;
        let (width, first) = (sizes.width, self.lengths[stream]);
        let x = &mut self.layers.room.x[row * width..][..tokens.len() * width];
        for (x, &id) in x.chunks_exact_mut(width).zip(tokens) {
            assert!((id as usize) < sizes.vocabulary, "token {id} of {}", sizes.vocabulary);
            x.copy_from_slice(&token[id as usize * width..][..width]);
        }
        let stands = positions.stands(sizes.context);
        let stands = &mut self.stands[stream * stands..][..stands];
        positions.add(x, width, tokens, first, stands);
        let all = &mut self.tokens[stream * sizes.context..][..first + tokens.len()];
        all[first..].copy_from_slice(tokens);
        if let Some((words, inputs)) = words.as_ref().zip(inputs.as_ref()) {
            inputs.add(x, width, words, all, first);
        }
        if let Some(turns) = turns {
            turns.number(&mut self.layers.room.words[row..][..tokens.len()], first, stands);
        }
    }

    /// Takes the rows through the layers and adds the logits that are asked for.
    fn pass(&mut self) {
        let DecoderWeights { blocks, turns, head, norm, sizes, .. } = &*self.weights;
        self.layers.pass(blocks, turns.as_ref());
        if !self.asked.is_empty() {
            self.layers.finish(&self.asked, norm);
            let tokens = &self.tokens;
            let ids = |asked: &Asked| (&tokens[asked.stream * sizes.context..][..=asked.place], asked.place);
            head.logits(&mut self.logits, &mut self.layers.room, sizes.width, self.asked.iter().map(ids));
        }
        self.asked.clear();
        self.layers.clear();
    }
}
