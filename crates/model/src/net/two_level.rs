//! A trunk in which every frame is a row, and a decoder inside the frame.
//!
//! Letters: B batch, F frames, N = B F, W tokens of a word, D width of the trunk, d of the decoder.

use super::block::{Block, Norm, linear};
use super::{Beside, rows_of, table};
use crate::config::{ModelConfig, TokenLayout};
use crate::forecast::NUMBERS;
use crate::frames::{BACK, Frames, TrunkRow, spelt_tables, trunk_row};
use crate::goal::Conditioning;
use crate::layout::{CLASS, FORECAST, GOAL, LABEL, MUSIC, SPELL, SPELT_LABEL, TRUNK, block_name};
use crate::ops::Mask;
use crate::sequence::Sequences;
use candle_core::{Result, Tensor};
use candle_nn::{Embedding, Linear, Module, VarBuilder};
use kinelm_engine::op::embedding::NONE;

#[derive(Clone)]
pub(super) struct TwoLevel {
    frames: Frames,
    /// K - 1: tokens of a window before the one after which frames begin; all but the first are labels.
    skipped: usize,
    heads: [usize; 2],
    /// (C (S + 1), e).
    character: Embedding,
    /// (F, D).
    position: Embedding,
    /// (n, D), where a classifier reads rows after the last frame.
    class: Option<Embedding>,
    /// (V, D) and (V, d), where windows begin with labels.
    labels: Option<[Embedding; 2]>,
    /// (2 C e, D).
    join: Linear,
    trunk: Vec<Block>,
    trunk_norm: Norm,
    /// (D, d).
    frame: Linear,
    /// Rows of d numbers each.
    spelt: Vec<Embedding>,
    /// (P, d), where there is a forecast.
    forecast: Option<Tensor>,
    decoder: Vec<Block>,
    /// Goal conditioning: (P, D), (P, d), and two tables of steps (R, d).
    conditioning: Option<([Tensor; 2], [Embedding; 2])>,
    /// Music conditioning: (M, D), (M, d).
    music: Option<[Tensor; 2]>,
}

impl TwoLevel {
    pub fn new(config: &ModelConfig, tokens: &TokenLayout, vars: &VarBuilder) -> Result<TwoLevel> {
        let blocks = |prefix: &str, layers: usize| -> Result<Vec<Block>> {
            (0..layers).map(|layer| Block::new(&vars.pp(format!("{prefix}{}", block_name(layer))))).collect()
        };
        let table = |name: &&str| table(vars, name);
        let matrices =
            |[trunk, decoder]: [&str; 2]| Result::Ok([vars.get_unchecked(trunk)?, vars.get_unchecked(decoder)?]);
        let [goal @ .., steps, paces] = GOAL;
        let conditioning = || Result::Ok((matrices(goal)?, [table(&steps)?, table(&paces)?]));
        let decoder = config.decoder();
        Ok(TwoLevel {
            frames: Frames::of(tokens),
            skipped: tokens.front - 1,
            heads: [config.heads, decoder.heads],
            character: table(&"frame.character.weight")?,
            position: table(&"frame.position.weight")?,
            class: (config.classes > 0).then(|| table(&CLASS)).transpose()?,
            labels: (tokens.front > 1).then(|| Result::Ok([table(&LABEL)?, table(&SPELT_LABEL)?])).transpose()?,
            join: linear(&vars.pp("frame.join"))?,
            trunk: blocks(TRUNK, config.layers)?,
            trunk_norm: Norm::new(&vars.pp("trunk.norm"))?,
            frame: linear(&vars.pp("spell.frame"))?,
            spelt: spelt_tables(config.forecast()).iter().map(table).collect::<Result<_>>()?,
            forecast: config.forecast().then(|| vars.get_unchecked(FORECAST)).transpose()?,
            decoder: blocks(SPELL, decoder.layers)?,
            conditioning: config.goal.then(conditioning).transpose()?,
            music: (!config.music.is_none()).then(|| matrices(MUSIC)).transpose()?,
        })
    }

    /// (B, F, D) what the trunk's norm gives of `windows` (B, T), whose frames see what `mask` lets them.
    pub fn vectors(&self, windows: &[Vec<u32>], sequences: &Sequences, mask: &Mask) -> Result<Tensor> {
        let frames = windows[0].len().saturating_sub(self.skipped).div_ceil(self.frames.word());
        self.trunk_norm.forward(&self.trunk(windows, sequences, frames, mask, Beside::default())?)
    }

    /// (B, T, d) of `windows` (B, T), whose frames attend to what `mask` allows; 0 for the tokens of the front but the last,
    /// which predict nothing.
    pub fn rows(&self, windows: &[Vec<u32>], sequences: &Sequences, mask: &Mask, beside: Beside) -> Result<Tensor> {
        let conditioning = beside.conditioning;
        let (batch, length) = (windows.len(), windows[0].len().saturating_sub(self.skipped));
        let no_rows = (batch, self.skipped.min(windows[0].len()), self.spelt[0].hidden_size());
        let no_rows = Tensor::zeros(no_rows, self.join.weight().dtype(), self.join.weight().device())?;
        if length == 0 {
            return Ok(no_rows);
        }
        let frames = length.div_ceil(self.frames.word());
        let trunk = self.trunk(windows, sequences, frames, mask, beside)?;
        let mut u = self.frame.forward(&self.trunk_norm.forward(&trunk)?)?;
        if let Some([_, spelt]) = &self.labels {
            u = u.broadcast_add(&self.of_labels(spelt, windows)?)?;
        }
        for (numbers, [_, decoder]) in self.conditioning(conditioning) {
            u = (u + through(numbers, decoder, windows.len(), frames)?)?;
        }
        // a row for every token of every frame, the window's or not
        let word = self.frames.word();
        let x = self.spelt(sequences, frames)?.reshape((batch * frames, word, ()))?;
        let mut x = x.broadcast_add(&u.reshape((batch * frames, 1, ()))?)?;
        if let Some((conditioning, (_, tables))) = conditioning.zip(self.conditioning.as_ref()) {
            for (table, rows) in tables.iter().zip(&conditioning.rows).filter(|(_, rows)| !rows.is_empty()) {
                x = (x + some_rows(table, rows)?.reshape((batch * frames, word, ()))?)?;
            }
        }
        let hiding = Mask::Causal.hiding(word, word, x.dtype(), x.device())?;
        for block in &self.decoder {
            x = block.forward(&x, self.heads[1], None, hiding.as_ref(), None, None)?;
        }
        // the last frame may be read in part
        let x = x.reshape((batch, frames * word, ()))?.narrow(1, 0, length)?;
        if self.skipped == 0 { Ok(x) } else { Tensor::cat(&[no_rows, x], 1) }
    }

    /// (B, 1, n) the sums of the rows of `table` (V, n) that the windows' labels have.
    fn of_labels(&self, table: &Embedding, windows: &[Vec<u32>]) -> Result<Tensor> {
        let labels = windows.iter().flat_map(|w| &w[1..=self.skipped]).copied().collect();
        rows_of(table, labels)?.reshape((windows.len(), self.skipped, ()))?.sum_keepdim(1)
    }

    /// The conditioning numbers, with the matrices that project them into the trunk and the decoder.
    fn conditioning<'a>(
        &'a self,
        conditioning: Option<&'a Conditioning>,
    ) -> impl Iterator<Item = (&'a [f32], [&'a Tensor; 2])> {
        let goal = conditioning
            .zip(self.conditioning.as_ref())
            .map(|(conditioning, ([trunk, decoder], _))| (&*conditioning.numbers, [trunk, decoder]));
        let music = conditioning
            .zip(self.music.as_ref())
            .map(|(conditioning, [trunk, decoder])| (&*conditioning.music, [trunk, decoder]));
        goal.into_iter().chain(music).filter(|(numbers, _)| !numbers.is_empty())
    }

    /// (B, F, D).
    fn trunk(
        &self,
        windows: &[Vec<u32>],
        sequences: &Sequences,
        frames: usize,
        mask: &Mask,
        beside: Beside,
    ) -> Result<Tensor> {
        let of_frame = BACK * self.frames.characters();
        let mut seen = vec![0; windows.len() * frames * of_frame];
        let classes = self.class.as_ref().map_or(Ok(0), |class| class.embeddings().dim(0))?;
        let (mut positions, mut class_rows) = (Vec::new(), Vec::new());
        for (i, rows) in seen.chunks_mut(of_frame).enumerate() {
            let window = &windows[i / frames][self.skipped..];
            let TrunkRow { frame, position, class } = trunk_row(i % frames, self.frames.shown(window), classes);
            self.frames.seen(
                sequences.get(i / frames).ids,
                sequences.layout.history() / self.frames.word() + frame,
                rows,
            );
            positions.push(position);
            class_rows.push(class);
        }
        let shape = (windows.len(), frames, ());
        let x = rows_of(&self.character, seen)?.reshape(shape)?;
        let mut x = (self.join.forward(&x)? + some_rows(&self.position, &positions)?.reshape(shape)?)?;
        if let Some(class) = &self.class {
            x = (x + some_rows(class, &class_rows)?.reshape(shape)?)?;
        }
        if let Some([label, _]) = &self.labels {
            x = x.broadcast_add(&self.of_labels(label, windows)?)?;
        }
        for (numbers, [matrix, _]) in self.conditioning(beside.conditioning) {
            x = (x + through(numbers, matrix, windows.len(), frames)?)?;
        }
        if let Some(dropout) = beside.dropout {
            x = dropout.apply(&x, "embedding")?;
        }
        let hiding = mask.hiding(frames, frames, x.dtype(), x.device())?;
        for block in &self.trunk {
            x = block.forward(&x, self.heads[0], None, hiding.as_ref(), beside.dropout, None)?;
        }
        Ok(x)
    }

    /// (B F W, d).
    fn spelt(&self, sequences: &Sequences, frames: usize) -> Result<Tensor> {
        let (tokens, before) = (frames * self.frames.word(), sequences.layout.history());
        let rows: Vec<[u32; 5]> = sequences
            .iter()
            .flat_map(|sequence| (before..before + tokens).map(move |at| self.frames.spelt(&sequence, at)))
            .collect();
        let one = |i: usize| rows_of(&self.spelt[i], rows.iter().map(|row| row[i]).collect());
        let x = (1..self.spelt.len()).try_fold(one(0)?, |sum, i| sum + one(i)?)?;
        let Some(matrix) = &self.forecast else { return Ok(x) };
        let mut numbers = vec![0.0; rows.len() * NUMBERS];
        for (row, numbers) in numbers.chunks_mut(NUMBERS).enumerate() {
            let (sequence, at) = (sequences.get(row / tokens), before + row % tokens);
            self.frames.forecast_numbers(sequence.ids, at, sequence.forecast(at), numbers);
        }
        x + through(&numbers, matrix, 1, rows.len())?.squeeze(0)?
    }
}

/// The numbers of all frames (B F, P) times a matrix (P, n): (B, F, n).
fn through(numbers: &[f32], matrix: &Tensor, batch: usize, frames: usize) -> Result<Tensor> {
    let numbers = Tensor::from_slice(numbers, (batch * frames, matrix.dim(0)?), matrix.device())?;
    numbers.to_dtype(matrix.dtype())?.matmul(matrix)?.reshape((batch, frames, ()))
}

/// Rows of a table, zeros for [`NONE`].
fn some_rows(table: &Embedding, rows: &[u32]) -> Result<Tensor> {
    let numbers = table.embeddings();
    let is_some: Vec<f32> = rows.iter().map(|&row| f32::from(u8::from(row != NONE))).collect();
    let is_some = Tensor::from_vec(is_some, (rows.len(), 1), numbers.device())?.to_dtype(numbers.dtype())?;
    // any row will do: it is multiplied by 0
    let rows = rows.iter().map(|&row| if row == NONE { 0 } else { row }).collect();
    rows_of(table, rows)?.broadcast_mul(&is_some)
}
