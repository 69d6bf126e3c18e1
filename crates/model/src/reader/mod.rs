//! Reading tokens with the engine: the fast form of [`super::Cache`], on the CPU.

mod packed;
#[cfg(test)]
mod tests;

use super::architecture::Architecture;
use super::config::{ModelConfig, ModelKind, TokenLayout};
use super::frames::Frames;
use super::goal;
use super::gpt::Gpt;
use super::scores::Scores;
use crate::{Error, Result};
use kinelm_engine::decode::{Decoder, FrameConditioning, FrameDecoder, KvKind, Logits, WeightKind};
use kinelm_engine::op::cross_entropy;
use kinelm_engine::op::embedding::NONE;
use std::sync::Arc;

/// How a model is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReaderOptions {
    /// Sequences side by side; they share every read of a weight.
    pub streams: usize,
    /// How the weights are held.
    pub weights: WeightKind,
    /// How keys and values are held.
    pub kv: KvKind,
}

impl Default for ReaderOptions {
    fn default() -> ReaderOptions {
        ReaderOptions { streams: 1, weights: WeightKind::F32, kv: KvKind::F32 }
    }
}

/// Sequences that a model reads side by side.
pub struct Reader {
    config: ModelConfig,
    tokens: TokenLayout,
    decoding: Decoding,
}

/// What reads them.
enum Decoding {
    Tokens(Box<Decoder>),
    Frames(Box<FrameDecoder>),
}

impl Reader {
    /// A reader with the weights of a model, packed.
    ///
    /// # Errors
    /// No sequences; a masked model; weights that can't be brought to the CPU.
    pub fn new(gpt: &Gpt, reading: ReaderOptions) -> Result<Reader> {
        if reading.streams == 0 {
            return Err(Error::call("0 sequences to read; expected at least one"));
        }
        if gpt.config().kind == ModelKind::Masked {
            let what = "a masked model sees the whole window at once: it can't be read token after token";
            return Err(Error::call(what));
        }
        let ReaderOptions { streams, weights, kv } = reading;
        let decoding = match gpt.config().architecture {
            Architecture::Flat => {
                Decoding::Tokens(Box::new(Decoder::new(Arc::new(packed::weights(gpt, weights)?), streams, kv)))
            }
            Architecture::TwoLevel => {
                let weights = Arc::new(packed::frame_weights(gpt, weights)?);
                Decoding::Frames(Box::new(FrameDecoder::new(weights, streams, kv)))
            }
        };
        Ok(Reader { config: gpt.config().clone(), tokens: gpt.tokens().clone(), decoding })
    }

    /// T: the most tokens of a sequence.
    pub fn context(&self) -> usize {
        self.config.context
    }

    /// Sequences.
    pub fn streams(&self) -> usize {
        match &self.decoding {
            Decoding::Tokens(decoder) => decoder.streams(),
            Decoding::Frames(decoder) => decoder.streams(),
        }
    }

    /// Bytes of weights that are read for a token; where places differ, their mean.
    pub fn weight_bytes(&self) -> usize {
        match &self.decoding {
            Decoding::Tokens(decoder) => decoder.weights().bytes(),
            Decoding::Frames(decoder) => decoder.weights().bytes(),
        }
    }

    /// A sequence forgets all but its first `length` tokens.
    ///
    /// # Panics
    /// A sequence that is not there.
    pub fn truncate(&mut self, stream: usize, length: usize) {
        match &mut self.decoding {
            Decoding::Tokens(decoder) => decoder.truncate(stream, length),
            Decoding::Frames(decoder) => decoder.truncate(stream, length),
        }
    }

    /// Tells a frame of a sequence something of what is given ahead, or nothing, and (M) of its music, or nothing, before the
    /// token is read that it is spelled behind.
    ///
    /// # Errors
    /// Something told to a model without `model.goal` and `model.music`.
    ///
    /// # Panics
    /// A sequence or a frame that is not there; numbers or rows of another shape.
    pub fn condition(
        &mut self,
        stream: usize,
        frame: usize,
        conditioning: Option<FrameConditioning>,
        music: &[f32],
    ) -> Result<()> {
        if conditioning.is_some() && !self.config.goal {
            return Err(Error::call("a model with model.goal = false can't be told"));
        }
        let m = self.config.music.numbers();
        if !music.is_empty() && music.len() != m {
            return Err(Error::call(format!("{} numbers of music; this model is told {m}", music.len())));
        }
        let Decoding::Frames(decoder) = &mut self.decoding else { return Ok(()) };
        if !self.config.is_conditioned() || (conditioning.is_none() && music.is_empty()) {
            if self.config.is_conditioned() {
                decoder.condition(stream, frame, None);
            }
            return Ok(());
        }
        // what one of the two doesn't tell is 0
        let of_music = if music.is_empty() { vec![0.0; m] } else { music.to_vec() };
        let frames = Frames::of(&self.tokens);
        let p = if self.config.goal { goal::numbers(frames.characters()) } else { 0 };
        let (nothing, none) = (vec![0.0; p], vec![NONE; self.tokens.word]);
        let ahead = conditioning.unwrap_or(FrameConditioning { numbers: &nothing, rows: [&none; 2] });
        let numbers = [ahead.numbers, &of_music].concat();
        decoder.condition(stream, frame, Some(FrameConditioning { numbers: &numbers, rows: ahead.rows }));
        Ok(())
    }

    /// Reads a block of tokens a sequence, which may be empty; logits (rows, V), the rows in the order of the sequences.
    ///
    /// Blocks cut otherwise give the same bits.
    ///
    /// # Errors
    /// Not a block a sequence, more tokens than the context has room for, ids outside the vocabulary.
    pub fn read(&mut self, blocks: &[&[u32]], wanted: Logits) -> Result<&[f32]> {
        if blocks.len() != self.streams() {
            return Err(Error::call(format!("{} blocks of tokens for {} sequences", blocks.len(), self.streams())));
        }
        for (stream, block) in blocks.iter().enumerate() {
            let (read, context) = (self.len(stream), self.config.context);
            if read + block.len() > context {
                return Err(Error::call(format!(
                    "{} more tokens behind {read} read; expected at most {}",
                    block.len(),
                    context - read
                )));
            }
            let vocabulary = self.tokens.vocabulary;
            if let Some(id) = block.iter().find(|&&id| id as usize >= vocabulary) {
                return Err(Error::call(format!("token {id} is outside the vocabulary of {vocabulary} ids")));
            }
        }
        Ok(match &mut self.decoding {
            Decoding::Tokens(decoder) => decoder.read(blocks, wanted),
            Decoding::Frames(decoder) => decoder.read(blocks, wanted),
        })
    }

    /// Tokens that a sequence has read.
    fn len(&self, stream: usize) -> usize {
        match &self.decoding {
            Decoding::Tokens(decoder) => decoder.len(stream),
            Decoding::Frames(decoder) => decoder.len(stream),
        }
    }
}

impl Scores for Reader {
    fn config(&self) -> &ModelConfig {
        &self.config
    }

    fn tokens(&self) -> &TokenLayout {
        &self.tokens
    }

    fn nats_conditioned(
        &mut self,
        (inputs, targets): (&[u32], &[u32]),
        length: usize,
        conditioning: Option<&goal::Conditioning>,
        out: &mut [f32],
    ) -> Result<()> {
        if conditioning.is_some() {
            return Err(Error::call(
                "what is ahead, and music, are told to whole windows; measure with weights and keys in f32",
            ));
        }
        assert_eq!((inputs.len(), targets.len()), (out.len(), out.len()), "a target for every input and its nats");
        let pad = self.tokens.pad;
        let mut nats = vec![0.0; length];
        let windows = inputs.chunks(length).zip(targets.chunks(length)).zip(out.chunks_mut(length));
        for ((inputs, targets), out) in windows {
            (0..self.streams()).for_each(|stream| self.truncate(stream, 0));
            let mut blocks = vec![&[][..]; self.streams()];
            blocks[0] = inputs;
            let logits = self.read(&blocks, Logits::All)?;
            cross_entropy::nats(&mut nats[..out.len()], logits, targets, pad);
            out.iter_mut().zip(&nats).for_each(|(out, nats)| *out = *nats as f32);
        }
        Ok(())
    }
}
