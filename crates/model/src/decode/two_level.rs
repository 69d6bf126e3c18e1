//! Decoding with a two-level model: a trunk over frames, and a decoder over the tokens of a frame.
//!
//! A frame is a word: C characters and its end, W = C + 1 tokens; K tokens come before the first, labels after the
//! first of them. Input i of a sequence, counted from the last of the front, is followed by slot c = i mod W of frame
//! f = i div W.
//!
//! The **trunk** has a row per frame, made of the two frames before it, and attends to the rows of the frames before. The
//! **frame decoder** has a row per token, made of the token just read, of the tokens in the same slot one and two frames
//! back, and of the trunk's output; it attends to the rows of its own frame alone. So the wide trunk is paid for once per
//! frame, and a prompt, of which only the last logits are needed, costs no decoder rows but those of its last frame.

use super::conditioning::{Conditioning, FrameConditioning};
use super::head::Head;
use super::numbers::Numbers;
use super::{KvKind, LogitRow, Logits, ReaderOptions, add_row};
use crate::frames::{BACK, Frames, SPELT};
use crate::{Gpt, Result, layout};
use kinelm_engine::arena::Floats;
use kinelm_engine::decode::{Matrix, Norm, Run, Stack, StackDecoder, StackWeights, in_pool};
use std::sync::Arc;

/// Sequences of frames that are read side by side, sharing every read of a weight.
pub(super) struct TwoLevelDecoder {
    weights: Arc<Weights>,
    trunk: StackDecoder,
    /// Every frame begins at place 0 of its stream: the keys of the frame before are overwritten.
    decoder: StackDecoder,
    progress: Vec<Progress>,
    /// Tokens read, T per stream.
    tokens: Vec<u32>,
    /// The trunk's output for each frame, (F, d) per stream: going back costs no trunk row.
    contexts: Floats,
    /// Stream and frame of the trunk's next rows, and their inputs, (m, 2 C e).
    trunk_rows: Vec<(usize, usize)>,
    inputs: Floats,
    conditioning: Conditioning,
    pending: Vec<LogitRow>,
    logits: Vec<f32>,
}

struct Weights {
    frames: Frames,
    /// F, V, K - 1, e.
    window: usize,
    vocabulary: usize,
    skipped: usize,
    character_width: usize,
    /// (C (S + 1), e).
    characters: Floats,
    /// (2 C e, D): from the characters of the two frames before.
    join: Matrix,
    /// (F, D).
    positions: Floats,
    /// (V, D) and (V, d): added to every row for the labels in front.
    labels: [Floats; 2],
    trunk: StackWeights,
    trunk_norm: Norm,
    /// (D, d): from the trunk to the frame decoder.
    output: Matrix,
    /// Tables of [`SPELT`].
    tables: [Floats; 4],
    decoder: StackWeights,
    norm: Norm,
    head: Head,
}

/// How far a stream is.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Progress {
    /// Tokens read, those of the front among them.
    length: usize,
    /// Frames that have been through the trunk.
    pub frames: usize,
    /// The frame whose rows the frame decoder holds.
    pub frame: usize,
    /// How many of them belong to the tokens read.
    pub rows: usize,
}

impl Progress {
    /// Inputs of frames that are read, after `skipped` tokens.
    fn inputs(&self, skipped: usize) -> usize {
        self.length.saturating_sub(skipped)
    }

    /// Forgets all but `length` tokens; frames have `word`, after `skipped`.
    fn truncate(&mut self, length: usize, word: usize, skipped: usize) {
        self.length = self.length.min(length);
        // the first row of a frame needs all of the frames before and nothing else
        self.frames = self.frames.min(self.inputs(skipped).div_ceil(word));
        self.rows = self.rows.min(self.inputs(skipped).saturating_sub(self.frame * word));
    }
}

impl Weights {
    fn new(gpt: &Gpt, numbers: &Numbers, ReaderOptions { weights: kind, .. }: ReaderOptions) -> Weights {
        let (config, tokens, shape) = (gpt.config(), gpt.tokens(), gpt.config().decoder());
        let (frames, wide, d) = (Frames::of(tokens), config.width, shape.width);
        let inputs = BACK * frames.characters() * shape.character_width;
        let trunk = Stack { layers: config.layers, heads: config.heads, width: wide };
        let decoder = Stack { layers: shape.layers, heads: shape.heads, width: d };
        Weights {
            window: config.frames(tokens),
            vocabulary: tokens.vocabulary,
            skipped: tokens.front - 1,
            character_width: shape.character_width,
            characters: numbers.floats("frame.character.weight"),
            join: Matrix::linear(numbers.pair("frame.join"), inputs, wide, kind),
            positions: numbers.floats("frame.position.weight"),
            labels: [layout::LABEL, layout::SPELT_LABEL].map(|name| Floats::of(numbers.optional(name))),
            trunk: numbers.stack(layout::TRUNK, trunk, kind, None),
            trunk_norm: numbers.norm("trunk.norm", wide),
            output: Matrix::linear(numbers.pair("spell.frame"), wide, d, kind),
            tables: SPELT.map(|name| numbers.floats(name)),
            decoder: numbers.stack(layout::SPELL, decoder, kind, None),
            norm: numbers.norm("norm", d),
            // the front's last token alone is before the frames: labels aren't part of the decoder's sequence
            head: Head::new(numbers, config, tokens, 1, d, kind),
            frames,
        }
    }

    /// Bytes that are read for a token, the mean over the slots of a frame.
    fn bytes(&self) -> usize {
        let Weights { trunk, join, output, decoder, head, frames, .. } = self;
        decoder.bytes() + head.bytes() + (trunk.bytes() + join.bytes() + output.bytes()) / frames.word()
    }

    /// T = K - 1 + F W.
    fn context(&self) -> usize {
        self.skipped + self.window * self.frames.word()
    }

    /// 2 C e.
    fn input_width(&self) -> usize {
        BACK * self.frames.characters() * self.character_width
    }

    /// D and d.
    fn widths(&self) -> [usize; 2] {
        [self.trunk.stack().width, self.decoder.stack().width]
    }

    /// Approximate multiply-adds of `frames` rows of the trunk and `tokens` rows of the frame decoder.
    fn work(&self, frames: usize, tokens: usize) -> usize {
        let [wide, d] = self.widths();
        let frame = self.trunk.work() + (self.input_width() + d) * wide;
        frames * frame + tokens * (self.decoder.work() + self.vocabulary * d)
    }

    /// Writes the trunk's input (2 C e) for `frame` of the sequence `ids`.
    fn write_input(&self, x: &mut [f32], ids: &[u32], frame: usize) {
        let e = self.character_width;
        for (row, x) in self.frames.words().seen(ids, frame).zip(x.chunks_exact_mut(e)) {
            x.copy_from_slice(&self.characters[row * e..][..e]);
        }
    }

    /// Adds the rows of a table of labels (V, n) to `x` (n).
    fn add_labels(x: &mut [f32], table: &[f32], labels: &[u32]) {
        labels.iter().for_each(|&label| add_row(x, table, label as usize));
    }
}

impl TwoLevelDecoder {
    /// Decoders of the same weights, as many streams each as `split` makes of the bytes that a token reads.
    ///
    /// # Errors
    /// If the weights can't be brought to the CPU.
    pub fn several(
        gpt: &Gpt,
        options: ReaderOptions,
        split: impl FnOnce(usize) -> Vec<usize>,
    ) -> Result<Vec<TwoLevelDecoder>> {
        let numbers = Numbers::of(gpt)?;
        let weights = Arc::new(Weights::new(gpt, &numbers, options));
        let new = |streams| TwoLevelDecoder::new(weights.clone(), gpt, &numbers, options.kv, streams);
        Ok(split(weights.bytes()).into_iter().map(new).collect())
    }

    fn new(weights: Arc<Weights>, gpt: &Gpt, numbers: &Numbers, kv: KvKind, streams: usize) -> TwoLevelDecoder {
        let (window, word, [_, d]) = (weights.window, weights.frames.word(), weights.widths());
        // a stream of the decoder can have rows of many frames in a pass, but its cache holds the keys of one
        let rows = window * streams * word;
        let decoder = StackDecoder::new(&weights.decoder, kv, streams, word, rows, weights.head.widest());
        let trunk = StackDecoder::new(&weights.trunk, kv, streams, window, window * streams, d);
        TwoLevelDecoder {
            progress: vec![Progress::default(); streams],
            tokens: vec![0; streams * weights.context()],
            contexts: Floats::new(streams * window * d),
            trunk_rows: Vec::with_capacity(trunk.free()),
            inputs: Floats::new(trunk.free() * weights.input_width()),
            conditioning: Conditioning::new(numbers, gpt.config(), streams, window, word),
            pending: Vec::with_capacity(decoder.free()),
            logits: Vec::with_capacity(streams * weights.vocabulary),
            trunk,
            decoder,
            weights,
        }
    }

    pub fn streams(&self) -> usize {
        self.progress.len()
    }

    /// Tokens that a stream has read.
    pub fn len(&self, stream: usize) -> usize {
        self.progress[stream].length
    }

    /// Bytes of weights that are read for a token, the mean over the slots of a frame.
    pub fn bytes(&self) -> usize {
        self.weights.bytes()
    }

    #[cfg(test)]
    pub fn progress(&self, stream: usize) -> Progress {
        self.progress[stream]
    }

    /// A stream forgets all but its first `length` tokens, and the conditioning of later frames. Where the tokens end in an
    /// earlier frame, the next read pays for the decoder's rows of that frame once more.
    pub fn truncate(&mut self, stream: usize, length: usize) {
        let (word, skipped) = (self.weights.frames.word(), self.weights.skipped);
        self.progress[stream].truncate(length, word, skipped);
        self.conditioning.clear(stream, self.progress[stream].inputs(skipped).div_ceil(word));
    }

    /// Sets the conditioning of a frame of a stream, before the last token in front of it is read. Frames from it on that
    /// were read already are read again with the next block.
    pub fn condition(&mut self, stream: usize, frame: usize, goal: Option<FrameConditioning>, music: &[f32]) {
        self.conditioning.set(stream, frame, goal, music);
        let progress = &mut self.progress[stream];
        progress.frames = progress.frames.min(frame);
        if progress.frame >= frame {
            progress.rows = 0;
        }
    }

    /// Reads a block of tokens per stream, which may be empty; logits (rows, V) of what follows, the rows in the order of
    /// the streams and of their tokens. What follows a token of the front but its last isn't known: its row is 0. A
    /// token's logits depend on the tokens before it alone.
    pub fn read(&mut self, blocks: &[&[u32]], logits: Logits) -> &[f32] {
        let (context, word, skipped) = (self.weights.context(), self.weights.frames.word(), self.weights.skipped);
        for (stream, block) in blocks.iter().enumerate() {
            let length = &mut self.progress[stream].length;
            self.tokens[stream * context + *length..][..block.len()].copy_from_slice(block);
            *length += block.len();
        }
        self.logits.clear();
        // `frames` never exceeds what the inputs need: `truncate` and `condition` lower both
        let frames = self.progress.iter().map(|p| p.inputs(skipped).div_ceil(word) - p.frames).sum();
        let tokens = blocks.iter().map(|block| block.len()).sum();
        in_pool(self.weights.work(frames, tokens), || {
            self.read_frames();
            self.read_tokens(blocks, logits);
        });
        &self.logits
    }

    /// Takes every frame through the trunk of which a token is to be predicted.
    fn read_frames(&mut self) {
        for stream in 0..self.progress.len() {
            loop {
                let Progress { frames, .. } = self.progress[stream];
                let length = self.progress[stream].inputs(self.weights.skipped);
                let n = (length.div_ceil(self.weights.frames.word()) - frames).min(self.trunk.free());
                if n == 0 {
                    break;
                }
                let first = self.trunk.push(Run { stream, place: frames, rows: n });
                self.trunk_rows.extend((frames..frames + n).map(|frame| (stream, frame)));
                self.write_frames(stream, frames, first);
                self.progress[stream].frames += n;
                if self.trunk.free() == 0 {
                    self.pass_trunk();
                }
            }
        }
        if self.trunk.rows() > 0 {
            self.pass_trunk();
        }
    }

    /// Writes the trunk's rows from `first` on: the frames of a stream from `frame` on.
    fn write_frames(&mut self, stream: usize, frame: usize, first: usize) {
        let (weights, wide) = (&self.weights, self.weights.input_width());
        let [width, _] = weights.widths();
        let front = stream * weights.context();
        let sequence = &self.tokens[front + weights.skipped..][..self.progress[stream].inputs(weights.skipped)];
        let labels = &self.tokens[front + 1..=front + weights.skipped];
        let rows = self.trunk.rows_mut(first);
        // one copy, since the rows are consecutive frames of one stream
        rows.copy_from_slice(&weights.positions[frame * width..][..rows.len()]);
        let inputs = self.inputs[first * wide..].chunks_exact_mut(wide);
        for ((x, input), frame) in rows.chunks_exact_mut(width).zip(inputs).zip(frame..) {
            Weights::add_labels(x, &weights.labels[0], labels);
            self.conditioning.add(x, stream, frame, &self.conditioning.trunk);
            weights.write_input(input, sequence, frame);
        }
    }

    /// Takes the frames through the trunk and stores its outputs.
    fn pass_trunk(&mut self) {
        let (weights, rows) = (&self.weights, self.trunk.rows());
        let [_, d] = weights.widths();
        self.trunk.add_product(&weights.join, &self.inputs[..rows * weights.input_width()]);
        self.trunk.forward(&weights.trunk);
        self.trunk.norm(&weights.trunk_norm, 0..rows);
        let product = self.trunk.product(&weights.output, 0..rows, 0..d);
        for (row, (stream, frame)) in self.trunk_rows.drain(..).enumerate() {
            let context = &mut self.contexts[(stream * weights.window + frame) * d..][..d];
            product.copy(row, 0, context);
            let labels = &self.tokens[stream * weights.context()..][1..=weights.skipped];
            // once per frame rather than for each of its tokens
            Weights::add_labels(context, &weights.labels[1], labels);
            self.conditioning.add(context, stream, frame, &self.conditioning.decoder);
        }
        self.trunk.clear();
    }

    /// Decoder rows of the frames whose logits are requested, up to the last token read.
    fn read_tokens(&mut self, blocks: &[&[u32]], logits: Logits) {
        let Weights { skipped, vocabulary, .. } = *self.weights;
        let word = self.weights.frames.word();
        for (stream, block) in blocks.iter().enumerate().filter(|(_, block)| !block.is_empty()) {
            let Progress { length, .. } = self.progress[stream];
            let first = match logits {
                Logits::All => length - block.len(),
                Logits::Last => length - 1,
            };
            // of the tokens read now, those before the front's last
            let unknown = length.min(skipped).saturating_sub(first);
            if unknown > 0 {
                // rows of earlier streams are still pending, and logits go out in the streams' order
                if self.decoder.rows() > 0 {
                    self.pass_decoder();
                }
                self.logits.extend(std::iter::repeat_n(0.0, unknown * vocabulary));
            }
            let (first, end) = (first.max(skipped) - skipped, length.saturating_sub(skipped));
            for frame in first / word..end.div_ceil(word) {
                if self.progress[stream].frame != frame {
                    // the decoder holds the keys of one frame: those of another begin at row 0
                    self.progress[stream] = Progress { frame, rows: 0, ..self.progress[stream] };
                }
                self.read_frame(stream, end.min((frame + 1) * word), first);
            }
        }
        if self.decoder.rows() > 0 {
            self.pass_decoder();
        }
    }

    /// The rows of the current frame of a stream up to input `end`; logits are requested from input `first` on.
    fn read_frame(&mut self, stream: usize, end: usize, first: usize) {
        loop {
            let weights = &self.weights;
            let (word, [_, width]) = (weights.frames.word(), weights.widths());
            let Progress { frame, rows: done, .. } = self.progress[stream];
            let from = frame * word + done;
            // `truncate` cut `rows` to the tokens that stay, so `from` is at most `end`
            let n = (end - from).min(self.decoder.free());
            if n == 0 {
                break;
            }
            let row = self.decoder.push(Run { stream, place: done, rows: n });
            let context = &self.contexts[(stream * weights.window + frame) * width..][..width];
            let ids = &self.tokens[stream * weights.context() + weights.skipped..][..end];
            for (i, x) in (from..).zip(self.decoder.rows_mut(row).chunks_exact_mut(width)) {
                x.copy_from_slice(context);
                let rows = weights.frames.words().spelt(ids, i);
                weights.tables.iter().zip(rows).for_each(|(table, row)| add_row(x, table, row));
                self.conditioning.add_rows(x, stream, frame, i % word);
            }
            let pending = (from..from + n).zip(row..).filter(|&(place, _)| place >= first);
            self.pending.extend(pending.map(|(place, row)| LogitRow { row, stream, place }));
            self.progress[stream].rows += n;
            if self.decoder.free() == 0 {
                self.pass_decoder();
            }
        }
    }

    /// Takes the rows through the frame decoder and appends the requested logits.
    fn pass_decoder(&mut self) {
        let weights = &self.weights;
        self.decoder.forward(&weights.decoder);
        if !self.pending.is_empty() {
            self.decoder.norm(&weights.norm, self.pending.iter().map(|pending| pending.row));
            let tokens = &self.tokens;
            let ids =
                |row: &LogitRow| (&tokens[row.stream * weights.context() + weights.skipped..][..=row.place], row.place);
            weights.head.logits(&mut self.logits, &mut self.decoder, self.pending.iter().map(ids));
        }
        self.pending.clear();
        self.decoder.clear();
    }
}
