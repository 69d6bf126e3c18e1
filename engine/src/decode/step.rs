//! Reading tokens: a block through all layers, the keys and values kept.

use super::attention::{self, Queries, SCORE_ROWS};
use super::cache::{KvCache, KvKind, Stored, Unit};
use super::kernel::Left;
use super::matrix::{Matrix, PIECE};
use super::position::Stand;
use super::rope::Turns;
use super::weights::{Block, DecoderWeights, Norm};
use crate::arena::Floats;
use crate::op::{gelu, layer_norm};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Tokens that go through the layers together; longer blocks are cut.
const ROWS: usize = 192;

/// Multiply-adds that are worth another thread.
const WORTH: usize = 1 << 17;

/// Reads of fewer multiply-adds stay on the thread they are called on, if it is none of a pool's.
const ALONE: usize = 1 << 20;

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
    cache: KvCache,
    /// Tokens read, a number a stream.
    lengths: Vec<usize>,
    /// Those tokens, T a stream.
    tokens: Vec<u32>,
    /// Where those tokens and the next stand in their words, if words are counted: so many a stream.
    stands: Vec<Stand>,
    /// What of the current rows belongs to which stream, in the order of the streams.
    runs: Vec<Run>,
    /// The stream and the place of each row whose logits are asked for.
    asked: Vec<(usize, usize)>,
    logits: Vec<f32>,
    room: Room,
}

/// Rows of one stream, one behind the other.
#[derive(Debug, Clone, Copy)]
struct Run {
    stream: usize,
    /// The place of the first.
    place: usize,
    rows: usize,
}

/// Scratch for [`ROWS`] rows at most; what is used of it depends on the rows there are.
pub(super) struct Room {
    pub x: Floats,      // (m, D)
    pub normed: Floats, // (m, D)
    stats: Floats,      // (m, 2)
    words: Vec<u32>,    // (m), those that the rows stand in, if queries and keys are turned
    qkv: Floats,        // (H, m, 3 d)
    heads: Floats,      // (H, m, d), d whole panels
    scores: Floats,     // (H, SCORE_ROWS, T)
    pub pieces: Floats, // (n / PIECE, m, PIECE) for the widest n
    hidden: Floats,     // (4 D / PIECE, m, PIECE)
}

impl Decoder {
    /// A reader of `streams` sequences.
    ///
    /// # Panics
    /// No streams.
    pub fn new(weights: Arc<DecoderWeights>, streams: usize, kv: KvKind) -> Decoder {
        assert!(streams > 0, "a decoder of no streams");
        let sizes = weights.sizes;
        let (d, unit) = (sizes.width / sizes.heads, Unit::new(sizes.context, sizes.width / sizes.heads));
        let rows = ROWS.min(sizes.context * streams);
        let hidden = (4 * sizes.width).next_multiple_of(PIECE);
        let widest = hidden.max(weights.head.widest().next_multiple_of(PIECE));
        let room = Room {
            x: Floats::new(rows * sizes.width),
            normed: Floats::new(rows * sizes.width),
            stats: Floats::new(rows * 2),
            words: vec![0; if weights.turns.is_some() { rows } else { 0 }],
            qkv: Floats::new(rows * sizes.heads * (3 * d).next_multiple_of(unit.panel)),
            heads: Floats::new(rows * sizes.heads * unit.padded),
            scores: Floats::new(sizes.heads * SCORE_ROWS * unit.tokens),
            pieces: Floats::new(rows * widest),
            hidden: Floats::new(rows * hidden),
        };
        Decoder {
            cache: KvCache::new(kv, sizes.layers, sizes.heads, streams, unit),
            lengths: vec![0; streams],
            tokens: vec![0; streams * sizes.context],
            stands: vec![Stand::default(); streams * weights.positions.stands(sizes.context)],
            runs: Vec::with_capacity(streams),
            asked: Vec::with_capacity(rows),
            logits: Vec::with_capacity(streams * sizes.vocabulary),
            room,
            weights,
        }
    }

    /// The weights it reads with.
    pub fn weights(&self) -> &Arc<DecoderWeights> {
        &self.weights
    }

    /// How keys and values are held.
    pub fn kv(&self) -> KvKind {
        self.cache.kind()
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
        let work = self.weights.multiply_adds() * blocks.iter().map(|b| b.len()).sum::<usize>();
        if work < ALONE || rayon::current_thread_index().is_some() {
            self.read_all(blocks, wanted);
        } else {
            // into the pool once, not for every piece of work
            rayon::join(|| self.read_all(blocks, wanted), || ());
        }
        &self.logits
    }

    fn read_all(&mut self, blocks: &[&[u32]], wanted: Logits) {
        let (mut stream, mut done) = (0, 0);
        while stream < blocks.len() {
            let mut rows = 0;
            self.runs.clear();
            while stream < blocks.len() && rows < ROWS {
                let n = (blocks[stream].len() - done).min(ROWS - rows);
                if n > 0 {
                    self.embed(rows, &blocks[stream][done..done + n], stream);
                    self.runs.push(Run { stream, place: self.lengths[stream], rows: n });
                }
                rows += n;
                done += n;
                self.lengths[stream] += n;
                if done == blocks[stream].len() {
                    (stream, done) = (stream + 1, 0);
                }
            }
            if rows > 0 {
                let open = if done > 0 { Some(stream) } else { None };
                self.pass(rows, wanted, open);
            }
        }
    }

    /// The vectors of the next `tokens` of a stream into the rows from `row` on.
    fn embed(&mut self, row: usize, tokens: &[u32], stream: usize) {
        let DecoderWeights { token, positions, turns, words, inputs, sizes, .. } = &*self.weights;
        let (width, first) = (sizes.width, self.lengths[stream]);
        let x = &mut self.room.x[row * width..][..tokens.len() * width];
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
            turns.number(&mut self.room.words[row..][..tokens.len()], first, stands);
        }
    }

    /// Takes `rows` rows through the layers and adds their logits. The block of the stream `open` goes on behind them.
    fn pass(&mut self, rows: usize, wanted: Logits, open: Option<usize>) {
        match self.cache.kind() {
            KvKind::F32 => self.layers::<f32>(rows),
            KvKind::F16 => self.layers::<u16>(rows),
        }
        let width = self.weights.sizes.width;
        self.asked.clear();
        // the rows that are asked for move to the front
        let mut end = 0;
        for run in &self.runs {
            end += run.rows;
            let rows = match wanted {
                Logits::All => run.rows,
                Logits::Last => usize::from(Some(run.stream) != open),
            };
            let (to, last) = (self.asked.len(), run.place + run.rows);
            self.room.x.copy_within((end - rows) * width..end * width, to * width);
            self.asked.extend((last - rows..last).map(|place| (run.stream, place)));
        }
        if !self.asked.is_empty() {
            self.head();
        }
    }

    fn layers<E: Stored>(&mut self, rows: usize) {
        let weights = self.weights.clone();
        for (i, block) in weights.blocks.iter().enumerate() {
            let unit = self.cache.unit();
            let layer = self.cache.layer::<E>(i);
            self.room.attention(block, rows, (&self.runs, weights.turns.as_ref()), layer, unit);
            self.room.mlp(block, rows);
        }
    }

    /// Adds the logits of the first rows, which are those asked for.
    fn head(&mut self) {
        let DecoderWeights { head, norm, sizes, .. } = &*self.weights;
        self.room.norm(norm, self.asked.len());
        let tokens = &self.tokens;
        let asked = self.asked.iter().map(|&(stream, place)| (&tokens[stream * sizes.context..][..=place], place));
        head.logits(&mut self.logits, &mut self.room, sizes.width, asked);
    }
}

impl Room {
    /// x += attention(norm1(x)).
    fn attention<E: Stored>(
        &mut self,
        block: &Block,
        rows: usize,
        (runs, turns): (&[Run], Option<&Turns>),
        cache: &mut [E],
        unit: Unit,
    ) {
        self.norm(&block.norm1, rows);
        let width = block.norm1.weight.len();
        let left = Left::whole(&self.normed, rows, width, width);
        let stride = block.heads[0].piece();
        let per_head = cache.len() / block.heads.len();
        let seen = runs.iter().map(|run| run.place + run.rows).max().unwrap_or(0);
        let work = rows * (block.heads[0].work() + 2 * seen * unit.d);
        let words = &self.words;
        self.qkv
            .par_chunks_mut(rows * stride)
            .zip(self.heads.par_chunks_mut(rows * unit.padded))
            .zip(self.scores.par_chunks_mut(SCORE_ROWS * unit.tokens))
            .zip(cache.par_chunks_mut(per_head))
            .zip(&block.heads)
            .with_min_len(worth(work))
            .for_each(|((((qkv, out), scores), cache), weights)| {
                weights.product(qkv, 0, left);
                let mut first = 0;
                for run in runs {
                    let qkv = &mut qkv[first * stride..][..run.rows * stride];
                    let out = &mut out[first * unit.padded..][..run.rows * unit.padded];
                    let cache = &mut cache[run.stream * unit.len()..][..unit.len()];
                    let turns = turns.map(|turns| (turns, &words[first..][..run.rows]));
                    attention::attend(out, Queries { qkv, stride, place: run.place, turns }, cache, unit, scores);
                    first += run.rows;
                }
            });
        let left = Left { data: &self.heads, rows, width: unit.d, stride: unit.padded };
        products(&block.out, 0..block.out.pieces(), &mut self.pieces, left);
        self.add(rows, width);
    }

    /// x += down(gelu(up(norm2(x)))).
    fn mlp(&mut self, block: &Block, rows: usize) {
        self.norm(&block.norm2, rows);
        let width = block.norm2.weight.len();
        let left = Left::whole(&self.normed, rows, width, width);
        self.pieces
            .par_chunks_mut(rows * PIECE)
            .zip(self.hidden.par_chunks_mut(rows * PIECE))
            .take(block.up.pieces())
            .enumerate()
            .with_min_len(worth(rows * block.up.work()))
            .for_each(|(piece, (up, hidden))| {
                block.up.product(up, piece, left);
                gelu::forward(hidden, up);
            });
        let left = Left { data: &self.hidden, rows, width: PIECE, stride: PIECE };
        products(&block.down, 0..block.down.pieces(), &mut self.pieces, left);
        self.add(rows, width);
    }

    fn norm(&mut self, norm: &Norm, rows: usize) {
        let width = norm.weight.len();
        let per = rows_at_once(width);
        self.normed[..rows * width]
            .par_chunks_mut(per * width)
            .zip(self.stats[..rows * 2].par_chunks_mut(per * 2))
            .zip(self.x[..rows * width].par_chunks(per * width))
            .for_each(|((out, stats), x)| layer_norm::forward(out, stats, x, &norm.weight, &norm.bias));
    }

    /// x += the product in `pieces`.
    fn add(&mut self, rows: usize, width: usize) {
        let per = rows_at_once(width);
        let pieces = &self.pieces;
        self.x[..rows * width].par_chunks_mut(per * width).enumerate().for_each(|(i, x)| {
            for (row, x) in x.chunks_exact_mut(width).enumerate() {
                for (x, piece) in x.chunks_mut(PIECE).zip(pieces.chunks_exact(rows * PIECE)) {
                    let piece = &piece[(i * per + row) * PIECE..][..x.len()];
                    x.iter_mut().zip(piece).for_each(|(x, y)| *x += y);
                }
            }
        });
    }
}

/// Some pieces of the product of `left` with `matrix`, one behind the other.
pub(super) fn products(matrix: &Matrix, wanted: Range<usize>, pieces: &mut [f32], left: Left) {
    pieces
        .par_chunks_mut(left.rows * PIECE)
        .take(wanted.len())
        .enumerate()
        .with_min_len(worth(left.rows * matrix.work()))
        .for_each(|(i, c)| matrix.product(c, wanted.start + i, left));
}

/// Pieces of `work` multiply-adds that one thread takes at least.
fn worth(work: usize) -> usize {
    WORTH.div_ceil(work.max(1))
}

/// Rows of a few additions a number that one thread takes.
fn rows_at_once(width: usize) -> usize {
    (WORTH / 8).div_ceil(width.max(1))
}
