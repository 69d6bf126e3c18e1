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

use super::conditioning::{Conditioning, FrameConditioning, SavedConditioning};
use super::head::Head;
use super::numbers::Numbers;
use super::{KvKind, LogitRow, Logits, ReaderOptions, add_row};
use crate::forecast::{Forecast, NUMBERS, Track};
use crate::frames::{BACK, Frames, spelt_tables};
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
    /// (streams, K + H W + F W): the front, the frames before the window, the tokens read after the front.
    tokens: Vec<u32>,
    /// What is forecast of each stream's slots; empty without a forecast.
    tracks: Vec<Track>,
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
    forecast: Option<Arc<Forecast>>,
    /// F, V, K - 1, H W, `<pad>`, e.
    window: usize,
    vocabulary: usize,
    skipped: usize,
    history: usize,
    pad: u32,
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
    /// Tables of [`crate::frames::SPELT`], and (P, d) the projection of a forecast's numbers.
    tables: Vec<Floats>,
    projection: Floats,
    decoder: StackWeights,
    norm: Norm,
    head: Head,
}

/// What a stream has read, and what was computed of it.
#[derive(Debug, Clone)]
pub(super) struct SavedFrames {
    progress: Progress,
    tokens: Vec<u32>,
    track: Option<Track>,
    contexts: Vec<f32>,
    conditioning: SavedConditioning,
    trunk: Vec<f32>,
    decoder: Vec<f32>,
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
    /// Words of the sequence, history included, that are padding.
    padded: usize,
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
            forecast: gpt.forecast().cloned(),
            window: config.frames(tokens),
            vocabulary: tokens.vocabulary,
            skipped: tokens.front - 1,
            history: config.history() * tokens.word,
            pad: tokens.pad,
            character_width: shape.character_width,
            characters: numbers.floats("frame.character.weight"),
            join: Matrix::linear(numbers.pair("frame.join"), inputs, wide, kind),
            positions: numbers.floats("frame.position.weight"),
            labels: [layout::LABEL, layout::SPELT_LABEL].map(|name| Floats::of(numbers.optional(name))),
            trunk: numbers.stack(layout::TRUNK, trunk, kind, None),
            trunk_norm: numbers.norm("trunk.norm", wide),
            output: Matrix::linear(numbers.pair("spell.frame"), wide, d, kind),
            tables: spelt_tables(config.forecast()).iter().map(|name| numbers.floats(name)).collect(),
            projection: Floats::of(numbers.optional(layout::FORECAST)),
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

    /// Tokens that a stream holds.
    fn room(&self) -> usize {
        self.skipped + 1 + self.history + self.window * self.frames.word()
    }

    /// The slots of words that are not padding, up to the last of the first `tokens` of a sequence's words.
    fn slots(&self, padded: usize, tokens: usize) -> usize {
        let (word, slots) = (self.frames.word(), self.frames.characters());
        (tokens / word * slots + (tokens % word).min(slots)).saturating_sub(padded * slots)
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

    /// The forecast of the slot just read and of the one that follows, after a sequence's `ids`; `None` and 0 where there is none.
    fn forecasts(&self, track: &mut Track, forecast: &Forecast, ids: &[u32], padded: usize) -> (Option<i32>, i32) {
        let (word, slots, places) = (self.frames.word(), self.frames.characters(), self.frames.places());
        let known = self.slots(padded, ids.len() - 1);
        track.truncate(known);
        for slot in track.known_slots()..known {
            let (frame, place) = (padded + slot / slots, slot % slots);
            track.push(forecast, places[place].bin(ids[1 + frame * word + place]));
        }
        match (ids.len() - 1) % word {
            0 => (None, track.next(forecast)),
            place if place == slots => (track.forecasts().last().copied(), 0),
            _ => (track.forecasts().last().copied(), track.next(forecast)),
        }
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
        let padded = weights.history / word;
        let track = || Track::new(weights.frames.characters(), padded + window);
        TwoLevelDecoder {
            progress: vec![Progress { padded, ..Progress::default() }; streams],
            tokens: vec![weights.pad; streams * weights.room()],
            tracks: weights.forecast.iter().flat_map(|_| (0..streams).map(|_| track())).collect(),
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
        let progress = self.progress[stream];
        self.conditioning.clear(stream, progress.inputs(skipped).div_ceil(word));
        if let Some(track) = self.tracks.get_mut(stream) {
            let tokens = (self.weights.history + progress.inputs(skipped)).saturating_sub(1);
            track.truncate(self.weights.slots(progress.padded, tokens));
        }
    }

    /// A stream forgets all tokens, and has `ids` before its window: whole frames, the last H of them.
    pub fn begin_after(&mut self, stream: usize, ids: &[u32]) {
        self.truncate(stream, 0);
        let Weights { history, skipped, pad, .. } = *self.weights;
        let word = self.weights.frames.word();
        let ids = &ids[ids.len().saturating_sub(history)..];
        let first = stream * self.weights.room() + skipped + 1;
        let (padding, before) = self.tokens[first..first + history].split_at_mut(history - ids.len());
        padding.fill(pad);
        before.copy_from_slice(ids);
        self.progress[stream].padded = padding.len() / word;
        if let Some(track) = self.tracks.get_mut(stream) {
            track.truncate(0);
        }
    }

    /// What a stream has read, for another to go on from.
    pub fn save(&self, stream: usize) -> SavedFrames {
        let (room, contexts) = (self.weights.room(), self.contexts.len() / self.streams());
        SavedFrames {
            progress: self.progress[stream],
            tokens: self.tokens[stream * room..][..room].to_vec(),
            track: self.tracks.get(stream).cloned(),
            contexts: self.contexts[stream * contexts..][..contexts].to_vec(),
            conditioning: self.conditioning.save(stream),
            trunk: self.trunk.save(stream),
            decoder: self.decoder.save(stream),
        }
    }

    /// A stream has read what another had.
    pub fn restore(&mut self, stream: usize, saved: &SavedFrames) {
        let (room, contexts) = (self.weights.room(), saved.contexts.len());
        self.progress[stream] = saved.progress;
        self.tokens[stream * room..][..room].copy_from_slice(&saved.tokens);
        if let Some((track, saved)) = self.tracks.get_mut(stream).zip(saved.track.as_ref()) {
            track.clone_from(saved);
        }
        self.contexts[stream * contexts..][..contexts].copy_from_slice(&saved.contexts);
        self.conditioning.restore(stream, &saved.conditioning);
        self.trunk.restore(stream, &saved.trunk);
        self.decoder.restore(stream, &saved.decoder);
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
        let (word, skipped) = (self.weights.frames.word(), self.weights.skipped);
        for (stream, block) in blocks.iter().enumerate() {
            let length = &mut self.progress[stream].length;
            let tokens = &mut self.tokens[stream * self.weights.room()..];
            let (front, words) = block.split_at(block.len().min((skipped + 1).saturating_sub(*length)));
            tokens[*length..][..front.len()].copy_from_slice(front);
            *length += front.len();
            // the history lies between the front and the words
            tokens[self.weights.history + *length..][..words.len()].copy_from_slice(words);
            *length += words.len();
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
        let front = stream * weights.room();
        let inputs = self.progress[stream].inputs(weights.skipped);
        let sequence = &self.tokens[front + weights.skipped..][..weights.history + inputs];
        let labels = &self.tokens[front + 1..=front + weights.skipped];
        let before = weights.history / weights.frames.word();
        let rows = self.trunk.rows_mut(first);
        // one copy, since the rows are consecutive frames of one stream
        rows.copy_from_slice(&weights.positions[frame * width..][..rows.len()]);
        let inputs = self.inputs[first * wide..].chunks_exact_mut(wide);
        for ((x, input), frame) in rows.chunks_exact_mut(width).zip(inputs).zip(frame..) {
            Weights::add_labels(x, &weights.labels[0], labels);
            self.conditioning.add(x, stream, frame, &self.conditioning.trunk);
            weights.write_input(input, sequence, before + frame);
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
            let labels = &self.tokens[stream * weights.room()..][1..=weights.skipped];
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
            let ids = &self.tokens[stream * weights.room() + weights.skipped..][..weights.history + end];
            for ((i, row), x) in (from..).zip(row..).zip(self.decoder.rows_mut(row).chunks_exact_mut(width)) {
                x.copy_from_slice(context);
                let at = weights.history + i;
                let rows = weights.frames.words().spelt(ids, at);
                weights.tables.iter().zip(rows).for_each(|(table, row)| add_row(x, table, row));
                let mut forecast = 0;
                if let Some((track, known)) = self.tracks.get_mut(stream).zip(weights.forecast.as_deref()) {
                    let Progress { padded, .. } = self.progress[stream];
                    let before;
                    (before, forecast) = weights.forecasts(track, known, &ids[..=at], padded);
                    add_row(x, &weights.tables[4], weights.frames.innovation(ids, at, before));
                    let mut numbers = [0.0; NUMBERS];
                    weights.frames.forecast_numbers(ids, at, forecast, &mut numbers);
                    // at most eight of them aren't 0
                    let rows = numbers.iter().zip(weights.projection.chunks_exact(width));
                    for (number, row) in rows.filter(|(number, _)| **number != 0.0) {
                        x.iter_mut().zip(row).for_each(|(x, y)| *x += number * y);
                    }
                }
                self.conditioning.add_rows(x, stream, frame, i % word);
                if i >= first {
                    self.pending.push(LogitRow { row, stream, place: i, forecast });
                }
            }
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
            let ids = |row: &LogitRow| {
                let at = weights.history + row.place;
                (&tokens[row.stream * weights.room() + weights.skipped..][..=at], at, row.forecast)
            };
            weights.head.logits(&mut self.logits, &mut self.decoder, self.pending.iter().map(ids));
        }
        self.pending.clear();
        self.decoder.clear();
    }
}
