//! Reading words of one length with two stacks of blocks: one looks over frames, one spells a frame's tokens.
//!
//! A frame is a word: C characters and its end, W = C + 1 tokens; K tokens stand in front of the first, labels behind the
//! first of them. Input i of a sequence, counted from the last of the front, is followed by place c = i mod W of frame
//! f = i div W.
//!
//! The **trunk** has a row a frame, made of the two frames before it, and sees the rows of the frames before. The
//! **speller** has a row a token, made of the token just read, of the tokens at the same place one and two frames back,
//! and of what the trunk made of the frames before; it sees the rows of its own frame alone. So the wide trunk is paid
//! for once a frame, and a prompt, of which only the last logits are wanted, costs no speller rows but its last
//! frame's.

mod conditioning;
mod rows;
#[cfg(test)]
mod tests;
mod weights;

pub use conditioning::FrameConditioning;
pub use weights::{ConditioningParts, FrameParts, FrameSizes, FrameWeights};

use super::cache::KvKind;
use super::head::Pieces;
use super::kernel::Left;
use super::layers::{Asked, Layers, Run, in_pool, products};
use super::step::Logits;
use crate::arena::Floats;
use conditioning::ConditionedFrames;
use std::sync::Arc;

/// Sequences of frames that are read side by side, sharing every read of a weight: the [`super::Decoder`] of a model of
/// two stacks.
pub struct FrameDecoder {
    weights: Arc<FrameWeights>,
    trunk: Layers,
    /// Every frame begins at place 0 of its stream: what it kept of the frame before is forgotten.
    speller: Layers,
    readings: Vec<Reading>,
    /// Tokens read, T a stream.
    tokens: Vec<u32>,
    /// What the trunk made of the frames before each, (F, d) a stream: going back costs no trunk row.
    known: Floats,
    /// What the trunk's next rows are made of, (m, 2 C e).
    frames: Floats,
    /// What frames are told beside it.
    conditioning: ConditionedFrames,
    /// The rows whose logits are asked for.
    asked: Vec<Asked>,
    logits: Vec<f32>,
}

/// How far a stream is.
#[derive(Debug, Clone, Copy, Default)]
struct Reading {
    /// Tokens read, those of the front among them.
    length: usize,
    /// Frames whose trunk rows are there.
    frames: usize,
    /// The frame that the speller has rows of.
    frame: usize,
    /// How many of them are those of the tokens read.
    rows: usize,
}

impl Reading {
    /// Inputs of frames that are read, behind `ahead` tokens.
    fn inputs(&self, ahead: usize) -> usize {
        self.length.saturating_sub(ahead)
    }

    /// Forgets all but `length` tokens; frames have `word`, behind `ahead`.
    fn truncate(&mut self, length: usize, word: usize, ahead: usize) {
        self.length = self.length.min(length);
        // the first row of a frame needs all of the frames before and nothing else
        self.frames = self.frames.min(self.inputs(ahead).div_ceil(word));
        self.rows = self.rows.min(self.inputs(ahead).saturating_sub(self.frame * word));
    }
}

impl FrameDecoder {
    /// A reader of `streams` sequences.
    ///
    /// # Panics
    /// No streams.
    pub fn new(weights: Arc<FrameWeights>, streams: usize, kv: KvKind) -> FrameDecoder {
        assert!(streams > 0, "a decoder of no streams");
        let FrameSizes { trunk, speller, frames, vocabulary, .. } = weights.sizes;
        let (word, context) = (weights.rows.word(), weights.context());
        // a stream of the speller can have rows of many frames in a pass, but never keeps more than one
        let spelled = Layers::new(kv, speller, (streams, word), frames * streams * word, false, weights.head.widest());
        let trunk = Layers::new(kv, trunk, (streams, frames), frames * streams, false, speller.width);
        FrameDecoder {
            readings: vec![Reading::default(); streams],
            tokens: vec![0; streams * context],
            known: Floats::new(streams * frames * speller.width),
            frames: Floats::new(trunk.free() * weights.rows.frame_width()),
            conditioning: ConditionedFrames::new((streams, frames), weights.told_numbers(), word),
            asked: Vec::with_capacity(spelled.free()),
            logits: Vec::with_capacity(streams * vocabulary),
            trunk,
            speller: spelled,
            weights,
        }
    }

    /// The weights it reads with.
    pub fn weights(&self) -> &Arc<FrameWeights> {
        &self.weights
    }

    /// How keys and values are held.
    pub fn kv(&self) -> KvKind {
        self.trunk.kv()
    }

    /// Sequences.
    pub fn streams(&self) -> usize {
        self.readings.len()
    }

    /// Tokens that a stream has read.
    ///
    /// # Panics
    /// A stream that is not there.
    pub fn len(&self, stream: usize) -> usize {
        self.readings[stream].length
    }

    /// Whether no stream has read anything.
    pub fn is_empty(&self) -> bool {
        self.readings.iter().all(|reading| reading.length == 0)
    }

    /// Every stream forgets all it has read, and what its frames were told.
    pub fn reset(&mut self) {
        self.readings.fill(Reading::default());
        (0..self.streams()).for_each(|stream| self.conditioning.forget(stream, 0));
    }

    /// A stream forgets all but its first `length` tokens, and what later frames were told. Where the tokens end in an
    /// earlier frame, the next read pays for the speller's rows of that frame once more.
    ///
    /// # Panics
    /// A stream that is not there.
    pub fn truncate(&mut self, stream: usize, length: usize) {
        self.readings[stream].truncate(length, self.weights.rows.word(), self.weights.ahead());
        let inputs = self.readings[stream].inputs(self.weights.ahead());
        self.conditioning.forget(stream, inputs.div_ceil(self.weights.rows.word()));
    }

    /// Tells a frame of a stream something, or nothing, before the token is read that it is spelled behind. Frames from it
    /// on that were read already are read again with the next block.
    ///
    /// # Panics
    /// A stream or a frame that is not there; a model that can't be told, numbers or rows of another shape.
    pub fn condition(&mut self, stream: usize, frame: usize, conditioning: Option<FrameConditioning>) {
        let has_rows = self.weights.conditioning.as_ref().is_some_and(|conditioning| !conditioning.rows[0].is_empty());
        let steps = if has_rows { self.weights.rows.steps() } else { 0 };
        self.conditioning.condition(stream, frame, conditioning, steps);
        let reading = &mut self.readings[stream];
        reading.frames = reading.frames.min(frame);
        if reading.frame >= frame {
            reading.rows = 0;
        }
    }

    /// Reads a block of tokens a stream, which may be empty; logits (rows, V) of what follows, the rows in the order of
    /// the streams and of their tokens; minus infinity where a token can't come. What follows a token of the front but its
    /// last isn't known: its row is 0.
    ///
    /// Work is shared out over the threads of the pool that this is called in where it is worth it. A token's logits
    /// depend on the tokens before it alone: not on how blocks are cut, on other streams or on threads.
    ///
    /// # Panics
    /// Not a block a stream, more tokens than the context has room for, tokens outside the vocabulary.
    pub fn read(&mut self, blocks: &[&[u32]], wanted: Logits) -> &[f32] {
        assert_eq!(blocks.len(), self.streams(), "blocks of tokens");
        let (context, vocabulary) = (self.weights.context(), self.weights.sizes.vocabulary);
        for (block, Reading { length, .. }) in blocks.iter().zip(&self.readings) {
            assert!(block.len() + length <= context, "{} tokens behind {length}, of {context}", block.len());
            let unknown = block.iter().find(|&&id| id as usize >= vocabulary);
            assert!(unknown.is_none(), "token {unknown:?} of {vocabulary}");
        }
        for (stream, block) in blocks.iter().enumerate() {
            let length = &mut self.readings[stream].length;
            self.tokens[stream * context + *length..][..block.len()].copy_from_slice(block);
            *length += block.len();
        }
        self.logits.clear();
        let word = self.weights.rows.word();
        let ahead = self.weights.ahead();
        let frames = self.readings.iter().map(|reading| reading.inputs(ahead).div_ceil(word) - reading.frames).sum();
        let tokens = blocks.iter().map(|block| block.len()).sum();
        in_pool(self.weights.work(frames, tokens), || {
            self.look();
            self.spell(blocks, wanted);
        });
        &self.logits
    }

    /// Trunk rows of all frames of which a token is to be spelled.
    fn look(&mut self) {
        let weights = self.weights.clone();
        let (rows, width) = (&weights.rows, weights.sizes.trunk.width);
        for stream in 0..self.readings.len() {
            let (front, ids) = (stream * weights.context(), stream * weights.context() + weights.ahead());
            loop {
                let (length, frames) = (self.readings[stream].inputs(weights.ahead()), self.readings[stream].frames);
                let n = (length.div_ceil(rows.word()) - frames).min(self.trunk.free());
                if n == 0 {
                    break;
                }
                let first = self.trunk.push(Run { stream, place: frames, rows: n });
                let positions = &weights.positions[frames * width..][..n * width];
                let x = &mut self.trunk.room.x[first * width..][..n * width];
                x.copy_from_slice(positions);
                x.chunks_exact_mut(width)
                    .for_each(|x| FrameWeights::add_labels(x, &weights.labels[0], &self.tokens[front + 1..=ids]));
                let wide = rows.frame_width();
                if let Some(weights) = &weights.conditioning {
                    for (frame, x) in (frames..frames + n).zip(x.chunks_exact_mut(width)) {
                        self.conditioning.add(x, (stream, frame), &weights.trunk);
                    }
                }
                for (frame, x) in (frames..frames + n).zip(self.frames[first * wide..].chunks_exact_mut(wide)) {
                    rows.frame(x, &self.tokens[ids..ids + length], frame);
                }
                self.readings[stream].frames += n;
                if self.trunk.free() == 0 {
                    self.pass_trunk();
                }
            }
        }
        if self.trunk.rows() > 0 {
            self.pass_trunk();
        }
    }

    /// Takes the frames through the trunk, and keeps what it makes of them.
    fn pass_trunk(&mut self) {
        let FrameWeights { frames, trunk, trunk_norm, join, rows: table, sizes, conditioning, labels, .. } =
            &*self.weights;
        let (rows, wide, width) = (self.trunk.rows(), table.frame_width(), sizes.trunk.width);
        let room = &mut self.trunk.room;
        products(frames, 0..frames.pieces(), &mut room.pieces, Left::whole(&self.frames, rows, wide, wide));
        room.add(rows, width);
        self.trunk.pass(trunk, None);
        let room = &mut self.trunk.room;
        room.norm(trunk_norm, rows);
        products(join, 0..join.pieces(), &mut room.pieces, Left::whole(&room.normed, rows, width, width));
        let product = Pieces { numbers: &self.trunk.room.pieces, rows, first: 0 };
        let mut row = 0;
        for run in self.trunk.runs() {
            let known = &mut self.known[(run.stream * sizes.frames + run.place) * sizes.speller.width..];
            let front = &self.tokens[run.stream * self.weights.context()..][1..sizes.front];
            for (i, known) in known.chunks_exact_mut(sizes.speller.width).take(run.rows).enumerate() {
                product.copy(known, row, 0);
                FrameWeights::add_labels(known, &labels[1], front);
                if let Some(weights) = conditioning {
                    self.conditioning.add(known, (run.stream, run.place + i), &weights.speller);
                }
                row += 1;
            }
        }
        self.trunk.clear();
    }

    /// Speller rows of the frames whose logits are wanted, up to the last token read.
    fn spell(&mut self, blocks: &[&[u32]], wanted: Logits) {
        let (word, ahead, vocabulary) = (self.weights.rows.word(), self.weights.ahead(), self.weights.sizes.vocabulary);
        for (stream, block) in blocks.iter().enumerate().filter(|(_, block)| !block.is_empty()) {
            let Reading { length, .. } = self.readings[stream];
            let first = match wanted {
                Logits::All => length - block.len(),
                Logits::Last => length - 1,
            };
            let unasked = length.min(ahead).saturating_sub(first);
            if unasked > 0 {
                // logits stand in the order of the streams
                if self.speller.rows() > 0 {
                    self.pass_speller();
                }
                self.logits.extend(std::iter::repeat_n(0.0, unasked * vocabulary));
            }
            let (first, end) = (first.max(ahead) - ahead, length.saturating_sub(ahead));
            for frame in first / word..end.div_ceil(word) {
                if self.readings[stream].frame != frame {
                    self.readings[stream] = Reading { frame, rows: 0, ..self.readings[stream] };
                }
                self.spell_frame(stream, end.min((frame + 1) * word), first);
            }
        }
        if self.speller.rows() > 0 {
            self.pass_speller();
        }
    }

    /// The rows of the current frame of a stream up to input `end`; logits are asked for from input `first` on.
    fn spell_frame(&mut self, stream: usize, end: usize, first: usize) {
        let weights = self.weights.clone();
        let (rows, width, context) = (&weights.rows, weights.sizes.speller.width, weights.context());
        loop {
            let Reading { frame, rows: done, .. } = self.readings[stream];
            let from = frame * rows.word() + done;
            let n = (end - from).min(self.speller.free());
            if n == 0 {
                break;
            }
            let row = self.speller.push(Run { stream, place: done, rows: n });
            let known = &self.known[(stream * weights.sizes.frames + frame) * width..][..width];
            let ids = &self.tokens[stream * context + weights.ahead()..][..end];
            for (i, x) in (from..from + n).zip(self.speller.room.x[row * width..].chunks_exact_mut(width)) {
                rows.spelled(x, ids, i, known);
                if let Some(conditioning) = &weights.conditioning {
                    self.conditioning.add_rows(x, (stream, frame), i % rows.word(), &conditioning.rows);
                }
            }
            let asked = (from..from + n).zip(row..).filter(|&(place, _)| place >= first);
            self.asked.extend(asked.map(|(place, row)| Asked { row, stream, place }));
            self.readings[stream].rows += n;
            if self.speller.free() == 0 {
                self.pass_speller();
            }
        }
    }

    /// Takes the rows through the speller and adds the logits that are asked for.
    fn pass_speller(&mut self) {
        let (context, ahead) = (self.weights.context(), self.weights.ahead());
        let FrameWeights { speller, norm, head, sizes, .. } = &*self.weights;
        self.speller.pass(speller, None);
        if !self.asked.is_empty() {
            self.speller.finish(&self.asked, norm);
            let tokens = &self.tokens;
            let ids = |asked: &Asked| (&tokens[asked.stream * context + ahead..][..=asked.place], asked.place);
            head.logits(&mut self.logits, &mut self.speller.room, sizes.speller.width, self.asked.iter().map(ids));
        }
        self.asked.clear();
        self.speller.clear();
    }
}
