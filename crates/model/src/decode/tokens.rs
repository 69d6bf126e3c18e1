//! Decoding with a flat model: a stack of blocks over tokens.

use super::head::Head;
use super::numbers::Numbers;
use super::{KvKind, LogitRow, Logits, ReaderOptions, add_row};
use crate::config::Positions;
use crate::position::{Counter, WordPosition};
use crate::words::Words;
use crate::{Gpt, Result};
use kinelm_engine::arena::Floats;
use kinelm_engine::decode::{Norm, Run, Stack, StackDecoder, StackWeights, in_pool};
use kinelm_engine::op::rope::Angles;
use std::sync::Arc;

/// Sequences that are read side by side, sharing every read of a weight.
pub(super) struct TokenDecoder {
    weights: Arc<Weights>,
    stack: StackDecoder,
    /// Tokens read, per stream.
    lengths: Vec<usize>,
    /// Those tokens, T per stream.
    tokens: Vec<u32>,
    /// Positions of those tokens and of the next, T + 1 per stream; empty where no words are counted.
    at: Vec<WordPosition>,
    pending: Vec<LogitRow>,
    logits: Vec<f32>,
}

/// What a stream has read.
#[derive(Debug, Clone)]
pub(super) struct SavedTokens {
    tokens: Vec<u32>,
    at: Vec<WordPosition>,
    keys: Vec<f32>,
}

struct Weights {
    /// T, V, D, K.
    context: usize,
    vocabulary: usize,
    width: usize,
    front: usize,
    /// (V, D).
    token: Floats,
    positions: PositionTables,
    previous: Option<PreviousTables>,
    stack: StackWeights,
    norm: Norm,
    head: Head,
}

enum PositionTables {
    /// (T, D).
    Absolute(Floats),
    /// Rows of the front tokens, of words (none with rotary positions) and of slots.
    Words { counter: Counter, front: Floats, word: Option<Floats>, slot: Floats },
}

/// Tables of the previous-frame features.
struct PreviousTables {
    words: Words,
    /// (V, D).
    character: Floats,
    /// The row where there is no previous word.
    missing: usize,
    /// (S + 1, D).
    step: Floats,
}

impl Weights {
    fn new(gpt: &Gpt, ReaderOptions { weights: kind, .. }: ReaderOptions) -> Result<Weights> {
        let (config, tokens, numbers) = (gpt.config(), gpt.tokens(), Numbers::of(gpt)?);
        let (context, width) = (config.context, config.width);
        let is_rotary = config.positions == Positions::Rope;
        let positions = match Counter::of(config, tokens) {
            None => PositionTables::Absolute(numbers.floats("position.absolute.weight")),
            Some(counter) => PositionTables::Words {
                counter,
                front: numbers.floats("position.front.weight"),
                word: (!is_rotary).then(|| numbers.floats("position.frame.weight")),
                slot: numbers.floats("position.place.weight"),
            },
        };
        let previous = config.reads_previous(tokens).then(|| PreviousTables {
            words: Words::new(tokens.front, tokens.bins()),
            character: numbers.floats("previous.character.weight"),
            missing: tokens.pad as usize,
            step: numbers.floats("previous.step.weight"),
        });
        // words of varying length may have one token each, and 0 is the front
        let angles = is_rotary.then(|| Angles::new(context + 1, width / config.heads));
        let stack = Stack { layers: config.layers, heads: config.heads, width };
        Ok(Weights {
            context,
            vocabulary: tokens.vocabulary,
            width,
            front: tokens.front,
            token: numbers.floats("token.weight"),
            positions,
            previous,
            norm: numbers.norm("norm", width),
            stack: numbers.stack("", stack, kind, angles),
            head: Head::new(&numbers, config, tokens, tokens.front, width, kind),
        })
    }

    /// Bytes that are read for a token, the mean over the slots of a word.
    fn bytes(&self) -> usize {
        self.stack.bytes() + self.head.bytes()
    }
}

impl TokenDecoder {
    /// Decoders of the same weights, as many streams each as `split` makes of the bytes that a token reads.
    ///
    /// # Errors
    /// If the weights can't be brought to the CPU.
    pub fn several(
        gpt: &Gpt,
        options: ReaderOptions,
        split: impl FnOnce(usize) -> Vec<usize>,
    ) -> Result<Vec<TokenDecoder>> {
        let weights = Arc::new(Weights::new(gpt, options)?);
        Ok(split(weights.bytes())
            .into_iter()
            .map(|streams| TokenDecoder::new(weights.clone(), options.kv, streams))
            .collect())
    }

    fn new(weights: Arc<Weights>, kv: KvKind, streams: usize) -> TokenDecoder {
        let context = weights.context;
        let stack = StackDecoder::new(&weights.stack, kv, streams, context, streams * context, weights.head.widest());
        let counted = if matches!(weights.positions, PositionTables::Words { .. }) { context + 1 } else { 0 };
        TokenDecoder {
            lengths: vec![0; streams],
            tokens: vec![0; streams * context],
            at: vec![WordPosition::default(); streams * counted],
            pending: Vec::with_capacity(stack.free()),
            logits: Vec::with_capacity(streams * weights.vocabulary),
            weights,
            stack,
        }
    }

    pub fn streams(&self) -> usize {
        self.lengths.len()
    }

    /// Tokens that a stream has read.
    pub fn len(&self, stream: usize) -> usize {
        self.lengths[stream]
    }

    /// Bytes of weights that are read for a token, the mean over the slots of a word.
    pub fn bytes(&self) -> usize {
        self.weights.bytes()
    }

    /// A stream forgets all but its first `length` tokens.
    pub fn truncate(&mut self, stream: usize, length: usize) {
        // keys and ids after it stay: the next read overwrites them before a row attends to them
        self.lengths[stream] = self.lengths[stream].min(length);
    }

    /// What a stream has read, for another to go on from.
    pub fn save(&self, stream: usize) -> SavedTokens {
        let context = self.weights.context;
        SavedTokens {
            tokens: self.tokens[stream * context..][..self.lengths[stream]].to_vec(),
            at: self.at.get(stream * (context + 1)..).unwrap_or_default().iter().take(context + 1).copied().collect(),
            keys: self.stack.save(stream),
        }
    }

    /// A stream has read what another had.
    pub fn restore(&mut self, stream: usize, saved: &SavedTokens) {
        let context = self.weights.context;
        self.lengths[stream] = saved.tokens.len();
        self.tokens[stream * context..][..saved.tokens.len()].copy_from_slice(&saved.tokens);
        if !saved.at.is_empty() {
            self.at[stream * (context + 1)..][..context + 1].copy_from_slice(&saved.at);
        }
        self.stack.restore(stream, &saved.keys);
    }

    /// Reads a block of tokens per stream, which may be empty; logits (rows, V) of what follows, the rows in the order of
    /// the streams and of their tokens. A token's logits depend on the tokens before it alone.
    pub fn read(&mut self, blocks: &[&[u32]], logits: Logits) -> &[f32] {
        self.logits.clear();
        let per_token = self.weights.stack.work() + self.weights.vocabulary * self.weights.width;
        let work = per_token * blocks.iter().map(|b| b.len()).sum::<usize>();
        in_pool(work, || self.read_all(blocks, logits));
        &self.logits
    }

    fn read_all(&mut self, blocks: &[&[u32]], logits: Logits) {
        for (stream, block) in blocks.iter().enumerate() {
            let mut rest = *block;
            while !rest.is_empty() {
                let (tokens, after) = rest.split_at(rest.len().min(self.stack.free()));
                let (n, place) = (tokens.len(), self.lengths[stream]);
                let row = self.stack.push(Run { stream, place, rows: n });
                self.embed(row, tokens, stream);
                // after `embed`, which counts the piece's places from the old length
                self.lengths[stream] += n;
                let first = match logits {
                    Logits::All => 0,
                    // only the piece with the block's last token has the row whose logits are returned
                    Logits::Last => n - usize::from(after.is_empty()),
                };
                self.pending.extend((first..n).map(|i| LogitRow {
                    row: row + i,
                    stream,
                    place: place + i,
                    forecast: 0,
                }));
                if self.stack.free() == 0 {
                    self.pass();
                }
                rest = after;
            }
        }
        if self.stack.rows() > 0 {
            self.pass();
        }
    }

    /// Writes the vectors of the next `tokens` of a stream into the rows from `row` on.
    fn embed(&mut self, row: usize, tokens: &[u32], stream: usize) {
        let weights = &self.weights;
        let (context, width, first) = (weights.context, weights.width, self.lengths[stream]);
        let all = &mut self.tokens[stream * context..][..first + tokens.len()];
        all[first..].copy_from_slice(tokens);
        let x = self.stack.rows_mut(row);
        for (x, &id) in x.chunks_exact_mut(width).zip(tokens) {
            x.copy_from_slice(&weights.token[id as usize * width..][..width]);
        }
        match &weights.positions {
            PositionTables::Absolute(table) => {
                x.iter_mut().zip(&table[first * width..]).for_each(|(x, position)| *x += position);
            }
            PositionTables::Words { counter, front, word, slot } => {
                let at = &mut self.at[stream * (context + 1)..][..context + 1];
                for (x, (place, &id)) in x.chunks_exact_mut(width).zip((first..).zip(tokens)) {
                    if place < weights.front {
                        add_row(x, front, place);
                        // words are counted from the end of the front
                        at[place + 1] = WordPosition::default();
                        continue;
                    }
                    let rows = counter.rows(at[place]);
                    let slot = &slot[rows.slot * width..];
                    match word {
                        Some(word) => {
                            let word = &word[rows.word * width..];
                            x.iter_mut().zip(word.iter().zip(slot)).for_each(|(x, (w, s))| *x += w + s);
                        }
                        None => x.iter_mut().zip(slot).for_each(|(x, s)| *x += s),
                    }
                    at[place + 1] = counter.next(at[place], id);
                }
                if word.is_none() {
                    // tokens of the front belong to no word: they aren't rotated
                    for (position, place) in self.stack.positions_mut(row).iter_mut().zip(first..) {
                        *position = if place < weights.front { 0 } else { 1 + at[place].word as u32 };
                    }
                }
            }
        }
        let Some(PreviousTables { words, character, missing, step }) = &weights.previous else { return };
        for (x, i) in self.stack.rows_mut(row).chunks_exact_mut(width).zip(first..) {
            let (previous, by) = words.previous(all, i);
            let character = &character[previous.map_or(*missing, |id| id as usize) * width..];
            let step = &step[by * width..];
            x.iter_mut().zip(character.iter().zip(step)).for_each(|(x, (c, s))| *x += c + s);
        }
    }

    /// Takes the rows through the stack and appends the requested logits.
    fn pass(&mut self) {
        let weights = &self.weights;
        self.stack.forward(&weights.stack);
        if !self.pending.is_empty() {
            self.stack.norm(&weights.norm, self.pending.iter().map(|pending| pending.row));
            let (tokens, context) = (&self.tokens, weights.context);
            let ids = |row: &LogitRow| (&tokens[row.stream * context..][..=row.place], row.place, 0);
            weights.head.logits(&mut self.logits, &mut self.stack, self.pending.iter().map(ids));
        }
        self.pending.clear();
        self.stack.clear();
    }
}
